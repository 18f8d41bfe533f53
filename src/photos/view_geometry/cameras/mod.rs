//! The cameras of a set: their samples of depth, their textures, and the stores of both.

pub(crate) mod lattice;
pub(crate) mod picture;
pub(crate) mod sample_cache;
pub(crate) mod samples;
pub(crate) mod store;
mod texture_lanes;
