//! The window of headbox: shows anything that turns a camera into a frame.
pub mod bounds;
pub mod camera_file;
pub mod export;
pub mod history;
pub mod motion;
pub mod path;
pub mod pose;
pub mod resolution;
pub mod setting;
pub mod slot;
pub mod source;
pub mod views;
pub use source::*;
