//! The sprite with depth: its plane, texture and displacements, and the `.sprite` file.

pub(crate) mod displacement;
pub(crate) mod file;
pub(crate) mod image_files;
pub(crate) mod plane;
pub(crate) mod set;
pub(crate) mod shift;
pub(crate) mod texture;
