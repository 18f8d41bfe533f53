//! Splat kernels, and splats in frame coordinates (S20, S21, C10, C12).

use super::size::{EllipseSize, LANES};
use crate::render::planes::{MAX_RADIUS_TESTED_AT_CENTRE_PX, PlaneLayer};
use crate::render::traverse::batches::BATCH_CAPACITY;
use fearless_simd::{Simd, SimdCvtTruncate, f32x16, i32x16, prelude::*};
use serde::{Deserialize, Serialize};

/// Footprint of a sample in the frame, and how overlapping footprints are combined.
///
/// Errors of each kernel, the loss from `Paper`'s size table, and rejected variants:
/// docs/decisions/0047, measured by `tests/library/cube/splat_quality.rs`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplatKernel {
    /// Squares of 1, 3, 5 and 7 pixels with the alphas 1, 1/2 and 1/4, each blended *over* the
    /// canvas; widths come from the paper's splat table, which is refilled for every frame (S20,
    /// S21).
    Paper,
    /// Opaque rectangles as large as the sample's area of its surface: nearest-neighbour
    /// reconstruction.
    Opaque,
    /// Tents that reach to the adjacent samples of the surface, averaged by weight per surface:
    /// bilinear reconstruction, with soft silhouettes.
    #[default]
    Tent,
    /// Elliptical Gaussians as wide as the sample's area of its surface, averaged by weight per
    /// surface in floating point and linear light: the reference for the integer kernels. Three
    /// times the time of [`Self::Tent`].
    Ellipse,
    /// One opaque pixel per sample.
    Point,
    /// An opaque plus of five pixels per sample, the one that contains it and the four adjacent
    /// ones: the fixed stamp that Rafferty et al. consider sufficient for LDIs (R7, R12).
    Plus,
    /// An opaque square of two pixels a side per sample (R7).
    Square2,
    /// An opaque square of three pixels a side per sample (R7).
    Square3,
}

headbox_core::named_variants!(SplatKernel {
    Tent => "tent",
    Paper => "paper",
    Opaque => "opaque",
    Ellipse => "ellipse",
    Point => "1x1",
    Plus => "plus",
    Square2 => "2x2",
    Square3 => "3x3",
});

impl SplatKernel {
    /// Returns the fraction of a footprint's radius that covers the sample's own area of its
    /// surface; beyond it, footprints of adjacent samples overlap.
    pub(crate) fn core_fraction(self) -> f32 {
        match self {
            Self::Tent => 0.5,
            Self::Ellipse => 0.5 / EllipseSize::SCALE,
            Self::Paper
            | Self::Opaque
            | Self::Point
            | Self::Plus
            | Self::Square2
            | Self::Square3 => 1.0,
        }
    }

    /// Returns true if the canvas compares and stores the depths of splats, rather than relying on
    /// their order alone.
    pub(crate) fn compares_depths(self) -> bool {
        matches!(self, Self::Tent | Self::Ellipse)
    }

    /// Returns true if the result depends on the order of the splats.
    pub(crate) fn needs_order(self) -> bool {
        self != Self::Tent
    }
}

/// Splats of a batch in frame coordinates, in drawing order, as a structure of arrays.
pub(crate) struct Splats {
    /// Number of entries in use.
    pub(crate) len: usize,
    /// Number of splats about 1, 3, 5, and 7 or more pixels wide.
    pub(crate) by_footprint: [u64; 4],
    /// Horizontal position, frame px.
    pub(crate) x: [f32; Splats::CAPACITY],
    /// Vertical position, frame px, row 0 at the top.
    pub(crate) y: [f32; Splats::CAPACITY],
    /// 1 / eye depth in the frame, 1/m.
    pub(crate) inverse_depth: [f32; Splats::CAPACITY],
    /// Half the width, px.
    pub(crate) radius_x: [f32; Splats::CAPACITY],
    /// Half the height, px.
    pub(crate) radius_y: [f32; Splats::CAPACITY],
    /// Weight at the centre, 0..1, such that the weights of a surface add up to at least 1
    /// everywhere.
    pub(crate) weight: [f32; Splats::CAPACITY],
    /// Correlation of x and y of elliptical footprints.
    pub(crate) correlation: [f32; Splats::CAPACITY],
    /// sRGB and straight alpha, in memory order.
    pub(crate) color: [u32; Splats::CAPACITY],
}

impl Splats {
    /// Splats of a full batch, and space to write a whole register behind the last.
    pub(crate) const CAPACITY: usize = BATCH_CAPACITY + LANES;

    pub(crate) fn new() -> Self {
        let zero = [0.0; Self::CAPACITY];
        Self {
            len: 0,
            by_footprint: [0; 4],
            x: zero,
            y: zero,
            inverse_depth: zero,
            radius_x: zero,
            radius_y: zero,
            weight: zero,
            correlation: zero,
            color: [0; Self::CAPACITY],
        }
    }

    /// Removes splats whose centre is hidden by the plane layer, except [large](Self::is_large)
    /// ones.
    pub(crate) fn cull_hidden(&mut self, planes: &PlaneLayer) {
        if planes.is_empty() {
            return;
        }
        let mut len = 0;
        for i in 0..self.count() {
            if !self.is_large(i) && planes.hides([self.x[i], self.y[i]], self.inverse_depth[i]) {
                continue;
            }
            if len < i {
                self.copy_within(i, len);
            }
            len += 1;
        }
        self.len = len;
    }

    /// Overwrites a splat by another.
    #[inline]
    fn copy_within(&mut self, from: usize, to: usize) {
        for values in [
            &mut self.x,
            &mut self.y,
            &mut self.inverse_depth,
            &mut self.radius_x,
            &mut self.radius_y,
            &mut self.weight,
            &mut self.correlation,
        ] {
            values[to] = values[from];
        }
        self.color[to] = self.color[from];
    }

    /// Returns true if a splat is tested against the plane layer pixel by pixel.
    #[inline]
    pub(crate) fn is_large(&self, i: usize) -> bool {
        self.radius_x[i].max(self.radius_y[i]) > MAX_RADIUS_TESTED_AT_CENTRE_PX
    }

    /// Returns the number of splats, at most [`Self::CAPACITY`].
    #[inline]
    pub(crate) fn count(&self) -> usize {
        self.len.min(Self::CAPACITY)
    }
}

/// Returns the pixels whose centres lie between `position - radius` and `position + radius`,
/// clipped to the bounds: the first, and the one after the last.
#[inline(always)]
pub(crate) fn covered_pixels(position: f32, radius: f32, [start, end]: [f32; 2]) -> [i32; 2] {
    [position - radius, position + radius]
        .map(|border| ceil_to_i32((border - 0.5).max(start).min(end)))
}

/// [`covered_pixels`] for the [`LANES`] splats from `start` on.
#[inline(always)]
pub(crate) fn covered_pixels_lanes<S: Simd>(
    simd: S,
    [position, radius]: [&[f32; Splats::CAPACITY]; 2],
    start: usize,
    [first, end]: [f32; 2],
) -> [i32x16<S>; 2] {
    let position = load(simd, position, start);
    let radius = load(simd, radius, start);
    let left = position - radius - 0.5;
    let right = position + radius - 0.5;
    let left = left.max(first).min(end).ceil();
    let right = right.max(first).min(end).ceil();
    [i32x16::truncate_from(left), i32x16::truncate_from(right)]
}

/// Loads the values of the [`LANES`] splats from `start` on.
#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, values: &[f32; Splats::CAPACITY], start: usize) -> f32x16<S> {
    f32x16::from_slice(simd, &values[start..start + LANES])
}

/// Computes `v.ceil() as i32` for |v| < 2^24, without the libm call of `ceil` on processors before
/// SSE4.1.
#[inline(always)]
pub(crate) fn ceil_to_i32(v: f32) -> i32 {
    let truncated = v as i32;
    truncated + i32::from((truncated as f32) < v)
}
