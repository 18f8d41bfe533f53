//! Tents: what splats weigh in the pixels that they touch, in integers.
//!
//! A tent is the product of two lines of heights, one along x and one along y, so that all weights of a splat that touches at
//! most [`SIDE`] pixels a side, as most do, come from eight heights, sixteen splats at a time
//! (docs/decisions.md: weights of tents sixteen splats at a time).

use super::size::LANES;
use super::splat::{Splats, covered_lanes, load};
use fearless_simd::{Simd, SimdCvtFloat, SimdCvtTruncate, f32x16, i32x16, prelude::*, u32x16};
use std::ops::Range;

/// Weight 1, with which the samples of a whole surface add up in every pixel.
pub(super) const ONE: u64 = 128;

/// Weight in the middle of a splat, at least. The pixel that holds a sample of the least radius, 0.75 px, is at most half
/// a pixel away in x and y and gets (1 - 0.5 / 0.75)^2 = 1/9 of it, which must not round to nothing however small the
/// sample is: 9 / 2 / 128.
pub(super) const MIN_PEAK: f32 = 0.036;

/// Where alpha lies in four bytes as they lie in memory.
const ALPHA_SHIFT: u32 = u32::from_ne_bytes([0, 0, 0, 1]).trailing_zeros();

/// Most pixels a side of a small splat.
pub(super) const SIDE: usize = 4;

/// Weights of small splats by row, column and lane.
pub(super) type SmallWeights = [[[u32; LANES]; SIDE]; SIDE];

/// The tents of all splats of a batch.
pub(super) struct Tents {
    columns: Lines,
    rows: Lines,
    /// A peak of up to 128 * 2^9, times 2^15 for each of the two distances: the tent in integers.
    peak: [u32; Splats::ROOM],
}

impl Default for Tents {
    fn default() -> Self {
        Self { columns: Lines::default(), rows: Lines::default(), peak: [0; Splats::ROOM] }
    }
}

impl Tents {
    /// Makes the tents of `splats`, clipped to ranges of columns and of rows.
    #[inline(always)]
    pub(super) fn fill<S: Simd>(&mut self, simd: S, splats: &Splats, [columns, rows]: [[f32; 2]; 2]) {
        for i in (0..splats.count()).step_by(LANES) {
            self.columns.fill(simd, [&splats.x, &splats.radius_x], i, columns);
            self.rows.fill(simd, [&splats.y, &splats.radius_y], i, rows);
            let weight = load(simd, &splats.weight, i);
            let alpha = (u32x16::from_slice(simd, &splats.color[i..i + LANES]) >> ALPHA_SHIFT) & 255;
            let alpha = f32x16::float_from(alpha);
            let peak = weight.max(MIN_PEAK) * alpha * (ONE as f32 * 512.0 / 255.0);
            u32x16::truncate_from(peak).store_slice(&mut self.peak[i..i + LANES]);
        }
    }

    /// The columns and rows that a splat touches.
    #[inline]
    pub(super) fn pixels(&self, i: usize) -> [Range<i32>; 2] {
        [self.columns.of(i), self.rows.of(i)]
    }

    /// Columns and rows that hold all that some splats touch.
    #[inline(always)]
    pub(super) fn bounds(&self, splats: Range<usize>) -> [Range<i32>; 2] {
        [self.columns.bounds(splats.clone()), self.rows.bounds(splats)]
    }

    /// The weights of the splats from `start` on that touch at most [`SIDE`] columns and rows.
    #[inline(always)]
    pub(super) fn small<S: Simd>(&self, simd: S, start: usize) -> SmallWeights {
        let mut weights = [[[0; LANES]; SIDE]; SIDE];
        let (across, down) = (self.columns.heights(simd, start), self.rows.heights(simd, start));
        let peak = u32x16::from_slice(simd, &self.peak[start..start + LANES]);
        for (row, down) in weights.iter_mut().zip(down) {
            let peak = (peak * down) >> 15;
            for (weights, across) in row.iter_mut().zip(across) {
                ((peak * across + (1 << 23)) >> 24).store_slice(weights);
            }
        }
        weights
    }

    /// The weights of any splat, row by row. At most [`ONE`], as 2^16 * 2^15 = 2^31.
    #[inline(always)]
    pub(super) fn any(&self, i: usize) -> impl Iterator<Item = impl Iterator<Item = u64>> {
        let across = self.columns.line(i);
        self.rows.line(i).map(move |down| {
            let peak = (self.peak[i] * down) >> 15;
            across.clone().map(move |across| u64::from((peak * across + (1 << 23)) >> 24))
        })
    }
}

/// The lines of pixels that splats touch, along x or y.
struct Lines {
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
        Self { first: zero, end: zero, at: zero, step: zero }
    }
}

impl Lines {
    #[inline(always)]
    fn fill<S: Simd>(&mut self, simd: S, [position, radius]: [&[f32; Splats::ROOM]; 2], i: usize, bounds: [f32; 2]) {
        let [first, end] = covered_lanes(simd, [position, radius], i, bounds);
        let (position, scale) = (load(simd, position, i), f32x16::splat(simd, 32_768.0) / load(simd, radius, i));
        // Rounded at the middle, not at `first`, which depends on the band.
        let middle = i32x16::truncate_from(position);
        let at = i32x16::truncate_from((f32x16::float_from(middle) + 0.5 - position) * scale);
        let step = i32x16::truncate_from(scale);
        first.store_slice(&mut self.first[i..i + LANES]);
        end.store_slice(&mut self.end[i..i + LANES]);
        (at + (first - middle) * step).store_slice(&mut self.at[i..i + LANES]);
        step.store_slice(&mut self.step[i..i + LANES]);
    }

    /// The lines of a splat.
    #[inline]
    fn of(&self, i: usize) -> Range<i32> {
        self.first[i]..self.end[i]
    }

    /// Lines that hold those of some splats.
    #[inline(always)]
    fn bounds(&self, splats: Range<usize>) -> Range<i32> {
        let (first, end) = (&self.first[splats.clone()], &self.end[splats]);
        first.iter().fold(i32::MAX, |least, line| least.min(*line))..end.iter().fold(0, |most, line| most.max(*line))
    }

    /// Heights of tents on their first lines, 0 to 2^15 = 1.
    #[inline(always)]
    fn heights<S: Simd>(&self, simd: S, start: usize) -> [u32x16<S>; SIDE] {
        let mut at = i32x16::from_slice(simd, &self.at[start..start + LANES]);
        let step = i32x16::from_slice(simd, &self.step[start..start + LANES]);
        let mut heights = [u32x16::splat(simd, 0); SIDE];
        for height in &mut heights {
            *height = (i32x16::splat(simd, 32_768) - at.abs()).max(0).bitcast();
            at += step;
        }
        heights
    }

    /// Heights of one tent on its lines, one after the other.
    #[inline(always)]
    fn line(&self, i: usize) -> impl Iterator<Item = u32> + Clone + use<> {
        let (at, step) = (self.at[i], self.step[i]);
        (0..).map(move |line: i32| (32_768 - (at + line * step).abs()).max(0).cast_unsigned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    #[test]
    fn small_splats_weigh_as_any() {
        let mut splats = Splats::new();
        splats.len = 3 * LANES - 5;
        for i in 0..splats.len {
            let part = i as f32 / splats.len as f32;
            (splats.x[i], splats.y[i]) = (3.0 * part - 0.4, 11.0 - 7.3 * part);
            (splats.radius_x[i], splats.radius_y[i]) = (0.75 + 1.2 * part, 1.9 - 1.1 * part);
            (splats.weight[i], splats.color[i]) = (part, u32::from_ne_bytes([1, 2, 3, 255 - (i % 3) as u8 * 100]));
        }
        let mut tents = Tents::default();
        let mut compared = 0;
        dispatch!(Level::new(), simd => {
            tents.fill(simd, &splats, [[0.0, 3.0], [4.0, 9.0]]);
            for start in (0..splats.count()).step_by(LANES) {
                let small = tents.small(simd, start);
                for i in start..splats.count().min(start + LANES) {
                    let [columns, rows] = tents.pixels(i);
                    assert!(columns.len() <= SIDE && rows.len() <= SIDE && columns.end <= 3 && rows.end <= 9);
                    for (row, weights) in tents.any(i).take(rows.len()).enumerate() {
                        for (column, weight) in weights.take(columns.len()).enumerate() {
                            assert_eq!(weight, u64::from(small[row][column][i - start]), "splat {i}");
                            compared += u64::from(weight > 0);
                        }
                    }
                }
            }
        });
        assert!(compared > 100, "{compared}");
    }
}
