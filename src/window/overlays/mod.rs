//! Overlays: pictures of how a frame was made.

pub(crate) mod effort;
pub(crate) mod geometry_overlay;
pub(crate) mod marks;
pub(crate) mod overlay;
pub(crate) mod variation;
