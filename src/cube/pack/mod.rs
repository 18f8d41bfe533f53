//! The render-time LDI: 8 bytes a depth pixel in one linear array, addressed by scanline offsets
//! and in-row counts.

pub mod blocks;
mod depth_pixel;
pub mod file;
pub mod layout;
pub mod pack_samples;
pub(crate) mod plane_textures;
pub(crate) mod runs;
#[cfg(test)]
pub(crate) mod tests;
pub mod validate;

pub use blocks::BlockIndex;
pub use decode::DecodedDepthPixel;
pub use depth_pixel::{decode, exact, packed_depth_pixel, splat_index};
pub use exact::{UnquantisedCube, UnquantisedDepthPixel};
pub use layout::{CubeLdi, PackedSegment, SegmentSide};
pub use pack_samples::{PackError, Split};
pub use packed_depth_pixel::{INVERSE_DEPTH_CODE_MAX, PackedDepthPixel, SplatIndexLayout};
pub use plane_set::PlaneSet;
pub use plane_textures::mips::LazyMips;
pub use plane_textures::{plane_set, planes};
pub use planes::{Plane, PlaneTile};
pub use validate::PackedError;
