//! Samples an image at sixteen positions at a time, bit-identical to single samples.

use super::picture::{LEAST_DEPTH, MASKED, Picture};
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, i32x16, u32x16};
use headbox_core::image::texels::{bilinear, gather_wide_quads};

/// Sixteen samples of an image.
pub(crate) struct TextureSamples<S: Simd> {
    /// Linear light, 0 to 65,535.
    pub(crate) color: [f32x16<S>; 3],
    /// Inverse depth of the nearest texel, 1/m; 0 where unknown.
    pub(crate) inverse_depth: f32x16<S>,
    /// Bit mask of lanes with a sample; the other lanes hold arbitrary finite values.
    pub(crate) known: u64,
}

impl Picture {
    /// Same as [`Self::level_for`], for sixteen lanes.
    #[inline(always)]
    pub(crate) fn levels_for<S: Simd>(&self, texels: f32x16<S>) -> u32x16<S> {
        let one = u32x16::splat(texels.token(), 1);
        let zero = u32x16::splat(texels.token(), 0);
        let mut level = zero;
        let mut bound = 2.0;
        for _ in 1..self.levels.len() {
            level += (texels * texels).simd_ge(bound).select(one, zero);
            bound *= 4.0;
        }
        level
    }

    /// Same as [`Self::sample`] in the `wanted` lanes.
    #[inline(always)]
    pub(crate) fn sample_sixteen<S: Simd>(
        &self,
        simd: S,
        level: u32,
        [x, y]: [f32x16<S>; 2],
        wanted: u64,
    ) -> TextureSamples<S> {
        let zero = f32x16::splat(simd, 0.0);
        let nothing = TextureSamples {
            color: [zero; 3],
            inverse_depth: zero,
            known: 0,
        };
        let Some(level) = self.levels.get(level as usize) else {
            return nothing;
        };
        let (x, y) = (x * level.scale[0], y * level.scale[1]);
        let [width, height] = level.size;
        let inside = x.simd_ge(0.0) & y.simd_ge(0.0) & x.simd_le(width) & y.simd_le(height);
        let known = inside.to_bitmask() & wanted;
        // The colour is constant beyond the centres of the outermost texels.
        let x = (inside.select(x, zero) - 0.5).max(0.0).min(width - 1.0);
        let y = (inside.select(y, zero) - 0.5).max(0.0).min(height - 1.0);
        let column = x.floor().min(level.last[0] as f32);
        let row = y.floor().min(level.last[1] as f32);
        let (fx, fy) = (x - column, y - row);
        let index: u32x16<S> = (i32x16::truncate_from(row) * level.stride as i32
            + i32x16::truncate_from(column))
        .bitcast();
        let Some([a, b, c, d]) = gather_wide_quads(simd, &level.texels, index, level.stride) else {
            return nothing;
        };
        let half = f32x16::splat(simd, 0.5);
        let (left, top) = (fx.simd_lt(half), fy.simd_lt(half));
        let depth = top.select(left.select(a[1], b[1]), left.select(c[1], d[1])) >> 16;
        let least = u32x16::splat(simd, u32::from(LEAST_DEPTH));
        let inverse_depth = float(depth.max(least) - least) * self.inverse_depth_step;
        let masked = (a[1] >> 16)
            .min(b[1] >> 16)
            .min((c[1] >> 16).min(d[1] >> 16))
            .simd_eq(u32::from(MASKED));
        let shares = [fx, fy];
        let red_green = [a[0], b[0], c[0], d[0]];
        let blue_depth = [a[1], b[1], c[1], d[1]];
        let mut color = [
            bilinear(lower_halves(red_green), shares),
            bilinear(upper_halves(red_green), shares),
            bilinear(lower_halves(blue_depth), shares),
        ];
        let mut known = known;
        if masked.to_bitmask() & known != 0 {
            let (unmasked_color, has_unmasked) = blend_unmasked_sixteen(simd, [a, b, c, d], shares);
            for channel in 0..3 {
                color[channel] = masked.select(unmasked_color[channel], color[channel]);
            }
            known &= has_unmasked;
        }
        TextureSamples {
            color,
            inverse_depth,
            known,
        }
    }
}

#[inline(always)]
fn lower_halves<S: Simd>([a, b, c, d]: [u32x16<S>; 4]) -> [f32x16<S>; 4] {
    [
        float(a & 0xffff),
        float(b & 0xffff),
        float(c & 0xffff),
        float(d & 0xffff),
    ]
}

#[inline(always)]
fn upper_halves<S: Simd>([a, b, c, d]: [u32x16<S>; 4]) -> [f32x16<S>; 4] {
    [
        float(a >> 16),
        float(b >> 16),
        float(c >> 16),
        float(d >> 16),
    ]
}

/// Same as `blend_unmasked`, and a mask of lanes that have an unmasked texel.
#[inline(always)]
fn blend_unmasked_sixteen<S: Simd>(
    simd: S,
    texels: [[u32x16<S>; 2]; 4],
    [x, y]: [f32x16<S>; 2],
) -> ([f32x16<S>; 3], u64) {
    let zero = f32x16::splat(simd, 0.0);
    let (left, top) = (1.0 - x, 1.0 - y);
    let weights = [left * top, x * top, left * y, x * y];
    let (mut color, mut total) = ([zero; 3], zero);
    for i in 0..4 {
        let [red_green, blue_depth] = texels[i];
        let weight = (blue_depth >> 16)
            .simd_eq(u32::from(MASKED))
            .select(zero, weights[i]);
        color[0] += float(red_green & 0xffff) * weight;
        color[1] += float(red_green >> 16) * weight;
        color[2] += float(blue_depth & 0xffff) * weight;
        total += weight;
    }
    let any = total.simd_gt(0.0);
    let divisor = any.select(total, f32x16::splat(simd, 1.0));
    for channel in &mut color {
        *channel /= divisor;
    }
    (color, any.to_bitmask())
}

/// Converts numbers below 2^31 as signed integers, which takes one instruction with AVX2 instead of
/// five.
#[inline(always)]
fn float<S: Simd>(numbers: u32x16<S>) -> f32x16<S> {
    f32x16::float_from(numbers.bitcast::<i32x16<S>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view_geometry::render::scan::LANES;
    pub(crate) use crate::view_geometry::tests::make_view;
    use fearless_simd::dispatch;
    use glam::DVec3;
    use headbox_core::random::Rng;
    use headbox_core::simd;

    #[inline(always)]
    fn look<S: Simd>(
        simd: S,
        picture: &Picture,
        level: u32,
        at: [&[f32; LANES]; 2],
    ) -> ([[f32; LANES]; 3], [f32; LANES], u64) {
        let [x, y] = at.map(|axis| f32x16::load_array_ref(simd, axis));
        let TextureSamples {
            color: [r, g, b],
            inverse_depth,
            known,
        } = picture.sample_sixteen(simd, level, [x, y], 0xf7ff);
        (
            [r.to_array(), g.to_array(), b.to_array()],
            inverse_depth.to_array(),
            known,
        )
    }

    #[test]
    fn texture_lanes_equal_scalar_at_every_level() {
        let mut random = Rng::keyed(5);
        let mut view = make_view(
            DVec3::ZERO,
            |x, y| 0.5 + (x * 7 + y * 3) as f32 % 5.0,
            |x, y| [x as u8 * 9, y as u8 * 13, 90],
            [23, 14],
        );
        view.depth[40..60].fill(f32::NAN);
        let mut masked = view.clone();
        (0..masked.color.len())
            .filter(|i| i * 31 % 7 < 2)
            .for_each(|i| masked.color[i][3] = 0);
        let hard = [
            -0.01,
            0.0,
            0.5,
            14.0,
            23.0,
            23.01,
            f32::NAN,
            f32::INFINITY,
            -1e30,
        ];
        for picture in [Picture::new(&view), Picture::new(&masked)] {
            for round in 0..400u32 {
                let mut place = |side: f64| match random.below(4) {
                    0 => hard[random.below(hard.len() as u64) as usize],
                    _ => random.between(0.0, side) as f32,
                };
                let at = [23.0, 14.0].map(|side| [0; LANES].map(|_| place(side)));
                let number = round % 5;
                for simd_level in simd::levels() {
                    let (color, depth, known) =
                        dispatch!(simd_level, simd => look(simd, &picture, number, at.each_ref()));
                    for lane in 0..LANES {
                        let expected = picture
                            .sample(number as usize, at[0][lane], at[1][lane])
                            .filter(|_| lane != 11);
                        let found = (known >> lane & 1 == 1)
                            .then(|| (color.map(|channel| channel[lane]), depth[lane]));
                        assert_eq!(
                            found, expected,
                            "({}, {}) of level {number}, {simd_level:?}",
                            at[0][lane], at[1][lane]
                        );
                        assert!(color.iter().all(|channel| channel[lane].is_finite()));
                    }
                }
            }
        }
    }

    #[test]
    fn levels_in_lanes_equal_scalar() {
        let picture = Picture::new(&make_view(DVec3::ZERO, |_, _| 1.0, |_, _| [9; 3], [64, 48]));
        let texels: [f32; LANES] = std::array::from_fn(|i| 0.3 * 1.37f32.powi(i as i32));
        let found = dispatch!(simd::level(), simd => picture.levels_for(f32x16::load_array_ref(simd, &texels)).to_array());
        assert_eq!(
            found.map(|level| level as usize),
            texels.map(|texels| picture.level_for(texels))
        );
        assert!(found.contains(&4));
    }
}
