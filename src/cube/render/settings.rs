//! Settings of a frame, and its statistics.

use crate::render::footprint::splat::SplatKernel;
use serde::Serialize;

/// Settings of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RenderSettings {
    /// Splat kernel.
    pub kernel: SplatKernel,
    /// Colour of holes, sRGB.
    pub hole_color_srgb: [u8; 3],
    /// Warps every depth pixel, including those that clipping would cull: the same frame, slower.
    /// For tests and reports.
    pub unclipped: bool,
    /// Rows of a band, or 0 for the default. The frame does not depend on it.
    pub band_rows: u32,
    /// Fills [`Frame::depth_m`](headbox_core::frame::Frame::depth_m).
    pub depth: bool,
    /// Leaves small holes open that are otherwise filled with the background. Kernels that do not
    /// compare depths ([`SplatKernel::Paper`] and others) never fill holes.
    pub keep_holes: bool,
}

/// Statistics of a frame. Times of the stages are summed over threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FrameStats {
    /// Depth pixels that reached the inner loop, once for each band that they might touch.
    pub depth_pixels_in: u64,
    /// Those of them behind the eye or outside the band.
    pub behind_or_outside: u64,
    /// Those of them that were drawn.
    pub splatted: u64,
    /// Splats about 1, 3, 5, and 7 or more pixels wide.
    pub by_footprint: [u64; 4],
    /// Pixels without splat and environment, filled or not.
    pub hole_pixels: u64,
    /// Wall-clock time of the frame, ms.
    pub frame_ms: f64,
    /// Drawing order, tables, clipping and clearing, ms.
    pub clear_ms: f64,
    /// Warping and splatting, ms.
    pub warp_ms: f64,
    /// Resolving, compositing over the environment and hole filling, ms.
    pub finish_ms: f64,
    /// Time of the slowest thread over the mean of those that took part.
    pub imbalance: f64,
}

impl FrameStats {
    /// Adds the counts and stage times of a part of the frame.
    pub fn add(&mut self, part: &Self) {
        self.depth_pixels_in += part.depth_pixels_in;
        self.behind_or_outside += part.behind_or_outside;
        self.splatted += part.splatted;
        self.by_footprint
            .iter_mut()
            .zip(part.by_footprint)
            .for_each(|(sum, count)| *sum += count);
        self.hole_pixels += part.hole_pixels;
        self.clear_ms += part.clear_ms;
        self.warp_ms += part.warp_ms;
        self.finish_ms += part.finish_ms;
    }

    /// Returns the sum of the stage times, ms.
    pub fn busy_ms(&self) -> f64 {
        self.clear_ms + self.warp_ms + self.finish_ms
    }
}

/// Ratio of the largest of some times to the mean of those that are not 0.
#[derive(Default)]
pub struct Imbalance {
    slowest: f64,
    sum: f64,
    count: u32,
}

impl Imbalance {
    /// Adds a thread's time, ms.
    pub fn add(&mut self, ms: f64) {
        self.slowest = self.slowest.max(ms);
        self.sum += ms;
        self.count += u32::from(ms > 0.0);
    }

    /// Returns the ratio; 1 without times.
    pub fn ratio(&self) -> f64 {
        if self.sum > 0.0 {
            self.slowest * f64::from(self.count) / self.sum
        } else {
            1.0
        }
    }
}
