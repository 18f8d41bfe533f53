//! Texels of sixteen rays at once: the nearest index, and bilinear colours of those that show a
//! layer (C21).

use super::pyramid::{Level, Texel};
use fearless_simd::{ExtractToken, Simd, f32x16, i32x16, mask32x16, prelude::*, u32x4, u32x16};

/// Pixels at a time.
pub(super) const LANES: usize = 16;

/// The indices of the nearest texels of a level at positions that lie `inside` the image, with a
/// camera's texels from `base` on.
#[inline(always)]
pub(super) fn nearest<S: Simd>(
    simd: S,
    texels: &[Texel],
    level: Level,
    base: u32x16<S>,
    [u, v]: [f32x16<S>; 2],
    inside: mask32x16<S>,
) -> i32x16<S> {
    let zero = f32x16::splat(simd, 0.0);
    // Positions are not negative: truncation is the floor.
    let column = inside.select(u, zero).to_int::<i32x16<S>>();
    let row = inside.select(v, zero).to_int::<i32x16<S>>();
    let at = (row * level.width as i32 + column).bitcast::<u32x16<S>>() + base + level.first as u32;
    let at = at.to_array();
    // Blue and index.
    let word = |i: usize| {
        texels
            .get(at[i] as usize)
            .map_or(0, |&texel| bytemuck::cast::<Texel, [u32; 2]>(texel)[1])
    };
    // Registers put together from loads, as wide stores before a wider load would stall.
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

/// Adds colour times weight, and weight, of those of the four texels around positions that show
/// layers from the first to the second of `indices`.
#[inline(always)]
pub(super) fn add_taps<S: Simd>(
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
    let (upper, lower) = (at.to_array(), (at + level.width as u32).to_array());
    let weights = [weight * (one - down), weight * down];
    for (at, weight) in [(upper, weights[0]), (lower, weights[1])] {
        let [left, right] = pairs(simd, texels, &at);
        add_tap(left, indices, weight * (one - to_right), sum);
        add_tap(right, indices, weight * to_right, sum);
    }
}

/// The texels at some places and right of them, as two words each: red and green, blue and index.
#[inline(always)]
fn pairs<S: Simd>(simd: S, texels: &[Texel], at: &[u32; LANES]) -> [[u32x16<S>; 2]; 2] {
    let part = [
        four_pairs(simd, texels, [at[0], at[1], at[2], at[3]]),
        four_pairs(simd, texels, [at[4], at[5], at[6], at[7]]),
        four_pairs(simd, texels, [at[8], at[9], at[10], at[11]]),
        four_pairs(simd, texels, [at[12], at[13], at[14], at[15]]),
    ];
    let (even, odd) = simd.deinterleave_u32x16(part[0], part[1]);
    let (more_even, more_odd) = simd.deinterleave_u32x16(part[2], part[3]);
    let (left_rg, right_rg) = simd.deinterleave_u32x16(even, more_even);
    let (left_bi, right_bi) = simd.deinterleave_u32x16(odd, more_odd);
    [[left_rg, left_bi], [right_rg, right_bi]]
}

#[inline(always)]
fn four_pairs<S: Simd>(simd: S, texels: &[Texel], at: [u32; 4]) -> u32x16<S> {
    let halves = [
        simd.combine_u32x4(pair(simd, texels, at[0]), pair(simd, texels, at[1])),
        simd.combine_u32x4(pair(simd, texels, at[2]), pair(simd, texels, at[3])),
    ];
    simd.combine_u32x8(halves[0], halves[1])
}

#[inline(always)]
fn pair<S: Simd>(simd: S, texels: &[Texel], at: u32) -> u32x4<S> {
    let at = at as usize;
    match texels.get(at..at + 2) {
        Some(two) => u32x4::load_array(simd, bytemuck::cast([two[0], two[1]])),
        None => u32x4::splat(simd, 0),
    }
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

/// Converts numbers below 2^31.
#[inline(always)]
fn float<S: Simd>(of: u32x16<S>) -> f32x16<S> {
    of.bitcast::<i32x16<S>>().to_float::<f32x16<S>>()
}
