//! What `headbox-capture` promises, one file a promise.

mod bake;
mod folder;
mod images;
mod light;
mod load_gltf;
mod load_model;
mod load_mutated;
mod load_obj;
mod load_real;
mod open_plan;
mod portal_model;
mod trace;
mod trace_edge_cases;
mod trace_oracle;
