//! Promises of loading, tracing, light and portal models, one file each.

mod folder;
mod gltf;
mod images;
mod light;
mod models;
mod scenes;
mod trace;
