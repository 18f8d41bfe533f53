//! Sprite rendering. `first_pass` moves displacements (`cell`), `fill` closes gaps in the `field`.
//! `second_pass` samples the texture by the homography (`transfer`) and the moved displacements.
//! `splat` is the forward-mapped baseline; `render` chooses among all variants.

pub(crate) mod cell;
pub(crate) mod field;
mod fill;
pub(crate) mod first_pass;
pub(crate) mod layer;
pub(crate) mod render;
pub(crate) mod second_pass;
mod splat;
#[cfg(test)]
mod tests;
pub(crate) mod transfer;
