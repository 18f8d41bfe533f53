//! Ray-traced truth of the current view, refined in the background.

use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_core::task::{Shared, Task, low_priority_pool};
use headbox_core::view::Ongoing;
use headbox_cube::model::info::CaptureInfo;
use headbox_ldi::scene_source::SceneSource;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use headbox_trace::truth::Truth;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

/// Rounds of refinement: rays per pixel, and side of the square of pixels that share them. The
/// first costs a five-hundredth of the last, all together a third more than the last alone.
const ROUNDS: [(u32, u32); 5] = [(4, 4), (2, 1), (8, 1), (32, 1), (128, 1)];

/// Number of recently requested views that are traced: two eyes with two settings each.
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
    /// Opens the scene that a cube LDI names, in the light and under the exposure of its capture,
    /// without path guiding.
    ///
    /// # Errors
    /// One sentence, if the scene cannot be opened.
    pub fn reopen(info: &CaptureInfo) -> Result<Self, String> {
        let source = SceneSource::in_frame(&info.scene, info.frame).lit_by(info.light.clone());
        let scene = source
            .open()
            .map_err(|error| format!("Truth needs the scene that was captured: {error}."))?;
        let tracer = Arc::new(Tracer::new(Arc::new(scene), info.centre));
        let lit = info.parameters.light_samples > 0;
        let bounces = info.parameters.bounces;
        let mut lighting = if lit {
            Lighting::measure_at(&tracer, info.centre, bounces)
        } else {
            Lighting::unmetered(&tracer, bounces)
        };
        lighting.exposure = info.exposure;
        lighting.tone = info.tone;
        Ok(Self {
            tracer,
            lighting: Arc::new(lighting),
            lit,
            guided: false,
        })
    }

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
    /// Number of completed entries of [`ROUNDS`].
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

    /// Returns true if all rounds are completed.
    pub(super) fn is_final(&self) -> bool {
        self.rounds == ROUNDS.len()
    }
}

/// Traces truth for the requested views until it is dropped.
pub(super) struct Reference(Task<Requests>);

#[derive(Default)]
struct Requests {
    /// Recently requested views, newest first, with repetitions.
    requested: VecDeque<Camera>,
    traced: Vec<Traced>,
    /// True once the scene is loaded.
    has_scene: bool,
    /// The view being traced, its round, and the time at which tracing of the view began.
    tracing: Option<(Camera, usize, Instant)>,
}

impl Reference {
    /// Starts the thread, which loads the scene by calling `scene`.
    ///
    /// # Errors
    /// One sentence, if the thread cannot be started.
    pub(super) fn start(
        scene: impl FnOnce() -> Result<LitScene, String> + Send + 'static,
    ) -> Result<Self, String> {
        const NAME: &str = "error map";
        let work = move |shared: &Shared<Requests>| {
            trace_requests(shared, scene()?);
            Ok(())
        };
        Task::start(NAME, low_priority_pool(NAME)?, Requests::default(), work).map(Self)
    }

    /// Returns the best truth of a view so far and requests its refinement.
    ///
    /// # Errors
    /// One sentence, if the scene cannot be loaded or traced.
    pub(super) fn request(&self, camera: &Camera) -> Result<Option<Traced>, String> {
        self.0.update(|state| {
            if let Some(error) = &state.error {
                return Err(error.clone());
            }
            let Requests {
                requested, traced, ..
            } = &mut state.data;
            requested.push_front(*camera);
            requested.truncate(VIEWS);
            traced.retain(|t| requested.contains(&t.camera));
            Ok(traced.iter().find(|t| t.camera == *camera).cloned())
        })
    }

    /// Progress of truth; `None` once it is finished.
    pub(super) fn ongoing(&self) -> Option<Ongoing> {
        let state = self.0.lock();
        if !state.data.has_scene {
            return Some(Ongoing {
                what: "preparing the scene for truth".into(),
                share: 0.0,
                left: None,
            });
        }
        let (_, round, begun) = state.data.tracing?;
        let work = |(samples, side): &(u32, u32)| f64::from(*samples) / f64::from(side * side);
        let sum = |rounds: &[(u32, u32)]| rounds.iter().map(work).sum::<f64>();
        let current = work(&ROUNDS[round]) * self.0.stage_share();
        let [samples, last] = [round, ROUNDS.len() - 1].map(|round| ROUNDS[round].0);
        let what = format!("truth, {samples} of {last} rays per pixel");
        let share = (sum(&ROUNDS[..round]) + current) / sum(&ROUNDS);
        Some(Ongoing::since(what, share, begun))
    }

    /// Discards all requests and results.
    pub(super) fn clear(&self) {
        self.0.update(|state| {
            state.data.requested.clear();
            state.data.traced.clear();
        });
    }
}

/// Traces the requested views until the task is cancelled.
fn trace_requests(shared: &Shared<Requests>, mut scene: LitScene) {
    shared.update(|state| state.data.has_scene = true);
    while let Some((camera, round)) = shared.next_request(Requests::next) {
        // Learning path guiding takes a second, and the first, coarse round is to be quick.
        if round > 0 {
            scene.guide();
        }
        let progress = RequestProgress { shared, camera };
        let (samples, side) = ROUNDS[round];
        let Some(coarse) = coarser(&camera, side) else {
            return;
        };
        let LitScene {
            tracer,
            lighting,
            lit,
            ..
        } = &scene;
        let truth = truth::render(tracer, lighting, *lit, &coarse, samples, &progress);
        if progress.is_cancelled() {
            continue;
        }
        let traced = Traced {
            camera,
            rounds: round + 1,
            truth: Arc::new(truth),
        };
        shared.complete_round(|state| {
            state.traced.retain(|t| t.camera != camera);
            state.traced.push(traced);
        });
    }
}

impl Requests {
    /// Returns the requested view with the fewest completed rounds, and their number; `None` if all
    /// views are finished.
    fn next(&mut self) -> Option<(Camera, usize)> {
        let rounds = |camera: &Camera| {
            let traced = self.traced.iter().find(|t| t.camera == *camera);
            traced.map_or(0, |t| t.rounds)
        };
        let coarsest = self
            .requested
            .iter()
            .map(|camera| (*camera, rounds(camera)));
        let next = coarsest
            .min_by_key(|(_, rounds)| *rounds)
            .filter(|(_, rounds)| *rounds < ROUNDS.len());
        self.tracing = next.map(|(camera, rounds)| {
            let same = self.tracing.filter(|(current, ..)| *current == camera);
            (
                camera,
                rounds,
                same.map_or_else(Instant::now, |(.., begun)| begun),
            )
        });
        next
    }
}

/// The same view with one pixel for each square of `side` pixels; the last ones may extend beyond
/// the edge.
fn coarser(camera: &Camera, side: u32) -> Option<Camera> {
    if side == 1 {
        return Some(*camera);
    }
    let side_f64 = f64::from(side);
    let coarse = Camera::from_parts(
        camera.eye(),
        camera.world_from_eye(),
        camera.focal_px() / side_f64,
        camera.width().div_ceil(side),
        camera.height().div_ceil(side),
    )
    .ok()?;
    let [x, y] = camera.principal_px();
    Some(coarse.with_principal_px([x / side_f64, y / side_f64]))
}

/// Progress of a view's truth, cancelled once the view is no longer requested.
struct RequestProgress<'a> {
    shared: &'a Shared<Requests>,
    camera: Camera,
}

impl Progress for RequestProgress<'_> {
    fn begin(&self, stage: &str, unit: &str, rows: u64) {
        self.shared.begin(stage, unit, rows);
    }

    fn advance(&self, rows: u64) {
        self.shared.advance(rows);
    }

    fn is_cancelled(&self) -> bool {
        self.shared.is_cancelled() || !self.shared.lock().data.requested.contains(&self.camera)
    }
}
