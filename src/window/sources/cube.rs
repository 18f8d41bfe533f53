//! A cube LDI that is replaced by finer ones while it is shown: captured in rounds, or made of
//! photographs.

use super::points::Points;
use super::progressive_capture::{CaptureStatus, ProgressiveCapture};
use super::view;
use crate::facts::axes_fact;
use crate::file_name::file_name;
use crate::terms::TERMS;
use crate::threads::FewerThreads;
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_core::view::StartView;
use headbox_cube::pack::CubeLdi;
use headbox_cube::view::CubeView;
use headbox_ldi::scene_source::SceneSource;
use headbox_trace::viewpoint::suggest_view;
use headbox_viewer::{
    EyeBounds, FrameReport, FrameRequest, FrameSource, Ongoing, Pose, Refinement, Setting,
};
use headbox_views::TruthView;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Source of a cube LDI that is replaced by [`Self::show`] or by its own capture.
pub(super) struct CubeSource {
    title: String,
    place: Place,
    /// View of the latest cube; `None` until there is one.
    view: Option<TruthView>,
    threads: FewerThreads,
    live: Option<LiveCapture>,
}

/// Default view and headbox of an LDI.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) centre: DVec3,
    pub(super) half_size_m: f64,
    pub(super) ahead: DVec3,
    pub(super) up: DVec3,
    pub(super) frame: FileFrame,
}

/// A capture that runs while its cube LDI is shown.
struct LiveCapture {
    capture: ProgressiveCapture,
    begun: Instant,
    /// Point cloud shown before the first cube.
    points: Points,
    /// File that the button writes.
    file: PathBuf,
}

/// Id of the button that saves the LDI.
const SAVE: &str = "save";

/// Interval between two polls of a live capture.
const POLL: Duration = Duration::from_millis(250);

impl CubeSource {
    /// Starts the capture of a scene, which can be saved in `output_dir`.
    ///
    /// # Errors
    /// One sentence if the scene cannot be opened or captured.
    pub(super) fn capture(source: SceneSource, output_dir: &Path) -> Result<Self, String> {
        let stem = source.name.strip_prefix("builtin:").unwrap_or(&source.name);
        let stem = Path::new(stem).file_stem().map_or_else(
            || "scene".into(),
            |stem| stem.to_string_lossy().into_owned(),
        );
        let name = if source.name.starts_with("builtin:") {
            source.name.clone()
        } else {
            file_name(Path::new(&source.name))
        };
        let (capture, found) = ProgressiveCapture::start(source)?;
        let scene = found.tracer.scene();
        let centre = found.headbox.centre;
        let place = Place {
            centre,
            half_size_m: found.headbox.half_size_m,
            ahead: suggest_view(&found.tracer, centre),
            up: DVec3::Y,
            frame: scene.frame,
        };
        let live = LiveCapture {
            capture,
            begun: Instant::now(),
            points: Points::new(scene, centre),
            file: output_dir.join(stem + ".ldi"),
        };
        Ok(Self {
            live: Some(live),
            ..Self::without_cube(format!("{name} (live capture)"), place)
        })
    }

    /// Creates the source of a cube made of the images in `folder`, to be replaced as the eye
    /// moves.
    pub(super) fn from_images(cube: CubeLdi, folder: &Path) -> Self {
        let start = CubeView::default_view(&cube);
        let place = Place {
            centre: start.eye,
            half_size_m: cube.info.half_size_m,
            ahead: start.forward,
            up: start.up,
            frame: cube.info.frame,
        };
        let title = format!("{} (cube LDI)", file_name(folder));
        let mut source = Self::without_cube(title, place);
        source.show(cube);
        source
    }

    /// Creates a source without a cube, which [`Self::show`] will set.
    pub(super) fn without_cube(title: String, place: Place) -> Self {
        Self {
            title,
            place,
            view: None,
            threads: FewerThreads::default(),
            live: None,
        }
    }

    /// Replaces the cube.
    pub(super) fn show(&mut self, cube: impl Into<Arc<CubeLdi>>) {
        let cube = cube.into();
        match (&mut self.view, &self.live) {
            (Some(view), _) => view.show(cube),
            (None, Some(live)) => {
                let scene = Arc::new(live.capture.lit_scene());
                self.view = Some(TruthView::with_scene(cube, scene));
            }
            (None, None) => self.view = Some(TruthView::new(cube)),
        }
    }

    fn cube(&self) -> Option<&Arc<CubeLdi>> {
        self.view.as_ref().map(TruthView::cube)
    }

    /// Shows the latest cube of a live capture, and returns the capture's status.
    fn update(&mut self) -> Result<Option<CaptureStatus>, String> {
        let Some(live) = &self.live else {
            return Ok(None);
        };
        let newer = live.capture.newer_than(self.cube());
        let error = live.capture.take_error();
        let status = live.capture.status();
        if let Some(newer) = newer {
            self.show(newer);
        }
        error.map_or_else(|| Ok(Some(status)), Err)
    }

    /// Progress of a live capture; `None` if it has ended.
    fn ongoing(&self, status: &CaptureStatus) -> Option<Ongoing> {
        let live = self.live.as_ref().filter(|_| !status.ended)?;
        let [done, all] = status.rounds;
        Some(Ongoing::since(
            format!("capturing, round {} of {all}", done + 1),
            status.share,
            live.begun,
        ))
    }
}

impl FrameSource for CubeSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        view::pose(&StartView {
            eye: self.place.centre,
            forward: self.place.ahead,
            up: self.place.up,
            fov_y_deg: 60.0,
        })
    }

    fn bounds(&self) -> Option<EyeBounds> {
        Some(EyeBounds {
            centre: self.place.centre,
            half_size: DVec3::splat(self.place.half_size_m),
        })
    }

    fn file_frame(&self) -> FileFrame {
        self.place.frame
    }

    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        &TERMS
    }

    fn settings(&self) -> Vec<Setting> {
        let mut settings = view::settings(TruthView::setting_table());
        if let Some(live) = &self.live {
            let tip = format!(
                "Writes the LDI as captured so far to {}.",
                live.file.display()
            );
            settings.push(Setting::action(SAVE, "Save as .ldi", &tip).under("Capture"));
        }
        settings
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let status = self.update()?;
        let ongoing = status.and_then(|status| self.ongoing(&status));
        let Some(view) = &mut self.view else {
            if let Some(live) = &mut self.live {
                live.points.paint(&request.camera, pixels);
            }
            return Ok(FrameReport {
                ongoing,
                refinement: Refinement::Later(POLL),
                facts: vec![axes_fact(&self.place.frame)],
                ..FrameReport::default()
            });
        };
        let mut report = view::render(view, &mut self.threads, request, pixels)?;
        if ongoing.is_some() {
            report.refinement = Refinement::Later(POLL);
        }
        // The progress of truth, if it is shown, has priority.
        report.ongoing = report.ongoing.or(ongoing);
        Ok(report)
    }

    fn act(&mut self, action: &str) -> Result<String, String> {
        match &self.live {
            Some(live) if action == SAVE => {
                let newest = live
                    .capture
                    .newer_than(self.cube())
                    .or_else(|| self.cube().cloned());
                let cube =
                    newest.ok_or("There is nothing to save before the first round is done.")?;
                cube.write(&live.file).map_err(|error| error.to_string())?;
                let (count, face) = (cube.depth_pixel_count(), cube.face_size_px);
                Ok(format!(
                    "Saved {}: {count} depth pixels, faces of {face} px.",
                    live.file.display()
                ))
            }
            _ => Err(format!(
                "\"{action}\" is not something that this view can do."
            )),
        }
    }
}
