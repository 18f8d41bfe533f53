//! Bilinear texture lookups: blends of four texels, and gathers in sixteen lanes.

use fearless_simd::{ExtractToken, Simd, f32x16, prelude::*, u16x32, u32x4, u32x16};
use std::ops::{Add, Mul, Sub};

/// Number of lanes.
pub const LANES: usize = 16;

/// Index of each lane.
pub const LANE_INDICES: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

/// Blends the upper left, upper right, lower left and lower right texel by the distances to the
/// right and down from the first, 0 to 1: numbers, vectors of channels, or lanes.
#[inline(always)]
pub fn bilinear<T, W>([a, b, c, d]: [T; 4], [x, y]: [W; 2]) -> T
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<W, Output = T>,
    W: Copy,
{
    let top = a + (b - a) * x;
    let bottom = c + (d - c) * x;
    top + (bottom - top) * y
}

/// Gathers for each lane the upper left, upper right, lower left and lower right texel: those at
/// `index`, after it, and `stride` after these. Larger indices are clamped to the last one that has
/// all four; `None` if there is none.
///
/// Registers are composed of registers of two pairs: composed of single pairs, they become a chain
/// of sixteen steps (docs/decisions/0005).
#[inline(always)]
pub fn gather_quads<S: Simd>(
    simd: S,
    texels: &[[u8; 4]],
    index: u32x16<S>,
    stride: usize,
) -> Option<[u32x16<S>; 4]> {
    let count = texels.len().checked_sub(stride)?;
    let (upper, lower) = (texels.get(..count)?, texels.get(stride..stride + count)?);
    if count < 2 {
        return None;
    }
    let index = index.to_array();
    let mut above = [u32x4::splat(simd, 0); LANES / 2];
    let mut below = [u32x4::splat(simd, 0); LANES / 2];
    for i in 0..LANES / 2 {
        // Lets the compiler prove that all indices are in range.
        let a = (index[2 * i] as usize).min(count - 2);
        let b = (index[2 * i + 1] as usize).min(count - 2);
        above[i] = u32x4::load_array(
            simd,
            bytemuck::cast([upper[a], upper[a + 1], upper[b], upper[b + 1]]),
        );
        below[i] = u32x4::load_array(
            simd,
            bytemuck::cast([lower[a], lower[a + 1], lower[b], lower[b + 1]]),
        );
    }
    let ([upper_left, upper_right], [lower_left, lower_right]) =
        (left_and_right(above), left_and_right(below));
    Some([upper_left, upper_right, lower_left, lower_right])
}

/// Splits pairs of texels into the left and the right ones.
#[inline(always)]
fn left_and_right<S: Simd>(two: [u32x4<S>; LANES / 2]) -> [u32x16<S>; 2] {
    let low = two[0].combine(two[1]).combine(two[2].combine(two[3]));
    let high = two[4].combine(two[5]).combine(two[6].combine(two[7]));
    let (left, right) = low.token().deinterleave_u32x16(low, high);
    [left, right]
}

/// Same as [`gather_quads`] for texels of four 16-bit channels, each as two words: the first two
/// channels, and the last two.
#[inline(always)]
pub fn gather_wide_quads<S: Simd>(
    simd: S,
    texels: &[[u16; 4]],
    index: u32x16<S>,
    stride: usize,
) -> Option<[[u32x16<S>; 2]; 4]> {
    let count = texels.len().checked_sub(stride)?;
    let (upper, lower) = (texels.get(..count)?, texels.get(stride..stride + count)?);
    if count < 2 {
        return None;
    }
    let index = index.min(count as u32 - 2).to_array();
    let [upper_left, upper_right] = gather_pairs(simd, upper, &index);
    let [lower_left, lower_right] = gather_pairs(simd, lower, &index);
    Some([upper_left, upper_right, lower_left, lower_right])
}

/// Gathers for each lane the texel at `index` and the one after it.
#[inline(always)]
fn gather_pairs<S: Simd>(
    simd: S,
    texels: &[[u16; 4]],
    index: &[u32; LANES],
) -> [[u32x16<S>; 2]; 2] {
    let (a, b) = simd.deinterleave_u32x16(
        four_pairs(simd, texels, index, 0),
        four_pairs(simd, texels, index, 4),
    );
    let (c, d) = simd.deinterleave_u32x16(
        four_pairs(simd, texels, index, 8),
        four_pairs(simd, texels, index, 12),
    );
    let (left_low, right_low) = simd.deinterleave_u32x16(a, c);
    let (left_high, right_high) = simd.deinterleave_u32x16(b, d);
    [[left_low, left_high], [right_low, right_high]]
}

#[inline(always)]
fn four_pairs<S: Simd>(
    simd: S,
    texels: &[[u16; 4]],
    index: &[u32; LANES],
    first: usize,
) -> u32x16<S> {
    let a = pair(simd, texels, index[first]);
    let b = pair(simd, texels, index[first + 1]);
    let c = pair(simd, texels, index[first + 2]);
    let d = pair(simd, texels, index[first + 3]);
    a.combine(b).combine(c.combine(d))
}

#[inline(always)]
fn pair<S: Simd>(simd: S, texels: &[[u16; 4]], index: u32) -> u32x4<S> {
    // Lets the compiler prove that all indices are in range.
    let at = (index as usize).min(texels.len().saturating_sub(2));
    let two = texels
        .get(at..at + 2)
        .and_then(<[[u16; 4]]>::first_chunk::<2>)
        .copied()
        .unwrap_or_default();
    u32x4::load_array(simd, bytemuck::cast(two))
}

/// Returns, for positions along an axis of an image, the pixel before each, which has a successor,
/// and the distance from it in 1/256.
#[inline(always)]
pub fn locate<S: Simd>(position: f32x16<S>, side_px: u32) -> (u32x16<S>, u32x16<S>) {
    let position = position.max(0.0).min((side_px - 1) as f32);
    let before = u32x16::truncate_from(position).min(side_px.saturating_sub(2));
    (
        before,
        u32x16::truncate_from((position - f32x16::float_from(before)) * 256.0 + 0.5),
    )
}

/// Blends four texels of [`gather_quads`] byte by byte: across, then down, by distances in 1/256.
/// Each of the two roundings is at most half a level.
#[inline(always)]
pub fn blend_quads<S: Simd>(
    [upper_left, upper_right, lower_left, lower_right]: [u32x16<S>; 4],
    [across, down]: [u32x16<S>; 2],
) -> u32x16<S> {
    let (across, down) = (in_both_halves(across), in_both_halves(down));
    let upper = mix_bytes(upper_left, upper_right, across);
    let lower = mix_bytes(lower_left, lower_right, across);
    let (even, odd) = (mix(upper[0], lower[0], down), mix(upper[1], lower[1], down));
    (even | (odd << 8)).bitcast()
}

#[inline(always)]
fn in_both_halves<S: Simd>(share: u32x16<S>) -> u16x32<S> {
    (share | (share << 16)).bitcast()
}

/// Blends the even and the odd bytes, 16 bits each.
#[inline(always)]
fn mix_bytes<S: Simd>(a: u32x16<S>, b: u32x16<S>, share: u16x32<S>) -> [u16x32<S>; 2] {
    let (a, b): (u16x32<S>, u16x32<S>) = (a.bitcast(), b.bitcast());
    [mix(a & 0xff, b & 0xff, share), mix(a >> 8, b >> 8, share)]
}

/// Blends 16-bit lanes; intermediate results may wrap, the sum fits.
#[inline(always)]
fn mix<S: Simd>(a: u16x32<S>, b: u16x32<S>, share: u16x32<S>) -> u16x32<S> {
    ((a << 8) + (b - a) * share + 0x80) >> 8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;
    use crate::simd;
    use fearless_simd::dispatch;

    /// Half a level for each of two roundings.
    const LEVELS: f64 = 1.0;

    #[inline(always)]
    fn look<S: Simd>(
        simd: S,
        texels: &[[u8; 4]],
        at: &[u32; LANES],
        stride: usize,
        shares: &[[u32; LANES]; 2],
    ) -> Option<([[u32; LANES]; 4], [u32; LANES])> {
        let found = gather_quads(simd, texels, u32x16::load_array(simd, *at), stride)?;
        let [across, down] = shares;
        let color = blend_quads(
            found,
            [
                u32x16::load_array(simd, *across),
                u32x16::load_array(simd, *down),
            ],
        );
        let [a, b, c, d] = found;
        Some((
            [a.to_array(), b.to_array(), c.to_array(), d.to_array()],
            color.to_array(),
        ))
    }

    #[test]
    fn blended_bytes_match_exact_at_every_level() {
        let mut random = Rng::keyed(11);
        for (width, height) in [(2usize, 2usize), (3, 2), (2, 7), (64, 64), (17, 5)] {
            // Mostly 0 and 255, where sums are largest.
            let mut byte = |_: u8| [0, 255, 255, random.below(256) as u8][random.below(4) as usize];
            let texels: Vec<[u8; 4]> = (0..width * height).map(|_| [0; 4].map(&mut byte)).collect();
            for _ in 0..200 {
                let place = [0; LANES].map(|_: u32| {
                    [
                        random.below(width as u64 - 1),
                        random.below(height as u64 - 1),
                    ]
                });
                let at = place.map(|[x, y]| (y * width as u64 + x) as u32);
                let shares = [[0; LANES]; 2].map(|all| all.map(|_: u32| random.below(257) as u32));
                for level in simd::levels() {
                    let found = dispatch!(level, simd => look(simd, &texels, &at, width, &shares));
                    let (four, color) = found.expect("all have four");
                    for i in 0..LANES {
                        let first = at[i] as usize;
                        let expected =
                            [first, first + 1, first + width, first + width + 1].map(|k| texels[k]);
                        assert_eq!(four.map(|of| of[i].to_ne_bytes()), expected);
                        let [a, b, c, d] = expected.map(|texel| texel.map(f64::from));
                        let [x, y] = shares.map(|of| f64::from(of[i]) / 256.0);
                        for (channel, byte) in color[i].to_ne_bytes().into_iter().enumerate() {
                            let upper = a[channel] * (1.0 - x) + b[channel] * x;
                            let lower = c[channel] * (1.0 - x) + d[channel] * x;
                            let exact = upper * (1.0 - y) + lower * y;
                            assert!(
                                (f64::from(byte) - exact).abs() <= LEVELS,
                                "{byte} for {exact} at {level:?}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn gather_wide<S: Simd>(
        simd: S,
        texels: &[[u16; 4]],
        index: &[u32; LANES],
        stride: usize,
    ) -> Option<[[[u32; LANES]; 2]; 4]> {
        let index = u32x16::load_array(simd, *index);
        let [a, b, c, d] = gather_wide_quads(simd, texels, index, stride)?;
        let words = |[low, high]: [u32x16<S>; 2]| [low.to_array(), high.to_array()];
        Some([words(a), words(b), words(c), words(d)])
    }

    #[test]
    fn wide_texels_are_gathered_and_clamped() {
        let texels: Vec<[u16; 4]> = (0..40u16)
            .map(|i| [i, 1000 + i, 2000 + i, 3000 + i])
            .collect();
        let mut index: [u32; LANES] = std::array::from_fn(|i| (i * 17 % 31) as u32);
        index[3] = 39;
        index[9] = u32::MAX;
        for level in simd::levels() {
            let gather = |texels: &[[u16; 4]], stride: usize| dispatch!(level, simd => gather_wide(simd, texels, &index, stride));
            let found = gather(&texels, 8).expect("all have four");
            for (words, offset) in found.iter().zip([0, 1, 8, 9]) {
                for lane in 0..LANES {
                    let texel = texels[(index[lane] as usize).min(30) + offset];
                    let expected: [u32; 2] = bytemuck::cast(texel);
                    assert_eq!(words.map(|word| word[lane]), expected, "{lane} {level:?}");
                }
            }
            for (count, stride) in [(0, 0), (1, 0), (9, 8), (8, 8), (2, 9)] {
                assert_eq!(gather(&texels[..count], stride), None, "{count} {stride}");
            }
        }
    }

    #[test]
    fn bilinear_is_linear_in_both_axes() {
        let plane = |x: f32, y: f32| 3.0 + 2.0 * x - 5.0 * y;
        let four = [
            plane(0.0, 0.0),
            plane(1.0, 0.0),
            plane(0.0, 1.0),
            plane(1.0, 1.0),
        ];
        for at in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.25, 0.5]] {
            assert_eq!(bilinear(four, at), plane(at[0], at[1]));
        }
    }

    #[test]
    fn gather_clamps_to_last_complete_quad() {
        let texels: Vec<[u8; 4]> = (0..6u32).map(u32::to_ne_bytes).collect();
        let none = [[0; LANES]; 2];
        for level in simd::levels() {
            let look = |texels: &[[u8; 4]], at: u32, stride: usize| dispatch!(level, simd => look(simd, texels, &[at; LANES], stride, &none));
            for at in [1, 2, 6, u32::MAX] {
                assert_eq!(
                    look(&texels, at, 3).map(|(four, _)| four.map(|of| of[0])),
                    Some([1, 2, 4, 5])
                );
            }
            for (count, stride) in [(0, 0), (1, 0), (4, 3), (3, 3), (2, 9)] {
                assert_eq!(look(&texels[..count], 0, stride), None, "{count} {stride}");
            }
        }
    }
}
