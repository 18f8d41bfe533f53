//! Cube layered depth images (LDIs): six faces of depth pixels about one centre, and the
//! environment behind them.
//!
//! In the order of work: [`model`] (the output of a capture: samples and header), [`planes`]
//! (planar samples become plane textures), [`pack`] (8 bytes a depth pixel, and the `.ldi` file),
//! [`render`] (from a packed cube and a camera to a frame), [`view`] (settings and overlays of the
//! representation).

pub mod model;
pub mod pack;
pub mod planes;
pub mod render;
pub mod view;
