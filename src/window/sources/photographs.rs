//! A folder of photographs without depth in the window: coloured into a cube LDI in the background
//! (S16), at first a coarse one.
//!
//! Colouring takes about the third power of the photographs' size, so that one of photographs an
//! eighth as large is there almost at once, and all coarser ones together take a seventh of the
//! last. Until the first is there, the photograph whose camera the cube is made about is shown, on
//! the plane through what all cameras look at: from where one starts it looks as it was taken.

use super::cube::{CubeSource, Place};
use crate::file_name::file_name;
use glam::DVec3;
use headbox_core::progress::Progress;
use headbox_core::view::level_up;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes;
use headbox_cube::planes::DEFAULT_ERROR_PX;
use headbox_images::{ImageSet, Lens, LoadedView, View};
use headbox_photos::voxel_colouring::PhotographsJob;
use headbox_viewer::{
    EyeBounds, FrameReport, FrameRequest, FrameSource, Ongoing, Pose, Refinement, Setting,
};
use headbox_views::background;
use rayon::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Reduction of the photographs, round by round.
const ROUNDS: [u32; 4] = [8, 4, 2, 1];

/// Stages of a round: marches outward.
const STAGES: f64 = 3.0;

/// Interval between two polls of the colouring.
const LOOK_AGAIN: Duration = Duration::from_millis(250);

/// Photographs, of which a cube is made while one looks at it.
pub(super) struct PhotographsSource {
    /// Draws the newest cube.
    shown: CubeSource,
    start: Pose,
    /// Shown until there is a cube.
    first: Option<Flat>,
    colouring: Colouring,
    begun: Instant,
}

/// A photograph on a plane that faces its camera.
struct Flat {
    view: LoadedView,
    /// A point of the plane.
    at: DVec3,
}

impl PhotographsSource {
    /// Begins to colour a set.
    ///
    /// # Errors
    /// One sentence: no view is a perspective photograph, the first cannot be read, or no thread
    /// started.
    pub(super) fn new(set: ImageSet, folder: &Path) -> Result<Self, String> {
        let job = PhotographsJob::suggest(&set);
        let apart = |view: &&View| view.pose.eye.distance_squared(job.centre);
        let perspective = set
            .views
            .iter()
            .filter(|view| matches!(view.lens, Lens::Pinhole(_)));
        let nearest = perspective.min_by(|a, b| apart(a).total_cmp(&apart(b)));
        let nearest = nearest.ok_or_else(|| {
            format!(
                "{}: none of its views is a perspective photograph.",
                folder.display()
            )
        })?;
        let view = nearest.load().map_err(|error| error.to_string())?;
        let (ahead, up) = (
            -view.pose.world_from_eye.z_axis,
            view.pose.world_from_eye.y_axis,
        );
        let place = Place {
            centre: job.centre,
            half_size_m: job.half_size_m,
            ahead,
            up: level_up(Some(up)),
            frame: set.frame,
        };
        let fov_y_deg = match view.lens {
            Lens::Pinhole(pinhole) => {
                2.0 * (f64::from(view.size_px[1]) / 2.0 / pinhole.focal_px[1])
                    .atan()
                    .to_degrees()
            }
            Lens::Equirectangular => 60.0,
        };
        let start = Pose::upright(place.centre, place.centre + ahead, place.up, fov_y_deg);
        // Cameras that look out of a room look at nothing in common.
        let least = 10.0 * job.half_size_m;
        let far = (set.focus() - view.pose.eye).dot(ahead).max(least);
        let first = Flat {
            at: view.pose.eye + ahead * far,
            view,
        };
        let shown = CubeSource::to_come(format!("{} (photographs)", file_name(folder)), place);
        let colouring = Colouring::start(set, job)?;
        Ok(Self {
            shown,
            start,
            first: Some(first),
            colouring,
            begun: Instant::now(),
        })
    }
}

impl Flat {
    fn paint(&self, request: &FrameRequest, pixels: &mut [[u8; 4]]) {
        let camera = &request.camera;
        pixels
            .par_chunks_mut(camera.width().max(1) as usize)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, pixel) in (0u32..).zip(row) {
                    let direction = camera.direction(f64::from(x) + 0.5, y as f64 + 0.5);
                    let color = self.view.color_on_plane(self.at, camera.eye(), direction);
                    *pixel = color.map_or([0; 4], |color| {
                        let [r, g, b] = color.map(|level| (level + 0.5) as u8);
                        [r, g, b, 255]
                    });
                }
            });
    }
}

/// The thread that colours. Dropping it gives the work up; nobody waits for it.
struct Colouring(Arc<ColouringShared>);

#[derive(Default)]
struct ColouringShared {
    state: Mutex<ColouringState>,
    cancelled: AtomicBool,
}

#[derive(Default)]
struct ColouringState {
    newest: Option<CubeLdi>,
    rounds_done: usize,
    /// Stages of this round begun.
    stages: u64,
    /// Steps of the stage, done and in all.
    steps: [u64; 2],
    ended: bool,
    failed: Option<String>,
}

impl Colouring {
    fn start(set: ImageSet, job: PhotographsJob) -> Result<Self, String> {
        let pool = background::pool("photographs")?;
        let shared = Arc::new(ColouringShared::default());
        let spawned = std::thread::Builder::new()
            .name("photographs".into())
            .spawn({
                let shared = Arc::clone(&shared);
                move || {
                    let rounds = || {
                        ROUNDS
                            .iter()
                            .try_for_each(|&smaller| shared.run(&set, &job, smaller))
                    };
                    let work = || pool.install(rounds);
                    let panicked =
                        |_| Err("The colouring stopped because of an error in the program.".into());
                    shared.end(catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(panicked));
                }
            });
        spawned.map_err(|error| format!("Cannot start a thread: {error}."))?;
        Ok(Self(shared))
    }

    /// Work in progress; `None` once it is finished.
    fn ongoing(&self, begun: Instant) -> Option<Ongoing> {
        let state = self.0.lock();
        let [done, all] = state.steps.map(|steps| steps as f64);
        let of_stage = if all > 0.0 {
            (done / all).min(1.0)
        } else {
            0.0
        };
        // A round is never told to be done before it is packed.
        let of_round =
            (state.stages.saturating_sub(1) as f64 + of_stage).min(STAGES * 0.97) / STAGES;
        let work = |rounds: &[u32]| {
            rounds
                .iter()
                .map(|smaller| 1.0 / f64::from(*smaller).powi(3))
                .sum::<f64>()
        };
        let (before, rest) = ROUNDS.split_at(state.rounds_done.min(ROUNDS.len()));
        let now = rest.get(..1).map_or(0.0, |round| work(round) * of_round);
        let what = format!("colouring, round {} of {}", before.len() + 1, ROUNDS.len());
        (!state.ended).then(|| Ongoing::since(what, (work(before) + now) / work(&ROUNDS), begun))
    }
}

impl Drop for Colouring {
    fn drop(&mut self) {
        self.0.cancelled.store(true, Ordering::Relaxed);
    }
}

impl ColouringShared {
    /// A panic elsewhere leaves whole values here, so a poisoned lock is still good.
    fn lock(&self) -> MutexGuard<'_, ColouringState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One round.
    fn run(&self, set: &ImageSet, job: &PhotographsJob, smaller: u32) -> Result<(), String> {
        let views: Vec<&View> = set.views.iter().collect();
        let ldi = job
            .run_smaller(set, &views, smaller, self)
            .map_err(|error| error.to_string())?;
        if self.is_cancelled() {
            return Err("given up".into());
        }
        let packed = planes::pack(ldi, SplatIndexLayout::Normal, Split::Auto, DEFAULT_ERROR_PX);
        let packed = packed.map_err(|error| format!("The cube cannot be packed: {error}."))?;
        let mut state = self.lock();
        state.newest = Some(packed);
        state.rounds_done += 1;
        (state.stages, state.steps) = (0, [0; 2]);
        Ok(())
    }

    fn end(&self, result: Result<(), String>) {
        let mut state = self.lock();
        state.ended = true;
        state.failed = result.err();
    }
}

impl Progress for ColouringShared {
    fn begin(&self, _: &str, _: &str, total: u64) {
        let mut state = self.lock();
        state.stages += 1;
        state.steps = [0, total];
    }

    fn advance(&self, steps: u64) {
        self.lock().steps[0] += steps;
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

impl FrameSource for PhotographsSource {
    fn title(&self) -> String {
        self.shown.title()
    }

    fn start_pose(&self) -> Pose {
        self.start
    }

    fn bounds(&self) -> Option<EyeBounds> {
        self.shown.bounds()
    }

    fn file_frame(&self) -> headbox_core::file_frame::FileFrame {
        self.shown.file_frame()
    }

    fn notes(&self) -> Vec<String> {
        vec!["Photographs are coloured by where they agree, which takes its time; headbox images FOLDER --depth finds their depth, which shows more.".into()]
    }

    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        self.shown.terms()
    }

    fn settings(&self) -> Vec<Setting> {
        self.shown.settings()
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        // Asked first: once nothing is going on the last cube is there.
        let ongoing = self.colouring.ongoing(self.begun);
        let (newest, failed) = {
            let mut state = self.colouring.0.lock();
            (state.newest.take(), state.failed.take())
        };
        if let Some(failed) = failed {
            return Err(failed);
        }
        if let Some(cube) = newest {
            self.shown.show(cube);
            self.first = None;
        }
        let mut report = match &self.first {
            Some(first) => {
                first.paint(request, pixels);
                FrameReport::default()
            }
            None => self.shown.render(request, pixels)?,
        };
        if ongoing.is_some() {
            report.refinement = Refinement::Later(LOOK_AGAIN);
        }
        report.ongoing = report.ongoing.or(ongoing);
        Ok(report)
    }

    fn act(&mut self, action: &str) -> Result<String, String> {
        self.shown.act(action)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::camera::Camera;
    use headbox_fixtures::{plane_view, saved, set_of};
    use headbox_viewer::SettingValues;

    const SIZE: [u32; 2] = [96, 72];

    /// A plane at Z = -3, photographed from five places, without depth.
    fn photographs() -> (tempfile::TempDir, ImageSet) {
        let folder = tempfile::tempdir().unwrap();
        let eyes = [
            [0.0, 0.0],
            [0.2, 0.0],
            [-0.2, 0.05],
            [0.0, 0.2],
            [0.1, -0.2],
        ];
        let view = |(i, [x, y]): (usize, [f64; 2])| {
            let taken = plane_view(DVec3::new(x, y, 0.0), 3.0, SIZE);
            View {
                depth: None,
                ..saved(&taken, folder.path(), &i.to_string())
            }
        };
        let views: Vec<View> = eyes.into_iter().enumerate().map(view).collect();
        let set = set_of(folder.path(), &views);
        (folder, set)
    }

    fn request(source: &PhotographsSource) -> FrameRequest {
        let camera = Camera::from_parts(
            source.start.eye,
            glam::DMat3::IDENTITY,
            f64::from(SIZE[1]) / 2.0 / (source.start.fov_y_deg.to_radians() / 2.0).tan(),
            SIZE[0],
            SIZE[1],
        );
        FrameRequest {
            camera: camera.unwrap(),
            settings: Arc::new(SettingValues::initial(&source.settings())),
            moving: false,
            complete: false,
            depth: false,
        }
    }

    #[test]
    fn photographs_refine_to_captured_cube() {
        let (folder, set) = photographs();
        let mut source = PhotographsSource::new(set.clone(), folder.path()).unwrap();
        let request = request(&source);
        let mut pixels = vec![[1; 4]; (SIZE[0] * SIZE[1]) as usize];
        // Whatever the thread has done by now: what stands there first is the photograph as it was
        // taken.
        let first = source.first.take().unwrap();
        first.paint(&request, &mut pixels);
        for (found, taken) in pixels.iter().zip(&first.view.color) {
            // Positions in f64, then the nearest level.
            assert!(
                (0..3).all(|c| found[c].abs_diff(taken[c]) <= 1),
                "{found:?} {taken:?}"
            );
        }
        let (mut shares, mut faces) = (Vec::new(), Vec::new());
        loop {
            let report = source.render(&request, &mut pixels);
            let Ok(report) = report else {
                panic!("{report:?}")
            };
            faces.extend(
                report
                    .figures
                    .iter()
                    .find(|figure| figure.name == "face size")
                    .map(|figure| figure.value),
            );
            match report.ongoing {
                Some(ongoing) => shares.push(ongoing.share),
                None => break,
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        assert!(
            shares.is_sorted() && shares.iter().all(|share| (0.0..=1.0).contains(share)),
            "{shares:?}"
        );
        let last = source.render(&request, &mut pixels).unwrap();
        assert_eq!(last.refinement, Refinement::Done);
        let views: Vec<&View> = set.views.iter().collect();
        let job = PhotographsJob::suggest(&set);
        assert!(
            faces.is_sorted() && faces.last() == Some(&f64::from(job.face_size_px)),
            "{faces:?}"
        );
        let ldi = job
            .run(&set, &views, &headbox_core::progress::Silent)
            .unwrap();
        let whole =
            planes::pack(ldi, SplatIndexLayout::Normal, Split::Auto, DEFAULT_ERROR_PX).unwrap();
        let mut expected = CubeSource::of_images(whole, folder.path());
        let mut other = pixels.clone();
        expected.render(&request, &mut other).unwrap();
        assert!(pixels == other, "the last round is what a capture makes");
    }

    #[test]
    fn unreadable_photograph_is_named() {
        let (folder, set) = photographs();
        set.views
            .iter()
            .for_each(|view| std::fs::remove_file(&view.color).unwrap());
        let error = PhotographsSource::new(set, folder.path()).err().unwrap();
        assert!(error.contains(".png"), "{error}");
    }
}
