//! A lumigraph as a [`View`], with one or several light slabs.

use crate::{Blend, LumigraphOverlay, LumigraphSettings, LumigraphStats, Slabs, SlabsRenderer};
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::view::paint::{expose, figure};
use headbox_core::view::{
    EXPOSURE, FrameReport, FrameRequest, OVERLAY, RENDERING, Rendered, Setting, SettingValues,
    Stage, StartView, Statistics, View, level_up,
};
use serde_json::json;

/// Name of the representation.
pub const KIND: &str = "lumigraph";

/// A lumigraph with its renderer.
pub struct LumigraphView {
    slabs: Slabs,
    renderer: SlabsRenderer,
    painted: Frame,
    stats: LumigraphStats,
}

impl LumigraphView {
    /// Creates a view of `slabs`.
    pub fn new(slabs: Slabs) -> Self {
        Self {
            slabs,
            renderer: SlabsRenderer::new(),
            painted: Frame::default(),
            stats: LumigraphStats::default(),
        }
    }

    /// The light slabs.
    pub fn slabs(&self) -> &Slabs {
        &self.slabs
    }

    /// Settings of all lumigraph views.
    pub fn setting_table() -> Vec<Setting> {
        let defaults = LumigraphSettings::default();
        vec![
            Setting::choice(
                OVERLAY,
                "Overlay",
                "Content of the image: colours, the stored layer of each pixel, the merged layers of this frame, \
                 or the cameras blended in each pixel (no unit).",
                &LumigraphOverlay::ALL.map(LumigraphOverlay::name),
            )
            .with_flag(OVERLAY),
            Setting::choice(
                "blend",
                "Blend",
                "Blending of a surface that only some cameras see: weighted by their share of the pixel, or \
                 opaque as in the paper (no unit).",
                &Blend::ALL.map(Blend::name),
            )
            .with_flag("variant")
            .folded_under(RENDERING),
            Setting::number(
                "merge",
                "Merge layers",
                "Maximum disagreement of two neighbouring cameras about a point in merged layers, pixels of an \
                 image or of the frame, whichever is larger; 0 merges none.",
                defaults.tolerance_px,
                0.0..=16.0,
                "px",
            )
            .with_flag("merge")
            .folded_under(RENDERING),
            Setting::toggle(
                "levels",
                "Levels of detail",
                "Takes coarser images where the frame is coarser.",
                defaults.levels,
            )
            .folded_under(RENDERING),
            Setting::toggle(
                "skip",
                "Skip rectangles",
                "Leaves layers out that show in no rectangle of the images where a block of the frame would find them; the \
                 frame is the same.",
                defaults.skip,
            )
            .folded_under(RENDERING),
            Setting::exposure(),
        ]
    }
}

fn lumigraph_settings(values: &SettingValues) -> Result<LumigraphSettings, String> {
    let tolerance_px = values.number("merge")?;
    Ok(LumigraphSettings {
        merge: tolerance_px > 0.0,
        tolerance_px,
        levels: values.toggle("levels")?,
        skip: values.toggle("skip")?,
        blend: Blend::ALL
            .get(values.choice("blend")?)
            .copied()
            .unwrap_or_default(),
        show: LumigraphOverlay::ALL
            .get(values.choice(OVERLAY)?)
            .copied()
            .unwrap_or_default(),
        ..LumigraphSettings::default()
    })
}

impl View for LumigraphView {
    fn kind(&self) -> &'static str {
        KIND
    }

    /// Returns the view from the middle of the grid, with the field of view that the cameras there
    /// cover.
    fn start(&self, size_px: [u32; 2]) -> StartView {
        let first = self.slabs.first();
        let grid = first.grid();
        let [column, row] = [grid.columns().len() / 2, grid.rows().len() / 2];
        let camera = grid.camera(column, row);
        StartView {
            eye: grid.origin(),
            forward: camera.forward(),
            up: level_up(Some(camera.world_from_eye().y_axis)),
            fov_y_deg: first.clear_fov_deg(size_px),
        }
    }

    fn speed_m_per_s(&self) -> f64 {
        let first = self.slabs.first();
        let grid = first.grid();
        let across = |places: &[f64]| places[places.len() - 1] - places[0];
        // With a single camera only the depth indicates the size of the scene.
        let nearest = first.range().map_or(1.0, |[_, max]| 1.0 / max);
        across(grid.columns())
            .max(across(grid.rows()))
            .max(nearest / 10.0)
    }

    fn file_frame(&self) -> FileFrame {
        self.slabs.info().frame
    }

    fn primitives(&self) -> (u64, &'static str) {
        let images = self.slabs.all().iter().map(|slab| slab.pictures().len());
        (images.sum::<usize>() as u64, "images")
    }

    fn bytes(&self) -> u64 {
        self.slabs.all().iter().map(|slab| slab.bytes()).sum()
    }

    fn settings(&self) -> Vec<Setting> {
        Self::setting_table()
    }

    fn render(&mut self, request: &FrameRequest) -> Result<Rendered<'_>, String> {
        let settings = lumigraph_settings(&request.settings)?;
        let layers = self.slabs.all().iter().map(|slab| slab.layers().len());
        let stored: usize = layers.sum();
        let shown = self.slabs.shares(&request.camera).len();
        let stops = request.settings.number(EXPOSURE)?;
        let (mut frame, stats) = self
            .renderer
            .render(&self.slabs, &request.camera, &settings);
        self.stats = *stats;
        let pixels = frame.color.len().max(1) as f64;
        let stages = [
            ("plan", stats.plan_ms),
            ("draw", stats.frame_ms - stats.plan_ms),
        ];
        let covered = (1.0 - stats.hole_pixels as f64 / pixels) * 100.0;
        let report = FrameReport {
            stages: stages.map(|(name, ms)| Stage { name, ms }).to_vec(),
            ms: stats.frame_ms,
            hole_pixels: stats.hole_pixels,
            figures: vec![
                figure("layers after merging", stats.layers as f64, ""),
                figure("layers stored", stored as f64, ""),
                figure("light slabs shown", shown as f64, ""),
                figure(
                    "layers asked a pixel",
                    stats.layer_pixels as f64 / pixels,
                    "",
                ),
                figure("pixels covered", covered, "%"),
            ],
            ..FrameReport::default()
        };
        if stops != 0.0 && settings.show == LumigraphOverlay::Colors {
            self.painted.clone_from(frame);
            expose(&mut self.painted.color, self.slabs.info().tone, stops);
            frame = &self.painted;
        }
        Ok(Rendered { frame, report })
    }

    fn statistics(&mut self, _: &FrameRequest) -> Statistics {
        json!(self.stats)
    }
}
