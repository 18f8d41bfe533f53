//! Measurements of headbox, separate from the product: no other part depends on them.
//!
//! Three kinds of measurement:
//!
//! * [`report`]: speed against error of every representation of a scene, and the page with the
//!   papers' figures.
//! * [`walk`]: times and errors of every variant of a house along a path.
//! * [`stability`]: hard numerical cases with bounds.
//!
//! Common parts: [`plan`] (sizes, seeded eyes), [`turns`] (timing in turns), [`truths`] (cached
//! ray-traced frames), [`stats`], [`table`] and [`chart`], [`machine`] (machine and commit).
//! Baselines: [`cube_map`] (panoramas), [`embree`] (primary rays), [`baselines`] (methods of the
//! papers that the product does not use). [`sprite_range`] measures the range of sprites.
//! [`images`], [`photographs`] and [`sequence`] are leave-one-out tests of image sets, with
//! [`held_out`] in common.

pub mod baselines;
pub mod chart;
pub mod cube_map;

pub mod embree;
mod leave_one_out;
pub mod machine;
pub mod plan;
pub mod report;
pub mod sprite_range;
pub mod stability;
pub mod stats;
pub mod table;
pub mod truths;
pub mod turns;
pub mod walk;

pub use leave_one_out::{held_out, images, photographs, sequence};
