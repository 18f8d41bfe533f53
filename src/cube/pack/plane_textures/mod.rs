//! Plane textures: tiles (`planes`), all of a cube (`plane_set`), and their mip levels (`mips`).

pub(crate) mod mips;
pub mod plane_set;
pub mod planes;
