//! Scene files as glTF: clean, damaged, compressed and extended.

mod gltf_asset;
mod load_gltf;
mod load_gltf_compressed;
mod load_gltf_extensions;
mod load_gltf_materials;
mod load_gltf_siblings;
