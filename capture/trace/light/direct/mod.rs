//! Direct light: the sun and lamps (`sharp`), sky images (`sky`), and emissive triangles
//! (`emitters`), of which a `light_tree` samples one.

pub(super) mod emitters;
pub(super) mod light_tree;
pub(super) mod sharp;
mod sky;
