//! Textures with their minified copies.

use crate::capture::{Texture, linear_from_srgb8, srgb8_from_linear};

/// A texture and copies of half the size each, down to one texel.
#[derive(Debug)]
pub(super) struct MipTexture {
    /// The largest first; never empty.
    levels: Vec<Texture>,
}

impl MipTexture {
    pub(super) fn new(texture: &Texture) -> Self {
        let mut levels = vec![texture.clone()];
        while let Some(next) = levels.last().and_then(halved) {
            levels.push(next);
        }
        Self { levels }
    }

    /// Linear RGB and alpha at a texture coordinate: bilinear in the two levels about `level` (0 is the texture itself,
    /// where the sample is that of [`Texture::sample`]), blended.
    pub(super) fn sample(&self, u: f32, v: f32, level: f32) -> [f32; 4] {
        let last = self.levels.len() - 1;
        let level = if level > 0.0 { level.min(last as f32) } else { 0.0 };
        let lower = (level as usize).min(last);
        let share = level - lower as f32;
        let a = self.levels[lower].sample(u, v);
        match self.levels.get(lower + 1).filter(|_| share > 0.0) {
            None => a,
            Some(next) => {
                let b = next.sample(u, v);
                std::array::from_fn(|c| a[c] + (b[c] - a[c]) * share)
            }
        }
    }

    /// Width and height in texels.
    pub(super) fn size(&self) -> [f32; 2] {
        [self.levels[0].width() as f32, self.levels[0].height() as f32]
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

    #[test]
    fn the_first_level_is_the_texture_and_the_last_its_mean() {
        let texture = Texture::from_fn(5, 3, |x, y| if (x + y) % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] });
        let mips = MipTexture::new(&texture);
        assert_eq!(
            mips.levels.iter().map(|t| (t.width(), t.height())).collect::<Vec<_>>(),
            [(5, 3), (3, 2), (2, 1), (1, 1)]
        );
        for (u, v) in [(0.1, 0.2), (0.77, 0.5), (-3.3, 9.9)] {
            assert_eq!(mips.sample(u, v, 0.0), texture.sample(u, v));
            assert_eq!(mips.sample(u, v, f32::NAN), texture.sample(u, v));
        }
        let [grey, _, _, alpha] = mips.sample(0.3, 0.3, 99.0);
        assert!((0.3..0.7).contains(&grey) && alpha == 1.0, "{grey}");
    }
}
