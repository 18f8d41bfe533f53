//! A cube LDI in the window, from a file or growing.

use super::points::Points;
use super::progressive_capture::{CaptureStatus, LitScene, ProgressiveCapture};
use crate::background::FewerThreads;
use crate::facts::{axes_fact, simd_fact};
use crate::file_name::file_name;
use crate::overlays::effort;
use crate::overlays::overlay::{
    Overlay, TruthComparison, paint_coverage, paint_epipole, paint_holes,
};
use crate::overlays::variation::{FACE_NAMES, Variation, Variations};
use crate::terms::TERMS;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{FrameStats, RenderSettings, Renderer};
use headbox_ldi::scene_source::SceneSource;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::viewpoint::suggest_view;
use headbox_viewer::{
    EyeBounds, Figure, FrameReport, FrameRequest, FrameSource, Ongoing, Pose, Refinement, Setting,
    SettingValues, Stage,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A cube LDI, shown from anywhere inside its headbox.
pub(super) struct CubeSource {
    title: String,
    /// None until a growing one has had its first round.
    cube: Option<Arc<CubeLdi>>,
    place: Place,
    variations: Variations,
    renderer: Renderer,
    threads: FewerThreads,
    judge: TruthComparison,
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
    pub(super) fn from_file(cube: CubeLdi, file: &Path) -> Self {
        let title = format!("{} (cube LDI)", file_name(file));
        let info = &cube.info;
        let ahead = info.ahead.unwrap_or_else(|| richest_side(&cube));
        let up = headbox_trace::viewpoint::level_up(info.up);
        let place = Place {
            centre: info.centre,
            half_size_m: info.half_size_m,
            ahead,
            up,
            frame: info.frame,
        };
        Self::new(title, place, Some(Arc::new(cube)), None)
    }

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
            None,
            Some(Growing {
                capture,
                begun,
                points,
                file,
            }),
        ))
    }

    /// A cube that [`Self::show`] will bring.
    pub(super) fn to_come(title: String, place: Place) -> Self {
        Self::new(title, place, None, None)
    }

    fn new(
        title: String,
        place: Place,
        cube: Option<Arc<CubeLdi>>,
        growing: Option<Growing>,
    ) -> Self {
        let (variations, renderer, judge) = (
            Variations::default(),
            Renderer::new(),
            TruthComparison::default(),
        );
        Self {
            title,
            cube,
            place,
            variations,
            renderer,
            threads: FewerThreads::default(),
            judge,
            growing,
        }
    }

    /// Shows another cube instead.
    pub(super) fn show(&mut self, cube: CubeLdi) {
        self.cube = Some(Arc::new(cube));
        self.variations.clear();
    }

    /// Takes over what a growing capture has become, and tells how far it is.
    fn grow(&mut self) -> Result<Option<CaptureStatus>, String> {
        let Some(growing) = &self.growing else {
            return Ok(None);
        };
        if let Some(newer) = growing.capture.newer_than(self.cube.as_ref()) {
            self.cube = Some(newer);
            self.variations.clear();
        }
        growing
            .capture
            .take_error()
            .map_or_else(|| Ok(Some(growing.capture.status())), Err)
    }

    /// Returns a loader of the scene that an LDI was captured from.
    fn scene(&self, cube: &CubeLdi) -> impl FnOnce() -> Result<LitScene, String> + Send + 'static {
        let in_hand = self
            .growing
            .as_ref()
            .map(|growing| growing.capture.lit_scene());
        let info = cube.info.clone();
        move || match in_hand {
            Some(scene) => scene(),
            None => reopen(&info),
        }
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

/// Further figures, and whether the picture can become better.
type OverlayReport = (Vec<Figure>, Refinement);

/// Paints a frame with its overlay.
fn paint(
    judge: &mut TruthComparison,
    frame: &Frame,
    request: &FrameRequest,
    overlay: Overlay,
    scene: impl FnOnce() -> Result<LitScene, String> + Send + 'static,
    pixels: &mut [[u8; 4]],
) -> Result<OverlayReport, String> {
    match overlay {
        Overlay::Holes => paint_holes(frame, pixels),
        Overlay::Coverage => paint_coverage(frame, pixels),
        _ => pixels.copy_from_slice(&frame.color),
    }
    if overlay.needs_truth() && !request.moving {
        return judge.paint(overlay, frame, &request.camera, scene, pixels);
    }
    judge.rest();
    Ok((Vec::new(), Refinement::Done))
}

/// Paints how the frame that was drawn last was made, if that is what the overlay shows.
fn paint_effort(
    renderer: &mut Renderer,
    cube: &CubeLdi,
    camera: &Camera,
    settings: &RenderSettings,
    overlay: Overlay,
    pixels: &mut [[u8; 4]],
) -> Vec<Figure> {
    match overlay {
        Overlay::Footprints => {
            effort::paint_footprints(&renderer.overdraw(cube, camera, settings), pixels)
        }
        Overlay::Overdraw => {
            effort::paint_overdraw(&renderer.overdraw(cube, camera, settings), pixels)
        }
        Overlay::Clipping => {
            let clipped = renderer.clipped_segments(cube, camera, settings);
            effort::paint_clipping(cube, &clipped, renderer.frame(), pixels)
        }
        _ => Vec::new(),
    }
}

/// Opens the scene that an LDI names, with the light it was captured in; where that comes from is
/// not learnt yet.
fn reopen(info: &CaptureInfo) -> Result<LitScene, String> {
    let source = SceneSource::in_frame(&info.scene, info.frame).lit_by(info.light.clone());
    let scene = source
        .open()
        .map_err(|error| format!("Truth needs the scene that was captured: {error}."))?;
    let tracer = Arc::new(Tracer::new(Arc::new(scene), info.centre));
    let lit = info.parameters.light_samples > 0;
    let bounces = info.parameters.bounces;
    let mut lighting = if lit {
        Lighting::measure(&tracer, bounces)
    } else {
        Lighting::prepare(&tracer, bounces, false)
    };
    lighting.exposure = info.exposure;
    Ok(LitScene {
        tracer,
        lighting: Arc::new(lighting),
        lit,
        guided: false,
    })
}

fn render_settings(values: &SettingValues) -> Result<RenderSettings, String> {
    let kernel = SplatKernel::ALL
        .get(values.choice("kernel")?)
        .copied()
        .unwrap_or_default();
    let unclipped = !values.toggle("clip")?;
    Ok(RenderSettings {
        kernel,
        unclipped,
        ..RenderSettings::default()
    })
}

fn variation(values: &SettingValues, overlay: Overlay) -> Result<Variation, String> {
    let mut faces = [true; 6];
    for (shown, (id, _)) in faces.iter_mut().zip(FACE_NAMES) {
        *shown = values.toggle(id)?;
    }
    let (near, far, planes) = (
        values.toggle("near")?,
        values.toggle("far")?,
        values.toggle("planes")?,
    );
    Ok(Variation {
        faces,
        near,
        far,
        planes,
        meaning: overlay.meaning(),
    })
}

/// The level direction toward the side of the cube that has the most to show; ahead (-Z) if there
/// is none.
fn richest_side(cube: &CubeLdi) -> DVec3 {
    let depth_pixels = |side: Face| -> usize {
        cube.segments
            .iter()
            .filter(|s| s.face == side)
            .map(|s| s.depth_pixels.len())
            .sum()
    };
    let sides = [Face::PosX, Face::NegX, Face::PosZ, Face::NegZ];
    sides
        .into_iter()
        .max_by_key(|&side| depth_pixels(side))
        .map_or(DVec3::NEG_Z, Face::normal)
}

impl FrameSource for CubeSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        Pose::upright(
            self.place.centre,
            self.place.centre + self.place.ahead,
            self.place.up,
            60.0,
        )
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
        let kernels = SplatKernel::ALL.map(SplatKernel::name);
        let overlays = Overlay::ALL.map(|(name, _)| name);
        let mut settings = vec![
            Setting::choice(
                "kernel",
                "Footprints",
                "How samples become pixels (no unit).",
                &kernels,
            ),
            Setting::choice(
                "overlay",
                "Overlay",
                "What is painted: the frame; its holes in magenta; the share of each pixel that splats cover (black 0 to \
                 white 1); the depth pixels coloured by their distance from the centre of the headbox (red near, blue \
                 far), layer (orange first), face, or near and far segment; the width of the footprint in front (px); how \
                 often each pixel was drawn (a number); what clipping left out, on the unfolded faces; the ray-traced truth \
                 of this view; the frame's error against it (FLIP, black 0 to yellow 1). The last two are refined while the \
                 eye rests.",
                &overlays,
            ),
            Setting::toggle(
                "clip",
                "Clipping",
                "Leaves out what is known to be outside the view; without it every depth pixel is warped, for the same frame.",
                true,
            ),
            FewerThreads::setting(),
            Setting::toggle(
                "epipole",
                "Epipole",
                "Marks where the centre of the headbox projects to: a cross ahead of the eye, a ring behind it.",
                false,
            ),
        ];
        let part = |id, label: &str| {
            Setting::toggle(
                id,
                label,
                "Draws this part of the LDI; holes show where nothing else is.",
                true,
            )
            .folded_under("Parts")
        };
        settings.extend(FACE_NAMES.map(|(id, name)| part(id, &format!("Face {name}"))));
        settings.extend([
            part("near", "Near segments"),
            part("far", "Far segments"),
            part("planes", "Pictures on planes"),
        ]);
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
        let settings = render_settings(&request.settings)?;
        let overlay = Overlay::ALL
            .get(request.settings.choice("overlay")?)
            .map_or(Overlay::None, |&(_, o)| o);
        let status = self.grow()?;
        let ongoing = status.and_then(|status| self.ongoing(&status));
        let Some(whole) = self.cube.clone() else {
            if let Some(growing) = &mut self.growing {
                growing.points.paint(&request.camera, pixels);
            }
            let refinement = Refinement::Later(LOOK_AGAIN);
            return Ok(FrameReport {
                ongoing,
                refinement,
                facts: vec![axes_fact(&self.place.frame)],
                ..FrameReport::default()
            });
        };
        let scene = self.scene(&whole);
        let cube = self
            .variations
            .of(&whole, &variation(&request.settings, overlay)?);
        let renderer = &mut self.renderer;
        let (frame, stats) = self.threads.install(&request.settings, || {
            renderer.render_with_stats(&cube, &request.camera, &settings)
        })?;
        let (stages, mut figures) = (stages(stats), figures(stats, &cube));
        let (judged, mut refinement) =
            paint(&mut self.judge, frame, request, overlay, scene, pixels)?;
        let inspected = self.threads.install(&request.settings, || {
            paint_effort(renderer, &cube, &request.camera, &settings, overlay, pixels)
        })?;
        // What was asked for stands on top.
        figures.splice(0..0, judged.into_iter().chain(inspected));
        if request.settings.toggle("epipole")? {
            paint_epipole(&request.camera, cube.info.centre, pixels);
        }
        if ongoing.is_some() {
            refinement = Refinement::Later(LOOK_AGAIN);
        }
        // Truth is what one waits for if one asked for it.
        let ongoing = self.judge.ongoing(overlay).or(ongoing);
        let facts = vec![simd_fact(), axes_fact(&self.place.frame)];
        Ok(FrameReport {
            stages,
            figures,
            facts,
            refinement,
            legend: overlay.legend(),
            ongoing,
        })
    }

    fn act(&mut self, action: &str) -> Result<String, String> {
        match &self.growing {
            Some(growing) if action == SAVE => {
                let newest = growing
                    .capture
                    .newer_than(self.cube.as_ref())
                    .or_else(|| self.cube.clone());
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

fn stages(stats: &FrameStats) -> Vec<Stage> {
    let times = [
        ("clear", stats.clear_ms),
        ("warp", stats.warp_ms),
        ("finish", stats.finish_ms),
    ];
    times.map(|(name, ms)| Stage { name, ms }).to_vec()
}

fn figures(stats: &FrameStats, cube: &CubeLdi) -> Vec<Figure> {
    let counts = [
        ("depth pixels", cube.depth_pixel_count() as u64),
        ("of these in the loop", stats.depth_pixels_in),
        ("splatted", stats.splatted),
        ("of about 1 px", stats.by_footprint[0]),
        ("of about 3 px", stats.by_footprint[1]),
        ("of about 5 px", stats.by_footprint[2]),
        ("of 7 px or more", stats.by_footprint[3]),
        ("hole pixels", stats.hole_pixels),
        ("face size", cube.face_size_px.into()),
    ];
    counts
        .map(|(name, value)| Figure {
            name,
            value: value as f64,
            unit: if name == "face size" { "px" } else { "" },
        })
        .to_vec()
}
