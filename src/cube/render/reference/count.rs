//! Number of depth pixels that clipping removes (S19, C15, C17).

use crate::pack::CubeLdi;
use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::render::setup::clip::Band;
use crate::render::{RenderSettings, Renderer};
use headbox_core::camera::Camera;
use serde::Serialize;

/// Depth pixels of an LDI by the result of clipping against a whole frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ClipCounts {
    /// In segments that are culled completely.
    pub culled: u64,
    /// In rows, columns and blocks of the other segments that are culled.
    pub clipped: u64,
    /// The rest, which is warped.
    pub kept: u64,
}

impl Renderer {
    /// Counts the depth pixels that clipping keeps for a frame. A frame in bands keeps more:
    /// samples that touch two bands count in both.
    pub fn clip_counts(
        &mut self,
        cube: &CubeLdi,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> ClipCounts {
        let settings = RenderSettings {
            unclipped: false,
            ..*settings
        };
        self.plan.prepare(cube, camera, &settings);
        let frame = Band::new(camera, 0..camera.height());
        let mut counts = ClipCounts::default();
        let mut visible = Vec::new();
        for (i, planned) in self.plan.segments().iter().enumerate() {
            let segment = &cube.segments[planned.index];
            let all = segment.depth_pixels.len() as u64;
            let Some([columns, rows]) = self.plan.clip(cube, i, &frame).clip(&mut visible) else {
                counts.culled += all;
                continue;
            };
            let blocks = columns.start / BLOCK_COLUMNS..columns.end.div_ceil(BLOCK_COLUMNS);
            let mut kept = 0;
            for y in rows.clone() {
                let (_, running_counts) = segment.row(y - segment.y0);
                let first = (y / BLOCK_ROWS - rows.start / BLOCK_ROWS) as usize * blocks.len();
                let row = blocks.clone().zip(visible.get(first..).unwrap_or(&[]));
                for (block, _) in row.filter(|(_, visible)| **visible) {
                    let start = (block * BLOCK_COLUMNS).max(columns.start);
                    let end = ((block + 1) * BLOCK_COLUMNS).min(columns.end);
                    let count_before = |x: u32| {
                        running_counts
                            .get((x - segment.x0) as usize)
                            .map_or(0, |count| u64::from(*count))
                    };
                    kept += count_before(end).saturating_sub(count_before(start));
                }
            }
            counts.kept += kept;
            counts.clipped += all - kept;
        }
        counts
    }
}
