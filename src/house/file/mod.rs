//! The `.house` file: a portal model with the backdrops behind its portals.
//!
//! Sections: `info` (JSON: a [`header::HouseHeader`], with a header per backdrop), the scene's
//! arrays as in memory (`positions` f64, `normals`, `texcoords` and `colors` f32, `triangles` u32,
//! four each: corners and material), `texels` (RGBA8, texture after texture), `sky` (f32, three per
//! texel) if the sky is an image, and a section per backdrop, `c` and its number: a cube's
//! environment, segments and plane textures, or textures.
//!
//! If vertices have them, there are also `emission_texcoords` and `opacities` (f32).
//!
//! Version 2 is for houses with plane textures, version 3 for houses with samplers other than the
//! default one, emission texture coordinates, opacities or single-sided materials; others are
//! written as version 1.

mod header;
mod read;
mod write;

pub use header::{HOUSE_FILE, HouseFileError};
pub use read::read;
pub use write::write;
