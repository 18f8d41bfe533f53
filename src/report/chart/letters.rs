//! Letters as outlines, from a font that travels in the program: charts look the same on every machine.

use epaint_default_fonts::UBUNTU_LIGHT;
use skrifa::instance::{LocationRef, Size};
use skrifa::outline::{DrawSettings, OutlinePen};
use skrifa::{FontRef, MetadataProvider};
use tiny_skia::{Path, PathBuilder};

/// Width of a text, pixels; an estimate if the font cannot be read.
pub(super) fn width_px(text: &str, size: f64) -> f64 {
    let Ok(font) = FontRef::new(UBUNTU_LIGHT) else { return text.chars().count() as f64 * size * 0.55 };
    let (charmap, metrics) = (font.charmap(), font.glyph_metrics(Size::new(size as f32), LocationRef::default()));
    let advance = |c: char| charmap.map(c).and_then(|glyph| metrics.advance_width(glyph)).unwrap_or(0.0);
    text.chars().map(|c| f64::from(advance(c))).sum()
}

/// The outlines of a text that begins at the origin, its baseline along y = 0, y down; `None` for an empty one.
pub(super) fn outlines(text: &str, size: f64) -> Option<Path> {
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
