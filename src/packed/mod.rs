//! The render-time LDI: 8 bytes a depth pixel in one linear array, addressed by scanline offsets and in-row counts.

pub mod decode;
pub mod encode;
pub mod layout;
pub mod splat_index;
pub mod validate;

pub use decode::DecodedDepthPixel;
pub use encode::{PackError, Split};
pub use layout::{PackedCube, PackedDepthPixel, PackedSegment, SegmentSide, SplatIndexLayout};
pub use validate::PackedError;
