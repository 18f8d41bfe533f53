//! `headbox`: image-based rendering with depth. A scene is ray-traced once into cube layered depth images (LDIs) and
//! then shown from anywhere inside a *headbox*, on a CPU, at a frame rate that does not depend on its geometry.
//!
//! The stages, in the order in which data flows: [`capture`] (scenes, light, rays) -> [`ldi`] (the build-time cube
//! LDI) -> [`packed`] (its 8-byte render-time form) -> [`render`] (samples to pixels) -> [`metrics`];
//! beside them [`sprite`], sprites with depth, and [`compose`], both in one frame.
//! Conventions (axes, pixels, depth, colour) are stated once, in [`capture`].

pub use headbox_capture as capture;
pub use headbox_capture::path;
pub use headbox_scenes as scenes;

pub mod cli;
pub mod compose;
pub mod container;
pub mod environment;
pub mod frame;
pub mod ldi;
pub mod metrics;
pub mod packed;
pub mod portal;
pub mod raster;
pub mod render;
pub mod report;
pub mod scene_source;
pub mod sprite;
pub mod truth;
#[cfg(feature = "viewer")]
pub mod view;
