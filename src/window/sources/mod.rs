//! Frame sources: what the window shows that is more than a view of a file.

mod cube;
mod house;
pub(crate) mod library;
mod live;
mod photographs;
mod points;
mod progressive_capture;
pub(crate) mod view;
