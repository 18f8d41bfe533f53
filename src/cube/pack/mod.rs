//! The render-time LDI: 8 bytes a depth pixel in one linear array, addressed by scanline offsets
//! and in-row counts.

pub mod blocks;
pub mod decode;
pub mod exact;
pub mod file;
pub mod layout;
pub(crate) mod mips;
pub mod pack_samples;
pub mod packed_depth_pixel;
pub mod plane_set;
pub mod planes;
pub(crate) mod runs;
pub mod splat_index;
#[cfg(test)]
pub(crate) mod tests;
pub mod validate;

pub use blocks::BlockIndex;
pub use decode::DecodedDepthPixel;
pub use exact::{UnquantisedCube, UnquantisedDepthPixel};
pub use layout::{CubeLdi, PackedSegment, SegmentSide};
pub use mips::LazyMips;
pub use pack_samples::{PackError, Split};
pub use packed_depth_pixel::{INVERSE_DEPTH_CODE_MAX, PackedDepthPixel, SplatIndexLayout};
pub use plane_set::PlaneSet;
pub use planes::{Plane, PlaneTile};
pub use validate::PackedError;
