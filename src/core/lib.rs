//! Shared types of headbox: camera, frame, colour, environment, file container, metrics, progress.
//!
//! # Conventions
//!
//! Stated once, here; every other file of the workspace follows them.
//!
//! * **World**: right-handed, metres, Y up. Positions are `f64` until the tracer subtracts its
//!   origin (the centre of the headbox) and goes to `f32`: large offsets in a file cost nothing.
//! * **Eye space**: X right, Y up, looking down -Z, as in glTF, Seurat and nerfstudio.
//! * **Pixels**: row 0 on top; the centre of pixel (i, j) lies at (i + 0.5, j + 0.5).
//! * **Matrices** are named `target_from_reference` and multiply column vectors.
//! * **Depth** is never a bare `z` or `d` in a public name: `eye_depth` is the distance along the
//!   viewing axis (Z in the papers), `inverse_depth` is 1/Z, `ray_distance` is Euclidean.
//!   [`depth_kind::DepthKind`] names them as a type.
//! * **Colour**: shading is linear `f32`; stored samples are 8-bit sRGB with straight alpha.
//! * **Determinism**: the same input and seed give the same bytes on any number of threads and at
//!   every SIMD level.
//!
//! A known point that pins all of the above (also a test of [`camera::Camera`]): a 4x2 camera at
//! the origin looking down -Z with 90 degrees of vertical view sees the world point (1, 0.5, -1) at
//! x = 3, y = 0.5, with eye depth 1.
//!
//! ```
//! use glam::{DVec3, dvec3};
//! use headbox_core::camera::Camera;
//!
//! let camera = Camera::look_at(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), DVec3::Y, 90.0, [4, 2]).unwrap();
//! let [x, y, eye_depth] = camera.project(dvec3(1.0, 0.5, -1.0)).unwrap();
//! assert!((x - 3.0).abs() < 1e-12 && (y - 0.5).abs() < 1e-12 && (eye_depth - 1.0).abs() < 1e-12);
//! ```

pub mod bounces;
pub mod color;
pub mod container;
pub mod drawing;
pub mod environment;
pub mod files;
pub mod frame;
mod geometry;
pub mod image;
pub mod inputs;
pub mod light_parameters;
pub mod lru;
pub mod metrics;
pub mod named_variants;
mod process;
pub mod random;
pub mod read_note;
pub mod statistics;
pub mod view;

pub use geometry::{camera, cube_face, depth_kind, file_frame, headbox};
pub use process::{memory, panics, progress, simd, stopwatch, task};
