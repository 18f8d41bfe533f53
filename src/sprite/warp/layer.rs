//! Render target of sprites, premultiplied.

use image::RgbImage;

/// A layer of 8-bit sRGB with premultiplied alpha, row-major; transparent pixels are all zero.
/// [`crate::compose`] makes a [`headbox_core::frame::Frame`] of layers.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct SpriteLayer {
    width: u32,
    height: u32,
    /// Red in the lowest byte, alpha in the highest.
    pub(super) pixels: Vec<u32>,
}

impl SpriteLayer {
    /// A transparent frame.
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            pixels: vec![0; width as usize * height as usize],
        }
    }

    /// Takes a size; all pixels become transparent.
    pub fn reset(&mut self, width: u32, height: u32) {
        self.resize(width, height);
        self.pixels.fill(0);
    }

    /// Takes a size; what the pixels hold is left open.
    pub(super) fn resize(&mut self, width: u32, height: u32) {
        (self.width, self.height) = (width, height);
        self.pixels.resize(width as usize * height as usize, 0);
    }

    /// Columns and rows.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// All pixels, row-major: red, green, blue (premultiplied), alpha.
    pub fn pixels(&self) -> &[[u8; 4]] {
        bytemuck::cast_slice(&self.pixels)
    }

    /// Draws `front` over this frame: out = front + back * (1 - alpha of front), rounded to
    /// nearest. Where the sizes differ only what both cover changes.
    pub fn draw_over(&mut self, front: &Self) {
        let width = (self.width as usize).max(1);
        for (back, front) in self
            .pixels
            .chunks_mut(width)
            .zip(front.pixels.chunks((front.width as usize).max(1)))
        {
            for (back, &front) in back.iter_mut().zip(front) {
                *back = over(front, *back);
            }
        }
    }

    /// Over an opaque colour, as an image without alpha.
    pub fn to_rgb(&self, background: [u8; 3]) -> RgbImage {
        let [r, g, b] = background;
        let back = u32::from_le_bytes([r, g, b, 255]);
        RgbImage::from_fn(self.width, self.height, |x, y| {
            let [r, g, b, _] = over(
                self.pixels[y as usize * self.width as usize + x as usize],
                back,
            )
            .to_le_bytes();
            image::Rgb([r, g, b])
        })
    }
}

/// A premultiplied pixel with straight alpha.
#[inline]
pub(crate) fn straight([r, g, b, a]: [u8; 4]) -> [u8; 4] {
    if a == 0 || a == 255 {
        return [r, g, b, a];
    }
    let straight =
        |c: u8| ((u32::from(c) * 510 + u32::from(a)) / (2 * u32::from(a))).min(255) as u8;
    [straight(r), straight(g), straight(b), a]
}

/// Premultiplied `front` over premultiplied `back`.
fn over(front: u32, back: u32) -> u32 {
    let (front, back) = (front.to_le_bytes(), back.to_le_bytes());
    let rest = 255 - u32::from(front[3]);
    let mixed = |c: usize| u32::from(front[c]) + (u32::from(back[c]) * rest * 2 + 255) / 510;
    u32::from_le_bytes([0, 1, 2, 3].map(|c| mixed(c).min(255) as u8))
}
