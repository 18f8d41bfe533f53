//! Images in memory: decoding and encoding, mip pyramids, bilinear samples, and the pixels that a
//! triangle covers.

pub mod codec;
mod ktx2;
pub mod mip;
pub mod texels;
pub mod triangle_scan;
