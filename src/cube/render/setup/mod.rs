//! Work done once per frame: drawing order, transfer matrices, footprint tables, clipping.

pub mod clip;
pub mod order;
pub mod plan;
pub mod transfer;
