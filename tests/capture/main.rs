//! Promises of loading, tracing, light and portal models, one file each.

mod bake;
mod folder;
mod gltf_asset;
mod home_details;
mod homes;
mod images;
mod light;
mod load_apartment;
mod load_gltf;
mod load_gltf_compressed;
mod load_gltf_extensions;
mod load_gltf_materials;
mod load_gltf_siblings;
mod load_home;
mod load_mutated;
mod load_obj;
mod load_real;
mod load_toml_model;
mod open_plan;
mod portal_model;
mod trace;
mod trace_edge_cases;
mod trace_oracle;
