//! Options of the window, and the summary of a run.

use crate::input::pose::Pose;
use crate::playback::tape::ReplayMode;
use crate::source::{Library, PendingSource};
use crate::window::views::Stereo;
use serde::Serialize;
use std::{path::PathBuf, time::Instant};

/// Start options of the window and, for scripts, end conditions.
pub struct ViewerOptions {
    /// When the program was started, for the time to the first image.
    pub started: Instant,
    /// Files that the window can open; without it, the window shows its one source only.
    pub library: Option<Box<dyn Library>>,
    /// Source that is being opened elsewhere, if no source is given.
    pub coming: Option<PendingSource>,
    /// The file that is shown at first, if it is one: told among those opened last.
    pub file: Option<PathBuf>,
    /// File of the list of recent files, if it is kept.
    pub recent_file: Option<PathBuf>,
    /// Size of the window's inside, points.
    pub window_size_points: [f32; 2],
    /// True to show the side panel and the status line at first.
    pub panels: bool,
    /// Start pose, instead of the source's.
    pub pose: Option<Pose>,
    /// Settings that differ from the source's initial ones: (id, text), as
    /// [`SettingValues::set_text`] reads them.
    ///
    /// [`SettingValues::set_text`]: crate::SettingValues::set_text
    pub settings: Vec<(String, String)>,
    /// Shows A (`settings`) and B (`settings` and then these) side by side at first.
    pub compare: Option<Vec<(String, String)>>,
    /// One eye or two at first.
    pub stereo: Stereo,
    /// The longest that a frame should take while the eye moves, ms, or else it is rendered with
    /// fewer pixels at first; none: always with all pixels.
    pub moving_limit_ms: Option<f64>,
    /// A path file that is replayed at once.
    pub path: Option<PathBuf>,
    /// Initial replay mode.
    pub replay: ReplayMode,
    /// Folder for saved frames, cameras and paths.
    pub output_dir: PathBuf,
    /// A picture of the whole window, taken (as a PNG file) just before the scripted end.
    pub screenshot: Option<PathBuf>,
    /// When the window closes by itself.
    pub exit: Exit,
}

impl ViewerOptions {
    /// 60 frames a second.
    pub const MOVING_LIMIT_MS: f64 = 16.0;
}

impl Default for ViewerOptions {
    fn default() -> Self {
        Self {
            started: Instant::now(),
            library: None,
            coming: None,
            file: None,
            recent_file: None,
            window_size_points: [1280.0, 800.0],
            panels: true,
            pose: None,
            settings: Vec::new(),
            compare: None,
            stereo: Stereo::Off,
            moving_limit_ms: Some(ViewerOptions::MOVING_LIMIT_MS),
            path: None,
            replay: ReplayMode::InTime,
            output_dir: PathBuf::from("."),
            screenshot: None,
            exit: Exit::Never,
        }
    }
}

/// When a window that is run by a script closes. In such a window any error ends the run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exit {
    /// When a person closes it.
    #[default]
    Never,
    /// After this many frames were shown; frames follow each other as fast as they can.
    AfterFrames(u64),
    /// When the replay of the path has ended.
    AfterPath,
    /// When the view cannot become better ([`Refinement::Done`](crate::Refinement::Done)): a
    /// capture or an error map is complete.
    WhenRefined,
    /// When every entry of the start page has its picture.
    AfterThumbnails,
}

/// Measurements of a run of the window.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// From [`ViewerOptions::started`] to the first picture of the window handed to the display,
    /// whatever it shows, seconds.
    pub window_s: Option<f64>,
    /// From [`ViewerOptions::started`] to the first frame handed to the display, seconds.
    pub first_image_s: Option<f64>,
    /// Frames of the source shown.
    pub frames_shown: u64,
    /// Frames shown per second, between the first and the last.
    pub shown_per_s: f64,
    /// Median time to render a frame, over the last frames, ms.
    pub render_ms_median: f64,
    /// Median time from the wish for a view to its hand-over to the display, over the last frames,
    /// ms.
    pub latency_ms_median: f64,
    /// Median time of one pass of the window (input, panels, upload, drawing), over the last
    /// passes, ms.
    pub pass_ms_median: f64,
    /// Size of the last frame, pixels.
    pub frame_size_px: [u32; 2],
    /// Mean share of each side of the frame that was rendered: 1 if pixels were never saved.
    pub scale_mean: f64,
}

/// Why the window could not do its work.
#[derive(Debug, thiserror::Error)]
pub enum ViewerError {
    /// There is no display to open a window on.
    #[error("there is no display to open a window on ({0}); the other commands work without one")]
    NoDisplay(String),
    /// There is a display, but it cannot draw.
    #[error("cannot open a window: {0}")]
    Window(String),
    /// Neither a source nor a library was given.
    #[error("there is nothing to show: neither a view nor anything to open")]
    NothingToShow,
    /// [`Exit::AfterPath`] without [`ViewerOptions::path`].
    #[error("the window is to close after its path, but there is no path")]
    NoPath,
    /// The render thread could not be started.
    #[error("cannot start the render thread: {0}")]
    Thread(std::io::Error),
    /// In a scripted run, something went wrong that a person would have read as a message.
    #[error("{0}")]
    Scripted(String),
}
