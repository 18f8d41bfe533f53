//! A folder of photographs without depth in the window: voxel colouring builds a cube LDI in the
//! background (S16), coarse ones first.
//!
//! The time of voxel colouring grows with the third power of the photographs' size, so a cube of
//! photographs reduced eightfold is ready almost at once, and all coarser cubes together take a
//! seventh of the last one's time. Until the first is ready, the photograph nearest to the cube's
//! centre is shown on a plane at the distance that all cameras look at: from the start pose it
//! looks as it was taken.

use super::cube::{CubeSource, Place};
use crate::file_name::file_name;
use glam::DVec3;
use headbox_core::camera::fov_deg;
use headbox_core::task::{Shared, Task, low_priority_pool};
use headbox_core::view::level_up;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes;
use headbox_cube::planes::DEFAULT_ERROR_PX;
use headbox_images::{ImageSet, Lens, LoadedView, View};
use headbox_photos::voxel_colouring::PhotographsJob;
use headbox_viewer::{
    EyeBounds, FrameReport, FrameRequest, FrameSource, Ongoing, Pose, Refinement, Setting,
};
use rayon::prelude::*;
use std::path::Path;
use std::time::{Duration, Instant};

/// Reduction of the photographs in each round.
const ROUNDS: [u32; 4] = [8, 4, 2, 1];

/// Interval between two polls of the background task.
const POLL_INTERVAL: Duration = Duration::from_millis(250);

/// Photographs that are coloured into a cube while it is shown.
pub(super) struct PhotographsSource {
    /// Draws the newest cube.
    shown: CubeSource,
    start: Pose,
    /// The photograph that is shown until there is a cube.
    first: Option<PhotographOnPlane>,
    colouring: Task<Colouring>,
    begun: Instant,
}

/// A photograph on a plane that faces its camera.
struct PhotographOnPlane {
    view: LoadedView,
    /// A point of the plane.
    at: DVec3,
}

impl PhotographsSource {
    /// Starts colouring a set of photographs.
    ///
    /// # Errors
    /// One sentence, if no view is a perspective photograph, the first one cannot be read, or the
    /// thread cannot be started.
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
            Lens::Pinhole(pinhole) => fov_deg(f64::from(view.size_px[1]), pinhole.focal_px[1]),
            Lens::Equirectangular => 60.0,
        };
        let start = Pose::upright(place.centre, place.centre + ahead, place.up, fov_y_deg);
        // Cameras that look outward from one place have no common focus.
        let least = 10.0 * job.half_size_m;
        let far = (set.focus() - view.pose.eye).dot(ahead).max(least);
        let first = PhotographOnPlane {
            at: view.pose.eye + ahead * far,
            view,
        };
        let shown = CubeSource::without_cube(format!("{} (photographs)", file_name(folder)), place);
        let colouring = start_colouring(set, job)?;
        Ok(Self {
            shown,
            start,
            first: Some(first),
            colouring,
            begun: Instant::now(),
        })
    }
}

impl PhotographOnPlane {
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

#[derive(Default)]
struct Colouring {
    newest: Option<CubeLdi>,
    rounds_done: usize,
}

/// Starts the task that colours all rounds.
fn start_colouring(set: ImageSet, job: PhotographsJob) -> Result<Task<Colouring>, String> {
    const NAME: &str = "colouring";
    let work = move |shared: &Shared<Colouring>| {
        let views: Vec<&View> = set.views.iter().collect();
        for reduction in ROUNDS {
            let colouring = job.prepare(&set, &views, reduction);
            let ldi = colouring.map_err(|error| error.to_string())?.run(shared);
            let packed = planes::pack(ldi, SplatIndexLayout::Normal, Split::Auto, DEFAULT_ERROR_PX);
            let packed = packed.map_err(|error| format!("The cube cannot be packed: {error}."))?;
            shared.complete_round(|state| {
                state.newest = Some(packed);
                state.rounds_done += 1;
            });
        }
        Ok(())
    };
    Task::start(NAME, low_priority_pool(NAME)?, Colouring::default(), work)
}

/// Progress of the colouring; `None` once it has ended.
fn ongoing(colouring: &Task<Colouring>, begun: Instant) -> Option<Ongoing> {
    let state = colouring.lock();
    if state.ended {
        return None;
    }
    // A round is complete only once it is packed.
    let round_share = colouring.stage_share().min(0.97);
    let work = |rounds: &[u32]| {
        rounds
            .iter()
            .map(|reduction| 1.0 / f64::from(*reduction).powi(3))
            .sum::<f64>()
    };
    let (before, rest) = ROUNDS.split_at(state.data.rounds_done.min(ROUNDS.len()));
    let current = rest.get(..1).map_or(0.0, work) * round_share;
    let what = format!("colouring, round {} of {}", before.len() + 1, ROUNDS.len());
    let share = (work(before) + current) / work(&ROUNDS);
    Some(Ongoing::since(what, share, begun))
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
        // Read before the newest cube, so that the last cube is shown when nothing is in progress.
        let ongoing = ongoing(&self.colouring, self.begun);
        let (newest, error) = self
            .colouring
            .update(|state| (state.data.newest.take(), state.error.take()));
        if let Some(error) = error {
            return Err(error);
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
            report.refinement = Refinement::Later(POLL_INTERVAL);
        }
        report.ongoing = report.ongoing.or(ongoing);
        Ok(report)
    }

    fn save(&mut self, id: &str, path: &Path) -> Result<String, String> {
        self.shown.save(id, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::camera::Camera;
    use headbox_fixtures::{image_set, plane_view, saved};
    use headbox_viewer::SettingValues;
    use std::sync::Arc;

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
        let set = image_set(folder.path(), &views);
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
        // The first frame is the photograph as it was taken, however far the thread is.
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
        let mut expected = CubeSource::from_images(whole, folder.path());
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
