//! A row of a picture on a plane, sixteen pixels at a time.
//!
//! One code for every SIMD level, without fused multiply-adds and approximate reciprocals, so that all give the same bits.

use super::Rim;
use fearless_simd::{Level, Simd, SimdCvtTruncate, dispatch, f32x16, prelude::*, u32x16};
use std::ops::Range;

/// Pixels at a time.
pub(super) const LANES: usize = 16;

/// Where alpha lies in four bytes as they lie in memory.
const ALPHA_SHIFT: u32 = u32::from_ne_bytes([0, 0, 0, 1]).trailing_zeros();

/// Below this alpha, a texel is not there: a canvas gives whatever is there a twentieth of its pixel.
const MIN_ALPHA: u32 = 8;

/// A row of a picture.
pub(super) struct Span<'a> {
    pub(super) texels: &'a [[u8; 4]],
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) opaque: bool,
    /// Of the frame.
    pub(super) columns: Range<u32>,
    /// At the first column: texel column and row times 1/w, 1/w, inverse depth.
    pub(super) start: [f32; 4],
    /// From column to column.
    pub(super) step: [f32; 4],
}

/// A row of a frame. Colours and inverse depths are longer than the frame is wide by [`LANES`].
pub(super) struct Row<'a> {
    /// Straight colours of what hides its pixel wholly; 0 where nothing does.
    pub(super) colors: &'a mut [u32],
    pub(super) depths: &'a mut [f32],
    /// Which row it is, counted from the band's first.
    pub(super) index: u32,
    /// Takes what covers its pixel in part.
    pub(super) rims: &'a mut Vec<Rim>,
}

/// Draws a span on a row.
pub(super) fn draw(span: &Span, row: &mut Row, level: Level) {
    dispatch!(level, simd => draw_span(simd, span, row));
}

#[inline(always)]
fn draw_span<S: Simd>(simd: S, span: &Span, to: &mut Row) {
    let lane = f32x16::load_array(simd, LANE_NUMBERS);
    let zero = f32x16::splat(simd, 0.0);
    let (right, lower) = (f32x16::splat(simd, span.width as f32 - 1.0), f32x16::splat(simd, span.height as f32 - 1.0));
    let (last_column, last_row) = (right - 1.0, lower - 1.0);
    let texels: &[u32] = bytemuck::cast_slice(span.texels);
    let stride = span.width as usize;
    let (first, count) = (span.columns.start as usize, span.columns.len());
    let mut at = 0;
    while at < count {
        let chunk = first + at..first + at + LANES;
        let (Some(colors), Some(depths)) = (to.colors.get_mut(chunk.clone()), to.depths.get_mut(chunk.clone())) else {
            return;
        };
        let k = lane + at as f32;
        let inside = k.simd_lt(f32x16::splat(simd, count as f32));
        at += LANES;
        let q = k * span.step[3] + span.start[3];
        let old = f32x16::from_slice(simd, depths);
        let in_front = q.simd_gt(old) & inside;
        if !in_front.any_true() {
            continue;
        }
        let w = f32x16::splat(simd, 1.0) / (k * span.step[2] + span.start[2]);
        let u = ((k * span.step[0] + span.start[0]) * w).max(zero).min(right);
        let v = ((k * span.step[1] + span.start[1]) * w).max(zero).min(lower);
        let (column, row) = (u.floor().min(last_column), v.floor().min(last_row));
        let (right_share, lower_share) = (share(u - column), share(v - row));
        let index = u32x16::truncate_from(row) * span.width + u32x16::truncate_from(column);
        let [upper_left, upper_right] = pairs(simd, texels, index, 0);
        let [lower_left, lower_right] = pairs(simd, texels, index, stride);
        let upper = mix(upper_left, upper_right, right_share);
        let lower_ = mix(lower_left, lower_right, right_share);
        let even = mix_two(upper[0], lower_[0], lower_share);
        let odd = mix_two(upper[1], lower_[1], lower_share);
        let color = even | (odd << 8);
        let alpha = color >> ALPHA_SHIFT;
        let whole = alpha.simd_eq(u32x16::splat(simd, 255));
        let shown = in_front & whole;
        shown.select(color, u32x16::from_slice(simd, colors)).store_slice(colors);
        shown.select(q, old).store_slice(depths);
        if span.opaque {
            continue;
        }
        let mut partial = (in_front & !whole & alpha.simd_ge(u32x16::splat(simd, MIN_ALPHA))).to_bitmask();
        if partial != 0 {
            let (color, q) = (color.to_array(), q.to_array());
            while partial != 0 {
                let i = partial.trailing_zeros() as usize;
                partial &= partial - 1;
                to.rims.push(Rim::new([(chunk.start + i) as u32, to.index], color[i], q[i]));
            }
        }
    }
}

/// A distance from 0 to 1, in 1/256.
#[inline(always)]
fn share<S: Simd>(distance: f32x16<S>) -> u32x16<S> {
    u32x16::truncate_from(distance * 256.0 + 0.5)
}

const LANE_NUMBERS: [f32; LANES] = [0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12., 13., 14., 15.];

/// The texels at some indices and right of them.
#[inline(always)]
fn pairs<S: Simd>(simd: S, texels: &[u32], index: u32x16<S>, offset: usize) -> [u32x16<S>; 2] {
    let index = index.to_array();
    let mut found = [[0u32; 2]; LANES];
    for (found, index) in found.iter_mut().zip(index) {
        let at = index as usize + offset;
        if let Some(pair) = texels.get(at..at + 2) {
            *found = [pair[0], pair[1]];
        }
    }
    let words: [u32; 2 * LANES] = bytemuck::cast(found);
    let (low, high) = words.split_at(LANES);
    let (left, right) = simd.deinterleave_u32x16(u32x16::from_slice(simd, low), u32x16::from_slice(simd, high));
    [left, right]
}

const TWO: u32 = 0x00ff_00ff;

/// Between two colours: the even and the odd bytes, 16 bits each.
#[inline(always)]
fn mix<S: Simd>(a: u32x16<S>, b: u32x16<S>, share: u32x16<S>) -> [u32x16<S>; 2] {
    [mix_two(a & TWO, b & TWO, share), mix_two((a >> 8) & TWO, (b >> 8) & TWO, share)]
}

/// Rounding is at most half a level. One product serves both halves: borrows of `b - a` go again with the sum.
#[inline(always)]
fn mix_two<S: Simd>(a: u32x16<S>, b: u32x16<S>, share: u32x16<S>) -> u32x16<S> {
    (((a << 8) + (b - a) * share + 0x0080_0080) >> 8) & TWO
}

impl Rim {
    /// Of a mean of texels: colour times alpha, and alpha, which is not 0.
    #[cold]
    #[inline(never)]
    fn new(pixel: [u32; 2], color: u32, inverse_depth: f32) -> Self {
        let [r, g, b, alpha] = color.to_ne_bytes();
        let straight = |c: u8| ((u32::from(c) * 255 + u32::from(alpha / 2)) / u32::from(alpha.max(1))).min(255) as u8;
        Self { pixel, color: [straight(r), straight(g), straight(b), alpha], inverse_depth }
    }
}
