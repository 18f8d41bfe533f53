//! From a canvas to the frame: background, and filling of small holes.

pub(crate) mod fill;
pub mod finish;
