//! Letters as outlines, from a font that travels in the program: charts look the same on every machine.

use epaint_default_fonts::UBUNTU_LIGHT;
use image::{Rgb, RgbImage};
use skrifa::instance::{LocationRef, Size};
use skrifa::outline::{DrawSettings, OutlinePen};
use skrifa::{FontRef, MetadataProvider};
use tiny_skia::{FillRule, Mask, Path, PathBuilder, Transform};

/// Width of a text, pixels; an estimate if the font cannot be read.
pub fn width_px(text: &str, size: f64) -> f64 {
    let Ok(font) = FontRef::new(UBUNTU_LIGHT) else { return text.chars().count() as f64 * size * 0.55 };
    let (charmap, metrics) = (font.charmap(), font.glyph_metrics(Size::new(size as f32), LocationRef::default()));
    let advance = |c: char| charmap.map(c).and_then(|glyph| metrics.advance_width(glyph)).unwrap_or(0.0);
    text.chars().map(|c| f64::from(advance(c))).sum()
}

/// The outlines of a text that begins at the origin, its baseline along y = 0, y down; `None` for an empty one.
pub(crate) fn outlines(text: &str, size: f64) -> Option<Path> {
    let font = FontRef::new(UBUNTU_LIGHT).ok()?;
    let location = LocationRef::default();
    let size = Size::new(size as f32);
    let (charmap, glyphs, metrics) = (font.charmap(), font.outline_glyphs(), font.glyph_metrics(size, location));
    let mut pen = Pen { path: PathBuilder::new(), x: 0.0 };
    for character in text.chars() {
        let Some(glyph) = charmap.map(character) else { continue };
        if let Some(outline) = glyphs.get(glyph) {
            // A glyph that cannot be drawn leaves its place empty.
            let _ = outline.draw(DrawSettings::unhinted(size, location), &mut pen);
        }
        pen.x += metrics.advance_width(glyph).unwrap_or(0.0);
    }
    pen.path.finish()
}

/// From one line to the next, pixels.
pub(crate) fn line_height_px(size: f64) -> u32 {
    (size * 1.25).ceil() as u32
}

/// Draws a line of text on a picture, the upper left corner of its line at (x, y); what lies outside is left out.
pub(crate) fn draw(image: &mut RgbImage, [x, y]: [u32; 2], size: f64, color: Rgb<u8>, text: &str) {
    let width = (width_px(text, size).ceil() as u32 + 2).min(image.width().saturating_sub(x));
    let height = line_height_px(size).min(image.height().saturating_sub(y));
    let (Some(path), Some(mut mask)) = (outlines(text, size), Mask::new(width, height)) else { return };
    // Letters reach 0.93 of their size above the baseline.
    let place = Transform::from_translate(0.0, (size * 0.96) as f32);
    mask.fill_path(&path, FillRule::Winding, true, place);
    for (i, share) in (0u32..).zip(mask.data()) {
        let pixel = image.get_pixel_mut(x + i % width, y + i / width);
        for (under, over) in pixel.0.iter_mut().zip(color.0) {
            let [under_part, over_part] = [255 - u32::from(*share), u32::from(*share)];
            *under = ((u32::from(*under) * under_part + u32::from(over) * over_part + 127) / 255) as u8;
        }
    }
}

/// Fonts have y up, pictures have y down.
struct Pen {
    path: PathBuilder,
    x: f32,
}

impl OutlinePen for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.path.move_to(self.x + x, -y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.path.line_to(self.x + x, -y);
    }

    fn quad_to(&mut self, cx: f32, cy: f32, x: f32, y: f32) {
        self.path.quad_to(self.x + cx, -cy, self.x + x, -y);
    }

    fn curve_to(&mut self, cx: f32, cy: f32, dx: f32, dy: f32, x: f32, y: f32) {
        self.path.cubic_to(self.x + cx, -cy, self.x + dx, -dy, self.x + x, -y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stands_where_it_is_put_and_is_clipped() {
        let ink = Rgb([0; 3]);
        let mut image = RgbImage::from_pixel(60, 40, Rgb([255; 3]));
        draw(&mut image, [20, 10], 20.0, ink, "H");
        let inked = |x: u32, y: u32| image.get_pixel(x, y).0[0] < 128;
        let place = image.enumerate_pixels().filter(|(_, _, pixel)| pixel.0[0] < 128).map(|(x, y, _)| [x, y]);
        let place: Vec<[u32; 2]> = place.collect();
        assert!(place.iter().all(|[x, y]| (20..36).contains(x) && (10..35).contains(y)), "{place:?}");
        assert!(place.len() > 20 && (10..35).any(|y| inked(23, y) || inked(22, y)), "{place:?}");
        assert!((width_px("HH", 20.0) - 2.0 * width_px("H", 20.0)).abs() < 1e-9);
        for corner in [[58, 38], [60, 40], [u32::MAX, 5], [5, u32::MAX]] {
            draw(&mut image, corner, 20.0, ink, "clipped");
        }
        draw(&mut image, [0, 0], 12.0, ink, "");
    }
}
