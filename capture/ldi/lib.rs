//! Capture: builds cube LDIs from scenes, from image sets with depth, and from deep EXR.
//!
//! [`spec`] specifies what to capture and how to run; [`capture`] runs these stages:
//!
//! 1. [`rays`]: rays from the faces of the headbox; a pilot round decides where the others go.
//! 2. [`accumulate`]: hits become accumulators, one for each surface in a depth bin of a pixel.
//!    Shards end here.
//! 3. [`surfaces`]: accumulators become unlit surface samples; pinholes are repaired.
//! 4. [`refine`]: test views show where samples are missing, and rays are aimed there.
//! 5. [`light`]: surface samples are lit, and light is pooled over surfaces.
//! 6. [`merge`]: surface samples of similar depth become depth pixels with coverage.
//!
//! A sample on its way: [`Sample`](accumulate::accumulator::Sample) (a hit),
//! [`Accumulator`](accumulate::accumulator::Accumulator),
//! [`SurfaceSample`](light::shade::SurfaceSample),
//! [`DepthPixel`](headbox_cube::model::samples::DepthPixel), and when the cube is packed,
//! [`PackedDepthPixel`](headbox_cube::pack::PackedDepthPixel).
//!
//! Before it: [`scene_source`] opens scenes by name, [`face_size`] chooses the faces' resolution.
//! Other sources: [`from_images`] warps depth images into a cube, [`from_deep`] reads deep EXR.

pub mod accumulate;
pub mod capture;
pub mod face_size;
pub mod from_deep;
pub mod from_images;
mod light;
mod merge;
pub mod rays;
mod refine;
pub mod scene_source;
pub mod spec;
mod surfaces;
