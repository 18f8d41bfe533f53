//! Render target of sprites, premultiplied.

use image::RgbImage;

/// A layer of 8-bit sRGB with premultiplied alpha, row-major; transparent pixels are all zero.
/// [`crate::compose`] composites layers into a [`headbox_core::frame::Frame`].
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct SpriteLayer {
    pub(super) width: u32,
    height: u32,
    /// Red in the lowest byte, alpha in the highest.
    pub(super) pixels: Vec<u32>,
}

impl SpriteLayer {
    /// Creates a transparent layer.
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            pixels: vec![0; width as usize * height as usize],
        }
    }

    /// Resizes the layer and makes all pixels transparent.
    pub fn reset(&mut self, width: u32, height: u32) {
        self.resize(width, height);
        self.pixels.fill(0);
    }

    /// Resizes the layer; the pixels are unspecified.
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

    /// Composites `front` over this layer: out = front + back * (1 - alpha of front), rounded to
    /// nearest. If the sizes differ, only the common rectangle changes.
    pub fn draw_over(&mut self, front: &Self) {
        let [width, front_width] = [self.width, front.width].map(|width| width.max(1) as usize);
        let rows = self.pixels.chunks_mut(width);
        for (back, front) in rows.zip(front.pixels.chunks(front_width)) {
            for (back, &front) in back.iter_mut().zip(front) {
                *back = over(front, *back);
            }
        }
    }

    /// Composites the layer over an opaque colour.
    pub fn to_rgb(&self, background: [u8; 3]) -> RgbImage {
        let [r, g, b] = background;
        let back = u32::from_le_bytes([r, g, b, 255]);
        RgbImage::from_fn(self.width, self.height, |x, y| {
            let front = self.pixels[y as usize * self.width as usize + x as usize];
            let [r, g, b, _] = over(front, back).to_le_bytes();
            image::Rgb([r, g, b])
        })
    }
}

/// Converts a pixel from premultiplied to straight alpha.
#[inline]
pub(crate) fn unpremultiply([r, g, b, a]: [u8; 4]) -> [u8; 4] {
    if a == 0 || a == 255 {
        return [r, g, b, a];
    }
    let straight =
        |c: u8| ((u32::from(c) * 510 + u32::from(a)) / (2 * u32::from(a))).min(255) as u8;
    [straight(r), straight(g), straight(b), a]
}

/// Composites premultiplied `front` over premultiplied `back`.
fn over(front: u32, back: u32) -> u32 {
    let (front, back) = (front.to_le_bytes(), back.to_le_bytes());
    let rest = 255 - u32::from(front[3]);
    let mixed = |c: usize| u32::from(front[c]) + (u32::from(back[c]) * rest * 2 + 255) / 510;
    u32::from_le_bytes([0, 1, 2, 3].map(|c| mixed(c).min(255) as u8))
}
