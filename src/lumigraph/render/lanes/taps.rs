//! Texture lookups of sixteen rays at once: nearest layer index, and bilinear colours over the
//! texels of a layer (C21).

use crate::render::pyramid::{Level, Texel};
use fearless_simd::{ExtractToken, Simd, f32x16, i32x16, mask32x16, prelude::*, u32x4, u32x16};
use headbox_core::image::texels::gather_wide_quads;

/// Number of pixels per vector.
pub(crate) const LANES: usize = 16;

/// Returns the layer indices of the nearest texels of a level, at positions `inside` the image; a
/// camera's texels start at `base`.
#[inline(always)]
pub(crate) fn nearest<S: Simd>(
    simd: S,
    texels: &[Texel],
    level: Level,
    base: u32x16<S>,
    [u, v]: [f32x16<S>; 2],
    inside: mask32x16<S>,
) -> i32x16<S> {
    let zero = f32x16::splat(simd, 0.0);
    // Positions are not negative, so that truncation is the floor.
    let column = inside.select(u, zero).to_int::<i32x16<S>>();
    let row = inside.select(v, zero).to_int::<i32x16<S>>();
    let at = (row * level.width as i32 + column).bitcast::<u32x16<S>>() + base + level.first as u32;
    let at = at.to_array();
    // The word of blue and index.
    let word = |i: usize| {
        texels
            .get(at[i] as usize)
            .map_or(0, |&texel| bytemuck::cast::<Texel, [u32; 2]>(texel)[1])
    };
    // Registers are combined from loads, since narrow stores before a wide load would stall.
    let four = [
        u32x4::load_array(simd, [word(0), word(1), word(2), word(3)]),
        u32x4::load_array(simd, [word(4), word(5), word(6), word(7)]),
        u32x4::load_array(simd, [word(8), word(9), word(10), word(11)]),
        u32x4::load_array(simd, [word(12), word(13), word(14), word(15)]),
    ];
    let eight = [
        simd.combine_u32x4(four[0], four[1]),
        simd.combine_u32x4(four[2], four[3]),
    ];
    (simd.combine_u32x8(eight[0], eight[1]) >> 16).bitcast::<i32x16<S>>()
}

/// Adds colour times weight, and weight, of those of the four texels around a position whose layer
/// lies between the two `indices`.
#[inline(always)]
pub(crate) fn add_taps<S: Simd>(
    simd: S,
    texels: &[Texel],
    level: Level,
    base: u32x16<S>,
    [u, v]: [f32x16<S>; 2],
    indices: &[i32x16<S>; 2],
    weight: f32x16<S>,
    sum: &mut [f32x16<S>; 4],
) {
    let one = f32x16::splat(simd, 1.0);
    let (right, lower) = (level.width as f32 - 1.0, level.height as f32 - 1.0);
    let (u, v) = ((u - 0.5).max(0.0).min(right), (v - 0.5).max(0.0).min(lower));
    let (column, row) = (u.floor().min(right - 1.0), v.floor().min(lower - 1.0));
    let (to_right, down) = (u - column, v - row);
    let at = row.to_int::<i32x16<S>>() * level.width as i32 + column.to_int::<i32x16<S>>();
    let at = at.bitcast::<u32x16<S>>() + base + level.first as u32;
    let Some(quads) = gather_wide_quads(simd, texels, at, level.width) else {
        return;
    };
    let [upper, lower] = [weight * (one - down), weight * down];
    add_tap(quads[0], indices, upper * (one - to_right), sum);
    add_tap(quads[1], indices, upper * to_right, sum);
    add_tap(quads[2], indices, lower * (one - to_right), sum);
    add_tap(quads[3], indices, lower * to_right, sum);
}

#[inline(always)]
fn add_tap<S: Simd>(
    [rg, bi]: [u32x16<S>; 2],
    indices: &[i32x16<S>; 2],
    weight: f32x16<S>,
    sum: &mut [f32x16<S>; 4],
) {
    let index = (bi >> 16).bitcast::<i32x16<S>>();
    let shows = index.simd_ge(indices[0]) & index.simd_le(indices[1]);
    let weight = shows.select(weight, f32x16::splat(weight.token(), 0.0));
    sum[0] += float(rg & 0xffff) * weight;
    sum[1] += float(rg >> 16) * weight;
    sum[2] += float(bi & 0xffff) * weight;
    sum[3] += weight;
}

/// Converts integers below 2^31.
#[inline(always)]
fn float<S: Simd>(values: u32x16<S>) -> f32x16<S> {
    values.bitcast::<i32x16<S>>().to_float::<f32x16<S>>()
}
