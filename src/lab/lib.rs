//! Measuring what headbox does: nothing of the product is in here, and nothing of the product needs
//! it.
//!
//! One harness, and three things built on it:
//!
//! * [`report`]: speed against error of every representation of a scene; the page beside the
//!   papers' figures.
//! * [`walk`]: times and errors of every way to draw a house along a path.
//! * [`stability`]: hard numerical cases with bounds.
//!
//! What they share: [`plan`] (sizes, seeded eyes), [`turns`] (times taken in turns), [`truths`]
//! (ray-traced frames, kept from run to run), [`stats`], [`table`] and [`chart`] (what people
//! read), [`machine`] (where and by which commit). [`cube_map`] is the rival that every panorama
//! viewer is, [`embree`] that of a frame; [`sprite_range`] says how far sprites carry. [`images`]
//! and [`photographs`] leave views out of sets; [`held_out`] is what they share. [`baselines`] has
//! methods of the papers that lost to the product.

pub mod baselines;
pub mod chart;
pub mod cube_map;

pub mod embree;
pub mod held_out;
pub mod images;
pub mod machine;
pub mod photographs;
pub mod plan;
pub mod report;
pub mod sequence;
pub mod sprite_range;
pub mod stability;
pub mod stats;
pub mod table;
pub mod truths;
pub mod turns;
pub mod walk;
