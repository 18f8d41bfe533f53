//! Capture: builds cube LDIs from scenes, from image sets with depth, and from deep EXR.
//!
//! A capture of a scene, in the order of work:
//!
//! 1. [`rays`]: rays from the faces of the headbox; a pilot round decides where the others go.
//! 2. [`accumulate`]: hits become accumulators, one for each surface in a depth bin of a pixel. Shards end here.
//! 3. [`surfaces`]: accumulators become unlit surface samples.
//! 4. [`refine`]: test frames show where samples are missing, and rays are aimed there.
//! 5. [`light`]: surface samples are lit, and light is pooled over surfaces.
//! 6. [`merge`]: surface samples of similar depth become depth pixels with coverage; pinholes are repaired.
//!
//! [`job`] describes a capture; [`refine::capture`] runs one.

pub mod accumulate;
pub mod face_size;
pub mod from_deep;
pub mod from_images;
pub mod job;
mod light;
mod merge;
pub mod rays;
pub mod refine;
pub mod scene_source;
pub mod settings;
mod surfaces;
