//! Ray-traced truth of the current view, refined in the background.

use crate::background;
use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_core::view::Ongoing;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use headbox_trace::truth::Truth;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// One truth after the other: rays per pixel, and the side of the square of pixels that share one.
/// All together take a third more than the last, the first a five-hundredth of it: a coarse answer
/// is there while one still wonders.
const ROUNDS: [(u32, u32); 5] = [(4, 4), (2, 1), (8, 1), (32, 1), (128, 1)];

/// Views asked for last that are worth tracing: two eyes with two settings each.
const VIEWS: usize = 4;

/// A scene with its light, ready for rays from its headbox.
#[derive(Clone)]
pub struct LitScene {
    /// The scene's geometry.
    pub tracer: Arc<Tracer>,
    /// Its light.
    pub lighting: Arc<Lighting>,
    /// False shows albedo and emission, like a capture without light.
    pub lit: bool,
    /// True if path guiding was learnt.
    pub guided: bool,
}

impl LitScene {
    /// Learns path guiding, if the scene is lit and it was not learnt before.
    pub fn guide(&mut self) {
        if self.lit && !self.guided {
            self.lighting = Arc::new(Lighting::clone(&self.lighting).guided(&self.tracer));
            self.guided = true;
        }
    }
}

/// Truth of one view so far.
#[derive(Clone)]
pub(super) struct Traced {
    camera: Camera,
    /// Number of entries of [`ROUNDS`] behind it.
    rounds: usize,
    /// Truth with as many pixels as the view, or one per square of [`Self::coarseness`] pixels a
    /// side.
    pub(super) truth: Arc<Truth>,
}

impl Traced {
    /// Rays per pixel.
    pub(super) fn samples(&self) -> u32 {
        ROUNDS[self.rounds - 1].0
    }

    /// Side of the square of pixels that share one.
    pub(super) fn coarseness(&self) -> u32 {
        ROUNDS[self.rounds - 1].1
    }

    /// Nothing better will come.
    pub(super) fn is_final(&self) -> bool {
        self.rounds == ROUNDS.len()
    }
}

/// Traces truth for the views asked for. Dropping it ends that; nobody waits for the thread, which
/// ends by itself.
pub(super) struct Reference {
    shared: Arc<ReferenceShared>,
}

#[derive(Default)]
struct ReferenceShared {
    state: Mutex<ReferenceState>,
    changed: Condvar,
    /// Rows of the present round that are done, and all.
    rows: [AtomicU64; 2],
}

#[derive(Default)]
struct ReferenceState {
    /// The last views asked for, newest first, with repetitions.
    asked: VecDeque<Camera>,
    traced: Vec<Traced>,
    failed: Option<String>,
    closed: bool,
    /// True once the scene is loaded.
    has_scene: bool,
    /// The view being traced and its round, and when tracing of the view began.
    tracing: Option<(Camera, usize, Instant)>,
}

impl Reference {
    /// Starts the thread. `scene` is called there, and may take its time.
    ///
    /// # Errors
    /// One sentence, if there can be no thread.
    pub(super) fn start(
        scene: impl FnOnce() -> Result<LitScene, String> + Send + 'static,
    ) -> Result<Self, String> {
        let shared = Arc::new(ReferenceShared::default());
        let pool = background::pool("error map")?;
        let spawned = std::thread::Builder::new().name("error map".into()).spawn({
            let shared = Arc::clone(&shared);
            move || {
                let work = || pool.install(|| scene().map(|scene| shared.work(scene)));
                let panicked =
                    |_| Err("Ray tracing stopped because of an error in the program.".into());
                let done = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(panicked);
                shared.lock().failed = done.err();
            }
        });
        spawned.map_err(|error| format!("Cannot start a thread: {error}."))?;
        Ok(Self { shared })
    }

    /// The best truth of a view so far; it goes on being refined.
    ///
    /// # Errors
    /// One sentence, if there will be none.
    pub(super) fn ask(&self, camera: &Camera) -> Result<Option<Traced>, String> {
        let mut state = self.shared.lock();
        if let Some(error) = &state.failed {
            return Err(error.clone());
        }
        state.asked.push_front(*camera);
        state.asked.truncate(VIEWS);
        let ReferenceState { asked, traced, .. } = &mut *state;
        traced.retain(|t| asked.contains(&t.camera));
        self.shared.changed.notify_all();
        Ok(state.traced.iter().find(|t| t.camera == *camera).cloned())
    }

    /// Progress of truth; `None` once it is finished.
    pub(super) fn ongoing(&self) -> Option<Ongoing> {
        let state = self.shared.lock();
        if !state.has_scene {
            return Some(Ongoing {
                what: "preparing the scene for truth".into(),
                share: 0.0,
                left: None,
            });
        }
        let (_, round, begun) = state.tracing?;
        let work = |(samples, side): &(u32, u32)| f64::from(*samples) / f64::from(side * side);
        let sum = |rounds: &[(u32, u32)]| rounds.iter().map(work).sum::<f64>();
        let [done, all] = [0, 1].map(|i| self.shared.rows[i].load(Ordering::Relaxed) as f64);
        let now = work(&ROUNDS[round]) * if all > 0.0 { done / all } else { 0.0 };
        let what = format!(
            "truth, {} of {} rays per pixel",
            ROUNDS[round].0,
            ROUNDS[ROUNDS.len() - 1].0
        );
        Some(Ongoing::since(
            what,
            (sum(&ROUNDS[..round]) + now) / sum(&ROUNDS),
            begun,
        ))
    }

    /// No view needs truth until one asks again.
    pub(super) fn rest(&self) {
        let mut state = self.shared.lock();
        state.asked.clear();
        state.traced.clear();
    }
}

impl Drop for Reference {
    fn drop(&mut self) {
        self.shared.lock().closed = true;
        self.shared.changed.notify_all();
    }
}

impl ReferenceShared {
    /// A panic elsewhere leaves whole values here, so a poisoned lock is still good.
    fn lock(&self) -> MutexGuard<'_, ReferenceState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, mut scene: LitScene) {
        self.lock().has_scene = true;
        while let Some((camera, rounds)) = self.next() {
            // That takes a second, which a first, coarse answer does not wait for.
            if rounds > 0 {
                scene.guide();
            }
            let wanted = StillWanted {
                shared: self,
                camera,
            };
            let (samples, side) = ROUNDS[rounds];
            // A view that has a camera has a coarser one.
            let Some(traced) = coarser(&camera, side) else {
                return;
            };
            let truth = truth::render(
                &scene.tracer,
                &scene.lighting,
                scene.lit,
                &traced,
                samples,
                &wanted,
            );
            if wanted.is_cancelled() {
                continue;
            }
            let traced = Traced {
                camera,
                rounds: rounds + 1,
                truth: Arc::new(truth),
            };
            let mut state = self.lock();
            state.traced.retain(|t| t.camera != camera);
            state.traced.push(traced);
        }
    }

    /// The view that is the farthest behind, and the rounds it has had; waits for one. `None` ends
    /// the work.
    fn next(&self) -> Option<(Camera, usize)> {
        let mut state = self.lock();
        loop {
            if state.closed {
                return None;
            }
            let rounds = |camera: &Camera| {
                state
                    .traced
                    .iter()
                    .find(|t| t.camera == *camera)
                    .map_or(0, |t| t.rounds)
            };
            let behind = state
                .asked
                .iter()
                .map(|camera| (*camera, rounds(camera)))
                .min_by_key(|(_, rounds)| *rounds);
            match behind.filter(|(_, rounds)| *rounds < ROUNDS.len()) {
                Some((camera, rounds)) => {
                    let begun = state
                        .tracing
                        .filter(|(before, ..)| *before == camera)
                        .map(|(.., begun)| begun);
                    state.tracing = Some((camera, rounds, begun.unwrap_or_else(Instant::now)));
                    return Some((camera, rounds));
                }
                None => {
                    state.tracing = None;
                    state = self
                        .changed
                        .wait(state)
                        .unwrap_or_else(PoisonError::into_inner);
                }
            }
        }
    }
}

/// The same view with fewer pixels: one for each square of `side` pixels, the last ones reaching
/// over the edge.
fn coarser(camera: &Camera, side: u32) -> Option<Camera> {
    if side == 1 {
        return Some(*camera);
    }
    let fov_y_deg = |height: u32| {
        2.0 * (f64::from(height) / 2.0 / camera.focal_px())
            .atan()
            .to_degrees()
    };
    let size = [
        camera.width().div_ceil(side),
        camera.height().div_ceil(side),
    ];
    // The middle of the coarse frame lies up to half a square from that of the fine one.
    let up = camera.world_from_eye().y_axis;
    let coarse = Camera::look_at(
        camera.eye(),
        camera.eye() + camera.forward(),
        up,
        fov_y_deg(size[1] * side),
        size,
    )
    .ok()?;
    let [x, y] = camera.principal_px();
    Some(coarse.with_principal_px([x / f64::from(side), y / f64::from(side)]))
}

/// Gives up once nobody asks for the view any more.
struct StillWanted<'a> {
    shared: &'a ReferenceShared,
    camera: Camera,
}

impl Progress for StillWanted<'_> {
    fn begin(&self, _: &str, _: &str, rows: u64) {
        self.shared.rows[0].store(0, Ordering::Relaxed);
        self.shared.rows[1].store(rows, Ordering::Relaxed);
    }

    fn advance(&self, rows: u64) {
        self.shared.rows[0].fetch_add(rows, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        let state = self.shared.lock();
        state.closed || !state.asked.contains(&self.camera)
    }
}
