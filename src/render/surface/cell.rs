//! A pixel of a canvas of surfaces: one mean in front, one behind it, and one colour behind both.

use crate::render::linear::LinearLight;
use crate::render::size::LANES;
use crate::render::splat;
use crate::render::tent::ONE;
use bytemuck::{Pod, Zeroable};
use fearless_simd::{Simd, SimdCvtFloat, SimdCvtTruncate, f32x16, prelude::*, u32x16};

/// A pixel's weights stay at or below this, so that sums of 255 times a weight fit into 16 bits.
const MAX_WEIGHT: u64 = 257;

/// Weight at which a surface hides wholly what is behind it: inside a surface, rounded weights add up to [`ONE`] less a few.
pub(in crate::render) const OPAQUE: u64 = 120;

/// The least share of 255 of a pixel that a surface has where it has any.
pub(in crate::render) const MIN_SHARE: u64 = 13;

/// One pixel: 16 bytes, all that most splats touch; the rest is its [`Second`].
#[derive(Clone, Copy, Default, Pod, Zeroable)]
#[repr(C, align(16))]
pub(super) struct Cell {
    /// Of the front surface, 16 bits each from the lowest: red, green and blue times weight, and weight. No lane
    /// overflows into the next, so that one multiplication and one addition serve all four. The highest bit, which no weight reaches,
    /// is [`HAS_SECOND`].
    pub(super) sum: u64,
    /// 1 / eye depth of the front surface, 1/m: the largest in the mean. 0 for none.
    pub(super) inverse_depth: f32,
    /// What is behind both surfaces: straight colour, and the share of the pixel that is covered.
    behind: [u8; 4],
}

const _: () = assert!(size_of::<Cell>() == 16, "one SIMD register a pixel");

/// Of a [`Cell::sum`]: there is a second surface. Where there is none, what its [`Second`] holds does not matter.
const HAS_SECOND: u64 = 1 << 63;

/// The surface behind the front one of a pixel, as in [`Cell`]: without it splats of what is behind it, drawn in turns with its own, would
/// share its place (docs/decisions.md: three surfaces in a pixel).
#[derive(Clone, Copy, Default)]
pub(super) struct Second {
    sum: u64,
    inverse_depth: f32,
}

/// Red, green, blue and 1, 16 bits each: times a weight, what a splat adds to a sum.
#[inline]
pub(super) fn lanes([r, g, b, _]: [u8; 4]) -> u64 {
    u64::from(r) | u64::from(g) << 16 | u64::from(b) << 32 | 1 << 48
}

static RECIPROCALS: [u64; MAX_WEIGHT as usize + 1] = splat::reciprocals();

/// Weight of a sum.
#[inline]
fn weight_of(sum: u64) -> u64 {
    sum >> 48 & 0x7fff
}

/// The share of 255 of the pixel that a surface with a sum has.
#[inline(always)]
fn share_of(sum: u64) -> u8 {
    (weight_of(sum) * 255 / OPAQUE).clamp(MIN_SHARE, 255) as u8
}

/// Mean colour of a sum, if it has any weight.
#[inline(always)]
fn mean_of(sum: u64) -> [u8; 3] {
    let weight = weight_of(sum);
    let reciprocal = RECIPROCALS[(weight as usize).min(RECIPROCALS.len() - 1)];
    let mean = |lane: u32| {
        let sum = (sum >> (16 * lane)) & 0xffff;
        (((sum + weight / 2) * reciprocal) >> 32) as u8
    };
    [mean(0), mean(1), mean(2)]
}

/// Half of a sum, so that more splats have room. An odd weight first loses one mean colour: rounding it down alone
/// would brighten.
#[cold]
fn halved(mut sum: u64) -> u64 {
    let flag = sum & HAS_SECOND;
    sum -= flag;
    if weight_of(sum) % 2 == 1 {
        let [r, g, b] = mean_of(sum);
        sum -= lanes([r, g, b, 0]);
    }
    sum >> 1 & 0x7fff_7fff_7fff_7fff | flag
}

/// Adds a splat of the same surface to its mean.
#[inline(always)]
fn join(sum: &mut u64, inverse_depth: &mut f32, added: &Added, weight: u64) {
    if weight_of(*sum) + weight > MAX_WEIGHT {
        *sum = halved(*sum);
    }
    *sum += added.color * weight;
    *inverse_depth = inverse_depth.max(added.inverse_depth);
}

impl Cell {
    /// Both surfaces over what is behind them.
    #[inline(always)]
    pub(super) fn flattened(&self, second: &Second, light: &LinearLight) -> [u8; 4] {
        if self.sum == 0 {
            return self.behind;
        }
        let ([r, g, b], share) = (mean_of(self.sum), share_of(self.sum));
        if share == 255 {
            return [r, g, b, share];
        }
        let front = [r, g, b, share];
        if self.sum & HAS_SECOND == 0 {
            return beside(front, self.behind, light);
        }
        let (second, [r, g, b, behind]) = (second.sum, self.behind);
        let of_second = share_of(second).min(255 - share);
        let rest = behind.min(255 - share - of_second);
        let shares = [share, of_second, rest];
        let [r, g, b] = light.mix([mean_of(self.sum), mean_of(second), [r, g, b]], shares.map(u32::from));
        [r, g, b, shares.iter().sum()]
    }

    /// The second surface, if there is one, over what is behind it.
    #[inline(always)]
    fn behind_front(&self, second: &Second, light: &LinearLight) -> [u8; 4] {
        if self.sum & HAS_SECOND == 0 {
            return self.behind;
        }
        let [r, g, b] = mean_of(second.sum);
        beside([r, g, b, share_of(second.sum)], self.behind, light)
    }

    /// Makes way for a nearer surface. Out of the loop, like [`Self::add_behind`], whose registers it would take.
    #[inline(never)]
    fn send_behind(&mut self, second: &mut Second, light: &LinearLight) {
        // What is behind a surface that fills the pixel never shows again.
        if weight_of(self.sum) < OPAQUE {
            self.behind = self.behind_front(second, light);
        }
        *second = Second { sum: self.sum & !HAS_SECOND, inverse_depth: self.inverse_depth };
    }

    /// Adds a splat behind a surface that does not fill the pixel (yet).
    #[inline(never)]
    fn add_behind(&mut self, second: &mut Second, added: &Added, weight: u64, light: &LinearLight) {
        if self.sum & HAS_SECOND == 0 || second.inverse_depth < added.nearest_behind {
            self.behind = self.behind_front(second, light);
            self.sum |= HAS_SECOND;
            *second = Second { sum: added.color * weight, inverse_depth: added.inverse_depth };
        } else if second.inverse_depth <= added.farthest_in_front {
            join(&mut second.sum, &mut second.inverse_depth, added, weight);
        } else if weight_of(self.sum) + weight_of(second.sum) < OPAQUE {
            let lane = |lane: u32| (added.color >> (16 * lane)) as u8;
            let share = (weight * 255 / OPAQUE).min(255) as u8;
            self.behind = beside([lane(0), lane(1), lane(2), share], self.behind, light);
        }
    }

    /// Adds a splat by a weight, which may be 0. Its second surface is `seconds[at]`.
    #[inline(always)]
    pub(super) fn add(&mut self, seconds: &mut [Second], at: usize, added: &Added, weight: u64, light: &LinearLight) {
        if weight == 0 {
            return;
        }
        if self.inverse_depth < added.nearest_behind {
            let mut flag = 0;
            if self.sum != 0
                && let Some(second) = seconds.get_mut(at)
            {
                self.send_behind(second, light);
                flag = HAS_SECOND;
            }
            self.sum = (added.color * weight) | flag;
            self.inverse_depth = added.inverse_depth;
        } else if self.inverse_depth <= added.farthest_in_front {
            join(&mut self.sum, &mut self.inverse_depth, added, weight);
        } else if weight_of(self.sum) < OPAQUE
            && let Some(second) = seconds.get_mut(at)
        {
            self.add_behind(second, added, weight, light);
        }
    }
}

/// A straight colour over another, each with the share of 255 of a pixel that it has: what is behind shows beside what is in front,
/// as far as there is room.
///
/// The surface behind often ends here only because nobody could see it go on behind the front one, and the weights of
/// its tents fade toward that border. It is therefore taken to lie in the part of the pixel that the front surface
/// leaves open: without this the sky shines through every crown of leaves along its branches (docs/decisions.md: surfaces are averaged
/// before they are blended). So shares of one surface's splats add up behind another surface as they do in front of it
/// (docs/decisions.md: shares behind a surface add up).
#[inline(always)]
fn beside(front: [u8; 4], behind: [u8; 4], light: &LinearLight) -> [u8; 4] {
    let share = front[3];
    let rest = behind[3].min(255 - share);
    if rest == 0 {
        return front;
    }
    let rgb = |[r, g, b, _]: [u8; 4]| [r, g, b];
    let [r, g, b] = light.mix([rgb(front), rgb(behind)], [u32::from(share), u32::from(rest)]);
    [r, g, b, share + rest]
}

/// What of a splat is added to every cell that it touches.
pub(super) struct Added {
    /// As [`lanes`] makes it.
    pub(super) color: u64,
    /// 1/m.
    pub(super) inverse_depth: f32,
    /// The inverse depth below which another surface lies behind the splat's.
    pub(super) nearest_behind: f32,
    /// The inverse depth above which another surface lies in front of the splat's.
    pub(super) farthest_in_front: f32,
}

/// Cells of what pictures on planes show: colours that hide the pixel where alpha is 255 and are not there elsewhere, and 1 / eye
/// depth, 1/m.
#[inline(always)]
pub(super) fn of_ground<S: Simd>(simd: S, colors: &[[u8; 4]; LANES], inverse_depths: &[f32; LANES]) -> [Cell; LANES] {
    let zero = u32x16::splat(simd, 0);
    let color = u32x16::load_array(simd, bytemuck::cast(colors.map(u32::from_le_bytes)));
    let is_whole = (color >> 24).simd_eq(255);
    // [`lanes`] times the weight 1, half by half.
    let low = ((color & 0xff) * ONE as u32) | (((color >> 8) & 0xff) * ((ONE as u32) << 16));
    let high = (((color >> 16) & 0xff) * ONE as u32) | (ONE as u32) << 16;
    let inverse_depth = f32x16::load_array(simd, *inverse_depths).max(0.0).bitcast();
    let [low, high, inverse_depth] =
        [is_whole.select(low, zero), is_whole.select(high, zero), is_whole.select(inverse_depth, zero)];
    let (evens, odds) = (simd.interleave_u32x16(low, inverse_depth), simd.interleave_u32x16(high, zero));
    let (first, second) = (simd.interleave_u32x16(evens.0, odds.0), simd.interleave_u32x16(evens.1, odds.1));
    bytemuck::cast([first.0.to_array(), first.1.to_array(), second.0.to_array(), second.1.to_array()])
}

/// Writes [`Cell::flattened`] of each cell and its second surface.
#[inline(always)]
pub(super) fn resolve<S: Simd>(simd: S, from: &[Cell], seconds: &[Second], to: &mut [[u8; 4]]) {
    let light = LinearLight::tables();
    let (from, from_rest) = from.as_chunks::<LANES>();
    let (seconds, seconds_rest) = seconds.as_chunks::<LANES>();
    let (to, to_rest) = to.as_chunks_mut::<LANES>();
    for ((from, seconds), to) in from.iter().zip(seconds).zip(to) {
        let mut others;
        (*to, others) = fronts(simd, from);
        while others != 0 {
            let i = others.trailing_zeros() as usize;
            others &= others - 1;
            to[i] = from[i].flattened(&seconds[i], light);
        }
    }
    for ((to, cell), second) in to_rest.iter_mut().zip(from_rest).zip(seconds_rest) {
        *to = cell.flattened(second, light);
    }
}

/// [`mean_of`] the sum, and 255, for cells whose front surface fills the pixel; of the others, the bits.
#[inline(always)]
fn fronts<S: Simd>(simd: S, cells: &[Cell; LANES]) -> ([[u8; 4]; LANES], u64) {
    let words: &[u32; 4 * LANES] = bytemuck::cast_ref(cells);
    let (ab, cd) = words.split_at(2 * LANES);
    let first =
        simd.deinterleave_u32x16(u32x16::from_slice(simd, &ab[..LANES]), u32x16::from_slice(simd, &ab[LANES..]));
    let second =
        simd.deinterleave_u32x16(u32x16::from_slice(simd, &cd[..LANES]), u32x16::from_slice(simd, &cd[LANES..]));
    let (low, _) = simd.deinterleave_u32x16(first.0, second.0);
    let (high, _) = simd.deinterleave_u32x16(first.1, second.1);
    let weight = (high >> 16) & 0x7fff;
    let fills = weight.simd_ge(OPAQUE as u32);
    let reciprocal = f32x16::splat(simd, 1.0) / f32x16::float_from(weight.max(1));
    let (red, green) = (mean(low & 0xffff, weight, reciprocal), mean(low >> 16, weight, reciprocal));
    let blue = mean(high & 0xffff, weight, reciprocal);
    let colors = (red | (green << 8) | (blue << 16) | 0xff00_0000).to_array();
    let mut bytes = [[0; 4]; LANES];
    for (bytes, color) in bytes.iter_mut().zip(colors) {
        *bytes = color.to_le_bytes();
    }
    (bytes, !fills.to_bitmask() & 0xffff)
}

/// Sums over weights, rounded to the nearest, by the weights' reciprocals; 0 for weight 0, whose sums are 0.
#[inline(always)]
fn mean<S: Simd>(sum: u32x16<S>, weight: u32x16<S>, reciprocal: f32x16<S>) -> u32x16<S> {
    // Rounded down like the integers: a quotient of them that is not whole is at least 1 / 257 away from the next, and products err by
    // less than 1 / 10,000.
    u32x16::truncate_from(f32x16::float_from(sum + (weight >> 1)) * reciprocal + 0.002)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ground_is_one_whole_splat() {
        let colors: [[u8; 4]; LANES] =
            std::array::from_fn(|i| [3 * i as u8, 255, 7, if i % 3 == 0 { 254 } else { 255 }]);
        let inverse_depths = std::array::from_fn(|i| i as f32 - 1.0);
        let level = fearless_simd::Level::new();
        let cells = fearless_simd::dispatch!(level, simd => of_ground(simd, &colors, &inverse_depths));
        for ((cell, color), q) in cells.iter().zip(colors).zip(inverse_depths) {
            let mut expected = Cell::default();
            if color[3] == 255 {
                expected.add(
                    &mut [Second::default()],
                    0,
                    &added(color, f32::max(q, 0.0), 0.01),
                    ONE,
                    LinearLight::tables(),
                );
                expected.inverse_depth = f32::max(q, 0.0);
                expected.sum = lanes(color) * ONE;
            }
            assert_eq!((cell.sum, cell.inverse_depth, cell.behind), (expected.sum, expected.inverse_depth, [0; 4]));
        }
    }

    fn added(color: [u8; 4], q: f32, tolerance: f32) -> Added {
        let (nearest_behind, farthest_in_front) = (q * (1.0 - tolerance), q * (1.0 + tolerance));
        Added { color: lanes(color), inverse_depth: q, nearest_behind, farthest_in_front }
    }

    #[test]
    fn means_are_exact_divisions() {
        for weight in 1..=MAX_WEIGHT {
            for sum in (0..=255 * weight).step_by(7).chain([255 * weight]) {
                assert_eq!(u64::from(mean_of(sum | weight << 48)[0]), (sum + weight / 2) / weight, "{sum} / {weight}");
            }
        }
    }

    #[test]
    fn sixteen_means_are_those_of_one_by_one_at_every_level() {
        for weight in 0..=MAX_WEIGHT {
            // All that red can be, with other green and blue.
            for start in (0..=255 * weight).step_by(LANES) {
                let cells: [Cell; LANES] = std::array::from_fn(|i| {
                    let red = (start + i as u64).min(255 * weight);
                    let sum =
                        red | (255 * weight - red) << 16 | (red / 2) << 32 | weight << 48 | (start / 16 % 2) << 63;
                    Cell { sum, inverse_depth: 1.0, behind: [255; 4] }
                });
                for level in crate::capture::simd::levels() {
                    let (colors, others) = fearless_simd::dispatch!(level, simd => fronts(simd, &cells));
                    assert_eq!(
                        colors,
                        cells.map(|cell| {
                            let [r, g, b] = mean_of(cell.sum);
                            [r, g, b, 255]
                        }),
                        "{weight}"
                    );
                    assert_eq!(others, if weight >= OPAQUE { 0 } else { 0xffff });
                }
            }
        }
    }

    #[test]
    fn one_colour_stays_one_colour_however_many_splats() {
        let color = [201, 0, 255, 255];
        for weights in [[1, 3, 5, 7], [127, 128, 1, 2], [0, 0, 64, 91], [37, 99, 128, 128]] {
            let (mut cell, mut second) = (Cell::default(), [Second::default()]);
            for i in 0..10_000 {
                let weight = weights[i % 4];
                if weight > 0 {
                    cell.add(&mut second, 0, &added(color, 1.0, 0.01), weight, LinearLight::tables());
                    assert_eq!(cell.flattened(&second[0], LinearLight::tables())[..3], color[..3]);
                    assert!(weight_of(cell.sum) <= MAX_WEIGHT);
                }
            }
            assert_eq!(cell.flattened(&second[0], LinearLight::tables()), color);
        }
    }

    #[test]
    fn surfaces_are_blended_in_depth_order() {
        let (red, blue, green) = ([250, 0, 0, 255], [0, 0, 250, 255], [0, 250, 0, 255]);
        let mut pixel = Pixel::default();
        pixel.add(blue, ONE, 1.0);
        pixel.add(red, OPAQUE / 2, 2.0);
        let [r, g, b, share] = pixel.color();
        assert!(r.abs_diff(184) <= 2 && g == 0 && b.abs_diff(184) <= 2 && share == 255, "half red over blue");
        pixel.add(green, ONE, 1.5);
        let [r, g, b, _] = pixel.color();
        assert!(r.abs_diff(184) <= 2 && g.abs_diff(184) <= 2 && b == 0, "green comes between");
        pixel.add(red, ONE, 2.02);
        assert_eq!(pixel.color(), red);
        pixel.add(green, ONE, 1.5);
        assert_eq!(pixel.color(), red, "hidden");
    }

    #[derive(Default)]
    struct Pixel(Cell, [Second; 1]);

    impl Pixel {
        fn add(&mut self, color: [u8; 4], weight: u64, q: f32) {
            self.0.add(&mut self.1, 0, &added(color, q, 0.05), weight, LinearLight::tables());
        }

        fn color(&self) -> [u8; 4] {
            self.0.flattened(&self.1[0], LinearLight::tables())
        }
    }

    #[test]
    fn a_surface_that_is_halved_keeps_what_is_behind_it() {
        let (red, blue) = ([250, 0, 0, 255], [0, 0, 250, 255]);
        let mut pixel = Pixel::default();
        pixel.add(red, 1, 2.0);
        for _ in 0..600 {
            pixel.add(blue, 1, 1.0);
            // No more than a pixel's weights: the next is halved, and no colour runs into another.
            assert!(weight_of(pixel.1[0].sum) <= MAX_WEIGHT);
        }
        assert_eq!(mean_of(pixel.1[0].sum), [0, 0, 250]);
        let mut pixel = Pixel::default();
        pixel.add(blue, 100, 1.0);
        (0..600).for_each(|_| pixel.add(red, 1, 2.0));
        assert_eq!((pixel.0.sum & HAS_SECOND, weight_of(pixel.1[0].sum)), (HAS_SECOND, 100));
    }

    #[test]
    fn what_is_behind_a_whole_surface_is_hidden_whoever_else_is_in_front() {
        let (curtain, wall, tree) = ([250, 0, 0, 255], [0, 0, 250, 255], [0, 250, 0, 255]);
        // The samples of four LDI pixels, each back to front; in some the curtain is in front of the wall, and hides it for good.
        for in_front in 0..16 {
            let mut pixel = Pixel::default();
            for ldi_pixel in 0..4 {
                pixel.add(tree, ONE / 4, 1.0);
                pixel.add(wall, ONE / 4, 2.0);
                if in_front >> ldi_pixel & 1 == 1 {
                    pixel.add(curtain, ONE / 8, 3.0);
                }
            }
            let [_, green, _, share] = pixel.color();
            assert_eq!((green, share), (0, 255), "{in_front:04b}");
        }
    }
}
