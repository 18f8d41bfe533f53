//! SVG writer: lines, polygons, circles and text on a white ground.
//!
//! The reader's program draws the text, in a sans-serif font of its system.

use super::escape;
use glam::DVec2;

/// sRGB colour.
pub type Color = [u8; 3];

/// Style of a line of text.
#[derive(Clone, Copy, Debug)]
pub struct TextStyle {
    /// Font size, pixels.
    pub size: f64,
    /// Colour of the letters.
    pub color: Color,
    /// Part of the baseline that lies at the text's position: `start`, `middle` or `end`.
    pub anchor: &'static str,
    /// Rotates the text by a quarter turn, so that it reads upwards.
    pub upwards: bool,
    /// Surrounds the letters with white, for text on top of lines.
    pub halo: bool,
}

/// An SVG file under construction. Lengths are pixels, y points down; later shapes cover earlier
/// ones.
pub struct Svg(String);

impl Svg {
    /// Starts a white drawing. Screen readers read `title` aloud.
    pub fn new(DVec2 { x, y }: DVec2, title: &str) -> Self {
        Self(format!(
            "<svg xmlns='http://www.w3.org/2000/svg' width='{x}' height='{y}' viewBox='0 0 {x} {y}' role='img' \
             font-family='Helvetica, Arial, Liberation Sans, sans-serif' stroke-linejoin='round'>\n\
             <title>{}</title>\n<rect width='{x}' height='{y}' fill='white'/>\n",
            escape(title)
        ))
    }

    /// Draws polylines in one colour and width.
    pub fn lines(
        &mut self,
        lines: impl IntoIterator<Item = impl AsRef<[DVec2]>>,
        color: Color,
        width: f64,
    ) {
        let mut path = String::new();
        for line in lines {
            for (i, DVec2 { x, y }) in line.as_ref().iter().enumerate() {
                path += &format!("{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' });
            }
        }
        if !path.is_empty() {
            self.0 += &format!(
                "<path d='{path}' fill='none' stroke='{}' stroke-width='{width}'/>\n",
                hex(color)
            );
        }
    }

    /// Fills a polygon.
    pub fn polygon(&mut self, corners: &[DVec2], color: Color) {
        let points: Vec<String> = corners
            .iter()
            .map(|DVec2 { x, y }| format!("{x:.1},{y:.1}"))
            .collect();
        self.0 += &format!(
            "<polygon points='{}' fill='{}'/>\n",
            points.join(" "),
            hex(color)
        );
    }

    /// Draws a white rectangle with a coloured border.
    pub fn white_box(&mut self, DVec2 { x, y }: DVec2, size: DVec2, border: Color) {
        let (width, height, border) = (size.x, size.y, hex(border));
        self.0 += &format!(
            "<rect x='{x:.1}' y='{y:.1}' width='{width:.1}' height='{height:.1}' fill='white' stroke='{border}' \
             stroke-width='1.2'/>\n"
        );
    }

    /// Draws a disc with a border.
    pub fn circle(&mut self, DVec2 { x, y }: DVec2, radius: f64, border: Color, fill: Color) {
        let [border, fill] = [border, fill].map(hex);
        self.0 += &format!(
            "<circle cx='{x:.1}' cy='{y:.1}' r='{radius}' fill='{fill}' stroke='{border}' stroke-width='1.6'/>\n"
        );
    }

    /// Writes a line of text with its baseline at a position.
    pub fn text(&mut self, DVec2 { x, y }: DVec2, text: &str, style: TextStyle) {
        let TextStyle { size, anchor, .. } = style;
        let (color, text) = (hex(style.color), escape(text));
        let rotation = if style.upwards {
            format!(" transform='rotate(-90 {x:.1} {y:.1})'")
        } else {
            String::new()
        };
        let halo = if style.halo {
            " stroke='white' stroke-width='4' paint-order='stroke'"
        } else {
            ""
        };
        self.0 += &format!(
            "<text x='{x:.1}' y='{y:.1}' font-size='{size}' fill='{color}' text-anchor='{anchor}'{rotation}{halo}>\
             {text}</text>\n"
        );
    }

    /// Returns the finished file.
    pub fn finish(self) -> String {
        self.0 + "</svg>\n"
    }
}

fn hex([r, g, b]: Color) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Returns the width of a line of text, pixels, in DejaVu Sans, the widest of the usual sans-serif
/// fonts: text laid out by it overlaps nothing on any system.
pub fn text_width(text: &str, size: f64) -> f64 {
    let em = |character: char| match character {
        'i' | 'j' | 'l' | '\'' | '|' => 0.3,
        'f' | 'r' | 't' | 'I' | 'J' | ' ' | '.' | ',' | ':' | ';' | '!' | '-' | '/' | '(' | ')' => {
            0.4
        }
        'm' | 'w' | 'M' | 'W' | '%' | '@' => 0.98,
        'A'..='Z' => 0.76,
        '\u{2e80}'.. => 1.0, // Chinese, Japanese, Korean
        _ => 0.64,
    };
    size * text.chars().map(em).sum::<f64>()
}
