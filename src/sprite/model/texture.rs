//! Texture of a sprite: premultiplied mip levels with transparent borders.

use headbox_core::image::mip::{MipLevel, OddEdge};
use image::RgbaImage;
use std::iter::successors;

/// Layout of a mip level in a [`Texture`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LevelLayout {
    /// Index of texel (0, 0) in [`Texture::texels`].
    pub origin: u32,
    /// Number of texels from one row to the next.
    pub stride: u32,
    /// Columns without the border.
    pub width: u32,
    /// Rows without the border.
    pub height: u32,
}

/// An image in premultiplied RGBA8 (red in the lowest byte) with all its mip levels.
///
/// Around each level lies a border of transparent texels: one at the left and the top, two at the
/// right and the bottom, so that a bilinear footprint that starts anywhere from -1 to width
/// (height) stays inside. Worked example, a level of 2 x 1 texels `a b`, `.` transparent; its
/// stride is 5, its origin 6:
///
/// ```text
/// . . . . .
/// . a b . .
/// . . . . .
/// . . . . .
/// ```
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Texture {
    /// Pairs of a texel and the texel below it, so that a bilinear footprint is contiguous in
    /// memory.
    pub texels: Vec<[u32; 2]>,
    pub levels: Vec<LevelLayout>,
}

/// Number of transparent columns (rows) around a level: one before, two after.
const BORDER: u32 = 3;

impl Texture {
    /// Premultiplies an image with straight alpha and halves it until one texel is left.
    pub(crate) fn new(color: &RgbaImage) -> Self {
        let finest = MipLevel {
            size: [color.width() as usize, color.height() as usize],
            texels: color.pixels().map(|p| premultiply(p.0)).collect(),
        };
        let levels = successors(Some(finest), |level| {
            let can_be_halved = level.size.iter().any(|side| *side > 1);
            can_be_halved.then(|| level.halved(OddEdge::Pad([0; 4]), mean))
        });
        let mut texture = Self {
            texels: Vec::new(),
            levels: Vec::new(),
        };
        levels.for_each(|level| texture.push_level(&level));
        texture
    }

    fn push_level(&mut self, level: &MipLevel<[u8; 4]>) {
        let [width, height] = level.size.map(|side| side as u32);
        let stride = width + BORDER;
        let start = self.texels.len();
        let origin = start + stride as usize + 1;
        self.texels
            .resize(start + stride as usize * (height + BORDER) as usize, [0; 2]);
        for (y, row) in level.texels.chunks_exact(width as usize).enumerate() {
            let first = origin + y * stride as usize;
            for (x, &pixel) in row.iter().enumerate() {
                let pixel = u32::from_le_bytes(pixel);
                self.texels[first + x][0] = pixel;
                self.texels[first + x - stride as usize][1] = pixel;
            }
        }
        self.levels.push(LevelLayout {
            origin: origin as u32,
            stride,
            width,
            height,
        });
    }
}

/// Multiplies the colour by alpha, rounded to nearest.
pub(super) fn premultiply([r, g, b, a]: [u8; 4]) -> [u8; 4] {
    let scaled = |c: u8| ((u32::from(c) * u32::from(a) * 2 + 255) / 510) as u8;
    [scaled(r), scaled(g), scaled(b), a]
}

fn mean(four: [[u8; 4]; 4]) -> [u8; 4] {
    [0, 1, 2, 3].map(|c| ((four.iter().map(|p| u32::from(p[c])).sum::<u32>() + 2) / 4) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    #[test]
    fn levels_have_transparent_borders() {
        let texture = Texture::new(&RgbaImage::from_pixel(5, 3, Rgba([255, 128, 0, 255])));
        let sizes: Vec<_> = texture.levels.iter().map(|l| (l.width, l.height)).collect();
        assert_eq!(sizes, [(5, 3), (3, 2), (2, 1), (1, 1)]);
        for level in &texture.levels {
            let at = |x: i64, y: i64| {
                texture.texels[(i64::from(level.origin) + y * i64::from(level.stride) + x) as usize]
                    [0]
            };
            let (w, h) = (i64::from(level.width), i64::from(level.height));
            for y in -1..h + 2 {
                assert_eq!([at(-1, y), at(w, y), at(w + 1, y)], [0; 3]);
            }
            for x in -1..w + 2 {
                assert_eq!([at(x, -1), at(x, h), at(x, h + 1)], [0; 3]);
            }
            assert_ne!(at(0, 0), 0);
        }
        assert_eq!(
            texture.texels[texture.levels[0].origin as usize][0],
            u32::from_le_bytes([255, 128, 0, 255])
        );
    }

    #[test]
    fn premultiplying_rounds_to_nearest() {
        for (c, a) in (0..=255u8).flat_map(|c| (0..=255u8).map(move |a| (c, a))) {
            let want = (f64::from(c) * f64::from(a) / 255.0).round() as u8;
            assert_eq!(premultiply([c, 0, 0, a]), [want, 0, 0, a]);
        }
    }
}
