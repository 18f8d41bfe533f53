//! Frame sources of the window: views of files, and captures that run in the background.

mod cube;
mod house;
pub(crate) mod library;
mod live;
mod photographs;
mod preview;
pub(crate) mod progressive_capture;
mod sun_settings;
#[cfg(test)]
mod tests;
pub(crate) mod view;
