//! Scene files: OBJ, real files and mutated ones.

mod load_mutated;
mod load_obj;
mod load_real;
mod obj_materials;
mod obj_names;
