//! Walks through portal models: geometry for the eye's cell and for near cells, images behind the
//! other portals (R1 to R3, R5 to R9, R11, R12, R14 to R16, P1, P2).
//!
//! * [`portal_culling`]: portal culling: visible cells, and the part of the frame that each covers (R1).
//! * [`house`]: a portal model prepared for the rasteriser and the tracer.
//! * [`portal_opening`]: a portal as seen from one of its cells.
//! * [`backdrop`]: representations of everything behind a portal: textures, warped images, layered
//!   depth images.
//! * [`file`](mod@file): the `.house` file, a model with its backdrops.
//! * [`store`]: backdrops in memory, built in the background.
//! * [`make`]: creates a house from a model: light, backdrops.
//! * [`visit`]: the cells that a frame draws as geometry, and the portals where backdrops begin.
//! * [`walk`]: rendering of a frame; [`variant`]: named settings; [`tour`]: a walk with backdrops
//!   built in advance.
//! * [`walk_path`]: a camera path through every room.
//! * [`floor_plan`]: the model drawn from above.

pub mod backdrop;
pub mod file;
pub mod floor_plan;
pub mod house;
pub mod make;
pub mod portal_culling;
pub mod portal_opening;
pub mod store;
pub mod view;
mod walks;

pub use walks::{settings, tour, variant, visit, walk, walk_path};
