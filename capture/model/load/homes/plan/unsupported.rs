//! Parts of a home that are not supported, counted.

use super::xml::{elements, number};
use glam::DVec2;
use roxmltree::Node;

/// Numbers of properties of a plan that are not built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Unsupported {
    /// Staircases that cut the floors above them.
    pub(crate) staircases: usize,
    /// Doors and windows whose hole in the wall is not their whole rectangle.
    pub(crate) shaped_openings: usize,
    /// Pieces of furniture with moved parts, such as an open door.
    pub(crate) moved_parts: usize,
    /// Baseboards of walls.
    pub(crate) baseboards: usize,
    /// Polylines in 3D.
    pub(crate) polylines: usize,
    /// Labels in 3D.
    pub(crate) labels: usize,
    /// Lamps with light sources.
    pub(crate) lights: usize,
    /// Compasses whose north is not upward in plan.
    pub(crate) compasses: usize,
}

impl Unsupported {
    /// Counts the properties of a piece of furniture, a lamp, a door or a window.
    pub(super) fn add_piece(&mut self, node: Node, is_opening: bool) {
        let cuts_floor = node
            .attribute("staircaseCutOutShape")
            .is_some_and(|shape| !matches!(shape, "" | "false"));
        self.staircases += usize::from(cuts_floor);
        self.lights += usize::from(elements(node, "lightSource").next().is_some());
        self.moved_parts += usize::from(elements(node, "transformation").next().is_some());
        let is_whole = |(attribute, whole): (&str, f64)| {
            number(node, attribute).is_none_or(|value| (value - whole).abs() < SHAPE_ROUNDING)
        };
        let is_shaped = node
            .attribute("cutOutShape")
            .is_some_and(|path| !path.is_empty() && !is_unit_square(path));
        let parts = [
            ("wallWidth", 1.0),
            ("wallLeft", 0.0),
            ("wallHeight", 1.0),
            ("wallTop", 0.0),
        ];
        let is_partial = is_shaped || !parts.into_iter().all(is_whole);
        self.shaped_openings += usize::from(is_opening && is_partial);
    }
}

/// Error of numbers in shapes, as a share of the piece.
const SHAPE_ROUNDING: f64 = 1e-3;

/// Returns true if an SVG path consists of lines between corners of the unit square.
pub(super) fn is_unit_square(path: &str) -> bool {
    let mut at = DVec2::ZERO;
    let mut rest = path.trim();
    while let Some(command) = rest.chars().next() {
        let after = &rest[command.len_utf8()..];
        let end = after
            .find(|c: char| c.is_ascii_alphabetic() && !matches!(c, 'e' | 'E'))
            .unwrap_or(after.len());
        let numbers: Option<Vec<f64>> = after[..end]
            .split(|c: char| c == ',' || c.is_whitespace())
            .filter(|word| !word.is_empty())
            .map(|word| word.parse().ok())
            .collect();
        let Some(numbers) = numbers else {
            return false;
        };
        let from = if command.is_ascii_lowercase() {
            at
        } else {
            DVec2::ZERO
        };
        at = match (command.to_ascii_lowercase(), numbers.as_slice()) {
            ('m' | 'l', &[x, y]) => from + DVec2::new(x, y),
            ('h', &[x]) => DVec2::new(from.x + x, at.y),
            ('v', &[y]) => DVec2::new(at.x, from.y + y),
            ('z', []) => at,
            _ => return false,
        };
        let off_corner = (at - at.round().clamp(DVec2::ZERO, DVec2::ONE)).abs();
        // Also true for NaN.
        let is_at_corner = off_corner.max_element() < SHAPE_ROUNDING;
        if !is_at_corner {
            return false;
        }
        rest = &after[end..];
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_square_is_told_from_other_shapes() {
        for path in [
            "M0,0 v1 h1 v-1 z",
            "M 0 0 L 1 0 L 1 1 L 0 1 Z",
            "M0,0V1H1V0Z",
        ] {
            assert!(is_unit_square(path), "{path}");
        }
        for path in [
            "M0.5,0 L 1,1 L 0,1 z",
            "M0,0.5 C 0,0 1,0 1,0.5 z",
            "M0,0 a1 1 0 0 1 1 1",
            "M0,0 v2",
            "?",
        ] {
            assert!(!is_unit_square(path), "{path}");
        }
    }
}
