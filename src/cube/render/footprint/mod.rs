//! Splat footprints: their size, and the weight of each pixel that they cover.

pub(crate) mod ellipse;
pub mod rules;
pub(crate) mod size;
pub mod splat;
pub(crate) mod tent;
