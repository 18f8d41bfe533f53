//! A picture on a plane, sixteen pixels of a row at a time.
//!
//! One code for every SIMD level, without fused multiply-adds and approximate reciprocals, so that all give the same bits.

use super::Rim;
use super::plan::{FrameSize, Span, TileInView};
use crate::render::footprint::splat;
use fearless_simd::{Level, Simd, SimdCvtTruncate, dispatch, f32x16, prelude::*, u32x16};
pub(super) use headbox_core::texels::LANES;
use headbox_core::texels::{between, fours};
use std::ops::Range;

/// Where alpha lies in four bytes as they lie in memory.
const ALPHA_SHIFT: u32 = u32::from_ne_bytes([0, 0, 0, 1]).trailing_zeros();

/// Below this alpha, a texel is not there: a canvas gives whatever is there a twentieth of its pixel.
const MIN_ALPHA: u32 = 8;

/// Rows of a frame, each of `stride` pixels: longer than the frame is wide by at least [`LANES`].
pub(super) struct Rows<'a> {
    pub(super) frame: &'a FrameSize,
    /// Straight colours of what hides its pixel wholly; 0 where nothing does.
    pub(super) colors: &'a mut [u32],
    pub(super) depths: &'a mut [f32],
    pub(super) stride: usize,
    /// Of the frame.
    pub(super) rows: Range<u32>,
    /// Takes what covers its pixel in part.
    pub(super) rims: &'a mut Vec<Rim>,
}

/// Draws a picture, its texels those of its size in view, on what it covers of some rows.
pub(super) fn draw(tile: &TileInView, texels: &[[u8; 4]], to: &mut Rows, level: Level) {
    dispatch!(level, simd => draw_tile(simd, tile, texels, to));
}

#[inline(always)]
fn draw_tile<S: Simd>(simd: S, tile: &TileInView, texels: &[[u8; 4]], to: &mut Rows) {
    let (first, end) = (
        tile.rows.start.max(to.rows.start),
        tile.rows.end.min(to.rows.end),
    );
    for y in first..end {
        if let Some(span) = tile.span(y, to.frame) {
            draw_span(simd, tile, texels, &span, y - to.rows.start, to);
        }
    }
}

#[inline(always)]
fn draw_span<S: Simd>(
    simd: S,
    tile: &TileInView,
    texels: &[[u8; 4]],
    span: &Span,
    index: u32,
    to: &mut Rows,
) {
    let start = index as usize * to.stride;
    let row = start..start + to.stride;
    let (Some(colors), Some(depths)) = (to.colors.get_mut(row.clone()), to.depths.get_mut(row))
    else {
        return;
    };
    let lane = f32x16::load_array(simd, LANE_NUMBERS);
    let (right, lower) = (tile.width as f32 - 1.0, tile.height as f32 - 1.0);
    let (first, count) = (span.columns.start as usize, span.columns.len());
    let mut at = 0;
    while at < count {
        let chunk = first + at..first + at + LANES;
        let (Some(colors), Some(depths)) =
            (colors.get_mut(chunk.clone()), depths.get_mut(chunk.clone()))
        else {
            return;
        };
        let k = lane + at as f32;
        let inside = k.simd_lt(count as f32);
        at += LANES;
        let q = k * span.step[3] + span.start[3];
        let old = f32x16::from_slice(simd, depths);
        let in_front = q.simd_gt(old) & inside;
        if !in_front.any_true() {
            continue;
        }
        let w = f32x16::splat(simd, 1.0) / (k * span.step[2] + span.start[2]);
        let u = ((k * span.step[0] + span.start[0]) * w).max(0.0).min(right);
        let v = ((k * span.step[1] + span.start[1]) * w).max(0.0).min(lower);
        let (column, row) = (u.floor().min(right - 1.0), v.floor().min(lower - 1.0));
        let upper_left = u32x16::truncate_from(row) * tile.width + u32x16::truncate_from(column);
        let Some(found) = fours(simd, texels, upper_left, tile.width as usize) else {
            return;
        };
        let color = between(found, [share(u - column), share(v - row)]);
        let alpha = color >> ALPHA_SHIFT;
        let whole = alpha.simd_eq(255);
        let shown = in_front & whole;
        shown
            .select(color, u32x16::from_slice(simd, colors))
            .store_slice(colors);
        shown.select(q, old).store_slice(depths);
        if tile.opaque {
            continue;
        }
        let partial = (in_front & !whole & alpha.simd_ge(MIN_ALPHA)).to_bitmask();
        if partial != 0 {
            add_rims(
                to.rims,
                partial,
                [chunk.start as u32, index],
                &color.to_array(),
                &q.to_array(),
            );
        }
    }
}

/// Adds what the pixels from `first` on show that cover theirs in part. Out of the loop, whose registers it would take.
#[inline(never)]
fn add_rims(
    rims: &mut Vec<Rim>,
    mut partial: u64,
    first: [u32; 2],
    colors: &[u32; LANES],
    q: &[f32; LANES],
) {
    rims.reserve(LANES);
    while partial != 0 {
        let i = partial.trailing_zeros() as usize;
        partial &= partial - 1;
        rims.push(Rim::new([first[0] + i as u32, first[1]], colors[i], q[i]));
    }
}

/// A distance from 0 to 1, in 1/256.
#[inline(always)]
fn share<S: Simd>(distance: f32x16<S>) -> u32x16<S> {
    u32x16::truncate_from(distance * 256.0 + 0.5)
}

const LANE_NUMBERS: [f32; LANES] = [
    0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15.,
];

static RECIPROCALS: [u64; 256] = splat::reciprocals();

impl Rim {
    /// Of a mean of texels: colour times alpha, and alpha, which is not 0.
    #[inline(always)]
    fn new(pixel: [u32; 2], color: u32, inverse_depth: f32) -> Self {
        let [r, g, b, alpha] = color.to_ne_bytes();
        let (reciprocal, half) = (RECIPROCALS[usize::from(alpha)], u64::from(alpha / 2));
        let straight = |c: u8| (((u64::from(c) * 255 + half) * reciprocal) >> 32).min(255) as u8;
        Self {
            pixel,
            color: [straight(r), straight(g), straight(b), alpha],
            inverse_depth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::simd;

    #[test]
    fn distances_are_rounded_to_the_nearest_share() {
        for i in 0..=256 {
            for (off, expected) in [(0.0, i), (0.4, i), (-0.4, i)] {
                let distance = (i as f32 + off).max(0.0) / 256.0;
                for level in simd::levels() {
                    let found =
                        dispatch!(level, simd => share(f32x16::splat(simd, distance)).to_array());
                    assert_eq!(found, [expected as u32; LANES]);
                }
            }
        }
    }

    #[test]
    fn straight_colours_are_exact_divisions() {
        for alpha in 1..=255u8 {
            for c in 0..=255u8 {
                let Rim { color, .. } =
                    Rim::new([0, 0], u32::from_ne_bytes([c, 0, alpha, alpha]), 1.0);
                let exact =
                    ((u32::from(c) * 255 + u32::from(alpha / 2)) / u32::from(alpha)).min(255);
                assert_eq!(color.map(u32::from), [exact, 0, 255, u32::from(alpha)]);
            }
        }
    }
}
