//! Splat footprints: kernels, sizes in the frame, and the tents of the default kernel.

pub mod rules;
pub(crate) mod size;
pub mod splat;
pub(crate) mod tent;
