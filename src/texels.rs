//! The four texels around each of sixteen places of a picture, and the colour between them.

use crate::capture::simd::permutes;
use fearless_simd::{ExtractToken, Simd, prelude::*, u8x64, u16x32, u32x4, u32x16};

/// Places at a time.
pub(crate) const LANES: usize = 16;

/// Of each place the upper left, upper right, lower left and lower right texel: those at an index, after it, and `stride` after
/// these. Indices beyond the last that has all four count as that one; `None` if no index has.
///
/// Registers are put together from registers of two pairs: put together from pairs, they become a chain of sixteen steps
/// (docs/decisions.md: texels by two pairs).
#[inline(always)]
pub(crate) fn fours<S: Simd>(simd: S, texels: &[[u8; 4]], index: u32x16<S>, stride: usize) -> Option<[u32x16<S>; 4]> {
    let count = texels.len().checked_sub(stride)?;
    let (upper, lower) = (texels.get(..count)?, texels.get(stride..stride + count)?);
    if count < 2 {
        return None;
    }
    let index = index.to_array();
    let (mut above, mut below) = ([u32x4::splat(simd, 0); LANES / 2], [u32x4::splat(simd, 0); LANES / 2]);
    for i in 0..LANES / 2 {
        // In these words the compiler sees that nothing lies outside.
        let (a, b) = ((index[2 * i] as usize).min(count - 2), (index[2 * i + 1] as usize).min(count - 2));
        above[i] = u32x4::load_array(simd, bytemuck::cast([upper[a], upper[a + 1], upper[b], upper[b + 1]]));
        below[i] = u32x4::load_array(simd, bytemuck::cast([lower[a], lower[a + 1], lower[b], lower[b + 1]]));
    }
    let ([upper_left, upper_right], [lower_left, lower_right]) = (left_and_right(above), left_and_right(below));
    Some([upper_left, upper_right, lower_left, lower_right])
}

/// Texels of a row that serve four places.
const NEAR: usize = 5;

/// The first place of each four, in all four lanes; and from it on.
const FIRST_OF_FOUR: [u8; 64] = bytes_of([0; 4]);
const BACKWARD: [u8; 64] = bytes_of([3, 2, 1, 0]);

/// Which bytes of a block of four words are those of some words, in every block.
const fn bytes_of(words: [u8; 4]) -> [u8; 64] {
    let mut bytes = [0; 64];
    let mut i = 0;
    while i < 64 {
        bytes[i] = words[i / 4 % 4] * 4 + (i % 4) as u8;
        i += 1;
    }
    bytes
}

/// As [`fours`], by columns and rows, where neighbours look at neighbours: of each four places the columns lie within four texels and the
/// rows within two, as in pictures that are hardly made smaller and hardly turned. These need three rows of five texels, of which each place
/// takes its own by a permutation, instead of four loads each. `None` where it is not so, and near the end of the last rows.
#[inline(always)]
pub(crate) fn fours_near<S: Simd>(
    simd: S,
    texels: &[[u8; 4]],
    [column, row]: [u32x16<S>; 2],
    stride: usize,
) -> Option<[u32x16<S>; 4]> {
    if !permutes(simd.level()) {
        return None;
    }
    let (first_column, first_row) = (least_of_four(column), least_of_four(row));
    // What lies before the first wraps round to what is far behind it.
    let (right, down) = (column - first_column, row - first_row);
    if !(right.simd_lt(4) & down.simd_lt(2)).all_true() {
        return None;
    }
    let starts = (first_row * stride as u32 + first_column).to_array();
    let (mut left, mut beside) = ([[u32x4::splat(simd, 0); 4]; 3], [[u32x4::splat(simd, 0); 4]; 3]);
    for block in 0..4 {
        let rows = texels.get(starts[4 * block] as usize..)?;
        for k in 0..3 {
            let [a, b, c, d, e] = *rows.get(k * stride..)?.first_chunk::<NEAR>()?;
            left[k][block] = u32x4::load_array(simd, bytemuck::cast([a, b, c, d]));
            beside[k][block] = u32x4::load_array(simd, bytemuck::cast([b, c, d, e]));
        }
    }
    let bytes: u8x64<S> = (right * 0x0404_0404 + 0x0302_0100).bitcast();
    let is_lower = down.simd_eq(1);
    let [left_0, left_1, left_2] = [own(left[0], bytes), own(left[1], bytes), own(left[2], bytes)];
    let [right_0, right_1, right_2] = [own(beside[0], bytes), own(beside[1], bytes), own(beside[2], bytes)];
    Some([
        is_lower.select(left_1, left_0),
        is_lower.select(right_1, right_0),
        is_lower.select(left_2, left_1),
        is_lower.select(right_2, right_1),
    ])
}

/// The least of each four places, in all four lanes, if they ascend or descend.
#[inline(always)]
fn least_of_four<S: Simd>(places: u32x16<S>) -> u32x16<S> {
    let simd = places.token();
    let backward = places.swizzle_dyn_within_blocks(u8x64::load_array(simd, BACKWARD));
    places.min(backward).swizzle_dyn_within_blocks(u8x64::load_array(simd, FIRST_OF_FOUR))
}

/// Of four texels for each four places, that of each place.
#[inline(always)]
fn own<S: Simd>([a, b, c, d]: [u32x4<S>; 4], bytes: u8x64<S>) -> u32x16<S> {
    a.combine(b).combine(c.combine(d)).swizzle_dyn_within_blocks(bytes)
}

/// Of pairs of texels, the left ones and the right ones.
#[inline(always)]
fn left_and_right<S: Simd>(two: [u32x4<S>; LANES / 2]) -> [u32x16<S>; 2] {
    let low = two[0].combine(two[1]).combine(two[2].combine(two[3]));
    let high = two[4].combine(two[5]).combine(two[6].combine(two[7]));
    let (left, right) = low.token().deinterleave_u32x16(low, high);
    [left, right]
}

/// Between four texels as [`fours`] gives them, byte by byte: to the right by one share of 256, then down by the other. Each of the
/// two roundings is at most half a level.
#[inline(always)]
pub(crate) fn between<S: Simd>(
    [upper_left, upper_right, lower_left, lower_right]: [u32x16<S>; 4],
    [across, down]: [u32x16<S>; 2],
) -> u32x16<S> {
    let (across, down) = (in_both_halves(across), in_both_halves(down));
    let (upper, lower) = (mix_bytes(upper_left, upper_right, across), mix_bytes(lower_left, lower_right, across));
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

/// What goes beyond 16 bits on the way comes back: the sum fits.
#[inline(always)]
fn mix<S: Simd>(a: u16x32<S>, b: u16x32<S>, share: u16x32<S>) -> u16x32<S> {
    ((a << 8) + (b - a) * share + 0x80) >> 8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::random::Rng;
    use crate::capture::simd;
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
        let color = between(found, [u32x16::load_array(simd, *across), u32x16::load_array(simd, *down)]);
        let [a, b, c, d] = found;
        Some(([a.to_array(), b.to_array(), c.to_array(), d.to_array()], color.to_array()))
    }

    #[test]
    fn colours_are_those_between_four_at_every_level() {
        let mut random = Rng::keyed(11);
        for (width, height) in [(2usize, 2usize), (3, 2), (2, 7), (64, 64), (17, 5)] {
            // Mostly 0 and 255, where sums are largest.
            let mut byte = |_: u8| [0, 255, 255, random.below(256) as u8][random.below(4) as usize];
            let texels: Vec<[u8; 4]> = (0..width * height).map(|_| [0; 4].map(&mut byte)).collect();
            for _ in 0..200 {
                let place = [0; LANES].map(|_: u32| [random.below(width as u64 - 1), random.below(height as u64 - 1)]);
                let at = place.map(|[x, y]| (y * width as u64 + x) as u32);
                let shares = [[0; LANES]; 2].map(|all| all.map(|_: u32| random.below(257) as u32));
                for level in simd::levels() {
                    let found = dispatch!(level, simd => look(simd, &texels, &at, width, &shares));
                    let (four, color) = found.expect("all have four");
                    for i in 0..LANES {
                        let first = at[i] as usize;
                        let expected = [first, first + 1, first + width, first + width + 1].map(|k| texels[k]);
                        assert_eq!(four.map(|of| of[i].to_ne_bytes()), expected);
                        let [a, b, c, d] = expected.map(|texel| texel.map(f64::from));
                        let [x, y] = shares.map(|of| f64::from(of[i]) / 256.0);
                        for (channel, byte) in color[i].to_ne_bytes().into_iter().enumerate() {
                            let upper = a[channel] * (1.0 - x) + b[channel] * x;
                            let lower = c[channel] * (1.0 - x) + d[channel] * x;
                            let exact = upper * (1.0 - y) + lower * y;
                            assert!((f64::from(byte) - exact).abs() <= LEVELS, "{byte} for {exact} at {level:?}");
                        }
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn look_near<S: Simd>(
        simd: S,
        texels: &[[u8; 4]],
        place: &[[u32; LANES]; 2],
        stride: usize,
    ) -> Option<[[u32; LANES]; 4]> {
        let place = [u32x16::load_array(simd, place[0]), u32x16::load_array(simd, place[1])];
        let [a, b, c, d] = fours_near(simd, texels, place, stride)?;
        Some([a.to_array(), b.to_array(), c.to_array(), d.to_array()])
    }

    #[test]
    fn what_is_near_is_what_is_there_or_nothing() {
        let mut random = Rng::keyed(12);
        let [width, height] = [40usize, 24];
        let texels: Vec<[u8; 4]> =
            (0..width * height).map(|i| (i as u32).wrapping_mul(2_654_435_761).to_ne_bytes()).collect();
        let (mut found, mut left_out) = (0, 0);
        for _ in 0..2000 {
            let mut along = |side: usize, steepest: f64| {
                let (start, step) = (random.between(-2.0, side as f64), random.between(-steepest, steepest));
                [0; LANES].map({
                    let mut lane = -1.0;
                    move |_: u32| {
                        lane += 1.0;
                        (start + lane * step).clamp(0.0, side as f64 - 2.0) as u32
                    }
                })
            };
            let place = [along(width, 1.4), along(height, 0.6)];
            let is_near = |of: &[u32; LANES], most: u32| of.chunks(4).all(|four| four[0].abs_diff(four[3]) <= most);
            let lowest = place[1].chunks(4).map(|four| four[0].min(four[3])).max();
            let expected =
                is_near(&place[0], 3) && is_near(&place[1], 1) && lowest.is_some_and(|row| row as usize + 3 < height);
            for level in simd::levels() {
                let four = dispatch!(level, simd => look_near(simd, &texels, &place, width));
                match four {
                    None => left_out += 1,
                    Some(four) => {
                        found += 1;
                        for i in 0..LANES {
                            let first = place[1][i] as usize * width + place[0][i] as usize;
                            let expected = [first, first + 1, first + width, first + width + 1].map(|k| texels[k]);
                            assert_eq!(four.map(|of| of[i].to_ne_bytes()), expected, "{level:?} {place:?}");
                        }
                    }
                }
                assert!(four.is_some() || !(expected && permutes(level)), "{level:?} {place:?}");
            }
        }
        assert!(found > 500 && left_out > 500, "{found} {left_out}");
    }

    #[test]
    fn what_is_outside_is_the_last_that_has_all_four_or_nothing() {
        let texels: Vec<[u8; 4]> = (0..6u32).map(u32::to_ne_bytes).collect();
        let none = [[0; LANES]; 2];
        for level in simd::levels() {
            let look = |texels: &[[u8; 4]], at: u32, stride: usize| dispatch!(level, simd => look(simd, texels, &[at; LANES], stride, &none));
            for at in [1, 2, 6, u32::MAX] {
                assert_eq!(look(&texels, at, 3).map(|(four, _)| four.map(|of| of[0])), Some([1, 2, 4, 5]));
            }
            for (count, stride) in [(0, 0), (1, 0), (4, 3), (3, 3), (2, 9)] {
                assert_eq!(look(&texels[..count], 0, stride), None, "{count} {stride}");
            }
        }
    }
}
