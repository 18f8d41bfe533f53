//! View-dependent geometry of an image set as a [`View`].

use super::overlay::GeometryOverlay;
use super::{
    GeometryRenderer, GeometrySettings, GeometryStats, Texturing, TimeBudget, ViewGeometry,
    WaitPolicy,
};
use headbox_core::camera::Camera;
use headbox_core::color::tone::ToneMap;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::view::paint::{expose, figure};
use headbox_core::view::{
    EXPOSURE, FrameReport, FrameRequest, OVERLAY, RENDERING, Refinement, Rendered, Setting, Stage,
    StartView, Statistics, View,
};
use serde_json::json;
use std::time::Duration;

/// Name of the representation.
pub const KIND: &str = "view-dependent geometry";

/// Interval between two checks for newly decoded images.
const POLL_INTERVAL: Duration = Duration::from_millis(60);

/// Default time for a frame while the eye moves, ms: 30 frames per second.
const FRAME_MS: u32 = 33;

/// View of an image set rendered by view-dependent geometry.
pub struct GeometryView {
    geometry: ViewGeometry,
    renderer: GeometryRenderer,
    start: StartView,
    initial: GeometrySettings,
    budget: TimeBudget,
    painted: Frame,
    stats: GeometryStats,
}

impl GeometryView {
    /// Creates a view of `geometry` that starts at the camera `start` with the settings `initial`.
    pub fn new(geometry: ViewGeometry, start: &Camera, initial: GeometrySettings) -> Self {
        Self {
            geometry,
            renderer: GeometryRenderer::new(),
            start: StartView::from_camera(start),
            initial,
            budget: TimeBudget::new(f64::from(FRAME_MS)),
            painted: Frame::default(),
            stats: GeometryStats::default(),
        }
    }

    /// Returns the settings of the representation with their defaults.
    pub fn setting_table() -> Vec<Setting> {
        Self::settings_from(&GeometrySettings::default())
    }

    fn settings_from(initial: &GeometrySettings) -> Vec<Setting> {
        let selected = Texturing::ALL
            .iter()
            .position(|texturing| *texturing == initial.texturing)
            .unwrap_or(0);
        vec![
            Setting::choice_at(
                "texturing",
                "Texturing",
                "Texture of the mesh: the nearest image unwarped, the best image, the best image of each \
                 triangle's corners, these blended, or the mean of the best images that see a point (no unit).",
                &Texturing::ALL.map(Texturing::name),
                selected,
            )
            .with_flag("variant")
            .folded_under(RENDERING),
            Setting::count(
                "cameras",
                "Cameras",
                "Number of cameras whose depth samples make the mesh (no unit); fewer while the eye moves, to \
                 keep the frame time.",
                initial.cameras as u32,
                1..=1000,
            )
            .with_flag("cameras")
            .folded_under(RENDERING),
            Setting::count(
                "grid",
                "Grid",
                "Spacing of the mesh's nodes, pixels; larger while the eye moves, to keep the frame time.",
                initial.grid_px as u32,
                1..=256,
            )
            .with_flag("grid")
            .folded_under(RENDERING),
            Setting::count(
                "lod",
                "Level of detail",
                "Level of detail of the depth samples, each with a quarter of the samples of the one before (no \
                 unit).",
                initial.level,
                0..=3,
            )
            .with_flag("lod")
            .folded_under(RENDERING),
            Setting::count(
                "budget",
                "Frame time",
                "Time for a frame while the eye moves, ms: cameras, grid and detail are chosen by it. All that is asked for \
                 is drawn once the eye stands still.",
                FRAME_MS,
                1..=1000,
            ),
            Setting::choice(
                OVERLAY,
                "Overlay",
                "Content of the image: the frame, holes in magenta, the number of cameras that see a point, \
                 pixels by camera, pixels by the number of cameras that own a triangle, the mesh, or the age of \
                 loaded images.",
                &GeometryOverlay::ALL.map(GeometryOverlay::name),
            )
            .with_flag(OVERLAY),
            Setting::exposure(),
        ]
    }

    fn read_settings(&self, request: &FrameRequest) -> Result<GeometrySettings, String> {
        let values = &request.settings;
        let texturing = Texturing::ALL
            .get(values.choice("texturing")?)
            .copied()
            .unwrap_or(Texturing::ALL[0]);
        Ok(GeometrySettings {
            texturing,
            cameras: values.number("cameras")? as usize,
            grid_px: values.number("grid")? as f32,
            level: values.number("lod")? as u32,
            ..self.initial
        })
    }

    /// Returns warnings about the last frame, a sentence each.
    fn warnings(&self) -> Vec<String> {
        let nothing = (self.stats.cameras_valid == 0).then(|| self.geometry.nothing_seen());
        let lost = self.geometry.pictures.lost().into_iter();
        let lost = lost.map(|why| format!("{why}; other pictures serve instead"));
        let repaired = self.geometry.repaired();
        nothing.into_iter().chain(lost).chain(repaired).collect()
    }
}

impl View for GeometryView {
    fn kind(&self) -> &'static str {
        KIND
    }

    fn start(&self, _: [u32; 2]) -> StartView {
        self.start
    }

    fn file_frame(&self) -> FileFrame {
        self.geometry.frame
    }

    fn primitives(&self) -> (u64, &'static str) {
        (self.geometry.cameras().len() as u64, "cameras")
    }

    fn bytes(&self) -> u64 {
        self.geometry.bytes() as u64
    }

    fn settings(&self) -> Vec<Setting> {
        Self::settings_from(&self.initial)
    }

    fn render(&mut self, request: &FrameRequest) -> Result<Rendered<'_>, String> {
        let full = self.read_settings(request)?;
        self.budget.ms = request.settings.number("budget")?;
        let settings = if request.moving {
            self.budget.settings(&full)
        } else {
            full
        };
        let wait = if request.complete {
            WaitPolicy::Wait
        } else {
            WaitPolicy::Never
        };
        let (_, stats) = self
            .renderer
            .render(&self.geometry, &request.camera, &settings, wait);
        self.stats = stats;
        if request.moving {
            self.budget.took(stats.frame_ms);
        }
        let count = |name, value: u64| figure(name, value as f64, "");
        let stages = [
            ("rank", stats.rank_ms),
            ("fetch", stats.fetch_ms),
            ("fuse", stats.fuse_ms),
            ("mesh", stats.mesh_ms),
            ("texture", stats.texture_ms),
        ];
        let mut report = FrameReport {
            stages: stages.map(|(name, ms)| Stage { name, ms }).to_vec(),
            ms: stats.frame_ms,
            hole_pixels: stats.hole_pixels,
            figures: vec![
                count("cameras valid", stats.cameras_valid),
                count("cameras used", stats.cameras_used),
                count("pictures to come", stats.pictures_missing),
                count("samples projected", stats.samples),
                count("triangles drawn", stats.triangles),
                count("hole pixels", stats.hole_pixels),
                figure("grid", f64::from(settings.grid_px), "px"),
                figure("memory", self.bytes() as f64 / f64::from(1 << 20), "MiB"),
            ],
            warnings: self.warnings(),
            refinement: match stats.pictures_missing {
                0 => Refinement::Done,
                _ => Refinement::Later(POLL_INTERVAL),
            },
            ..FrameReport::default()
        };
        let overlay = GeometryOverlay::ALL
            .get(request.settings.choice(OVERLAY)?)
            .copied()
            .unwrap_or(GeometryOverlay::None);
        let stops = request.settings.number(EXPOSURE)?;
        if overlay == GeometryOverlay::None && stops == 0.0 {
            let frame = self.renderer.frame();
            return Ok(Rendered { frame, report });
        }
        self.painted.clone_from(self.renderer.frame());
        expose(&mut self.painted.color, ToneMap::SrgbClipped, stops);
        report.legend = overlay.paint(&self.geometry, &self.renderer, &mut self.painted.color);
        Ok(Rendered {
            frame: &self.painted,
            report,
        })
    }

    fn statistics(&mut self, _: &FrameRequest) -> Statistics {
        json!(self.stats)
    }
}
