//! Bilinear lookups in sixteen lanes: gather of four texels, and their blend.

use fearless_simd::{ExtractToken, Simd, f32x16, prelude::*, u16x32, u32x4, u32x16};

/// Number of lanes.
pub const LANES: usize = 16;

/// Gathers for each lane the upper left, upper right, lower left and lower right texel: those at
/// `index`, after it, and `stride` after these. Larger indices are clamped to the last one that has
/// all four; `None` if there is none.
///
/// Registers are put together from registers of two pairs: put together from pairs, they become a
/// chain of sixteen steps (docs/decisions/0005).
#[inline(always)]
pub fn fours<S: Simd>(
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
    let (mut above, mut below) = (
        [u32x4::splat(simd, 0); LANES / 2],
        [u32x4::splat(simd, 0); LANES / 2],
    );
    for i in 0..LANES / 2 {
        // In these words the compiler sees that nothing lies outside.
        let (a, b) = (
            (index[2 * i] as usize).min(count - 2),
            (index[2 * i + 1] as usize).min(count - 2),
        );
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

/// The pixel before a position along an axis of a picture, of which another follows, and the way to
/// that in parts of 256.
#[inline(always)]
pub fn place<S: Simd>(position: f32x16<S>, side_px: u32) -> (u32x16<S>, u32x16<S>) {
    let position = position.max(0.0).min((side_px - 1) as f32);
    let before = u32x16::truncate_from(position).min(side_px.saturating_sub(2));
    (
        before,
        u32x16::truncate_from((position - f32x16::float_from(before)) * 256.0 + 0.5),
    )
}

/// Between four texels as [`fours`] gives them, byte by byte: to the right by one share of 256,
/// then down by the other. Each of the two roundings is at most half a level.
#[inline(always)]
pub fn between<S: Simd>(
    [upper_left, upper_right, lower_left, lower_right]: [u32x16<S>; 4],
    [across, down]: [u32x16<S>; 2],
) -> u32x16<S> {
    let (across, down) = (in_both_halves(across), in_both_halves(down));
    let (upper, lower) = (
        mix_bytes(upper_left, upper_right, across),
        mix_bytes(lower_left, lower_right, across),
    );
    let (even, odd) = (mix(upper[0], lower[0], down), mix(upper[1], lower[1], down));
    (even | (odd << 8)).bitcast()
}

#[inline(always)]
fn in_both_halves<S: Simd>(share: u32x16<S>) -> u16x32<S> {
    (share | (share << 16)).bitcast()
}

/// Between the even and between the odd bytes, 16 bits each.
#[inline(always)]
fn mix_bytes<S: Simd>(a: u32x16<S>, b: u32x16<S>, share: u16x32<S>) -> [u16x32<S>; 2] {
    let (a, b): (u16x32<S>, u16x32<S>) = (a.bitcast(), b.bitcast());
    [mix(a & 0xff, b & 0xff, share), mix(a >> 8, b >> 8, share)]
}

/// Intermediate results may wrap in 16 bits; the sum fits.
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
        let found = fours(simd, texels, u32x16::load_array(simd, *at), stride)?;
        let [across, down] = shares;
        let color = between(
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
    fn colours_are_those_between_four_at_every_level() {
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
