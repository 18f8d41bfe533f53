//! The window of headbox: shows anything that turns a camera into a frame.
//!
//! The window does not depend on layered depth images. It shows a [`FrameSource`]: camera in, frame
//! and statistics out, its own settings as data. The source lives on a render thread that renders
//! the newest camera; the window shows the latest finished frame and never waits.
//!
//! | module | content |
//! |---|---|
//! | `source` | the frame source and the library: traits that other crates implement |
//! | `input` | keys and commands; pose, motion and bounds of the eye; the viewport that shows the frame |
//! | `playback` | camera paths, exported files, scripted runs |
//! | `thread` | the render thread, its queue and its loop; dynamic resolution |
//! | `panels` | the panels around the frame, a file each |
//! | `window` | state of the window, its passes, layout and options |
//!
//! Everything but `window::desktop` runs without a display, and is tested so.
//!
//! ```no_run
//! use headbox_viewer::{FrameReport, FrameRequest, FrameSource, Pose, Setting, ViewerOptions, run};
//! use glam::DVec3;
//!
//! /// Shows the viewing direction as a colour.
//! struct Directions;
//!
//! impl FrameSource for Directions {
//!     fn title(&self) -> String {
//!         "Directions".into()
//!     }
//!
//!     fn start_pose(&self) -> Pose {
//!         Pose::looking_at(DVec3::ZERO, DVec3::NEG_Z, 60.0)
//!     }
//!
//!     fn settings(&self) -> Vec<Setting> {
//!         vec![Setting::number("gain", "Gain", "Factor on the colours (no unit).", 1.0, 0.0..=4.0, "")]
//!     }
//!
//!     fn render(&mut self, request: &FrameRequest, pixels: &mut [[u8; 4]]) -> Result<FrameReport, String> {
//!         let gain = request.settings.number("gain")?;
//!         for (i, pixel) in pixels.iter_mut().enumerate() {
//!             let (x, y) = (i as u32 % request.camera.width(), i as u32 / request.camera.width());
//!             let ray = request.camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5).normalize();
//!             let [r, g, b] = ((ray * 0.5 + 0.5) * 255.0 * gain).to_array().map(|c| c as u8);
//!             *pixel = [r, g, b, 255];
//!         }
//!         Ok(FrameReport::default())
//!     }
//! }
//!
//! run(Some(Box::new(Directions)), ViewerOptions::default())?;
//! # Ok::<(), headbox_viewer::ViewerError>(())
//! ```

// The tests include the example's frame source, which refers to this crate by its name.
#[cfg(test)]
extern crate self as headbox_viewer;

mod input;
mod panels;
mod playback;
mod source;
#[cfg(test)]
mod tests;
mod thread;
mod window;

pub use crate::input::bounds::EyeBounds;
pub use crate::input::pose::Pose;
pub use crate::playback::eye_path::{CameraPath, PathError, TimedPose};
pub use crate::playback::path_recorder::ReplayMode;
pub use crate::window::desktop::run;
pub use crate::window::options::{Exit, Summary, ViewerError, ViewerOptions};
pub use crate::window::views::Stereo;
pub use headbox_core::view::{
    Control, Fact, Figure, FrameReport, FrameRequest, Navigation, Ongoing, Refinement, Room,
    RoomMap, Setting, SettingError, SettingValue, SettingValues, Stage, Swatch,
};
pub use source::{
    Entry, FrameSource, HeadboxRequest, Headboxes, Library, PendingSource, Thumbnail,
};
