//! What sprites are drawn into and laid over each other in, before it is a finished [`Frame`].

use crate::frame::{Coverage, Frame};
use image::{RgbImage, RgbaImage};
use rayon::prelude::*;

/// A layer of 8-bit sRGB with premultiplied alpha, row-major; transparent pixels are all zero. [`Self::finish`] makes a
/// [`Frame`] of it, [`Self::draw_frame_over`] takes one in.
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
        Self { width, height, pixels: vec![0; width as usize * height as usize] }
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

    /// Draws `front` over this frame: out = front + back * (1 - alpha of front), rounded to nearest. Where the sizes
    /// differ only what both cover changes.
    pub fn draw_over(&mut self, front: &Self) {
        let width = (self.width as usize).max(1);
        for (back, front) in self.pixels.chunks_mut(width).zip(front.pixels.chunks((front.width as usize).max(1))) {
            for (back, &front) in back.iter_mut().zip(front) {
                *back = over(front, *back);
            }
        }
    }

    /// As [`Self::draw_over`], of the share of each pixel that splats cover in a frame drawn without an environment. Colours are
    /// weighted and added in one step, rounded once.
    pub fn draw_frame_over(&mut self, front: &Frame) {
        let width = (self.width as usize).max(1);
        let rows = self.pixels.chunks_mut(width).zip(front.color.chunks((front.width as usize).max(1)));
        for ((back, colors), coverages) in rows.zip(front.coverage.chunks((front.width as usize).max(1))) {
            for ((back, &[r, g, b, _]), coverage) in back.iter_mut().zip(colors).zip(coverages) {
                let under = back.to_le_bytes();
                let (share, rest) = (u32::from(coverage.splat_share()), u32::from(255 - coverage.splat_share()));
                let mixed =
                    |front: u8, c: usize| ((u32::from(front) * share + u32::from(under[c]) * rest) * 2 + 255) / 510;
                *back = u32::from_le_bytes([mixed(r, 0), mixed(g, 1), mixed(b, 2), mixed(255, 3)].map(|c| c as u8));
            }
        }
    }

    /// The finished frame: over what `background` gives for a column and a row, and where it gives nothing over the colour of
    /// holes. It is asked only where the layer is not opaque.
    pub fn finish(
        &self,
        background: impl Fn(u32, u32) -> Option<[u8; 3]> + Sync,
        hole_color_srgb: [u8; 3],
        frame: &mut Frame,
    ) {
        frame.resize(self.width, self.height, false);
        let width = (self.width as usize).max(1);
        let rows = frame.color.par_chunks_mut(width).zip(frame.coverage.par_chunks_mut(width));
        rows.zip(self.pixels.par_chunks(width)).enumerate().for_each(|(y, ((colors, coverages), layer))| {
            for (x, ((color, coverage), &pixel)) in colors.iter_mut().zip(coverages).zip(layer).enumerate() {
                let share = (pixel >> 24) as u8;
                let behind = if share < 255 { background(x as u32, y as u32) } else { None };
                let [r, g, b] = behind.unwrap_or(hole_color_srgb);
                *color = over(pixel, u32::from_le_bytes([r, g, b, 255])).to_le_bytes();
                *coverage = match (share, behind) {
                    (0, None) => Coverage::HOLE,
                    (0, Some(_)) => Coverage::ENVIRONMENT,
                    _ => Coverage::of_splats(share),
                };
            }
        });
    }

    /// Over an opaque colour, as an image without alpha.
    pub fn to_rgb(&self, background: [u8; 3]) -> RgbImage {
        let [r, g, b] = background;
        let back = u32::from_le_bytes([r, g, b, 255]);
        RgbImage::from_fn(self.width, self.height, |x, y| {
            let [r, g, b, _] = over(self.pixels[y as usize * self.width as usize + x as usize], back).to_le_bytes();
            image::Rgb([r, g, b])
        })
    }

    /// As an image with straight alpha.
    pub fn to_rgba(&self) -> RgbaImage {
        RgbaImage::from_fn(self.width, self.height, |x, y| {
            let [r, g, b, a] = self.pixels[y as usize * self.width as usize + x as usize].to_le_bytes();
            let straight = |c: u8| {
                if a == 0 { 0 } else { ((u32::from(c) * 510 + u32::from(a)) / (2 * u32::from(a))).min(255) as u8 }
            };
            image::Rgba([straight(r), straight(g), straight(b), a])
        })
    }
}

/// Premultiplied `front` over premultiplied `back`.
fn over(front: u32, back: u32) -> u32 {
    let (front, back) = (front.to_le_bytes(), back.to_le_bytes());
    let rest = 255 - u32::from(front[3]);
    let mixed = |c: usize| u32::from(front[c]) + (u32::from(back[c]) * rest * 2 + 255) / 510;
    u32::from_le_bytes([0, 1, 2, 3].map(|c| mixed(c).min(255) as u8))
}
