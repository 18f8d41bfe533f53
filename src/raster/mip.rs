//! Textures with mip levels.

use super::LANES;
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, u32x16};
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use headbox_core::image::mip::{MipLevel, OddEdge};
use headbox_core::image::texels::bilinear;
use headbox_scene::material::{Sampler, Texture};
use std::iter::successors;

/// Largest code of 16-bit linear light: a step is a twentieth of the darkest step of 8-bit sRGB.
const FULL: f32 = 65_535.0;

/// A texture and its mip levels, sizes rounded up, down to one texel.
#[derive(Debug)]
pub(super) struct MipTexture {
    /// Size of level 0, texels.
    size: [u32; 2],
    sampler: Sampler,
    /// Index of the first texel of each mip level; never empty.
    starts: Vec<u32>,
    /// Row by row, linear RGB and alpha, 16 bits each.
    texels: Vec<[u16; 4]>,
}

impl MipTexture {
    pub(super) fn new(texture: &Texture) -> Self {
        let size = [texture.width(), texture.height()];
        let finest = MipLevel {
            size: size.map(|side| side as usize),
            texels: texture.texels().to_vec(),
        };
        let levels = successors(Some(finest), |level| {
            (level.size != [1, 1]).then(|| level.halved(OddEdge::Repeat, linear_mean))
        });
        let linear = |c: u8| (linear_from_srgb8(c) * FULL + 0.5) as u16;
        let mut mips = Self {
            size,
            sampler: texture.sampler(),
            starts: Vec::new(),
            texels: Vec::new(),
        };
        for level in levels {
            mips.starts.push(mips.texels.len() as u32);
            let texels = level.texels.into_iter();
            mips.texels.extend(
                texels.map(|[r, g, b, a]| [linear(r), linear(g), linear(b), u16::from(a) * 257]),
            );
        }
        mips
    }

    /// Returns the width and height of level 0, texels.
    #[inline]
    pub(super) fn size(&self) -> [f32; 2] {
        [self.size[0] as f32, self.size[1] as f32]
    }

    /// Samples linear red, green and blue at (u, v) in the first `count` lanes: by the sampler,
    /// like [`Texture::sample`], from the mip level whose texels are nearest in size to the
    /// footprint. `footprint` is the fourth power of the footprint's side in texels of level 0; 1
    /// and less give level 0.
    pub(super) fn sample<S: Simd>(
        &self,
        simd: S,
        texcoords: [f32x16<S>; 2],
        footprint: f32x16<S>,
        count: usize,
    ) -> [f32x16<S>; 3] {
        simd.vectorize(
            #[inline(always)]
            || self.sample_at(simd, texcoords, footprint, count),
        )
    }

    #[inline(always)]
    fn sample_at<S: Simd>(
        &self,
        simd: S,
        [u, v]: [f32x16<S>; 2],
        footprint: f32x16<S>,
        count: usize,
    ) -> [f32x16<S>; 3] {
        // The bits of a float are its binary logarithm, linear between powers of two: the error is
        // at most 0.09, and a quarter of that is negligible. NaN becomes 1 by the comparison.
        let one = f32x16::splat(simd, 1.0);
        let footprint = footprint.simd_gt(one).select(footprint, one);
        let octaves = (f32x16::float_from(footprint.bitcast::<u32x16<S>>()) * (1.0 / 8_388_608.0)
            - 127.0)
            * 0.25
            + 0.5;
        let level = u32x16::truncate_from(octaves).min(self.starts.len() as u32 - 1);
        let (x, y) = (
            self.neighbours(0, u, level),
            self.neighbours(1, 1.0 - v, level),
        );
        let (upper, lower) = (y.first * x.size, y.second * x.size);
        let (a, b) = ((upper + x.first).to_array(), (upper + x.second).to_array());
        let (c, d) = ((lower + x.first).to_array(), (lower + x.second).to_array());
        let level = level.to_array();
        let mut texels = [[[0; 4]; LANES]; 4];
        for i in 0..count.min(LANES) {
            let start = self.starts.get(level[i] as usize).copied().unwrap_or(0);
            for (texels, at) in texels.iter_mut().zip([a[i], b[i], c[i], d[i]]) {
                texels[i] = self
                    .texels
                    .get((start + at) as usize)
                    .copied()
                    .unwrap_or([0; 4]);
            }
        }
        let [a, b, c, d] = &texels;
        let (a, b, c, d) = (
            unpack(simd, a),
            unpack(simd, b),
            unpack(simd, c),
            unpack(simd, d),
        );
        let mut color = [f32x16::splat(simd, 0.0); 3];
        for (k, color) in color.iter_mut().enumerate() {
            *color = bilinear([a[k], b[k], c[k], d[k]], [x.weight, y.weight]) * (1.0 / FULL);
        }
        color
    }

    /// Finds the texels of a mip level beside coordinate `t` along an axis.
    #[inline(always)]
    fn neighbours<S: Simd>(&self, axis: usize, t: f32x16<S>, level: u32x16<S>) -> Neighbours<S> {
        if self.sampler == Sampler::default() {
            Neighbours::new(t, self.size[axis], level)
        } else {
            Neighbours::by_sampler(self.sampler, axis, t, self.size[axis], level)
        }
    }
}

/// Converts texels to red, green and blue lanes, 0 to [`FULL`].
#[inline(always)]
fn unpack<S: Simd>(simd: S, texels: &[[u16; 4]; LANES]) -> [f32x16<S>; 3] {
    let words: [u32; 2 * LANES] = bytemuck::cast(*texels);
    let (low, high) = words.split_at(LANES);
    let (red_green, blue) = simd.deinterleave_u32x16(
        u32x16::from_slice(simd, low),
        u32x16::from_slice(simd, high),
    );
    [
        f32x16::float_from(red_green & 0xffff),
        f32x16::float_from(red_green >> 16),
        f32x16::float_from(blue & 0xffff),
    ]
}

/// The two texels along an axis between which a texture coordinate lies.
struct Neighbours<S: Simd> {
    /// Size of the mip level along the axis, texels.
    size: u32x16<S>,
    first: u32x16<S>,
    second: u32x16<S>,
    /// Interpolation weight of `second`.
    weight: f32x16<S>,
}

impl<S: Simd> Neighbours<S> {
    /// Finds the neighbours of coordinate `t` in a mip level; `size` is that of level 0.
    #[inline(always)]
    fn new(t: f32x16<S>, size: u32, level: u32x16<S>) -> Self {
        let zero = f32x16::splat(t.simd, 0.0);
        let last = u32x16::splat(t.simd, size - 1) >> level;
        let (last_f, size_f) = (f32x16::float_from(last), f32x16::float_from(last + 1));
        let fraction = t - t.floor();
        // False for NaN, which is also the fraction of infinity.
        let fraction = (fraction.simd_ge(zero) & fraction.simd_le(f32x16::splat(t.simd, 1.0)))
            .select(fraction, zero);
        let x = fraction * size_f - 0.5;
        let x = x.simd_lt(zero).select(x + size_f, x);
        let first = x.floor().min(last_f);
        let second = first.simd_lt(last_f).select(first + 1.0, zero);
        let weight = (x - first).max(zero).min(f32x16::splat(t.simd, 1.0));
        Self {
            size: last + 1,
            first: u32x16::truncate_from(first),
            second: u32x16::truncate_from(second),
            weight,
        }
    }

    /// Same as [`Self::new`] for a sampler that is not the default one.
    #[inline(always)]
    fn by_sampler(
        sampler: Sampler,
        axis: usize,
        t: f32x16<S>,
        size: u32,
        level: u32x16<S>,
    ) -> Self {
        let simd = t.simd;
        let size = (u32x16::splat(simd, size - 1) >> level) + 1;
        let (first, second, weight) =
            neighbours_by_lane(sampler, axis, &t.to_array(), &size.to_array());
        Self {
            size,
            first: u32x16::load_array(simd, first),
            second: u32x16::load_array(simd, second),
            weight: f32x16::load_array(simd, weight),
        }
    }
}

/// Finds first and second neighbour and the weight of the second, lane by lane. It is not inlined,
/// to keep rare samplers out of the kernel.
#[inline(never)]
fn neighbours_by_lane(
    sampler: Sampler,
    axis: usize,
    t: &[f32; LANES],
    sizes: &[u32; LANES],
) -> ([u32; LANES], [u32; LANES], [f32; LANES]) {
    let found: [_; LANES] =
        std::array::from_fn(|lane| sampler.neighbours(axis, t[lane], sizes[lane]));
    (
        found.map(|(first, ..)| first as u32),
        found.map(|(_, second, _)| second as u32),
        found.map(|(.., weight)| weight),
    )
}

/// Averages four texels in linear light.
fn linear_mean(four: [[u8; 4]; 4]) -> [u8; 4] {
    let mean = |value: &dyn Fn([u8; 4]) -> f32| four.iter().map(|t| value(*t)).sum::<f32>() / 4.0;
    let [r, g, b] = [0, 1, 2].map(|c| srgb8_from_linear(mean(&|t| linear_from_srgb8(t[c]))));
    [r, g, b, (mean(&|t| f32::from(t[3])) + 0.5) as u8]
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::dispatch;
    use headbox_scene::material::Wrap;

    /// Half a step of 16 bits, and rounding in the fractions of a texel.
    const STORED: f32 = 1e-4;

    /// Samples in one lane between others that sample elsewhere.
    fn sample(mips: &MipTexture, footprint: f32, u: f32, v: f32) -> [f32; 3] {
        let lanes = |other: f32, at_five: f32| {
            std::array::from_fn(|i| if i == 5 { at_five } else { other })
        };
        let (us, vs, footprints) = (lanes(0.4, u), lanes(0.6, v), lanes(1e9, footprint.powi(4)));
        dispatch!(fearless_simd::Level::new(), simd => {
            let load = |lanes: [f32; LANES]| f32x16::load_array(simd, lanes);
            let colors = mips.sample(simd, [load(us), load(vs)], load(footprints), 6);
            colors.map(|channel| channel.to_array()[5])
        })
    }

    #[test]
    fn mip_levels_run_from_texture_to_mean() {
        let texture = Texture::from_fn(5, 3, |x, y| {
            if (x + y) % 2 == 0 {
                [255; 4]
            } else {
                [0, 0, 0, 255]
            }
        });
        let mips = MipTexture::new(&texture);
        assert_eq!(
            (mips.size, mips.starts.as_slice()),
            ([5, 3], [0, 15, 21, 23].as_slice()),
            "5x3, 3x2, 2x1, 1x1"
        );
        for (u, v) in [
            (0.1, 0.2),
            (0.77, 0.5),
            (-3.3, 9.9),
            (1.0, 0.0),
            (-1.0, 1.0),
        ] {
            for footprint in [0.0, 1.0, f32::NAN] {
                let (found, expected) = (sample(&mips, footprint, u, v), texture.sample(u, v));
                assert!(
                    (0..3).all(|c| (found[c] - expected[c]).abs() < STORED),
                    "({u}, {v}): {found:?} {expected:?}"
                );
            }
        }
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for nearest in [false, true] {
                let sampler = Sampler {
                    wrap: [wrap, Wrap::Clamp],
                    nearest,
                };
                let texture = texture.with_sampler(sampler);
                let mips = MipTexture::new(&texture);
                for (u, v) in [(0.12, 0.21), (-0.33, 0.5), (1.01, -0.2), (7.77, 1.3)] {
                    let (found, expected) = (sample(&mips, 1.0, u, v), texture.sample(u, v));
                    assert!(
                        (0..3).all(|c| (found[c] - expected[c]).abs() < STORED),
                        "({u}, {v}) {sampler:?}: {found:?} {expected:?}"
                    );
                }
            }
        }
        assert!(
            sample(&mips, 2.0, f32::NAN, f32::INFINITY)
                .iter()
                .all(|c| c.is_finite())
        );
        let [grey, ..] = sample(&mips, 1e9, 0.3, 0.3);
        assert!((0.3..0.7).contains(&grey), "{grey}");
    }
}
