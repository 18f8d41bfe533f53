//! A cube LDI that is replaced by finer ones while it is shown: captured in rounds, or made of
//! photographs.

use super::preview::Preview;
use super::progressive_capture::{CaptureOptions, CapturePlace, CaptureStatus, ProgressiveCapture};
use super::sun_settings::SunSettings;
use super::view;
use crate::facts::axes_fact;
use crate::file_name::file_name;
use crate::terms::TERMS;
use crate::threads::FewerThreads;
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, figure, triple};
use headbox_core::headbox::Headbox;
use headbox_core::light_parameters::LightParameters;
use headbox_core::view::StartView;
use headbox_cube::pack::CubeLdi;
use headbox_cube::view::CubeView;
use headbox_ldi::scene_source::SceneSource;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::viewpoint::suggest_view;
use headbox_viewer::{
    EyeBounds, Fact, FrameReport, FrameRequest, FrameSource, HeadboxRequest, Headboxes, Ongoing,
    Pose, Refinement, Setting,
};
use headbox_views::TruthView;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Source of a cube LDI that is replaced by [`Self::show`] or by its own capture.
pub(super) struct CubeSource {
    title: String,
    /// Headboxes with a cube, and the one that is being captured.
    headboxes: Vec<ShownHeadbox>,
    /// Index of the headbox that is shown.
    shown: usize,
    threads: FewerThreads,
    live: Option<LiveCapture>,
}

/// A headbox and its cube.
struct ShownHeadbox {
    place: Place,
    /// View of the latest cube; `None` until there is one.
    view: Option<TruthView>,
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

impl Place {
    /// The place of a capture, looking toward what there is to see.
    fn of_capture(found: &CapturePlace) -> Self {
        let Headbox {
            centre,
            half_size_m,
        } = found.headbox;
        Self {
            centre,
            half_size_m,
            ahead: suggest_view(&found.tracer, centre),
            up: DVec3::Y,
            frame: found.tracer.scene().frame,
        }
    }

    fn bounds(&self) -> EyeBounds {
        EyeBounds {
            centre: self.centre,
            half_size: DVec3::splat(self.half_size_m),
        }
    }
}

/// A capture that runs while cube LDIs are shown.
struct LiveCapture {
    source: SceneSource,
    options: CaptureOptions,
    capture: ProgressiveCapture,
    /// True if the capture has all rays of `headbox capture`, as the user asked in the window.
    is_best: bool,
    /// Index of the headbox that is captured.
    index: usize,
    begun: Instant,
    /// The scene in the light in which it was opened.
    opened: Arc<Scene>,
    sun: SunSettings,
    /// Light and quality ([`Self::is_best`]) of the latest request, and when they changed.
    requested: (LightParameters, bool, Instant),
    /// True if the cube that is shown is in another light than the one that is captured.
    shows_old_light: bool,
    tracer: Arc<Tracer>,
    /// Preview of the scene before the first cube and outside of the headbox.
    preview: Preview,
    /// Warning about the first headbox.
    warning: Option<String>,
    /// Start of the names of saved files.
    stem: String,
}

impl LiveCapture {
    /// Choice of the quality; `None` if the scene was opened in the best one.
    fn quality_setting(&self) -> Option<Setting> {
        let tip = "Rays of the capture: as the scene was opened, by default a fifth of those of \
                   headbox capture in about a minute; or all of them (--quality best), which is \
                   what to save as a file. The headbox that is shown is captured again.";
        let options = ["fast", "best"];
        let is_best = self.options.quality == Some(CaptureOptions::BEST);
        (!is_best).then(|| Setting::choice(QUALITY, "Quality", tip, &options))
    }

    /// Restarts the capture in another place, light or quality; only its last round if
    /// `only_last`. Also returns a warning about the headbox.
    fn restart(
        &mut self,
        scene: &Arc<Scene>,
        centre: DVec3,
        half_size_m: f64,
        only_last: bool,
    ) -> Result<(Place, Option<String>), String> {
        let frame = scene.frame;
        let options = CaptureOptions {
            centre: Some(frame.file_from_world(centre)),
            half_size: Some(half_size_m / frame.unit_m),
            quality: if self.is_best {
                Some(CaptureOptions::BEST)
            } else {
                self.options.quality
            },
            ..self.options
        };
        let (capture, found) =
            ProgressiveCapture::restart(scene, &self.source, &options, only_last)?;
        let place = Place::of_capture(&found);
        self.capture = capture;
        self.begun = Instant::now();
        self.preview = Preview::new(Arc::clone(&found.tracer));
        self.tracer = found.tracer;
        self.shows_old_light = false;
        Ok((place, found.warning))
    }
}

/// Id of the choice of the quality.
const QUALITY: &str = "quality";

/// Id of the button that saves the LDI.
const SAVE: &str = "save";

/// Interval between two polls of a live capture.
const POLL: Duration = Duration::from_millis(250);

/// Time for which light must not have changed before it is captured.
const SETTLED: Duration = Duration::from_millis(500);

impl CubeSource {
    /// Starts the capture of a scene.
    ///
    /// # Errors
    /// One sentence if the scene cannot be opened or captured.
    pub(super) fn capture(source: SceneSource, options: CaptureOptions) -> Result<Self, String> {
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
        let (capture, found) = ProgressiveCapture::start(&source, &options)?;
        let place = Place::of_capture(&found);
        let opened = Arc::clone(found.tracer.scene());
        let live = LiveCapture {
            sun: SunSettings::new(&opened, &source.light),
            opened,
            requested: (source.light.clone(), false, Instant::now()),
            shows_old_light: false,
            source,
            options,
            capture,
            is_best: false,
            index: 0,
            begun: Instant::now(),
            preview: Preview::new(Arc::clone(&found.tracer)),
            tracer: found.tracer,
            warning: found.warning,
            stem,
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
            headboxes: vec![ShownHeadbox { place, view: None }],
            shown: 0,
            threads: FewerThreads::default(),
            live: None,
        }
    }

    /// Replaces the cube of the shown headbox.
    pub(super) fn show(&mut self, cube: impl Into<Arc<CubeLdi>>) {
        self.show_at(self.shown, cube.into());
    }

    /// Replaces the cube of a headbox.
    fn show_at(&mut self, index: usize, cube: Arc<CubeLdi>) {
        let view = &mut self.headboxes[index].view;
        if let Some(live) = self.live.as_mut().filter(|live| live.shows_old_light) {
            live.shows_old_light = false;
            *view = None;
        }
        match (&mut *view, &self.live) {
            (Some(view), _) => view.show(cube),
            (None, Some(live)) => {
                let scene = Arc::new(live.capture.lit_scene());
                *view = Some(TruthView::with_scene(cube, scene));
            }
            (None, None) => *view = Some(TruthView::new(cube)),
        }
    }

    fn place(&self) -> &Place {
        &self.headboxes[self.shown].place
    }

    fn cube(&self, index: usize) -> Option<&Arc<CubeLdi>> {
        self.headboxes[index].view.as_ref().map(TruthView::cube)
    }

    /// Shows the latest cube of a live capture, and returns the capture's status.
    fn update(&mut self) -> Result<Option<CaptureStatus>, String> {
        let Some(live) = &self.live else {
            return Ok(None);
        };
        let index = live.index;
        // In this order, or the last cube could be missed: it is there before the capture ends.
        let status = live.capture.status();
        let error = live.capture.take_error();
        let newer = live.capture.newer_than(self.cube(index));
        if let Some(newer) = newer {
            self.show_at(index, newer);
        }
        error.map_or_else(|| Ok(Some(status)), Err)
    }

    /// Starts the capture of another headbox, and shows it. The earlier ones keep their latest
    /// cubes; the one that was being captured is not refined further, and dropped without a cube.
    fn capture_headbox(&mut self, centre: DVec3, half_size_m: f64) -> Result<String, String> {
        self.update()?;
        let Some(live) = &mut self.live else {
            return Err("Only a scene can be captured here.".into());
        };
        let scene = Arc::clone(live.tracer.scene());
        let same = |h: &ShownHeadbox| {
            let known = Headbox {
                centre: h.place.centre,
                half_size_m: h.place.half_size_m,
            };
            known
                == Headbox {
                    centre,
                    half_size_m,
                }
        };
        if let Some(index) = self.headboxes.iter().position(same) {
            self.shown = index;
            return Ok(format!(
                "This is headbox {}, which is captured already.",
                index + 1
            ));
        }
        let (place, warning) = live.restart(&scene, centre, half_size_m, false)?;
        if self.headboxes[live.index].view.is_none() {
            self.headboxes.remove(live.index);
        }
        self.headboxes.push(ShownHeadbox { place, view: None });
        self.shown = self.headboxes.len() - 1;
        live.index = self.shown;
        let here = format!(
            "Capturing --center {} --half-size {} (in the file's axes and unit).",
            triple(scene.frame.file_from_world(place.centre)),
            figure(place.half_size_m / scene.frame.unit_m)
        );
        Ok(warning.map_or(here.clone(), |warning| format!("{here} But {warning}.")))
    }

    /// Captures the shown headbox again once the light or the quality of the requests has changed
    /// and settled. Its cube is shown until there is one in the new light, or a finer one. Returns
    /// true if new values have not settled.
    fn follow_settings(&mut self, request: &FrameRequest) -> Result<bool, String> {
        let Some(live) = &mut self.live else {
            return Ok(false);
        };
        let light = live.sun.light(&request.settings)?;
        let is_best = live.quality_setting().is_some() && request.settings.choice(QUALITY)? == 1;
        let (requested_light, requested_best, since) = &mut live.requested;
        if (&*requested_light, *requested_best) != (&light, is_best) {
            *requested_light = light.clone();
            *requested_best = is_best;
            *since = Instant::now();
        }
        let is_relit = light != live.source.light;
        if !is_relit && is_best == live.is_best {
            return Ok(false);
        }
        if since.elapsed() < SETTLED {
            return Ok(true);
        }
        let ShownHeadbox { place, view } = &self.headboxes[self.shown];
        let (place, has_cube) = (*place, view.is_some());
        let scene = if is_relit {
            let mut scene = Scene::clone(&live.opened);
            if let Err(error) = scene.set_light(&live.sun.change_to(&light)) {
                live.requested.2 = Instant::now(); // tries again later
                return Err(error.to_string());
            }
            live.source.light = light;
            Arc::new(scene)
        } else {
            Arc::clone(live.tracer.scene())
        };
        live.is_best = is_best;
        let was_old = live.shows_old_light;
        let keeps_cube = has_cube && !is_relit && !was_old;
        live.restart(&scene, place.centre, place.half_size_m, keeps_cube)?;
        let before = std::mem::replace(&mut live.index, self.shown);
        live.shows_old_light = has_cube && !keeps_cube;
        if before != self.shown && self.headboxes[before].view.is_none() {
            self.headboxes.remove(before);
            if before < self.shown {
                self.shown -= 1;
                live.index = self.shown;
            }
        }
        Ok(false)
    }

    fn show_headbox(&mut self, index: usize) -> Result<String, String> {
        if index >= self.headboxes.len() {
            return Err(format!("There is no headbox {}.", index + 1));
        }
        self.shown = index;
        Ok(format!("Headbox {} is shown.", index + 1))
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
            eye: self.place().centre,
            forward: self.place().ahead,
            up: self.place().up,
            fov_y_deg: 60.0,
        })
    }

    fn bounds(&self) -> Option<EyeBounds> {
        Some(self.place().bounds())
    }

    fn headboxes(&self) -> Option<Headboxes> {
        self.live.as_ref()?;
        Some(Headboxes {
            bounds: self.headboxes.iter().map(|h| h.place.bounds()).collect(),
            shown: self.shown,
        })
    }

    fn request_headbox(&mut self, request: HeadboxRequest) -> Result<String, String> {
        match request {
            HeadboxRequest::Capture {
                centre,
                half_size_m,
            } => self.capture_headbox(centre, half_size_m),
            HeadboxRequest::Show(index) => self.show_headbox(index),
        }
    }

    fn notes(&self) -> Vec<String> {
        let Some(live) = &self.live else {
            return Vec::new();
        };
        let warning = live.warning.iter().map(|text| format!("Warning: {text}."));
        let notes = &live.tracer.scene().summary.notes;
        warning
            .chain(notes.iter().map(|note| format!("{note}.")))
            .collect()
    }

    fn file_frame(&self) -> FileFrame {
        self.place().frame
    }

    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        &TERMS
    }

    fn settings(&self) -> Vec<Setting> {
        let mut settings = view::settings(TruthView::setting_table());
        if let Some(live) = &self.live {
            settings.extend(live.sun.settings());
            let tip = "Writes the LDI of the shown headbox as captured so far.";
            let save = Setting::save(SAVE, "Save as .ldi", tip, &live.stem, "ldi");
            let of_capture = live.quality_setting().into_iter().chain([save]);
            settings.extend(of_capture.map(|setting| setting.under("Capture")));
        }
        settings
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let is_settling = self.follow_settings(request)?;
        let status = self.update()?;
        let ongoing = status.and_then(|status| self.ongoing(&status));
        let polls = ongoing.is_some() || is_settling;
        let ShownHeadbox { place, view } = &mut self.headboxes[self.shown];
        let is_outside = !place.bounds().contains(request.camera.eye());
        let mut report = match (view, &mut self.live) {
            (Some(view), None) => view::render(view, &mut self.threads, request, pixels)?,
            (Some(view), Some(_)) if !is_outside => {
                view::render(view, &mut self.threads, request, pixels)?
            }
            (view, Some(live)) => {
                live.preview.paint(&request.camera, pixels);
                let text = if view.is_some() {
                    "the scene without light: the eye is outside of the headbox"
                } else {
                    "the scene without light, until the first round is captured"
                };
                let shown = Fact {
                    name: "shown",
                    text: text.into(),
                };
                FrameReport {
                    facts: vec![shown, axes_fact(&place.frame)],
                    ..FrameReport::default()
                }
            }
            // Nothing to show: the owner replaces the cube soon.
            (None, None) => {
                pixels.fill([0; 4]);
                FrameReport {
                    refinement: Refinement::Later(POLL),
                    facts: vec![axes_fact(&place.frame)],
                    ..FrameReport::default()
                }
            }
        };
        if polls {
            report.refinement = Refinement::Later(POLL);
        }
        // The progress of truth, if it is shown, has priority.
        report.ongoing = report.ongoing.or(ongoing);
        Ok(report)
    }

    fn save(&mut self, id: &str, file: &Path) -> Result<String, String> {
        match &self.live {
            Some(live) if id == SAVE => {
                let shown = self.cube(self.shown);
                let newer = (live.index == self.shown).then(|| live.capture.newer_than(shown));
                let newest = newer.flatten().or_else(|| shown.cloned());
                let cube =
                    newest.ok_or("There is nothing to save before the first round is done.")?;
                cube.write(file).map_err(|error| error.to_string())?;
                let (count, face) = (cube.depth_pixel_count(), cube.face_size_px);
                let light = if cube.info.light == live.requested.0 {
                    ""
                } else {
                    " Its light is that before the latest change."
                };
                let is_best = (cube.face_size_px, cube.info.parameters) == CaptureOptions::BEST;
                let rays = if is_best {
                    ""
                } else {
                    " It has fewer rays than headbox capture takes; for all of them, choose \
                     Quality \"best\" and save at the end."
                };
                Ok(format!(
                    "Saved {}: {count} depth pixels, faces of {face} px.{light}{rays}",
                    file.display()
                ))
            }
            _ => Err(format!("\"{id}\" is nothing that this view can save.")),
        }
    }
}
