//! Separable filters on rows, shared by FLIP (in `f32`) and SSIM (in `f64`).
//!
//! A filter of radius r uses 2 r + 1 *neighbours*, slices of equal length. Across a row they are
//! the same padded row, shifted by one element each; down a column they are 2 r + 1 rows. So one
//! kernel serves both directions. Filters are given by half of their taps, since all are symmetric
//! or antisymmetric: `taps[0]` is the centre, `taps[k]` is the weight of the neighbours k before
//! and k after it.
//!
//! Every output element is computed by the same IEEE operations in the same order whatever the
//! width of a vector, so the SIMD level does not change a bit. Rows are padded to whole blocks of
//! vectors ([`padded_len`]); results in the padding are ignored.

use fearless_simd::{Level, dispatch, prelude::*};

/// Number of vectors that are summed together, to amortise the lookup of a neighbour.
const BLOCK: usize = 4;

/// Returns the padded length of a row of `len` elements: whole blocks of the widest vectors of any
/// SIMD level.
pub(super) fn padded_len(len: usize) -> usize {
    len.next_multiple_of(16 * BLOCK)
}

/// Returns the neighbours across a row: `2 radius + 1` slices of `len` elements of `padded`,
/// centred on its middle. `padded` has `len` elements and equally many more (at least `radius`)
/// before as after them.
pub(super) fn across<T>(padded: &[T], radius: usize, len: usize) -> Vec<&[T]> {
    let first = (padded.len() - len) / 2 - radius;
    padded[first..].windows(len).take(2 * radius + 1).collect()
}

/// Smooths: `out = taps[0] * centre + sum over k of taps[k] * (before_k + after_k)`. Slices have a
/// padded length.
pub(super) fn smooth<T: SimdFloatElement>(
    level: Level,
    taps: &[T],
    neighbors: &[&[T]],
    out: &mut [T],
) {
    dispatch!(level, simd => smooth_vectors(simd, taps, neighbors, out));
}

/// Computes the first and second derivative:
/// `first = sum over k of first_taps[k] * (after_k - before_k)` and
/// `second = sum over k of second_taps[k] * ((before_k + after_k) - 2 centre)`, both exactly zero
/// where the neighbours are all equal. Slices have a padded length, both filters the same radius.
pub(super) fn derive<T: SimdFloatElement>(
    level: Level,
    [first_taps, second_taps]: [&[T]; 2],
    neighbors: &[&[T]],
    [first, second]: [&mut [T]; 2],
) {
    dispatch!(level, simd => derive_vectors(simd, [first_taps, second_taps], neighbors, [first, second]));
}

#[inline(always)]
fn smooth_vectors<S: Simd, T: SimdFloatElement>(
    simd: S,
    taps: &[T],
    neighbors: &[&[T]],
    out: &mut [T],
) {
    let lanes = T::Native::<S>::LEN;
    let block_len = BLOCK * lanes;
    let radius = taps.len() - 1;
    let (before, rest) = neighbors.split_at(radius);
    for (i, out) in out.chunks_exact_mut(block_len).enumerate() {
        let block = i * block_len..(i + 1) * block_len;
        let center = &rest[0][block.clone()];
        let mut sums = [T::Native::<S>::splat(simd, taps[0]); BLOCK];
        for v in 0..BLOCK {
            sums[v] *= T::Native::<S>::from_slice(simd, &center[v * lanes..(v + 1) * lanes]);
        }
        for ((before, after), &tap) in before.iter().rev().zip(&rest[1..]).zip(&taps[1..]) {
            let (before, after) = (&before[block.clone()], &after[block.clone()]);
            for v in 0..BLOCK {
                let lanes = v * lanes..(v + 1) * lanes;
                let (before, after) = (&before[lanes.clone()], &after[lanes]);
                sums[v] += (T::Native::<S>::from_slice(simd, before)
                    + T::Native::<S>::from_slice(simd, after))
                    * tap;
            }
        }
        for v in 0..BLOCK {
            sums[v].store_slice(&mut out[v * lanes..(v + 1) * lanes]);
        }
    }
}

#[inline(always)]
fn derive_vectors<S: Simd, T: SimdFloatElement>(
    simd: S,
    [first_taps, second_taps]: [&[T]; 2],
    neighbors: &[&[T]],
    [first, second]: [&mut [T]; 2],
) {
    let lanes = T::Native::<S>::LEN;
    let radius = first_taps.len() - 1;
    let center = neighbors.len() / 2;
    for (i, (first, second)) in first
        .chunks_exact_mut(lanes)
        .zip(second.chunks_exact_mut(lanes))
        .enumerate()
    {
        let load = |row: usize| {
            T::Native::<S>::from_slice(simd, &neighbors[row][i * lanes..(i + 1) * lanes])
        };
        let twice_center = load(center) + load(center);
        let mut slope = T::Native::<S>::splat(simd, T::default());
        let mut curvature = slope;
        for k in 1..=radius {
            let (before, after) = (load(center - k), load(center + k));
            slope += (after - before) * first_taps[k];
            curvature += ((before + after) - twice_center) * second_taps[k];
        }
        slope.store_slice(first);
        curvature.store_slice(second);
    }
}

/// Ring buffer of the last `2 radius + 1` rows of an image that are filtered across and not yet
/// down, with a few planes each.
///
/// Rows are identified by their number in the image, which may lie outside of it (the caller
/// chooses their content). For example, with radius 1 (three slots), rows -1, 0, 1 fill slots 2, 0,
/// 1; row 2 then replaces row -1.
pub(super) struct RowRing<T> {
    values: Vec<T>,
    slots: usize,
    planes: usize,
    len: usize,
}

impl<T: Copy + Default> RowRing<T> {
    /// Creates a ring for rows of `planes` planes of `len` elements.
    pub(super) fn new(radius: usize, planes: usize, len: usize) -> Self {
        let slots = 2 * radius + 1;
        Self {
            values: vec![T::default(); slots * planes * len],
            slots,
            planes,
            len,
        }
    }

    /// Returns the planes of row `y` for writing; they replace those of row `y - (2 radius + 1)`.
    pub(super) fn row_mut(&mut self, y: isize) -> std::slice::ChunksExactMut<'_, T> {
        let row_len = self.planes * self.len;
        let first = self.slot(y) * row_len;
        self.values[first..first + row_len].chunks_exact_mut(self.len)
    }

    /// Returns the neighbours of row `y` down one plane: `2 radius + 1` rows, of the ring's radius
    /// or a smaller one.
    pub(super) fn down(&self, y: isize, radius: usize, plane: usize) -> Vec<&[T]> {
        let radius = radius as isize;
        (y - radius..=y + radius)
            .map(|y| &self.values[(self.slot(y) * self.planes + plane) * self.len..][..self.len])
            .collect()
    }

    fn slot(&self, y: isize) -> usize {
        y.rem_euclid(self.slots as isize) as usize
    }
}

#[cfg(test)]
pub(super) mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    pub(in crate::metrics) use crate::simd::levels;

    /// Seeded noise: every pixel of its own color.
    pub(in crate::metrics) fn noise(width: u32, height: u32, seed: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| {
            let hash = (x + 1000 * y + seed).wrapping_mul(2_654_435_761);
            Rgb([(hash >> 24) as u8, (hash >> 16) as u8, (hash >> 8) as u8])
        })
    }

    #[test]
    fn both_directions_use_same_neighbors() {
        let padded: Vec<f32> = (0..16 + 6).map(|i| (i * i) as f32).collect();
        let neighbors = across(&padded, 2, 16);
        assert_eq!(neighbors.len(), 5);
        assert!(
            neighbors
                .iter()
                .enumerate()
                .all(|(k, row)| row.len() == 16 && row[0] == ((k + 1) * (k + 1)) as f32)
        );

        let mut ring = RowRing::<f32>::new(3, 2, 16);
        for y in -3..=10 {
            for (plane, row) in ring.row_mut(y).enumerate() {
                row.fill((10 * y) as f32 + plane as f32);
            }
        }
        let column: Vec<f32> = ring.down(7, 2, 1).iter().map(|row| row[5]).collect();
        assert_eq!(column, [51.0, 61.0, 71.0, 81.0, 91.0]);
    }

    #[test]
    fn filters_equal_their_definition_on_integers() {
        // Small integers are exact in f32, so no order of summation could hide a misplaced tap.
        let padded: Vec<f32> = (0..128 + 4).map(|i| ((i * 7919) % 13) as f32).collect();
        let (mut smoothed, mut first, mut second) = ([0.0; 128], [0.0; 128], [0.0; 128]);
        let neighbors = across(&padded, 2, 128);
        let level = Level::new();
        smooth(level, &[3.0, 2.0, 1.0], &neighbors, &mut smoothed);
        derive(
            level,
            [&[0.0, 1.0, 4.0], &[0.0, 2.0, 5.0]],
            &neighbors,
            [&mut first, &mut second],
        );
        for i in 0..128 {
            let p = &padded[i..i + 5];
            assert_eq!(
                smoothed[i],
                p[0] + 2.0 * p[1] + 3.0 * p[2] + 2.0 * p[3] + p[4]
            );
            assert_eq!(first[i], (p[3] - p[1]) + 4.0 * (p[4] - p[0]));
            assert_eq!(
                second[i],
                2.0 * (p[1] + p[3]) + 5.0 * (p[0] + p[4]) - 14.0 * p[2]
            );
        }
    }
}
