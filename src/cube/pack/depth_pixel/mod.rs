//! Depth pixels: their bits (`packed_depth_pixel`, `splat_index`), decoding, and unquantised ones
//! (`exact`).

pub mod decode;
pub mod exact;
pub mod packed_depth_pixel;
pub mod splat_index;
