//! A cube LDI that grows while it is looked at: captured in rounds, or made of photographs.

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

/// A cube LDI that [`Self::show`] or a capture brings, finer and finer.
pub(super) struct CubeSource {
    title: String,
    place: Place,
    /// None until the first cube is there.
    view: Option<TruthView>,
    threads: FewerThreads,
    growing: Option<Growing>,
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

/// State of a cube LDI that is still being captured.
struct Growing {
    capture: ProgressiveCapture,
    begun: Instant,
    /// Shown before there is anything else.
    points: Points,
    /// File that the button writes.
    file: PathBuf,
}

/// Id of the button that saves a growing LDI.
const SAVE: &str = "save";

/// Interval between two polls of a growing capture.
const LOOK_AGAIN: Duration = Duration::from_millis(250);

impl CubeSource {
    /// A scene that is captured while one looks around in it; can be saved in `output_dir`.
    ///
    /// # Errors
    /// One sentence.
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
        let title = format!("{name} (live capture)");
        let (capture, found) = ProgressiveCapture::start(source)?;
        let scene = found.tracer.scene();
        let (centre, half_size_m) = (found.headbox.centre, found.headbox.half_size_m);
        let ahead = suggest_view(&found.tracer, centre);
        let place = Place {
            centre,
            half_size_m,
            ahead,
            up: DVec3::Y,
            frame: scene.frame,
        };
        let (begun, points, file) = (
            Instant::now(),
            Points::new(scene, centre),
            output_dir.join(stem + ".ldi"),
        );
        Ok(Self::new(
            title,
            place,
            Some(Growing {
                capture,
                begun,
                points,
                file,
            }),
        ))
    }

    /// A cube made of the images in `folder`, to be replaced as the eye moves.
    pub(super) fn of_images(cube: CubeLdi, folder: &Path) -> Self {
        let start = CubeView::start_in(&cube);
        let place = Place {
            centre: start.eye,
            half_size_m: cube.info.half_size_m,
            ahead: start.forward,
            up: start.up,
            frame: cube.info.frame,
        };
        let title = format!("{} (cube LDI)", file_name(folder));
        let mut source = Self::new(title, place, None);
        source.show(cube);
        source
    }

    /// A cube that [`Self::show`] will bring.
    pub(super) fn to_come(title: String, place: Place) -> Self {
        Self::new(title, place, None)
    }

    fn new(title: String, place: Place, growing: Option<Growing>) -> Self {
        Self {
            title,
            place,
            view: None,
            threads: FewerThreads::default(),
            growing,
        }
    }

    /// Shows another cube instead.
    pub(super) fn show(&mut self, cube: impl Into<Arc<CubeLdi>>) {
        let cube = cube.into();
        match (&mut self.view, &self.growing) {
            (Some(view), _) => view.show(cube),
            (None, Some(growing)) => {
                let scene = Arc::new(growing.capture.lit_scene());
                self.view = Some(TruthView::of_scene(cube, scene));
            }
            (None, None) => self.view = Some(TruthView::new(cube)),
        }
    }

    /// The cube shown.
    fn cube(&self) -> Option<&Arc<CubeLdi>> {
        self.view.as_ref().map(TruthView::cube)
    }

    /// Takes over what a growing capture has become, and tells how far it is.
    fn grow(&mut self) -> Result<Option<CaptureStatus>, String> {
        let Some(growing) = &self.growing else {
            return Ok(None);
        };
        let newer = growing.capture.newer_than(self.cube());
        let error = growing.capture.take_error();
        let status = growing.capture.status();
        if let Some(newer) = newer {
            self.show(newer);
        }
        error.map_or_else(|| Ok(Some(status)), Err)
    }

    /// Work that is going on, and how far it is.
    fn ongoing(&self, status: &CaptureStatus) -> Option<Ongoing> {
        let growing = self.growing.as_ref().filter(|_| !status.ended)?;
        let [done, all] = status.rounds;
        Some(Ongoing::since(
            format!("capturing, round {} of {all}", done + 1),
            status.share,
            growing.begun,
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
        if let Some(growing) = &self.growing {
            let tip = format!(
                "Writes the LDI as captured so far to {}.",
                growing.file.display()
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
        let status = self.grow()?;
        let ongoing = status.and_then(|status| self.ongoing(&status));
        let Some(view) = &mut self.view else {
            if let Some(growing) = &mut self.growing {
                growing.points.paint(&request.camera, pixels);
            }
            return Ok(FrameReport {
                ongoing,
                refinement: Refinement::Later(LOOK_AGAIN),
                facts: vec![axes_fact(&self.place.frame)],
                ..FrameReport::default()
            });
        };
        let mut report = view::render(view, &mut self.threads, request, pixels)?;
        if ongoing.is_some() {
            report.refinement = Refinement::Later(LOOK_AGAIN);
        }
        // Truth is what one waits for if one asked for it.
        report.ongoing = report.ongoing.or(ongoing);
        Ok(report)
    }

    fn act(&mut self, action: &str) -> Result<String, String> {
        match &self.growing {
            Some(growing) if action == SAVE => {
                let newest = growing
                    .capture
                    .newer_than(self.cube())
                    .or_else(|| self.cube().cloned());
                let cube =
                    newest.ok_or("There is nothing to save before the first round is done.")?;
                cube.write(&growing.file)
                    .map_err(|error| error.to_string())?;
                let (count, face) = (cube.depth_pixel_count(), cube.face_size_px);
                Ok(format!(
                    "Saved {}: {count} depth pixels, faces of {face} px.",
                    growing.file.display()
                ))
            }
            _ => Err(format!(
                "\"{action}\" is not something that this view can do."
            )),
        }
    }
}
