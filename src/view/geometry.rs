//! A folder of images with depth in the window: view-dependent geometry, made anew for each frame.

use super::background::FewerThreads;
use super::overlay::{Overlay, paint_holes};
use crate::capture::Camera;
use crate::capture::scene::FileFrame;
use crate::view_geometry::{GeometryRenderer, GeometrySettings, GeometryStats, Patience, Texturing, ViewGeometry};
use headbox_viewer::{Control, Fact, Figure, FrameReport, FrameRequest, FrameSource, Pose, Refinement, Setting, Stage};
use std::time::Duration;

/// How long the thread that decodes pictures is left to itself between two looks for what it has.
const LOOK_AGAIN: Duration = Duration::from_millis(60);

/// What the pixels show: the frame, or where it has holes.
const OVERLAYS: [&str; 2] = ["none", "holes"];

/// Cameras, and growth of the grid's spacing, while the eye moves: a preview (E11).
const PREVIEW: (usize, f32) = (4, 1.5);

/// Images, walked through from camera to camera and between them.
pub(super) struct GeometrySource {
    title: String,
    geometry: ViewGeometry,
    renderer: GeometryRenderer,
    start: Pose,
    initial: GeometrySettings,
    threads: FewerThreads,
}

impl GeometrySource {
    pub(super) fn new(title: String, geometry: ViewGeometry, start: &Camera, initial: GeometrySettings) -> Self {
        let (start, renderer) = (super::start_at(start), GeometryRenderer::new());
        Self { title, geometry, renderer, start, initial, threads: FewerThreads::default() }
    }

    fn settings_of(&self, request: &FrameRequest) -> Result<GeometrySettings, String> {
        let (_, texturing) =
            Texturing::ALL.get(request.settings.choice("texturing")?).copied().unwrap_or(Texturing::ALL[0]);
        let mut settings = GeometrySettings {
            texturing,
            cameras: request.settings.number("cameras")? as usize,
            grid_px: request.settings.number("grid")? as f32,
            hole_color_srgb: [0; 3],
            ..self.initial
        };
        if request.moving {
            settings.cameras = settings.cameras.min(PREVIEW.0);
            settings.grid_px *= PREVIEW.1;
        }
        Ok(settings)
    }
}

impl FrameSource for GeometrySource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        self.start
    }

    fn file_frame(&self) -> FileFrame {
        self.geometry.frame
    }

    fn settings(&self) -> Vec<Setting> {
        let options = Texturing::ALL.map(|(name, _)| name.to_owned()).to_vec();
        let selected =
            Texturing::ALL.iter().position(|(_, texturing)| *texturing == self.initial.texturing).unwrap_or(0);
        vec![
            Setting::new(
                "texturing",
                "Texturing",
                "Whose picture colours the mesh: the nearest as it is, the best alone, the best of each triangle's corners, these \
                 blended, or the mean of the best that see a point (no unit).",
                Control::Choice { options, selected },
            ),
            Setting::count(
                "cameras",
                "Cameras",
                "Cameras whose depth makes the mesh (no unit); a few while the eye moves.",
                self.initial.cameras as u32,
                1..=64,
            ),
            Setting::count(
                "grid",
                "Grid",
                "Pixels between the mesh's nodes; more while the eye moves.",
                self.initial.grid_px as u32,
                1..=32,
            ),
            Setting::choice("overlay", "Overlay", "What is painted: the frame, or its holes in magenta.", &OVERLAYS),
            FewerThreads::setting(),
        ]
    }

    fn render(&mut self, request: &FrameRequest, pixels: &mut [[u8; 4]]) -> Result<FrameReport, String> {
        let settings = self.settings_of(request)?;
        let Self { geometry, renderer, threads, .. } = self;
        let draw = || renderer.render(geometry, &request.camera, &settings, Patience::Never).1;
        let stats = threads.install(&request.settings, draw)?;
        let legend = match OVERLAYS.get(request.settings.choice("overlay")?) {
            Some(&"holes") => {
                paint_holes(renderer.frame(), pixels);
                Overlay::Holes.legend()
            }
            _ => {
                pixels.copy_from_slice(&renderer.frame().color);
                Vec::new()
            }
        };
        let mut facts = vec![super::facts::simd_fact()];
        if stats.cameras_valid == 0 {
            facts.push(Fact { name: "nothing", text: geometry.nothing_seen() });
        }
        facts.extend(geometry.lost().first().map(|why| Fact { name: "lost", text: why.clone() }));
        let refinement = match stats.pictures_missing {
            0 => Refinement::Done,
            _ => Refinement::Later(LOOK_AGAIN),
        };
        let mut figures = figures(&stats);
        figures.push(figure("memory", geometry.bytes() as f64 / f64::from(1 << 20), "MiB"));
        Ok(FrameReport { stages: stages(&stats), figures, facts, legend, refinement, ongoing: None })
    }
}

fn stages(stats: &GeometryStats) -> Vec<Stage> {
    let stage = |name, ms| Stage { name, ms };
    vec![
        stage("rank", stats.rank_ms),
        stage("fuse", stats.fuse_ms),
        stage("mesh", stats.mesh_ms),
        stage("texture", stats.texture_ms),
    ]
}

fn figure(name: &'static str, value: f64, unit: &'static str) -> Figure {
    Figure { name, value, unit }
}

fn figures(stats: &GeometryStats) -> Vec<Figure> {
    vec![
        figure("cameras valid", stats.cameras_valid as f64, ""),
        figure("cameras used", stats.cameras_used as f64, ""),
        figure("pictures to come", stats.pictures_missing as f64, ""),
        figure("samples projected", stats.samples as f64, ""),
        figure("triangles drawn", stats.triangles as f64, ""),
        figure("hole pixels", stats.hole_pixels as f64, ""),
    ]
}
