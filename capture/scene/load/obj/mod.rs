//! OBJ files, with their MTL files.
//!
//! `tobj` parses positions (in `f64`, so that coordinates of 1e7 stay exact), merges corners and
//! splits by material; [`obj_prepare`] removes defects before, [`mtl`] reads materials,
//! [`super::polygon`] triangulates.
//!
//! The format leaves open:
//! * `Kd` is linear, vertex colours are sRGB, as most programs write them. In a file whose first
//!   comments name Sweet Home 3D, `Kd` is sRGB: that program writes colours as it shows them.
//! * A `Kd` of 0 with a `map_Kd` counts as absent. An absent `Kd` is white with vertex colours or a
//!   texture, else grey.
//! * Nothing is emitted if a `map_Ke` cannot be read.
//! * A `Ka` with a component above 1 is emitted radiance, as in the common file of the Cornell box,
//!   unless there is a `Ke`.
//! * Triangles with an opacity (`d`, `Tr`) of at most one half and no map of it are left out,
//!   because diffuse scenes have no clear glass; others are opaque. Panes of Sweet Home 3D have one
//!   half.

pub mod material_names;
pub mod mtl;
mod obj_file;
mod obj_materials;
mod obj_prepare;

pub(crate) use obj_file::load;
pub use obj_file::load_text;
pub(crate) use obj_materials::CUTOUT_THRESHOLD;
pub use obj_materials::EmbeddedImages;
