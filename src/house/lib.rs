//! Walking portal models: geometry for the cell that the eye is in and for near cells, images
//! behind the other portals (R1 to R3, R5 to R9, R11, R12, R14 to R16, P1, P2).
//!
//! * [`cull`]: which cells show, and through which part of the frame (R1).
//! * [`house`]: a portal model made ready for the rasteriser and the tracer.
//! * [`opening`]: a portal as it is seen from one of its cells.
//! * [`backdrop`]: what stands in for everything behind a portal: textures, warped images, layered
//!   depth images.
//! * [`file`](mod@file): the `.house` file, a model with its captures.
//! * [`store`]: backdrops in memory, built in the background.
//! * [`make`]: makes a house from a model: light, backdrops.
//! * [`visit`]: which cells a frame draws as geometry, and where backdrops begin.
//! * [`walk`]: a frame of all of this; [`variant`]: the ways to draw it; [`tour`]: with backdrops
//!   built ahead of need.
//! * [`walk_path`]: a walk through every room.
//! * [`floor_plan`]: the model drawn from above.

pub mod backdrop;
pub mod cull;
pub mod file;
pub mod floor_plan;
pub mod house;
pub mod make;
pub mod opening;
pub mod settings;
pub mod store;
pub mod tour;
pub mod variant;
pub mod view;
pub mod visit;
pub mod walk;
pub mod walk_path;
