//! Progressive capture: a coarse cube LDI in about a second, finer ones while one looks around (as the barnyard of the
//! papers, sampled in rounds).
//!
//! Every round is a whole capture, about four times as dear as the one before: all rounds together take a third longer than
//! the last alone, each is what `headbox capture` makes with the same settings, to the byte, and nothing needs to be known
//! here of how rays become depth pixels.

use super::background;
use crate::capture::light::Lighting;
use crate::capture::scene::Headbox;
use crate::capture::trace::Tracer;
use crate::capture::viewpoint;
use crate::ldi::job::CaptureJob;
use crate::ldi::parameters::{CaptureParameters, Resources};
use crate::packed::{PackedCube, SplatIndexLayout, Split};
use crate::progress::Progress;
use crate::scene_source::SceneSource;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// A scene ready for rays from its headbox.
#[derive(Clone)]
pub(super) struct LitScene {
    pub(super) tracer: Arc<Tracer>,
    pub(super) lighting: Arc<Lighting>,
    /// False shows albedo and emission, as a capture without light does.
    pub(super) lit: bool,
}

/// One round of a progressive capture.
#[derive(Clone, Copy)]
struct Round {
    face_size_px: u32,
    strata: u32,
    rays: u32,
    light_samples: u32,
}

/// The rounds. The last is what `headbox capture` makes when nothing is said.
const ROUNDS: [Round; 4] = [
    Round { face_size_px: 192, strata: 12, rays: 8, light_samples: 1 },
    Round { face_size_px: 384, strata: 16, rays: 16, light_samples: 4 },
    Round { face_size_px: 640, strata: 24, rays: 16, light_samples: 4 },
    Round { face_size_px: 1024, strata: 32, rays: 16, light_samples: 4 },
];

impl Round {
    fn job(&self, scene: &SceneSource, headbox: &Headbox) -> CaptureJob {
        CaptureJob {
            face_size_px: self.face_size_px,
            parameters: CaptureParameters {
                strata: self.strata,
                rays_per_stratum: self.rays,
                light_samples: self.light_samples,
                ..CaptureParameters::DEFAULT
            },
            ..CaptureJob::new(scene.clone(), headbox.centre, headbox.half_size_m)
        }
    }
}

/// A capture under way. Dropping it gives the capture up; nobody waits for the thread, which ends by itself.
pub(super) struct Growth {
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    cancelled: AtomicBool,
    steps_done: AtomicU64,
    steps: AtomicU64,
}

#[derive(Default)]
struct State {
    newest: Option<Arc<PackedCube>>,
    rounds_done: usize,
    ended: bool,
    failed: Option<String>,
}

/// How far a capture is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stand {
    /// Rounds done, and in all.
    pub(super) rounds: [usize; 2],
    /// Share of the present stage (pilot, rays, light) that is done, 0 to 1.
    pub(super) stage_share: f64,
    /// Nothing more will come.
    pub(super) ended: bool,
}

impl Growth {
    /// Loads a scene, begins to capture it, and returns with the coarsest LDI.
    ///
    /// # Errors
    /// One sentence: the scene cannot be opened, or its first capture failed.
    pub(super) fn start(source: SceneSource) -> Result<(Self, LitScene, Arc<PackedCube>), String> {
        let scene = Arc::new(source.open().map_err(|error| error.to_string())?);
        let headbox = viewpoint::place_headbox(&scene, None, None).map_err(|error| error.to_string())?;
        let tracer = Arc::new(Tracer::new(scene, headbox.centre));
        let lighting = Arc::new(Lighting::measure(&tracer, CaptureParameters::DEFAULT.bounces));
        let lit = LitScene { tracer, lighting, lit: true };
        let pool = background::pool("capture")?;
        let shared = Arc::new(Shared::default());
        let spawned = std::thread::Builder::new().name("capture".into()).spawn({
            let (shared, lit) = (Arc::clone(&shared), lit.clone());
            move || {
                let work =
                    || pool.install(|| ROUNDS.iter().try_for_each(|r| shared.run(&r.job(&source, &headbox), &lit)));
                let panicked = |_| Err("The capture stopped because of an error in the program.".into());
                shared.end(catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(panicked));
            }
        });
        spawned.map_err(|error| format!("Cannot start a thread: {error}."))?;
        let growth = Self { shared };
        let first = growth.first()?;
        Ok((growth, lit, first))
    }

    /// Waits for the first LDI.
    fn first(&self) -> Result<Arc<PackedCube>, String> {
        let mut state = self.shared.lock();
        loop {
            if let Some(cube) = &state.newest {
                return Ok(Arc::clone(cube));
            }
            if state.ended {
                return Err(state.failed.take().unwrap_or_default());
            }
            state = self.shared.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The finest LDI so far, if it is another than `shown`.
    pub(super) fn newer_than(&self, shown: &Arc<PackedCube>) -> Option<Arc<PackedCube>> {
        let state = self.shared.lock();
        state.newest.as_ref().filter(|newest| !Arc::ptr_eq(newest, shown)).map(Arc::clone)
    }

    /// Why a later round failed, told once.
    pub(super) fn failure(&self) -> Option<String> {
        self.shared.lock().failed.take()
    }

    /// How far the capture is.
    pub(super) fn stand(&self) -> Stand {
        let state = self.shared.lock();
        let [done, all] = [&self.shared.steps_done, &self.shared.steps].map(|n| n.load(Ordering::Relaxed) as f64);
        Stand {
            rounds: [state.rounds_done, ROUNDS.len()],
            stage_share: if all > 0.0 { (done / all).min(1.0) } else { 0.0 },
            ended: state.ended,
        }
    }
}

impl Drop for Growth {
    fn drop(&mut self) {
        self.shared.cancelled.store(true, Ordering::Relaxed);
    }
}

impl Shared {
    /// A panic elsewhere leaves whole values here, so a poisoned lock is still good.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One round.
    fn run(&self, job: &CaptureJob, scene: &LitScene) -> Result<(), String> {
        /// Beyond so many bytes the accumulators of large faces go to a temporary file; those of small ones never are as
        /// many.
        const BUDGET: (u32, u64) = (1000, 1 << 30);
        let is_large = job.face_size_px >= BUDGET.0;
        let resources = Resources { budget: is_large.then(|| (BUDGET.1, std::env::temp_dir())) };
        let captured = job.run(&scene.tracer, &scene.lighting, &resources, self);
        let (ldi, _) = captured.map_err(|error| format!("The capture failed: {error}."))?;
        let packed = PackedCube::pack(&ldi, SplatIndexLayout::Normal, Split::Auto);
        let packed = packed.map_err(|error| format!("The capture cannot be packed: {error}."))?;
        let mut state = self.lock();
        state.newest = Some(Arc::new(packed));
        state.rounds_done += 1;
        self.changed.notify_all();
        Ok(())
    }

    fn end(&self, result: Result<(), String>) {
        let mut state = self.lock();
        state.ended = true;
        state.failed = result.err().filter(|_| !self.cancelled.load(Ordering::Relaxed));
        self.changed.notify_all();
    }
}

impl Progress for Shared {
    fn begin(&self, _: &str, _: &str, total: u64) {
        self.steps_done.store(0, Ordering::Relaxed);
        self.steps.store(total, Ordering::Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.steps_done.fetch_add(steps, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_round_is_what_a_capture_of_its_settings_makes_and_dropping_gives_the_rest_up() {
        let source = SceneSource::new("builtin:miniature");
        let (growth, scene, first) = Growth::start(source.clone()).unwrap();
        let headbox = viewpoint::place_headbox(scene.tracer.scene(), None, None).unwrap();
        let job = ROUNDS[0].job(&source, &headbox);
        let silent = crate::progress::Silent;
        let (ldi, _) = job.run(&scene.tracer, &scene.lighting, &Resources::default(), &silent).unwrap();
        assert!(*first == PackedCube::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).unwrap());
        let shared = Arc::clone(&growth.shared);
        drop(growth);
        let mut state = shared.lock();
        while !state.ended {
            state = shared.changed.wait(state).unwrap();
        }
        assert!(state.failed.is_none(), "given up without an error");
    }

    #[test]
    fn scenes_that_cannot_be_opened_are_named() {
        let error = Growth::start(SceneSource::new("builtin:nonsense")).err().unwrap();
        assert!(error.contains("nonsense"), "{error}");
    }
}
