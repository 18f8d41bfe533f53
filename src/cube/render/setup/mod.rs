//! Once per frame and segment: the matrix, the clipping planes and the drawing order.

pub(crate) mod clip;
pub(crate) mod order;
pub mod transfer;
