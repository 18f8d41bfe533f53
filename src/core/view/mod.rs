//! Interface between representations and their consumers.
//!
//! Each representation (cube LDI, sprites, lumigraph, house, view-dependent geometry) implements
//! [`View`] once, in its own crate. `headbox render`, the window, the report and the exports use it
//! through this trait and the [`Setting`]s that a view declares.

mod navigation;
pub mod paint;
mod report;
mod setting;

pub use navigation::{Navigation, Room, RoomMap, StartView, level_up};
pub use report::{
    Fact, Figure, FrameReport, FrameRequest, Ongoing, Refinement, Rendered, Stage, Swatch,
};
pub use setting::{Control, Setting, SettingError, SettingValue, SettingValues};

/// Statistics of a frame, as JSON.
pub use serde_json::Value as Statistics;

use crate::camera::Camera;
use crate::file_frame::FileFrame;
use crate::headbox::Headbox;
use crate::light_parameters::LightParameters;
use std::any::Any;

/// Scene in an image-based representation, ready to be rendered.
pub trait View: Any + Send {
    /// Name of the representation, for titles and messages: "cube LDI".
    fn kind(&self) -> &'static str;

    /// First view of the eye, for frames of `size_px` (width, height).
    fn start(&self, size_px: [u32; 2]) -> StartView;

    /// Default size of a frame: width and height in pixels.
    fn default_size_px(&self) -> [u32; 2] {
        [1024, 768]
    }

    /// Headbox from which the view is meant to be seen; `None` if nothing bounds the eye.
    fn headbox(&self) -> Option<Headbox> {
        None
    }

    /// Cameras of a film for which no path is given, `fps` a second: by default a loop of six
    /// seconds about `first` in the headbox. `None` if the view has no such path.
    fn film_path(&self, first: &Camera, fps: u32) -> Option<Vec<Camera>> {
        const SECONDS: usize = 6;
        self.headbox()?.camera_loop(first, SECONDS * fps as usize)
    }

    /// Navigation mode in a window.
    fn navigation(&self) -> Navigation {
        Navigation::Fly
    }

    /// Speed of the eye while a key is pressed, metres per second. By default half the size of the
    /// headbox per second, or walking speed.
    fn speed_m_per_s(&self) -> f64 {
        self.headbox()
            .map_or(1.4, |headbox| headbox.half_size_m.max(1e-3))
    }

    /// Axes and unit of the scene's file, in which cameras and paths are read and saved.
    fn file_frame(&self) -> FileFrame {
        FileFrame::default()
    }

    /// Floor plan, for views with rooms.
    fn plan(&self) -> Option<RoomMap> {
        None
    }

    /// Source scene of the view, if the file names it.
    fn origin(&self) -> Option<Origin> {
        None
    }

    /// Number of primitives of the view, and their name ("depth pixels").
    fn primitives(&self) -> (u64, &'static str);

    /// Bytes of memory that rendering needs.
    fn bytes(&self) -> u64;

    /// Settings, in the order of the window's panel. The same table gives the flags of
    /// `headbox render` and the controls of the window. By convention the choice with the flag
    /// "variant" selects the rendering method, and the one named [`OVERLAY`] what is painted
    /// instead of colours.
    fn settings(&self) -> Vec<Setting>;

    /// Renders a frame for the request's camera.
    ///
    /// # Errors
    /// A message: a setting that the view does not have, or a capture that failed.
    fn render(&mut self, request: &FrameRequest) -> Result<Rendered<'_>, String>;

    /// Computes the machine-readable statistics of the last frame.
    fn statistics(&mut self, _request: &FrameRequest) -> Statistics {
        Statistics::Null
    }

    /// Linear radiance of each stored 8-bit level, if the file specifies it.
    fn level_radiance(&self) -> Option<[f32; 256]> {
        None
    }
}

/// Source scene of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Origin {
    /// Name of the scene: a file, or `builtin:NAME`.
    pub scene: String,
    /// Axes and unit of its file.
    pub frame: FileFrame,
    /// Light that was specified for it.
    pub light: LightParameters,
    /// Headbox of the view.
    pub headbox: Headbox,
    /// True if it was lit; false if it shows albedo and emission.
    pub lit: bool,
}

/// Id of the choice of an overlay that replaces a frame's colours.
pub const OVERLAY: &str = "overlay";

/// Id of the exposure of a frame relative to its file, a number of stops.
pub const EXPOSURE: &str = "exposure";

/// Heading of the settings that only experts change; initially folded.
pub const RENDERING: &str = "Rendering";
