//! Progressive capture: a coarse cube LDI in about a second, finer ones while the user looks around
//! (like the barnyard of the papers, sampled in rounds). Until the first is ready, the scene's
//! surfaces are shown without light.
//!
//! Every round is a whole capture, about four times as expensive as the one before: all rounds
//! together take a third longer than the last alone. The last round is the capture of `headbox
//! capture` with the same settings, to the byte. Earlier rounds take the headbox of the last round.
//! The first does not search for holes, which would delay the first image; the second, which is
//! shown while the last is captured, closes those that show as specks.

use glam::DVec3;
use headbox_core::headbox::Headbox;
use headbox_core::read_note;
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
use headbox_trace::viewpoint::{self, HeadboxError};
use headbox_views::LitScene;
use std::sync::Arc;

/// Headbox and quality of a capture in the window; by default as the scene suggests, with a fifth
/// of the rays of `headbox capture`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CaptureOptions {
    /// Centre of the headbox, in the axes and unit of the scene's file.
    pub centre: Option<DVec3>,
    /// Half of the headbox's edge length, in the file's unit.
    pub half_size: Option<f64>,
    /// Face size (pixels) and parameters of the last round; `None` for the default of `headbox
    /// capture` with a fifth of its rays.
    pub quality: Option<(u32, CaptureParameters)>,
    /// Refuses a scene on which its loader has notes.
    pub is_strict: bool,
}

impl CaptureOptions {
    /// The default quality of `headbox capture`.
    pub(super) const BEST: (u32, CaptureParameters) = (
        CaptureSpec::DEFAULT_FACE_SIZE_PX,
        CaptureParameters::DEFAULT,
    );
}

/// Settings of one round of a progressive capture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Round {
    face_size_px: u32,
    parameters: CaptureParameters,
}

/// Creates a round from its face size, strata, rays, light samples and share of holes.
const fn round(face_size_px: u32, strata: u32, rays: u32, light_samples: u32, holes: f64) -> Round {
    Round {
        face_size_px,
        parameters: CaptureParameters {
            strata,
            rays_per_stratum: rays,
            light_samples,
            holes,
            ..CaptureParameters::DEFAULT
        },
    }
}

/// The rounds before the last.
const FIRST_ROUNDS: [Round; 3] = [
    round(192, 12, 8, 1, 1.0),
    round(512, 16, 16, 2, 1e-3),
    round(1024, 24, 10, 4, 1e-3),
];

/// Returns the rounds that end with the given quality: those of at most half of its work, then
/// itself. By default the last has the face size and light of the default of `headbox capture` with
/// a fifth of its rays, so that it is complete in about a minute.
fn rounds(quality: Option<(u32, CaptureParameters)>) -> Vec<Round> {
    let [first, second, third] = FIRST_ROUNDS;
    let Some((face_size_px, parameters)) = quality else {
        let holes = CaptureParameters::DEFAULT.holes;
        let parameters = CaptureParameters {
            holes,
            ..third.parameters
        };
        return vec![
            first,
            second,
            Round {
                parameters,
                ..third
            },
        ];
    };
    let last = Round {
        face_size_px,
        parameters,
    };
    let before = FIRST_ROUNDS
        .into_iter()
        .filter(|round| round.work() <= last.work() / 2.0);
    before.chain([last]).collect()
}

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
        let parameters = &self.parameters;
        let rays = f64::from(parameters.strata).powi(4) * f64::from(parameters.rays_per_stratum);
        let light_samples = f64::from(parameters.light_samples);
        rays + f64::from(self.face_size_px).powi(2) * LAYERS * light_samples
    }

    fn spec(&self, source: &SceneSource, headbox: &Headbox) -> CaptureSpec {
        CaptureSpec {
            face_size_px: self.face_size_px,
            parameters: self.parameters,
            ..CaptureSpec::new(source.clone(), headbox.centre, headbox.half_size_m)
        }
    }
}

/// Places the headbox of a capture. Without a requested half-size it is the one that the last round
/// can fill.
fn place(
    options: &CaptureOptions,
    rounds: &[Round],
    source: &SceneSource,
    scene: &Arc<Scene>,
) -> Result<Headbox, HeadboxError> {
    let centre = options.centre.map(|p| scene.frame.world_from_file(p));
    let half_size_m = options.half_size.map(|length| length * scene.frame.unit_m);
    let headbox = viewpoint::place_headbox(scene, centre, half_size_m)?;
    let (None, Some(last)) = (half_size_m, rounds.last()) else {
        return Ok(headbox);
    };
    let mut spec = last.spec(source, &headbox);
    spec.fit_half_size(scene);
    Ok(Headbox {
        half_size_m: spec.half_size_m,
        ..headbox
    })
}

/// A capture in rounds on its own thread. Dropping it cancels the capture.
pub(super) struct ProgressiveCapture {
    rounds: Vec<Round>,
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
    /// Warning about a requested headbox.
    pub(super) warning: Option<String>,
}

impl ProgressiveCapture {
    /// Loads a scene and starts its capture.
    ///
    /// # Errors
    /// A sentence, if the scene cannot be opened, the headbox cannot be placed, or no thread can be
    /// started.
    pub(super) fn start(
        source: &SceneSource,
        options: &CaptureOptions,
    ) -> Result<(Self, CapturePlace), String> {
        let scene = Arc::new(source.open().map_err(|error| error.to_string())?);
        if options.is_strict {
            read_note::refuse(&source.name, &scene.summary.notes)
                .map_err(|error| error.to_string())?;
        }
        Self::start_in(scene, source, options, rounds(options.quality))
    }

    /// Starts the capture of a scene that is already loaded from `source`; only its last round if
    /// coarser cubes would replace a finer one.
    ///
    /// # Errors
    /// A sentence, if the headbox cannot be placed or no thread can be started.
    pub(super) fn restart(
        scene: &Arc<Scene>,
        source: &SceneSource,
        options: &CaptureOptions,
        only_last: bool,
    ) -> Result<(Self, CapturePlace), String> {
        let mut rounds = rounds(options.quality);
        if only_last {
            rounds.drain(..rounds.len() - 1);
        }
        Self::start_in(Arc::clone(scene), source, options, rounds)
    }

    fn start_in(
        scene: Arc<Scene>,
        source: &SceneSource,
        options: &CaptureOptions,
        rounds: Vec<Round>,
    ) -> Result<(Self, CapturePlace), String> {
        let headbox = place(options, &rounds, source, &scene).map_err(|error| error.to_string())?;
        let tracer = Arc::new(Tracer::new(scene, headbox.centre));
        let is_requested = options.centre.is_some() || options.half_size.is_some();
        let warning = is_requested.then(|| viewpoint::check_headbox(&tracer, &headbox));
        let warning = warning.flatten();
        const NAME: &str = "capture";
        let work = {
            let tracer = Arc::clone(&tracer);
            let (source, rounds) = (source.clone(), rounds.clone());
            move |shared: &Shared<State>| run_all(shared, &rounds, &source, tracer, &headbox)
        };
        let task = Task::start(NAME, low_priority_pool(NAME)?, State::default(), work)?;
        let place = CapturePlace {
            warning: warning.map(|warning| warning.sentence(&tracer.scene().frame)),
            tracer,
            headbox,
        };
        Ok((Self { rounds, task }, place))
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
            share: (work(before) + current) / work(&self.rounds),
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
    let last = rounds.last().map(|round| round.parameters);
    let bounces = last.unwrap_or(CaptureParameters::DEFAULT).bounces;
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

    /// Two small rounds; the second searches for holes.
    fn small_rounds() -> Vec<Round> {
        vec![round(24, 4, 4, 1, 1.0), round(64, 5, 4, 1, 1e-3)]
    }

    fn start_small(
        source: &SceneSource,
        options: &CaptureOptions,
    ) -> (ProgressiveCapture, CapturePlace) {
        let scene = Arc::new(source.open().unwrap());
        ProgressiveCapture::start_in(scene, source, options, small_rounds()).unwrap()
    }

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
            parameters: round.parameters,
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
            let (capture, place) = start_small(&source, &CaptureOptions::default());
            let state = capture.task.wait_while(|state| !state.ended);
            assert_eq!(state.error, None);
            let finished = state.data.newest.clone().unwrap();
            drop(state);
            assert_eq!(capture.status().share, 1.0);
            let expected = command_capture(&source, &small_rounds()[1]);
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
        let last = rounds(None)[2].spec(&source, &headbox);
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
    fn requested_headbox_is_captured() {
        let source = SceneSource::new("builtin:interior");
        let options = CaptureOptions {
            centre: Some(DVec3::new(0.0, 1.5, 0.5)),
            half_size: Some(0.25),
            ..CaptureOptions::default()
        };
        let (_capture, place) = start_small(&source, &options);
        assert_eq!(place.headbox.centre, DVec3::new(0.0, 1.5, 0.5));
        assert_eq!(place.headbox.half_size_m, 0.25);
        assert_eq!(place.warning, None);
        let in_the_wall = CaptureOptions {
            centre: Some(DVec3::new(0.0, -1.0, 0.0)),
            ..options
        };
        let (_capture, place) = start_small(&source, &in_the_wall);
        let warning = place.warning.unwrap();
        assert!(warning.contains("--center "), "{warning}");
    }

    #[test]
    fn requested_quality_is_the_last_round() {
        let draft = CaptureParameters {
            strata: 16,
            rays_per_stratum: 8,
            light_samples: 1,
            ..CaptureParameters::DEFAULT
        };
        let rounds = rounds(Some((256, draft)));
        assert_eq!(rounds[0], FIRST_ROUNDS[0]);
        let last = Round {
            face_size_px: 256,
            parameters: draft,
        };
        assert_eq!(rounds[1..], [last]);
    }

    #[test]
    fn dropping_cancels_the_capture() {
        let source = SceneSource::new("builtin:miniature");
        let (capture, _) = ProgressiveCapture::start(&source, &CaptureOptions::default()).unwrap();
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
        let source = SceneSource::new("builtin:nonsense");
        let error = ProgressiveCapture::start(&source, &CaptureOptions::default())
            .err()
            .unwrap();
        assert!(error.contains("nonsense"), "{error}");
    }
}
