//! Canvases: where splats accumulate, one for each way of blending.

pub(crate) mod depth;
pub mod linear;
pub(crate) mod over;
pub mod surface;
pub mod touched;
