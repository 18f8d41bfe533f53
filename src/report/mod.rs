//! What is shown to people: sheets of pictures side by side.

pub mod cube_map;
pub mod font;
pub mod sheet;
