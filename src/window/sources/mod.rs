//! Frame sources: one for each kind of file that the window shows.

mod cube;
mod geometry;
mod house;
pub(crate) mod library;
mod live;
mod lumigraph;
mod photographs;
mod points;
pub(crate) mod progressive_capture;
pub(crate) mod reference;
mod sprite;
