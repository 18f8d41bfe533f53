//! Progressive capture: a coarse cube LDI in about a second, finer ones while the user looks around
//! (like the barnyard of the papers, sampled in rounds). Until the first is ready, the scene's
//! surfaces are shown as points.
//!
//! Every round is a whole capture, about four times as expensive as the one before: all rounds
//! together take a third longer than the last alone. The last round is the capture of `headbox
//! capture` with the same settings, to the byte. Earlier rounds take the headbox of the last round.
//! The first does not search for holes, which would delay the first image; the second, which is
//! shown while the last is captured, closes those that show as specks.

use headbox_core::headbox::Headbox;
use headbox_core::task::{Shared, Task, low_priority_pool};
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes;
use headbox_cube::planes::DEFAULT_ERROR_PX;
use headbox_ldi::capture::{SceneCapture, stage};
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::viewpoint;
use headbox_views::LitScene;
use std::sync::Arc;

/// Settings of one round of a progressive capture.
#[derive(Clone, Copy)]
struct Round {
    face_size_px: u32,
    strata: u32,
    rays: u32,
    light_samples: u32,
    /// See [`CaptureParameters::holes`].
    holes: f64,
}

/// The rounds. The last has the face size and light of the default of `headbox capture` with a
/// fifth of its rays, so that it is complete in about a minute.
const ROUNDS: [Round; 3] = [
    Round {
        face_size_px: 192,
        strata: 12,
        rays: 8,
        light_samples: 1,
        holes: 1.0,
    },
    Round {
        face_size_px: 512,
        strata: 16,
        rays: 16,
        light_samples: 2,
        holes: 1e-3,
    },
    Round {
        face_size_px: 1024,
        strata: 24,
        rays: 10,
        light_samples: 4,
        holes: CaptureParameters::DEFAULT.holes,
    },
];

/// Face size from which accumulators are spilled to a temporary file, pixels. Smaller faces never
/// need as much memory.
const SPILL_FACE_PX: u32 = 1000;

/// Memory for accumulators of such faces, bytes.
const SPILL_BUDGET: u64 = 1 << 30;

impl Round {
    /// Work of the round in an arbitrary unit: rays, and light at the depth pixels that they
    /// become.
    fn work(&self) -> f64 {
        /// Approximate number of depth pixels per face pixel.
        const LAYERS: f64 = 1.5;
        let rays = f64::from(self.strata).powi(4) * f64::from(self.rays);
        rays + f64::from(self.face_size_px).powi(2) * LAYERS * f64::from(self.light_samples)
    }

    fn spec(&self, source: &SceneSource, headbox: &Headbox) -> CaptureSpec {
        CaptureSpec {
            face_size_px: self.face_size_px,
            parameters: CaptureParameters {
                strata: self.strata,
                rays_per_stratum: self.rays,
                light_samples: self.light_samples,
                holes: self.holes,
                ..CaptureParameters::DEFAULT
            },
            ..CaptureSpec::new(source.clone(), headbox.centre, headbox.half_size_m)
        }
    }
}

/// The half size of the headbox that the last round captures.
fn fitted_headbox(
    rounds: &[Round],
    source: &SceneSource,
    scene: &Scene,
    headbox: Headbox,
) -> Headbox {
    let Some(last) = rounds.last() else {
        return headbox;
    };
    let mut spec = last.spec(source, &headbox);
    spec.fit_half_size(scene);
    Headbox {
        half_size_m: spec.half_size_m,
        ..headbox
    }
}

/// A capture in rounds on its own thread. Dropping it cancels the capture.
pub(super) struct ProgressiveCapture {
    rounds: &'static [Round],
    task: Task<State>,
}

#[derive(Default)]
struct State {
    scene: Option<LitScene>,
    newest: Option<Arc<CubeLdi>>,
    rounds_done: usize,
}

/// Completed share of a round, 0 to 1: the stages begun, in order, and the completed share of the
/// last one. Each stage of [`stage::ALL`] counts alike. Each round of the search for holes covers
/// half of the rest of its stage, because their number is not known.
fn round_share(stages: &[String], stage_share: f64) -> f64 {
    let mut current = 0;
    let (mut start, mut length) = (0.0, 0.0);
    for name in stages {
        let known = stage::ALL.iter().position(|known| known == name);
        let index = known.unwrap_or(current);
        let repeats = length > 0.0 && index == current;
        start = if repeats {
            start + length
        } else {
            index as f64
        };
        length = index as f64 + 1.0 - start;
        if name == stage::HOLES {
            length /= 2.0;
        }
        current = index;
    }
    (start + length * stage_share) / stage::ALL.len() as f64
}

/// Status of a progressive capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CaptureStatus {
    /// Number of completed rounds, and of all rounds.
    pub(super) rounds: [usize; 2],
    /// Approximate share of all work that is done, 0 to 1.
    pub(super) share: f64,
    /// True if no further cube will come.
    pub(super) ended: bool,
}

/// The headbox of a capture, known before anything is traced.
pub(super) struct CapturePlace {
    pub(super) tracer: Arc<Tracer>,
    pub(super) headbox: Headbox,
}

impl ProgressiveCapture {
    /// Loads a scene and starts its capture.
    ///
    /// # Errors
    /// A sentence, if the scene cannot be opened or no thread can be started.
    pub(super) fn start(source: SceneSource) -> Result<(Self, CapturePlace), String> {
        Self::start_rounds(source, &ROUNDS)
    }

    fn start_rounds(
        source: SceneSource,
        rounds: &'static [Round],
    ) -> Result<(Self, CapturePlace), String> {
        let scene = Arc::new(source.open().map_err(|error| error.to_string())?);
        let headbox =
            viewpoint::place_headbox(&scene, None, None).map_err(|error| error.to_string())?;
        let headbox = fitted_headbox(rounds, &source, &scene, headbox);
        let tracer = Arc::new(Tracer::new(scene, headbox.centre));
        const NAME: &str = "capture";
        let work = {
            let tracer = Arc::clone(&tracer);
            move |shared: &Shared<State>| run_all(shared, rounds, &source, tracer, &headbox)
        };
        let task = Task::start(NAME, low_priority_pool(NAME)?, State::default(), work)?;
        Ok((Self { rounds, task }, CapturePlace { tracer, headbox }))
    }

    /// A function that waits for the scene with its light.
    pub(super) fn lit_scene(
        &self,
    ) -> impl Fn() -> Result<LitScene, String> + Send + Sync + 'static {
        let shared = self.task.share();
        move || {
            let state = shared.wait_while(|state| state.data.scene.is_none() && !state.ended);
            let scene = state.data.scene.clone();
            scene.ok_or_else(|| "The capture ended before there was light.".into())
        }
    }

    /// The finest cube so far, if it is not `shown`.
    pub(super) fn newer_than(&self, shown: Option<&Arc<CubeLdi>>) -> Option<Arc<CubeLdi>> {
        let state = self.task.lock();
        let newest = state.data.newest.as_ref();
        newest
            .filter(|newest| shown.is_none_or(|shown| !Arc::ptr_eq(newest, shown)))
            .map(Arc::clone)
    }

    /// The error of a later round, returned once.
    pub(super) fn take_error(&self) -> Option<String> {
        self.task.lock().error.take()
    }

    /// The progress of the capture.
    pub(super) fn status(&self) -> CaptureStatus {
        let state = self.task.lock();
        let work = |rounds: &[Round]| rounds.iter().map(Round::work).sum::<f64>();
        let rounds_done = state.data.rounds_done.min(self.rounds.len());
        let (before, rest) = self.rounds.split_at(rounds_done);
        let current = rest.first().map_or(0.0, |round| {
            round.work() * round_share(&state.stages, self.task.stage_share())
        });
        CaptureStatus {
            rounds: [rounds_done, self.rounds.len()],
            share: (work(before) + current) / work(self.rounds),
            ended: state.ended,
        }
    }
}

/// Prepares the light and captures all rounds.
fn run_all(
    shared: &Shared<State>,
    rounds: &[Round],
    source: &SceneSource,
    tracer: Arc<Tracer>,
    headbox: &Headbox,
) -> Result<(), String> {
    let bounces = CaptureParameters::DEFAULT.bounces;
    let scene = LitScene {
        lighting: Arc::new(Lighting::prepare(&tracer, headbox.centre, bounces, true)),
        tracer,
        lit: true,
        guided: true,
    };
    shared.update(|state| state.data.scene = Some(scene.clone()));
    for round in rounds {
        let cube = capture(shared, &round.spec(source, headbox), &scene)?;
        shared.complete_round(|state| {
            state.newest = Some(Arc::new(cube));
            state.rounds_done += 1;
        });
    }
    Ok(())
}

/// Captures one round.
fn capture(
    shared: &Shared<State>,
    spec: &CaptureSpec,
    scene: &LitScene,
) -> Result<CubeLdi, String> {
    let options = RunOptions {
        budget: (spec.face_size_px >= SPILL_FACE_PX).then(|| (SPILL_BUDGET, std::env::temp_dir())),
        progress: shared,
        ..RunOptions::default()
    };
    let capture = SceneCapture::new(spec, &scene.tracer, &scene.lighting, &options);
    let (ldi, _) = capture
        .run()
        .map_err(|error| format!("The capture failed: {error}."))?;
    planes::pack(ldi, SplatIndexLayout::Normal, Split::Auto, DEFAULT_ERROR_PX)
        .map_err(|error| format!("The capture cannot be packed: {error}."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Two small rounds; the second searches for holes.
    const SMALL_ROUNDS: [Round; 2] = [
        Round {
            face_size_px: 24,
            strata: 4,
            rays: 4,
            light_samples: 1,
            holes: 1.0,
        },
        Round {
            face_size_px: 64,
            strata: 5,
            rays: 4,
            light_samples: 1,
            holes: 1e-3,
        },
    ];

    /// The capture of `headbox capture` with the settings of a round: its headbox, and the
    /// command's default for all that a round does not set.
    fn command_capture(source: &SceneSource, round: &Round) -> CubeLdi {
        let scene = Arc::new(source.open().unwrap());
        let headbox = viewpoint::place_headbox(&scene, None, None).unwrap();
        let mut spec = CaptureSpec {
            scene: source.clone(),
            centre: headbox.centre,
            half_size_m: headbox.half_size_m,
            face_size_px: round.face_size_px,
            parameters: CaptureParameters {
                strata: round.strata,
                rays_per_stratum: round.rays,
                light_samples: round.light_samples,
                holes: round.holes,
                ..CaptureParameters::DEFAULT
            },
        };
        spec.fit_half_size(&scene);
        let tracer = Tracer::new(scene, headbox.centre);
        let lighting = Lighting::prepare(&tracer, spec.centre, spec.parameters.bounces, true);
        let options = RunOptions::default();
        let (ldi, _) = SceneCapture::new(&spec, &tracer, &lighting, &options)
            .run()
            .unwrap();
        planes::pack(ldi, SplatIndexLayout::Normal, Split::Auto, DEFAULT_ERROR_PX).unwrap()
    }

    fn file_bytes(cube: &CubeLdi) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ldi");
        cube.write(&path).unwrap();
        std::fs::read(path).unwrap()
    }

    /// A floor and a box in the open, without a headbox of its own.
    fn write_open_scene(path: &std::path::Path) {
        let corners = [[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9]];
        let walls = [[-3, 0, -4], [3, 0, -4], [3, 4, -4], [-3, 4, -4]];
        let mut text = String::new();
        for [x, y, z] in corners.into_iter().chain(walls) {
            text += &format!("v {x} {y} {z}\n");
        }
        text += "f 1 4 3\nf 1 3 2\nf 5 6 7\nf 5 7 8\n";
        std::fs::write(path, text).unwrap();
    }

    #[test]
    fn last_round_equals_the_command_to_the_byte() {
        let folder = tempfile::tempdir().unwrap();
        let open_scene = folder.path().join("open.obj");
        write_open_scene(&open_scene);
        let mut fitted = Vec::new();
        for source in [
            SceneSource::new("builtin:miniature"),
            SceneSource::new(open_scene.to_str().unwrap()),
        ] {
            let (capture, place) =
                ProgressiveCapture::start_rounds(source.clone(), &SMALL_ROUNDS).unwrap();
            let state = capture.task.wait_while(|state| !state.ended);
            assert_eq!(state.error, None);
            let finished = state.data.newest.clone().unwrap();
            drop(state);
            assert_eq!(capture.status().share, 1.0);
            let expected = command_capture(&source, &SMALL_ROUNDS[1]);
            assert!(
                file_bytes(&finished) == file_bytes(&expected),
                "{}",
                source.name
            );
            assert_eq!(finished.info.half_size_m, place.headbox.half_size_m);
            let holes = finished.info.holes.expect("holes were searched");
            assert!(holes.rounds > 0);
            let scene = place.tracer.scene();
            let suggested = viewpoint::place_headbox(scene, None, None).unwrap();
            fitted.push(finished.info.half_size_m < suggested.half_size_m);
        }
        assert_eq!(
            fitted,
            [false, true],
            "only a headbox in free space shrinks"
        );
    }

    #[test]
    fn last_round_is_the_commands_default_with_fewer_rays() {
        let source = SceneSource::new("builtin:miniature");
        let headbox = Headbox {
            centre: DVec3::ZERO,
            half_size_m: 1.0,
        };
        let last = ROUNDS[ROUNDS.len() - 1].spec(&source, &headbox);
        let default = CaptureSpec::new(source, headbox.centre, headbox.half_size_m);
        let fewer_rays = CaptureParameters {
            strata: last.parameters.strata,
            rays_per_stratum: last.parameters.rays_per_stratum,
            ..default.parameters
        };
        assert_eq!(last.parameters, fewer_rays);
        assert_eq!(last.face_size_px, default.face_size_px);
        let share = last.max_rays() / default.max_rays();
        assert!((share - 0.2).abs() < 0.01, "a fifth of the rays: {share}");
    }

    #[test]
    fn dropping_cancels_the_capture() {
        let source = SceneSource::new("builtin:miniature");
        let (capture, _) = ProgressiveCapture::start(source).unwrap();
        let state = capture
            .task
            .wait_while(|state| state.data.newest.is_none() && !state.ended);
        assert!(state.data.scene.is_some() && state.data.newest.is_some());
        drop(state);
        let status = capture.status();
        assert!(status.rounds[0] >= 1 && status.share > 0.0 && status.share < 1.0);
        let shared = capture.task.share();
        drop(capture);
        let state = shared.wait_while(|state| !state.ended);
        assert_eq!(state.error, None, "cancelled without an error");
    }

    #[test]
    fn stages_advance_to_the_end_of_a_round() {
        let mut names = vec![stage::PILOT.to_owned(), stage::TRACE.to_owned()];
        names.extend([stage::HOLES; 5].map(str::to_owned));
        names.push(stage::LIGHT.to_owned());
        let stages = (1..=names.len()).flat_map(|n| [(n, 0.0), (n, 1.0)]);
        let shares: Vec<f64> = std::iter::once((0, 0.0))
            .chain(stages)
            .map(|(begun, share)| round_share(&names[..begun], share))
            .collect();
        assert!(shares.is_sorted(), "{shares:?}");
        assert_eq!(shares.last(), Some(&1.0));
    }

    #[test]
    fn unknown_scene_is_named_in_the_error() {
        let error = ProgressiveCapture::start(SceneSource::new("builtin:nonsense"))
            .err()
            .unwrap();
        assert!(error.contains("nonsense"), "{error}");
    }
}
