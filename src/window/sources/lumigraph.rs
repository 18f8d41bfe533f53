//! A lumigraph in the window: the eye flies about before its images, or from one light slab to the
//! next.

use headbox_core::file_frame::FileFrame;
use headbox_lumigraph::{Blend, LumigraphSettings, Show, Slabs, SlabsRenderer};
use headbox_viewer::{
    Figure, FrameReport, FrameRequest, FrameSource, Pose, Setting, SettingValues, Stage,
};
use std::path::Path;

/// The lumigraph of a file.
pub(super) struct LumigraphSource {
    title: String,
    slabs: Slabs,
    renderer: SlabsRenderer,
}

impl LumigraphSource {
    pub(super) fn new(slabs: Slabs, file: &Path) -> Self {
        let title = format!("{} (lumigraph)", crate::file_name::file_name(file));
        Self {
            title,
            slabs,
            renderer: SlabsRenderer::new(),
        }
    }
}

fn settings(values: &SettingValues) -> Result<LumigraphSettings, String> {
    let show = Show::ALL
        .get(values.choice("overlay")?)
        .map_or(Show::Colors, |(_, show)| *show);
    let blend = Blend::ALL
        .get(values.choice("blend")?)
        .map_or(Blend::default(), |(_, blend)| *blend);
    let tolerance_px = values.number("merge")?;
    let (levels, skip) = (values.toggle("levels")?, values.toggle("skip")?);
    Ok(LumigraphSettings {
        merge: tolerance_px > 0.0,
        tolerance_px,
        levels,
        skip,
        blend,
        show,
        ..LumigraphSettings::default()
    })
}

/// Width and height in which a window shows frames, more or less: as wide as it is, all is to be
/// clear in it.
const ABOUT_A_WINDOW: [u32; 2] = [1024, 768];

impl FrameSource for LumigraphSource {
    fn title(&self) -> String {
        self.title.clone()
    }

    fn start_pose(&self) -> Pose {
        let first = self.slabs.first();
        let grid = first.grid();
        let ahead = grid.origin() - grid.world_from_eye().z_axis;
        Pose::looking_at(grid.origin(), ahead, first.clear_fov_deg(ABOUT_A_WINDOW))
    }

    fn speed_m_per_s(&self) -> f64 {
        let first = self.slabs.first();
        let grid = first.grid();
        let across = |places: &[f64]| places[places.len() - 1] - places[0];
        // Of a single camera nothing says how large the scene is but its depth.
        let nearest = first.range().map_or(1.0, |[_, max]| 1.0 / max);
        across(grid.columns())
            .max(across(grid.rows()))
            .max(nearest / 10.0)
    }

    fn file_frame(&self) -> FileFrame {
        self.slabs.info().frame
    }

    fn settings(&self) -> Vec<Setting> {
        let defaults = LumigraphSettings::default();
        let merge = "How far two neighbouring cameras may disagree about a point where layers are merged for the frame; 0 merges \
                     none (pixels of an image or of the frame, whichever is larger).";
        let blend = "Where some cameras show a surface and others look through it: it takes their share of the pixel, or the \
                     whole of it as the paper has it (no unit).";
        let overlay = "What is painted instead of colours: the layer that a pixel is stored in, the layers as they were merged for \
                       this frame, or the cameras that a pixel is blended from (no unit).";
        let skip = "Leaves layers out that show in no rectangle of the images where a block of the frame would find them; the frame \
                    is the same.";
        vec![
            Setting::choice(
                "overlay",
                "Overlay",
                overlay,
                &Show::ALL.map(|(name, _)| name),
            ),
            Setting::choice("blend", "Blend", blend, &Blend::ALL.map(|(name, _)| name)),
            Setting::number(
                "merge",
                "Merge layers",
                merge,
                defaults.tolerance_px,
                0.0..=16.0,
                "px",
            ),
            Setting::toggle(
                "levels",
                "Levels of detail",
                "Takes coarser images where the frame is coarser.",
                defaults.levels,
            ),
            Setting::toggle("skip", "Skip rectangles", skip, defaults.skip),
        ]
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let settings = settings(&request.settings)?;
        let (frame, stats) = self
            .renderer
            .render(&self.slabs, &request.camera, &settings);
        pixels.copy_from_slice(&frame.color);
        let stored: usize = self
            .slabs
            .all()
            .iter()
            .map(|slab| slab.layers().len())
            .sum();
        let shown = self.slabs.shares(&request.camera).len();
        let share = 1.0 - stats.hole_pixels as f64 / pixels.len().max(1) as f64;
        Ok(FrameReport {
            stages: vec![
                Stage {
                    name: "plan",
                    ms: stats.plan_ms,
                },
                Stage {
                    name: "draw",
                    ms: stats.frame_ms - stats.plan_ms,
                },
            ],
            figures: vec![
                Figure {
                    name: "layers after merging",
                    value: stats.layers as f64,
                    unit: "",
                },
                Figure {
                    name: "layers stored",
                    value: stored as f64,
                    unit: "",
                },
                Figure {
                    name: "light slabs shown",
                    value: shown as f64,
                    unit: "",
                },
                Figure {
                    name: "layers asked a pixel",
                    value: stats.layer_pixels as f64 / pixels.len().max(1) as f64,
                    unit: "",
                },
                Figure {
                    name: "pixels covered",
                    value: share * 100.0,
                    unit: "%",
                },
            ],
            facts: vec![crate::facts::simd_fact()],
            ..FrameReport::default()
        })
    }
}
