//! Textures with their minified copies.

use super::view::{LANES, Lane};
use crate::capture::{Texture, linear_from_srgb8, srgb8_from_linear};

/// Sixteen bits of linear light: a step is a twentieth of the darkest step of 8-bit sRGB.
const FULL: f32 = 65_535.0;

/// A texture and copies of half the size each, down to one texel.
#[derive(Debug)]
pub(super) struct MipTexture {
    /// The largest first; never empty.
    levels: Vec<Level>,
}

/// Linear RGB and alpha, 16 bits each.
#[derive(Debug)]
pub(super) struct Level {
    width: u32,
    height: u32,
    texels: Vec<[u16; 4]>,
}

impl Level {
    fn new(texture: &Texture) -> Self {
        let linear = |c: u8| (linear_from_srgb8(c) * FULL + 0.5) as u16;
        let texel = |&[r, g, b, a]: &[u8; 4]| [linear(r), linear(g), linear(b), u16::from(a) * 257];
        let texels = texture.texels().iter().map(texel).collect();
        Self { width: texture.width(), height: texture.height(), texels }
    }

    /// Multiplies each channel of the first `count` lanes by the texture at (u, v): bilinear, wrapping around, as
    /// [`Texture::sample`] is, linear light.
    #[inline(always)]
    pub(super) fn multiply(&self, u: &Lane, v: &Lane, count: usize, channels: &mut [Lane; 3]) {
        let mut upward = [0.0; LANES];
        for (upward, v) in upward.iter_mut().zip(v) {
            *upward = 1.0 - v;
        }
        let (x, y) = (Neighbours::new(u, self.width), Neighbours::new(&upward, self.height));
        for i in 0..count.min(LANES) {
            let (upper, lower) = (y.first[i] * self.width, y.second[i] * self.width);
            let at = |row: u32, column: u32| self.texels.get((row + column) as usize).copied().unwrap_or([0; 4]);
            let (a, b) = (at(upper, x.first[i]), at(upper, x.second[i]));
            let (c, d) = (at(lower, x.first[i]), at(lower, x.second[i]));
            // Four channels, for the compiler to take at once.
            let mut mixed = [0.0; 4];
            for (k, mixed) in mixed.iter_mut().enumerate() {
                let (a, b, c, d) = (f32::from(a[k]), f32::from(b[k]), f32::from(c[k]), f32::from(d[k]));
                let (top, bottom) = (a + (b - a) * x.share[i], c + (d - c) * x.share[i]);
                *mixed = (top + (bottom - top) * y.share[i]) * (1.0 / FULL);
            }
            for (channel, mixed) in channels.iter_mut().zip(mixed) {
                channel[i] *= mixed;
            }
        }
    }
}

/// The two texels on either side of texture coordinates, and the weight of the second.
struct Neighbours {
    first: [u32; LANES],
    second: [u32; LANES],
    share: Lane,
}

impl Neighbours {
    #[inline(always)]
    fn new(t: &Lane, size: u32) -> Self {
        let (last, size_f) = (size - 1, size as f32);
        let mut found = Self { first: [0; LANES], second: [0; LANES], share: [0.0; LANES] };
        for (i, &t) in t.iter().enumerate() {
            // `t.floor()` without the call into libm; the cast turns NaN and what is out of range into numbers.
            let truncated = t as i32 as f32;
            let fraction = t - if truncated > t { truncated - 1.0 } else { truncated };
            let fraction = if (0.0..=1.0).contains(&fraction) { fraction } else { 0.0 };
            let x = fraction * size_f - 0.5;
            let x = if x < 0.0 { x + size_f } else { x };
            let first = (x as i32 as u32).min(last);
            (found.first[i], found.second[i]) = (first, if first == last { 0 } else { first + 1 });
            found.share[i] = (x - first as f32).clamp(0.0, 1.0);
        }
        found
    }
}

impl MipTexture {
    pub(super) fn new(texture: &Texture) -> Self {
        let mut levels = vec![Level::new(texture)];
        let mut next = halved(texture);
        while let Some(texture) = next {
            levels.push(Level::new(&texture));
            next = halved(&texture);
        }
        Self { levels }
    }

    /// The copy whose texels are nearest to a footprint of so many texels of the texture itself (1 and less is that).
    #[inline(always)]
    pub(super) fn level(&self, footprint: f32) -> &Level {
        // The bits of a float are its binary logarithm, linear between powers of two: off by at most 0.09.
        let logarithm = (footprint.to_bits() as f32) * (1.0 / 8_388_608.0) - 127.0;
        let level = if footprint > 1.0 { (logarithm + 0.5) as usize } else { 0 };
        &self.levels[level.min(self.levels.len() - 1)]
    }

    /// Width and height in texels.
    #[inline(always)]
    pub(super) fn size(&self) -> [f32; 2] {
        [self.levels[0].width as f32, self.levels[0].height as f32]
    }
}

/// A texture of half the size, rounded up: each texel the mean of four, in linear light; `None` for a single texel.
fn halved(texture: &Texture) -> Option<Texture> {
    let (width, height) = (texture.width(), texture.height());
    if width == 1 && height == 1 {
        return None;
    }
    let at = |x: u32, y: u32| texture.texels()[(y.min(height - 1) * width + x.min(width - 1)) as usize];
    let texel = |x: u32, y: u32| {
        let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| at(2 * x + dx, 2 * y + dy));
        let mean = |of: &dyn Fn([u8; 4]) -> f32| four.iter().map(|t| of(*t)).sum::<f32>() / 4.0;
        let [r, g, b] = [0, 1, 2].map(|c| srgb8_from_linear(mean(&|t| linear_from_srgb8(t[c]))));
        [r, g, b, (mean(&|t| f32::from(t[3])) + 0.5) as u8]
    };
    Some(Texture::from_fn(width.div_ceil(2), height.div_ceil(2), texel))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a step of 16 bits, and rounding in the fractions of a texel.
    const STORED: f32 = 1e-4;

    /// The texture in one lane between others that look elsewhere.
    fn sample(level: &Level, u: f32, v: f32) -> [f32; 3] {
        let (mut us, mut vs, mut channels) = ([0.4; LANES], [0.6; LANES], [[1.0; LANES]; 3]);
        (us[5], vs[5]) = (u, v);
        level.multiply(&us, &vs, 6, &mut channels);
        assert!(channels.iter().all(|channel| channel[6] == 1.0), "only as many as asked for");
        channels.map(|channel| channel[5])
    }

    #[test]
    fn the_first_level_is_the_texture_and_the_last_its_mean() {
        let texture = Texture::from_fn(5, 3, |x, y| if (x + y) % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] });
        let mips = MipTexture::new(&texture);
        let sizes: Vec<_> = mips.levels.iter().map(|level| (level.width, level.height)).collect();
        assert_eq!(sizes, [(5, 3), (3, 2), (2, 1), (1, 1)]);
        for (u, v) in [(0.1, 0.2), (0.77, 0.5), (-3.3, 9.9), (1.0, 0.0), (-1.0, 1.0)] {
            for footprint in [0.0, 1.0, f32::NAN] {
                let (found, expected) = (sample(mips.level(footprint), u, v), texture.sample(u, v));
                assert!((0..3).all(|c| (found[c] - expected[c]).abs() < STORED), "({u}, {v}): {found:?} {expected:?}");
            }
        }
        assert!(sample(mips.level(2.0), f32::NAN, f32::INFINITY).iter().all(|c| c.is_finite()));
        let [grey, ..] = sample(mips.level(1e9), 0.3, 0.3);
        assert!((0.3..0.7).contains(&grey), "{grey}");
    }
}
