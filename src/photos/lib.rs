//! Photographs as input: view-dependent geometry of image sets with depth, voxel colouring of image
//! sets without, and a cache of results about image sets.

pub mod cache;
pub mod view_geometry;
pub mod voxel_colouring;
