//! Progressive capture: a coarse cube LDI in about a second, finer ones while one looks around (as the barnyard of the
//! papers, sampled in rounds). Until the first is there, the scene's surfaces are shown as points.
//!
//! Every round is a whole capture, about four times as dear as the one before: all rounds together take a third longer than
//! the last alone, each is what `headbox capture` makes with the same settings, to the byte, and nothing needs to be known
//! here of how rays become depth pixels.

use crate::background;
use headbox_core::headbox::Headbox;
use headbox_core::progress::Progress;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::pack::{PackedCube, SplatIndexLayout, Split};
use headbox_cube::planes;
use headbox_cube::planes::DEFAULT_ERROR_PX;
use headbox_ldi::job::CaptureJob;
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::settings::Resources;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::viewpoint;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// A scene ready for rays from its headbox.
#[derive(Clone)]
pub(crate) struct LitScene {
    pub(super) tracer: Arc<Tracer>,
    pub(super) lighting: Arc<Lighting>,
    /// False shows albedo and emission, as a capture without light does.
    pub(super) lit: bool,
    /// Whether it was learnt where light comes from.
    pub(super) guided: bool,
}

impl LitScene {
    /// Learns where light comes from, if that is worth knowing and not known.
    pub(super) fn guide(&mut self) {
        if self.lit && !self.guided {
            self.lighting = Arc::new(Lighting::clone(&self.lighting).guided(&self.tracer));
            self.guided = true;
        }
    }
}

/// One round of a progressive capture.
#[derive(Clone, Copy)]
struct Round {
    face_size_px: u32,
    strata: u32,
    rays: u32,
    light_samples: u32,
}

/// The rounds. The last has the faces of what `headbox capture` makes when nothing is said, with a fifth of its rays: what a
/// window shows while one waits is to be whole in a minute.
const ROUNDS: [Round; 3] = [
    Round {
        face_size_px: 192,
        strata: 12,
        rays: 8,
        light_samples: 1,
    },
    Round {
        face_size_px: 512,
        strata: 16,
        rays: 16,
        light_samples: 2,
    },
    Round {
        face_size_px: 1024,
        strata: 24,
        rays: 10,
        light_samples: 4,
    },
];

/// Stages of a round: pilot, rays, light.
const STAGES: f64 = 3.0;

impl Round {
    /// How much work it is, in any unit: rays, and light at the depth pixels that they become.
    fn work(&self) -> f64 {
        /// Depth pixels to a pixel of a face, about.
        const LAYERS: f64 = 1.5;
        let rays = f64::from(self.strata).powi(4) * f64::from(self.rays);
        rays + f64::from(self.face_size_px).powi(2) * LAYERS * f64::from(self.light_samples)
    }

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
    /// Stages of this round begun.
    stages: AtomicU64,
    steps_done: AtomicU64,
    steps: AtomicU64,
}

#[derive(Default)]
struct State {
    scene: Option<LitScene>,
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
    /// Share of all work that is done, 0 to 1, about.
    pub(super) share: f64,
    /// Nothing more will come.
    pub(super) ended: bool,
}

/// Where a scene is captured, known before anything is traced.
pub(super) struct CapturePlace {
    pub(super) tracer: Arc<Tracer>,
    pub(super) headbox: Headbox,
}

impl Growth {
    /// Loads a scene, begins to capture it, and returns with where.
    ///
    /// # Errors
    /// One sentence: the scene cannot be opened.
    pub(super) fn start(source: SceneSource) -> Result<(Self, CapturePlace), String> {
        let scene = Arc::new(source.open().map_err(|error| error.to_string())?);
        let headbox =
            viewpoint::place_headbox(&scene, None, None).map_err(|error| error.to_string())?;
        let tracer = Arc::new(Tracer::new(scene, headbox.centre));
        let pool = background::pool("capture")?;
        let shared = Arc::new(Shared::default());
        let spawned = std::thread::Builder::new().name("capture".into()).spawn({
            let (shared, tracer) = (Arc::clone(&shared), Arc::clone(&tracer));
            move || {
                let rounds = || {
                    let lighting = Arc::new(Lighting::prepare(
                        &tracer,
                        CaptureParameters::DEFAULT.bounces,
                        true,
                    ));
                    let scene = shared.is_lit(LitScene {
                        tracer,
                        lighting,
                        lit: true,
                        guided: true,
                    });
                    ROUNDS
                        .iter()
                        .try_for_each(|round| shared.run(&round.job(&source, &headbox), &scene))
                };
                let work = || pool.install(rounds);
                let panicked =
                    |_| Err("The capture stopped because of an error in the program.".into());
                shared.end(catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(panicked));
            }
        });
        spawned.map_err(|error| format!("Cannot start a thread: {error}."))?;
        Ok((Self { shared }, CapturePlace { tracer, headbox }))
    }

    /// A way to wait for the scene with its light.
    pub(super) fn lit_scene(&self) -> impl FnOnce() -> Result<LitScene, String> + Send + 'static {
        let shared = Arc::clone(&self.shared);
        move || {
            let mut state = shared.lock();
            loop {
                match &state.scene {
                    Some(scene) => return Ok(scene.clone()),
                    None if state.ended => {
                        return Err("The capture ended before there was light.".into());
                    }
                    None => {
                        state = shared
                            .changed
                            .wait(state)
                            .unwrap_or_else(PoisonError::into_inner)
                    }
                }
            }
        }
    }

    /// Waits for the first LDI; none if there will be none.
    #[cfg(test)]
    pub(super) fn first(&self) -> Option<Arc<PackedCube>> {
        let mut state = self.shared.lock();
        while state.newest.is_none() && !state.ended {
            state = self
                .shared
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
        state.newest.clone()
    }

    /// The finest LDI so far, if it is another than `shown`.
    pub(super) fn newer_than(&self, shown: Option<&Arc<PackedCube>>) -> Option<Arc<PackedCube>> {
        let state = self.shared.lock();
        state
            .newest
            .as_ref()
            .filter(|newest| shown.is_none_or(|shown| !Arc::ptr_eq(newest, shown)))
            .map(Arc::clone)
    }

    /// Why a later round failed, told once.
    pub(super) fn failure(&self) -> Option<String> {
        self.shared.lock().failed.take()
    }

    /// How far the capture is.
    pub(super) fn stand(&self) -> Stand {
        let state = self.shared.lock();
        let [stages, done, all] = [
            &self.shared.stages,
            &self.shared.steps_done,
            &self.shared.steps,
        ]
        .map(|n| n.load(Ordering::Relaxed) as f64);
        let of_stage = if all > 0.0 {
            (done / all).min(1.0)
        } else {
            0.0
        };
        // Stages may come more than once: a round is never told to be done before it is.
        let of_round = ((stages - 1.0).max(0.0) + of_stage).min(STAGES * 0.97) / STAGES;
        let work = |rounds: &[Round]| rounds.iter().map(Round::work).sum::<f64>();
        let (before, rest) = ROUNDS.split_at(state.rounds_done.min(ROUNDS.len()));
        let now = rest.first().map_or(0.0, |round| round.work() * of_round);
        Stand {
            rounds: [state.rounds_done, ROUNDS.len()],
            share: (work(before) + now) / work(&ROUNDS),
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

    /// Tells those who wait that the scene has its light.
    fn is_lit(&self, scene: LitScene) -> LitScene {
        self.lock().scene = Some(scene.clone());
        self.changed.notify_all();
        scene
    }

    /// One round.
    fn run(&self, job: &CaptureJob, scene: &LitScene) -> Result<(), String> {
        /// Beyond so many bytes the accumulators of large faces go to a temporary file; those of small ones never are as
        /// many.
        const BUDGET: (u32, u64) = (1000, 1 << 30);
        let is_large = job.face_size_px >= BUDGET.0;
        let resources = Resources {
            budget: is_large.then(|| (BUDGET.1, std::env::temp_dir())),
        };
        let captured = job.run(&scene.tracer, &scene.lighting, &resources, self);
        let (ldi, _) = captured.map_err(|error| format!("The capture failed: {error}."))?;
        let packed = planes::pack(ldi, SplatIndexLayout::Normal, Split::Auto, DEFAULT_ERROR_PX);
        let packed = packed.map_err(|error| format!("The capture cannot be packed: {error}."))?;
        let mut state = self.lock();
        state.newest = Some(Arc::new(packed));
        state.rounds_done += 1;
        self.stages.store(0, Ordering::Relaxed);
        self.changed.notify_all();
        Ok(())
    }

    fn end(&self, result: Result<(), String>) {
        let mut state = self.lock();
        state.ended = true;
        state.failed = result
            .err()
            .filter(|_| !self.cancelled.load(Ordering::Relaxed));
        self.changed.notify_all();
    }
}

impl Progress for Shared {
    fn begin(&self, _: &str, _: &str, total: u64) {
        self.stages.fetch_add(1, Ordering::Relaxed);
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
        let (growth, place) = Growth::start(source.clone()).unwrap();
        assert!(growth.stand().share < 1.0);
        let (scene, first) = (growth.lit_scene()().unwrap(), growth.first().unwrap());
        assert!(growth.stand().rounds[0] >= 1 && growth.stand().share > 0.0);
        let job = ROUNDS[0].job(&source, &place.headbox);
        let silent = headbox_core::progress::Silent;
        let (ldi, _) = job
            .run(
                &scene.tracer,
                &scene.lighting,
                &Resources::default(),
                &silent,
            )
            .unwrap();
        assert!(
            *first
                == planes::pack(ldi, SplatIndexLayout::Normal, Split::Auto, DEFAULT_ERROR_PX)
                    .unwrap()
        );
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
        let error = Growth::start(SceneSource::new("builtin:nonsense"))
            .err()
            .unwrap();
        assert!(error.contains("nonsense"), "{error}");
    }
}
