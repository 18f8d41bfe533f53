//! Number of depth pixels that clipping removes (S19, C15, C17).

use crate::pack::CubeLdi;
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
        let mut counts = ClipCounts::default();
        for clipped in self.clipped_segments(cube, camera, &settings) {
            let segment = &cube.segments[clipped.segment];
            let all = segment.depth_pixels.len() as u64;
            if clipped.is_culled() {
                counts.culled += all;
            } else {
                let [kept, ..] = clipped.counts(segment);
                counts.kept += kept;
                counts.clipped += all - kept;
            }
        }
        counts
    }
}
