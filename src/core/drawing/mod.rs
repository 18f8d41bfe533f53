//! Drawings for people: marks on white (lines, areas, dots, boxes and texts) as SVG and as PNG, both from one list; and sheets
//! of pictures side by side.
//!
//! Letters are outlines of a font that travels in the program, so that a drawing looks the same on every machine.

pub mod letters;
mod marks;
mod png;
pub mod sheet;

pub use marks::{Anchor, Color, Drawing, Mark};
