//! Sprite rendering. First pass: `forward` (with `planes`, `patches`, `pure_parallax`, `cell`)
//! moves displacements, `fill` closes gaps in the `field`. Second pass: `backward` samples the
//! texture (`sampling`) by the homography (`transfer`) and the moved displacements. `splat` is the
//! forward-mapped baseline; `render` chooses among all variants.

mod backward;
pub(crate) mod cell;
pub(crate) mod field;
mod fill;
pub(crate) mod forward;
pub(crate) mod layer;
mod patches;
pub(crate) mod planes;
pub(crate) mod pure_parallax;
pub(crate) mod render;
pub(crate) mod sampling;
mod splat;
#[cfg(test)]
mod tests;
pub(crate) mod transfer;
