//! Tents: what splats weigh in the pixels that they touch, in integers.
//!
//! A tent is the product of two lines of heights, one along x and one along y. What it weighs in a pixel does not depend on where a
//! band or a tile begins, so that it may be cut in any way.

use super::size::LANES;
use super::splat::{Splats, covered_lanes, load};
use fearless_simd::{Simd, SimdCvtFloat, SimdCvtTruncate, f32x16, i32x16, prelude::*, u32x16};
use std::ops::Range;

/// Weight 1, with which the samples of a whole surface add up in every pixel.
pub(crate) const ONE: u32 = 128;

/// Height of a tent in its middle: of a line of heights, in 2^-15.
pub(crate) const TOP: i32 = 1 << 15;

/// A peak is so many times a weight.
pub(crate) const PEAK_STEPS: u32 = 512;

/// Weight in the middle of a splat, at least. The pixel that holds a sample of the least radius, 0.75 px, is at most half
/// a pixel away in x and y and gets (1 - 0.5 / 0.75)^2 = 1/9 of it, which must not round to nothing however small the
/// sample is: 9 / 2 / 128.
pub(super) const MIN_PEAK: f32 = 0.036;

/// Where alpha lies in four bytes as they lie in memory.
const ALPHA_SHIFT: u32 = u32::from_ne_bytes([0, 0, 0, 1]).trailing_zeros();

/// The tents of all splats of a batch.
pub(crate) struct Tents {
    pub(crate) columns: Lines,
    pub(crate) rows: Lines,
    /// At most [`ONE`] * [`PEAK_STEPS`] = 2^16, so that two heights of 2^15 each, one after the other, stay within 32 bits.
    pub(crate) peak: [u32; Splats::ROOM],
}

impl Default for Tents {
    fn default() -> Self {
        Self {
            columns: Lines::default(),
            rows: Lines::default(),
            peak: [0; Splats::ROOM],
        }
    }
}

impl Tents {
    /// Makes the tents of `splats`, clipped to ranges of columns and of rows.
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

/// The lines of pixels that splats touch, along x or y.
pub(crate) struct Lines {
    /// The first line.
    first: [i32; Splats::ROOM],
    /// The one after the last.
    end: [i32; Splats::ROOM],
    /// Distance of the first line from the middle over the radius, in 2^-15.
    at: [i32; Splats::ROOM],
    /// From line to line, the same.
    step: [i32; Splats::ROOM],
}

impl Default for Lines {
    fn default() -> Self {
        let zero = [0; Splats::ROOM];
        Self {
            first: zero,
            end: zero,
            at: zero,
            step: zero,
        }
    }
}

impl Lines {
    #[inline(always)]
    fn fill<S: Simd>(
        &mut self,
        simd: S,
        [position, radius]: [&[f32; Splats::ROOM]; 2],
        i: usize,
        bounds: [f32; 2],
    ) {
        let [first, end] = covered_lanes(simd, [position, radius], i, bounds);
        let (position, scale) = (
            load(simd, position, i),
            f32x16::splat(simd, TOP as f32) / load(simd, radius, i),
        );
        // Rounded at the middle, not at `first`, which depends on the band.
        let middle = i32x16::truncate_from(position);
        let at = i32x16::truncate_from((f32x16::float_from(middle) + 0.5 - position) * scale);
        let step = i32x16::truncate_from(scale);
        first.store_slice(&mut self.first[i..i + LANES]);
        end.store_slice(&mut self.end[i..i + LANES]);
        (at + (first - middle) * step).store_slice(&mut self.at[i..i + LANES]);
        step.store_slice(&mut self.step[i..i + LANES]);
    }

    /// The lines that a splat touches.
    #[inline(always)]
    pub(crate) fn of(&self, i: usize) -> Range<i32> {
        self.first[i]..self.end[i]
    }

    /// Distance of a line from the middle over the radius, and what it changes by from line to line, in 2^-15.
    #[inline(always)]
    pub(crate) fn from(&self, i: usize, line: i32) -> [i32; 2] {
        // A line before the first may be far from it, where what it says does not matter.
        [
            self.at[i].wrapping_add((line - self.first[i]).wrapping_mul(self.step[i])),
            self.step[i],
        ]
    }
}
