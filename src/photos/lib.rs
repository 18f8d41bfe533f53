//! Photographs as input: view-dependent geometry of image sets with depth, voxel colouring of image
//! sets without, and the cache of what was computed about a set.

pub mod cache;
pub mod view_geometry;
pub mod voxel_colouring;
