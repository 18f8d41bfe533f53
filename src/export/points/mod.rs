//! Captures as points: surfels, Gaussian splats and PLY.

pub mod ply;
pub mod splats;
pub(crate) mod surfels;
