//! Vertex colours of an OBJ, which the format does not define: numbers behind a position, or the
//! polypaint of ZBrush in `#MRGB` comments.

use super::notes::{Note, Notes};

/// sRGB colour; 0..=1, or up to the white of the file.
type Color = [f64; 3];

/// Part of a colour outside 0..=1 that is an error of rounding.
const ROUNDING: f64 = 1e-3;

/// White in place of a missing or unreadable colour.
const ABSENT: Color = [f64::NAN; 3];

/// Colours of the vertices so far.
#[derive(Default)]
pub(super) struct VertexColors {
    /// Number of vertices.
    vertices: usize,
    /// Colours of the first vertices; those of the others are absent.
    colors: Vec<Color>,
    /// Polypaint that no vertex has yet.
    polypaint: Vec<Color>,
    unreadable: usize,
    /// Colours of the polypaint without a vertex.
    surplus: usize,
}

impl VertexColors {
    /// Adds a vertex; `color` is `Some(None)` if it does not parse.
    pub(super) fn add_vertex(&mut self, color: Option<Option<Color>>) {
        self.assign_polypaint();
        match color {
            Some(Some(color)) => self.set(self.vertices, color),
            Some(None) => self.unreadable += 1,
            None => {}
        }
        self.vertices += 1;
    }

    /// Adds the argument of a `#MRGB`: mask, red, green and blue of each vertex, two hexadecimal
    /// digits each. A block of these lines belongs to the last vertices before it.
    pub(super) fn add_polypaint(&mut self, digits: &str) {
        for entry in digits.as_bytes().chunks(8) {
            let value = std::str::from_utf8(entry)
                .ok()
                .filter(|entry| entry.len() == 8)
                .and_then(|entry| u32::from_str_radix(entry, 16).ok());
            match value {
                Some(value) => {
                    let [_, r, g, b] = value.to_be_bytes();
                    self.polypaint
                        .push([r, g, b].map(|byte| f64::from(byte) / 255.0));
                }
                None => {
                    self.polypaint.push(ABSENT);
                    self.unreadable += 1;
                }
            }
        }
    }

    fn assign_polypaint(&mut self) {
        let count = self.polypaint.len().min(self.vertices);
        self.surplus += self.polypaint.len() - count;
        self.polypaint.truncate(count);
        let first = self.vertices - count;
        for (i, color) in std::mem::take(&mut self.polypaint).into_iter().enumerate() {
            self.set(first + i, color);
        }
    }

    fn set(&mut self, vertex: usize, color: Color) {
        if self.colors.len() <= vertex {
            self.colors.resize(vertex + 1, ABSENT);
        }
        self.colors[vertex] = color;
    }

    /// Returns a colour of each vertex, white where it is absent, or nothing if the file has none.
    /// Whole numbers up to 255 or 65535 become 0..=1; other values above 1 stay and are noted.
    pub(super) fn finish(mut self, notes: &mut Notes) -> Vec<Color> {
        self.assign_polypaint();
        notes.add(Note::VertexColorUnread, self.unreadable);
        notes.add(Note::VertexColorSurplus, self.surplus);
        if self.colors.is_empty() && self.unreadable == 0 {
            return Vec::new();
        }
        let white = white_of(self.colors.as_flattened());
        if white != 1.0 {
            let count = self
                .colors
                .iter()
                .filter(|color| !color[0].is_nan())
                .count();
            notes.add_to(Note::VertexColorScaled, count, format!("{white}"));
        }
        let is_outside = |c: f64| (c - 0.5).abs() > 0.5 + ROUNDING;
        let limited = self
            .colors
            .iter()
            .filter(|color| color.iter().any(|c| is_outside(c / white)));
        notes.add(Note::VertexColorLimited, limited.count());
        self.colors.resize(self.vertices, ABSENT);
        for color in &mut self.colors {
            *color = if color.iter().any(|value| value.is_nan()) {
                [1.0; 3]
            } else {
                color.map(|value| value / white)
            };
        }
        self.colors
    }
}

/// Returns the value of white: 1, or that of bytes or 16-bit numbers if all values are whole and
/// some are above 1.
fn white_of(values: &[f64]) -> f64 {
    let numbers = || values.iter().filter(|value| !value.is_nan());
    let greatest = numbers().fold(0.0_f64, |greatest, &value| greatest.max(value));
    let least = numbers().fold(0.0_f64, |least, &value| least.min(value));
    let is_whole = numbers().all(|value| value.fract() == 0.0);
    // Bytes that were averaged have fractions, and no light is so much above white.
    let is_scaled = least >= 0.0 && (greatest > 1.0 && is_whole || greatest > 32.0);
    match greatest {
        ..=255.0 if is_scaled => 255.0,
        ..=65_535.0 if is_scaled && is_whole => 65_535.0,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_is_that_of_the_values() {
        for (values, white) in [
            ([0.0, 1.0, 0.5], 1.0),
            ([0.0, 1.0, 1.5], 1.0),
            ([0.0, 1.0, 2.0], 255.0),
            ([0.5, 199.5, 2.0], 255.0),
            ([0.0, 65535.0, 2.0], 65_535.0),
            ([0.5, 300.0, 2.0], 1.0),
            ([-1.0, 200.0, 2.0], 1.0),
            ([f64::NAN, 0.0, 1.0], 1.0),
        ] {
            assert_eq!(white_of(&values), white, "{values:?}");
        }
    }

    #[test]
    fn polypaint_belongs_to_the_vertices_before_it() {
        let mut colors = VertexColors::default();
        colors.add_vertex(None);
        colors.add_polypaint("ffff0000ff00ff00");
        colors.add_vertex(None);
        colors.add_vertex(None);
        colors.add_polypaint("ff0000ff");
        colors.add_polypaint("xx");
        let mut notes = Notes::default();
        let expected = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]];
        assert_eq!(colors.finish(&mut notes), expected);
        assert_eq!(
            notes.summary().notes.len(),
            2,
            "one colour too many, one unreadable"
        );
    }
}
