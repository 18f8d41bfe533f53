//! Images in memory: decoding and encoding, channels of EXR by name, chunks of PNG, EXIF
//! orientation, mip pyramids, bilinear samples, and the pixels that a triangle covers.

pub mod codec;
pub mod exr_channels;
mod ktx2;
pub mod mip;
pub mod orientation;
pub mod png_chunks;
pub mod texels;
pub mod triangle_scan;
