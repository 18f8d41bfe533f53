//! Promises of the cube LDI: packing, plane textures, the warp.

mod export_budget;
mod packed_ldi;
mod plane_frames;
mod primitives;
mod splat_quality;
mod version_1;
mod warp;
