//! Sampling of a sprite's texture: vector arithmetic on sixteen pixels at a time; texels are
//! fetched one by one.
//!
//! The arithmetic has no closures: a closure that is not inlined would be compiled without the SIMD
//! level's instructions and cost more than all the rest.
//!
//! Bilinear weights are 14-bit integers that sum to 2^14, so that a weighted sum of 8-bit texels is
//! exact in 32 bits and rounds once. The weights' own rounding is at most one and a half units,
//! which changes a result by at most 255 * 1.5 / 2^14 = 0.023 levels beyond the half level of the
//! final rounding.

use crate::model::texture::{LevelLayout, Texture};
use fearless_simd::{Simd, f32x16, i16x32, i32x16, mask32x16, prelude::*, u8x64, u16x32, u32x16};

/// Texture filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Hash, serde::Serialize)]
pub enum SpriteSampling {
    /// The nearest pixel.
    Nearest,
    /// Weighted mean of the four nearest pixels.
    #[default]
    Bilinear,
}

/// Number of pixels that are addressed, fetched and mixed together: enough to hide the latency of
/// the fetches.
pub(super) const BLOCK: usize = 128;
/// Number of pixels in a vector.
pub(crate) const LANES: usize = 16;

/// Lane numbers of a vector.
pub(crate) const LANE_NUMBERS: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

/// Addresses, weights and texels of a block. Aligned to cache lines: a vector across two of them
/// costs twice as much.
#[repr(align(64))]
pub(crate) struct Footprints {
    /// Index of the top left texel.
    offsets: [u32; BLOCK],
    /// Weights of the two upper texels, 16 bits each, the left one low.
    upper: [u32; BLOCK],
    /// Weights of the two lower texels.
    lower: [u32; BLOCK],
    /// Top left, bottom left, top right, bottom right texel of each pixel, pixels in the order of
    /// [`mix`].
    texels: [[[u32; 2]; 2]; BLOCK],
}

impl Footprints {
    pub(crate) fn new() -> Self {
        Self {
            offsets: [0; BLOCK],
            upper: [0; BLOCK],
            lower: [0; BLOCK],
            texels: [[[0; 2]; 2]; BLOCK],
        }
    }
}

/// Mapping from positions relative to an anchor to texel positions of a mip level.
pub(super) struct TexelMap {
    level: LevelLayout,
    /// 2^-level.
    scale: f32,
    /// Fractional part of the anchor's texel position.
    fraction: [f32; 2],
    /// Texel to which positions are relative.
    base: [i32; 2],
}

impl TexelMap {
    /// Creates the map of positions relative to the whole pixel `anchor` of level 0.
    #[inline(always)]
    pub(crate) fn new(texture: &Texture, level: usize, anchor: [f64; 2]) -> Self {
        let level = level.min(texture.levels.len() - 1);
        let scale = 1.0 / f64::from(1u32 << level);
        let (x, y) = (anchor[0] * scale - 0.5, anchor[1] * scale - 0.5);
        let (column, row) = (x.floor(), y.floor());
        Self {
            level: texture.levels[level],
            scale: scale as f32,
            fraction: [(x - column) as f32, (y - row) as f32],
            base: [column as i32, row as i32],
        }
    }
}

/// Computes the footprints of sixteen positions into `first..first + 16`; positions that are not
/// `valid` are transparent. With `INSIDE` all are valid, and no footprint extends beyond the texels
/// and their border.
#[inline(always)]
pub(super) fn address<S: Simd, const NEAREST: bool, const INSIDE: bool>(
    simd: S,
    map: &TexelMap,
    position: [f32x16<S>; 2],
    valid: mask32x16<S>,
    first: usize,
    out: &mut Footprints,
) {
    let sides = [map.level.width as i32, map.level.height as i32];
    let mut cell = [i32x16::splat(simd, 0); 2];
    let mut fraction = [f32x16::splat(simd, 0.0); 2];
    for axis in 0..2 {
        // The outermost border texels and all positions beyond them are transparent.
        let low = f32x16::splat(simd, (-1 - map.base[axis]) as f32);
        let high = (sides[axis] - map.base[axis]) as f32;
        let half = if NEAREST { 0.5 } else { 0.0 };
        let texel = position[axis] * map.scale + (map.fraction[axis] + half);
        let texel = if INSIDE {
            texel
        } else {
            valid.select(texel, low).max(low).min(high)
        };
        let floor = texel.floor();
        fraction[axis] = texel - floor;
        cell[axis] = floor.to_int::<i32x16<S>>();
    }
    // Far from the image the summands may overflow, but the sum modulo 2^32 is correct.
    let row = map.base[1].wrapping_mul(map.level.stride as i32);
    let origin = (map.level.origin as i32)
        .wrapping_add(row)
        .wrapping_add(map.base[0]);
    let offset = cell[1] * (map.level.stride as i32) + cell[0] + origin;
    offset
        .bitcast::<u32x16<S>>()
        .store_slice(&mut out.offsets[first..first + LANES]);
    if NEAREST {
        return;
    }
    // In units of 1 / ONE, rounded by truncation.
    let across = fraction[0] * ONE as f32;
    let x = (across + 0.5).to_int::<i32x16<S>>();
    let y = (fraction[1] * ONE as f32 + 0.5).to_int::<i32x16<S>>();
    let both = (across * fraction[1] + 0.5).to_int::<i32x16<S>>();
    let upper_left = i32x16::splat(simd, ONE) - x - y + both;
    let upper = (upper_left & 0xffff) | ((x - both) << 16);
    let lower = ((y - both) & 0xffff) | (both << 16);
    upper
        .bitcast::<u32x16<S>>()
        .store_slice(&mut out.upper[first..first + LANES]);
    lower
        .bitcast::<u32x16<S>>()
        .store_slice(&mut out.lower[first..first + LANES]);
}

/// Fixed-point weight 1.
const ONE: i32 = 1 << 14;

/// Repeats byte indices in each 128-bit block of a vector.
const fn repeat_in_blocks(indices: [u8; 16]) -> [u8; 64] {
    let mut all = [0; 64];
    let mut i = 0;
    while i < 64 {
        all[i] = indices[i % 16];
        i += 1;
    }
    all
}

/// Transposes 4 x 4 bytes. Of a footprint it gives the left and right texel of each channel, the
/// upper in the low byte, the lower in the high byte.
const TRANSPOSE: [u8; 64] =
    repeat_in_blocks([0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15]);
/// The k-th of four 32-bit numbers, repeated four times.
pub(crate) const COPIES: [[u8; 64]; 4] = [
    repeat_in_blocks([0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3]),
    repeat_in_blocks([4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 7]),
    repeat_in_blocks([8, 9, 10, 11, 8, 9, 10, 11, 8, 9, 10, 11, 8, 9, 10, 11]),
    repeat_in_blocks([
        12, 13, 14, 15, 12, 13, 14, 15, 12, 13, 14, 15, 12, 13, 14, 15,
    ]),
];

/// Fetches and mixes the first `count` pixels of a block into `out`; `count` is a multiple of
/// [`LANES`].
#[inline(always)]
pub(crate) fn sample<S: Simd, const NEAREST: bool>(
    simd: S,
    texture: &Texture,
    footprints: &mut Footprints,
    count: usize,
    out: &mut [u32; BLOCK],
) {
    let texels = texture.texels.as_slice();
    if NEAREST {
        for (out, &offset) in out.iter_mut().zip(&footprints.offsets[..count]) {
            *out = texels.get(offset as usize).map_or(0, |texel| texel[0]);
        }
        return;
    }
    let offsets = footprints.offsets[..count].chunks_exact(LANES);
    for (offsets, fetched) in offsets.zip(footprints.texels.chunks_exact_mut(LANES)) {
        for lane in 0..LANES {
            let offset = offsets[lane] as usize;
            if let Some(window) = texels.get(offset..offset + 2) {
                fetched[lane % 4 * 4 + lane / 4] = [window[0], window[1]];
            }
        }
    }
    for first in (0..count).step_by(LANES) {
        mix(simd, footprints, first, &mut out[first..first + LANES]);
    }
}

/// Computes the weighted sums of sixteen footprints.
///
/// All steps stay within 128-bit blocks: block b of the k-th of four vectors holds the texels of
/// pixel 4 b + k, so the weights of pixel 4 b + k, which lie in block b, are copied within it only,
/// and the four results end up in block b, one byte each.
#[inline(always)]
fn mix<S: Simd>(simd: S, footprints: &Footprints, first: usize, out: &mut [u32]) {
    let transpose = u8x64::load_array_ref(simd, &TRANSPOSE);
    let upper_weights = u32x16::from_slice(simd, &footprints.upper[first..first + LANES]);
    let lower_weights = u32x16::from_slice(simd, &footprints.lower[first..first + LANES]);
    let bytes: &[u8] = bytemuck::cast_slice(&footprints.texels[first..first + LANES]);
    let mut word = u32x16::splat(simd, 0);
    for k in 0..4 {
        let texels = u8x64::from_slice(simd, &bytes[k * 64..k * 64 + 64]);
        let pairs = texels
            .swizzle_dyn_within_blocks(transpose)
            .bitcast::<u16x32<S>>();
        let upper = (pairs & 0xff).bitcast::<i16x32<S>>();
        let lower = (pairs >> 8).bitcast::<i16x32<S>>();
        let lane = u8x64::load_array_ref(simd, &COPIES[k]);
        let upper_weights = upper_weights
            .swizzle_dyn_within_blocks(lane)
            .bitcast::<i16x32<S>>();
        let lower_weights = lower_weights
            .swizzle_dyn_within_blocks(lane)
            .bitcast::<i16x32<S>>();
        let sum =
            upper.pairwise_dot_product(upper_weights) + lower.pairwise_dot_product(lower_weights);
        let level = (sum + ONE / 2) >> 14;
        word |= level.bitcast::<u32x16<S>>() << (8 * k as u32);
    }
    word.bitcast::<u8x64<S>>()
        .swizzle_dyn_within_blocks(transpose)
        .bitcast::<u32x16<S>>()
        .store_slice(out);
}
