//! The render-time LDI: 8 bytes a depth pixel in one linear array, addressed by scanline offsets and in-row counts.

pub mod layout;

pub use layout::{PackedCube, PackedDepthPixel, PackedSegment, SegmentSide, SplatIndexLayout};
