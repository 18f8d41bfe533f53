//! Textures with their minified copies.

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

    /// Bilinear, wrapping around, as [`Texture::sample`] is: linear RGB.
    #[inline(always)]
    pub(super) fn sample(&self, u: f32, v: f32) -> [f32; 3] {
        let (x0, x1, fx) = neighbours(u, self.width);
        let (y0, y1, fy) = neighbours(1.0 - v, self.height);
        let width = self.width as usize;
        let at = |x: usize, y: usize| self.texels.get(y * width + x).copied().unwrap_or([0; 4]);
        let (a, b, c, d) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
        let mut mixed = [0.0; 4];
        for i in 0..4 {
            let (a, b, c, d) = (f32::from(a[i]), f32::from(b[i]), f32::from(c[i]), f32::from(d[i]));
            let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
            mixed[i] = (top + (bottom - top) * fy) * (1.0 / FULL);
        }
        [mixed[0], mixed[1], mixed[2]]
    }
}

/// The two texels on either side of the texture coordinate `t` and the weight of the second.
#[inline(always)]
fn neighbours(t: f32, size: u32) -> (usize, usize, f32) {
    let size_f = size as f32;
    // `t.floor()` without the call into libm; the cast turns NaN and what is out of range into numbers.
    let truncated = t as i32 as f32;
    let fraction = t - if truncated > t { truncated - 1.0 } else { truncated };
    let fraction = if (0.0..=1.0).contains(&fraction) { fraction } else { 0.0 };
    let x = fraction * size_f - 0.5;
    let x = if x < 0.0 { x + size_f } else { x };
    let first = (x as usize).min(size as usize - 1);
    let second = if first + 1 == size as usize { 0 } else { first + 1 };
    (first, second, (x - first as f32).clamp(0.0, 1.0))
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

    #[test]
    fn the_first_level_is_the_texture_and_the_last_its_mean() {
        let texture = Texture::from_fn(5, 3, |x, y| if (x + y) % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] });
        let mips = MipTexture::new(&texture);
        let sizes: Vec<_> = mips.levels.iter().map(|level| (level.width, level.height)).collect();
        assert_eq!(sizes, [(5, 3), (3, 2), (2, 1), (1, 1)]);
        for (u, v) in [(0.1, 0.2), (0.77, 0.5), (-3.3, 9.9), (1.0, 0.0), (-1.0, 1.0)] {
            for footprint in [0.0, 1.0, f32::NAN] {
                let (found, expected) = (mips.level(footprint).sample(u, v), texture.sample(u, v));
                assert!((0..3).all(|c| (found[c] - expected[c]).abs() < STORED), "({u}, {v}): {found:?} {expected:?}");
            }
        }
        assert!(mips.level(2.0).sample(f32::NAN, f32::INFINITY).iter().all(|c| c.is_finite()));
        let [grey, ..] = mips.level(1e9).sample(0.3, 0.3);
        assert!((0.3..0.7).contains(&grey), "{grey}");
    }
}
