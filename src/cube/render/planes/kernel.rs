//! Rasterisation of a plane texture, sixteen pixels of a row at a time.
//!
//! One implementation for every SIMD level, without fused multiply-adds and approximate
//! reciprocals, so that all levels give the same bits.

use super::Rim;
use super::plan::{FrameSize, TextureSpan, TileInView};
use crate::render::canvas::linear::{ALPHA_SHIFT, unpremultiply};
use fearless_simd::{Level, Simd, SimdCvtTruncate, dispatch, f32x16, prelude::*, u32x16};
pub(super) use headbox_core::image::texels::LANES;
use headbox_core::image::texels::{blend_quads, gather_quads};
use std::ops::Range;

/// Least alpha that is drawn: one step of the weights of a canvas.
const MIN_ALPHA: u32 = 2;

/// Rows of the frame to draw on.
pub(super) struct TargetRows<'a> {
    pub(super) frame: &'a FrameSize,
    /// Straight colours of opaque pixels; 0 elsewhere.
    pub(super) colors: &'a mut [u32],
    /// 1 / eye depth of opaque pixels, 1/m.
    pub(super) depths: &'a mut [f32],
    /// Pixels from row to row: at least [`LANES`] more than the frame is wide.
    pub(super) stride: usize,
    /// Rows of the frame.
    pub(super) rows: Range<u32>,
    /// Receives the partly covered pixels.
    pub(super) rims: &'a mut Vec<Rim>,
}

/// Draws a plane texture on the rows that it covers. `texels`: those of the tile's mip level.
pub(super) fn draw(tile: &TileInView, texels: &[[u8; 4]], target: &mut TargetRows, level: Level) {
    dispatch!(level, simd => draw_tile(simd, tile, texels, target));
}

#[inline(always)]
fn draw_tile<S: Simd>(simd: S, tile: &TileInView, texels: &[[u8; 4]], target: &mut TargetRows) {
    let first = tile.rows.start.max(target.rows.start);
    let end = tile.rows.end.min(target.rows.end);
    for y in first..end {
        if let Some(span) = tile.span(y, target.frame) {
            draw_span(simd, tile, texels, &span, y - target.rows.start, target);
        }
    }
}

#[inline(always)]
fn draw_span<S: Simd>(
    simd: S,
    tile: &TileInView,
    texels: &[[u8; 4]],
    span: &TextureSpan,
    row: u32,
    target: &mut TargetRows,
) {
    let start = row as usize * target.stride;
    let pixels = start..start + target.stride;
    let (Some(colors), Some(depths)) = (
        target.colors.get_mut(pixels.clone()),
        target.depths.get_mut(pixels),
    ) else {
        return;
    };
    let lane = f32x16::load_array(simd, LANE_NUMBERS);
    let right = tile.width as f32 - 1.0;
    let lower = tile.height as f32 - 1.0;
    let first = span.columns.start as usize;
    let count = span.columns.len();
    let mut offset = 0;
    while offset < count {
        let chunk = first + offset..first + offset + LANES;
        let (Some(colors), Some(depths)) =
            (colors.get_mut(chunk.clone()), depths.get_mut(chunk.clone()))
        else {
            return;
        };
        let k = lane + offset as f32;
        let inside = k.simd_lt(count as f32);
        offset += LANES;
        let q = k * span.step[3] + span.start[3];
        let old = f32x16::from_slice(simd, depths);
        let in_front = q.simd_gt(old) & inside;
        if !in_front.any_true() {
            continue;
        }
        let w = f32x16::splat(simd, 1.0) / (k * span.step[2] + span.start[2]);
        let u = ((k * span.step[0] + span.start[0]) * w).max(0.0).min(right);
        let v = ((k * span.step[1] + span.start[1]) * w).max(0.0).min(lower);
        let texel_column = u.floor().min(right - 1.0);
        let texel_row = v.floor().min(lower - 1.0);
        let upper_left =
            u32x16::truncate_from(texel_row) * tile.width + u32x16::truncate_from(texel_column);
        let Some(quads) = gather_quads(simd, texels, upper_left, tile.width as usize) else {
            return;
        };
        let color = blend_quads(
            quads,
            [to_256ths(u - texel_column), to_256ths(v - texel_row)],
        );
        let alpha = color >> ALPHA_SHIFT;
        let opaque = alpha.simd_eq(255);
        let visible = in_front & opaque;
        visible
            .select(color, u32x16::from_slice(simd, colors))
            .store_slice(colors);
        visible.select(q, old).store_slice(depths);
        if tile.opaque {
            continue;
        }
        let partial = (in_front & !opaque & alpha.simd_ge(MIN_ALPHA)).to_bitmask();
        if partial != 0 {
            add_rims(
                target.rims,
                partial,
                [chunk.start as u32, row],
                &color.to_array(),
                &q.to_array(),
            );
        }
    }
}

/// Adds the `partial` lanes of the pixels from `first` on as rims. Not inlined, to keep the loop's
/// registers.
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
        let pixel = [first[0] + i as u32, first[1]];
        rims.push(Rim::from_premultiplied(pixel, colors[i], q[i]));
    }
}

/// Converts a distance from 0 to 1 to units of 1/256, rounded.
#[inline(always)]
fn to_256ths<S: Simd>(distance: f32x16<S>) -> u32x16<S> {
    u32x16::truncate_from(distance * 256.0 + 0.5)
}

const LANE_NUMBERS: [f32; LANES] = [
    0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15.,
];

impl Rim {
    /// Creates a rim from a mean of texels: premultiplied colour and alpha > 0.
    #[inline(always)]
    fn from_premultiplied(pixel: [u32; 2], color: u32, inverse_depth: f32) -> Self {
        let [r, g, b, alpha] = color.to_ne_bytes();
        let [r, g, b] = [r, g, b].map(|c| unpremultiply(c, alpha));
        Self {
            pixel,
            color: [r, g, b, alpha],
            inverse_depth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::simd;

    #[test]
    fn distances_are_rounded_to_nearest() {
        for i in 0..=256 {
            for offset in [0.0, 0.4, -0.4] {
                let distance = (i as f32 + offset).max(0.0) / 256.0;
                for level in simd::levels() {
                    let rounded = dispatch!(level, simd => {
                        to_256ths(f32x16::splat(simd, distance)).to_array()
                    });
                    assert_eq!(rounded, [i as u32; LANES]);
                }
            }
        }
    }
}
