//! Tents: integer weights of splats in the pixels that they touch.
//!
//! A tent is the product of two height profiles, one along x and one along y. Its weight in a pixel
//! does not depend on where a band or a tile begins, so it may be cut anywhere.

use super::size::LANES;
use super::splat::{Splats, covered_pixels_lanes, load};
use crate::render::canvas::linear::ALPHA_SHIFT;
use fearless_simd::{Simd, SimdCvtFloat, SimdCvtTruncate, f32x16, i32x16, prelude::*, u32x16};
use std::ops::Range;

/// Weight 1: the sum of the weights of a surface's samples in every pixel.
pub(crate) const ONE: u32 = 128;

/// Height of a profile at its centre.
pub(crate) const TOP: i32 = 1 << 15;

/// Steps of a peak per step of a weight.
pub(crate) const PEAK_STEPS: u32 = 512;

/// Least radius of a tent, px; less and more are both worse (docs/decisions/0048).
pub(crate) const MIN_RADIUS_PX: f32 = 0.75;

/// Least weight at the centre of a splat. The pixel that contains a sample of the least radius is
/// at most half a pixel away in x and y and receives (1 - 0.5 / 0.75)^2 = 1/9 of it, which must not
/// round to 0 however small the sample is: 9 / 2 / 128.
pub(super) const MIN_PEAK: f32 = 0.036;

/// Tents of all splats of a batch.
pub(crate) struct Tents {
    /// Profiles along x.
    pub(crate) columns: Profiles,
    /// Profiles along y.
    pub(crate) rows: Profiles,
    /// Weights at the centres, at most [`ONE`] * [`PEAK_STEPS`] = 2^16, so that multiplication by
    /// one height of 2^15 and then the other stays within 32 bits.
    pub(crate) peak: [u32; Splats::CAPACITY],
}

impl Default for Tents {
    fn default() -> Self {
        Self {
            columns: Profiles::default(),
            rows: Profiles::default(),
            peak: [0; Splats::CAPACITY],
        }
    }
}

impl Tents {
    /// Computes the tents of `splats`, clipped to ranges of columns and of rows.
    #[inline(always)]
    pub(crate) fn fill<S: Simd>(
        &mut self,
        simd: S,
        splats: &Splats,
        [columns, rows]: [[f32; 2]; 2],
    ) {
        for i in (0..splats.count()).step_by(LANES) {
            self.columns
                .fill(simd, [&splats.x, &splats.radius_x], i, columns);
            self.rows.fill(simd, [&splats.y, &splats.radius_y], i, rows);
            let weight = load(simd, &splats.weight, i);
            let alpha =
                (u32x16::from_slice(simd, &splats.color[i..i + LANES]) >> ALPHA_SHIFT) & 255;
            let alpha = f32x16::float_from(alpha);
            let peak = weight.max(MIN_PEAK) * alpha * ((ONE * PEAK_STEPS) as f32 / 255.0);
            u32x16::truncate_from(peak).store_slice(&mut self.peak[i..i + LANES]);
        }
    }
}

/// Height profiles of splats along x or y.
pub(crate) struct Profiles {
    /// First column or row that the splat touches.
    first: [i32; Splats::CAPACITY],
    /// Column or row after the last.
    end: [i32; Splats::CAPACITY],
    /// Distance of `first` from the centre over the radius, in 2^-15.
    distance: [i32; Splats::CAPACITY],
    /// Change of the distance from one column or row to the next.
    step: [i32; Splats::CAPACITY],
}

impl Default for Profiles {
    fn default() -> Self {
        let zero = [0; Splats::CAPACITY];
        Self {
            first: zero,
            end: zero,
            distance: zero,
            step: zero,
        }
    }
}

impl Profiles {
    #[inline(always)]
    fn fill<S: Simd>(
        &mut self,
        simd: S,
        [position, radius]: [&[f32; Splats::CAPACITY]; 2],
        i: usize,
        bounds: [f32; 2],
    ) {
        let [first, end] = covered_pixels_lanes(simd, [position, radius], i, bounds);
        let position = load(simd, position, i);
        let scale = f32x16::splat(simd, TOP as f32) / load(simd, radius, i);
        // Rounded at the centre, not at `first`, which depends on the band.
        let centre = i32x16::truncate_from(position);
        let distance = i32x16::truncate_from((f32x16::float_from(centre) + 0.5 - position) * scale);
        let step = i32x16::truncate_from(scale);
        first.store_slice(&mut self.first[i..i + LANES]);
        end.store_slice(&mut self.end[i..i + LANES]);
        (distance + (first - centre) * step).store_slice(&mut self.distance[i..i + LANES]);
        step.store_slice(&mut self.step[i..i + LANES]);
    }

    /// Returns the columns or rows that a splat touches.
    #[inline(always)]
    pub(crate) fn touched(&self, i: usize) -> Range<i32> {
        self.first[i]..self.end[i]
    }

    /// Returns the distance of a column or row from the centre over the radius, and its change to
    /// the next, in 2^-15.
    #[inline(always)]
    pub(crate) fn starting_at(&self, i: usize, line: i32) -> [i32; 2] {
        // A line far before the first may overflow; it has no weight.
        [
            self.distance[i].wrapping_add((line - self.first[i]).wrapping_mul(self.step[i])),
            self.step[i],
        ]
    }
}
