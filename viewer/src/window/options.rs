//! Options of the window, and the summary of a run.

use crate::input::pose::Pose;
use crate::playback::path_recorder::ReplayMode;
use crate::source::{Library, PendingSource};
use crate::window::views::Stereo;
use serde::Serialize;
use std::{path::PathBuf, time::Instant};

/// Start options of the window and, for scripts, end conditions.
pub struct ViewerOptions {
    /// Start of the program, for the time to the first image.
    pub started: Instant,
    /// Files that the window can open; without it, the window shows its one source only.
    pub library: Option<Box<dyn Library>>,
    /// Source that another thread is opening, if no source is given.
    pub coming: Option<PendingSource>,
    /// File of the first source, if it has one; becomes a recent file.
    pub file: Option<PathBuf>,
    /// File that stores the list of recent files; `None`: not stored.
    pub recent_file: Option<PathBuf>,
    /// Name of the first source for its bookmarks, such as its absolute path; `None`: they are not
    /// stored.
    pub name: Option<String>,
    /// Folder that stores bookmarks; `None`: not stored.
    pub bookmark_dir: Option<PathBuf>,
    /// Folder that caches thumbnails; `None`: not cached.
    pub thumbnail_dir: Option<PathBuf>,
    /// Inner size of the window, points.
    pub window_size_points: [f32; 2],
    /// True to show the side panel and the status line initially.
    pub panels: bool,
    /// Start pose, instead of the source's.
    pub pose: Option<Pose>,
    /// Settings that differ from the source's initial ones: (id, text), as
    /// [`SettingValues::set_text`] reads them.
    ///
    /// [`SettingValues::set_text`]: crate::SettingValues::set_text
    pub settings: Vec<(String, String)>,
    /// Changes of B relative to A (`settings`), which are initially shown side by side; `None`: no
    /// comparison.
    pub compare: Option<Vec<(String, String)>>,
    /// Initial stereo mode.
    pub stereo: Stereo,
    /// Time limit of a frame while the eye moves, ms: slower frames are initially rendered with
    /// fewer pixels. `None`: always all pixels.
    pub moving_limit_ms: Option<f64>,
    /// Path file that is replayed at once.
    pub path: Option<PathBuf>,
    /// Initial replay mode.
    pub replay: ReplayMode,
    /// Folder that is proposed for saved frames, cameras and paths.
    pub output_dir: PathBuf,
    /// PNG file for a screenshot of the whole window, taken just before the scripted end.
    pub screenshot: Option<PathBuf>,
    /// End condition of a scripted run.
    pub exit: Exit,
}

impl ViewerOptions {
    /// Default of [`Self::moving_limit_ms`]: 60 frames per second.
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
            name: None,
            bookmark_dir: None,
            thumbnail_dir: None,
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

/// End condition of a scripted run. Any error ends such a run, too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exit {
    /// The user closes the window; not a scripted run.
    #[default]
    Never,
    /// This number of frames was shown; frames are rendered without pause.
    AfterFrames(u64),
    /// The replay of the path has ended.
    AfterPath,
    /// The view cannot improve ([`Refinement::Done`](crate::Refinement::Done)): a capture or an
    /// error map is complete.
    WhenRefined,
    /// Every entry of the start page has its thumbnail.
    AfterThumbnails,
}

/// Measurements of a run of the window.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Time from [`ViewerOptions::started`] to the first pass of the window on the display, with or
    /// without a frame, seconds.
    pub window_s: Option<f64>,
    /// Time from [`ViewerOptions::started`] to the first frame on the display, seconds.
    pub first_image_s: Option<f64>,
    /// Number of the source's frames that were shown.
    pub frames_shown: u64,
    /// Frames shown per second, between the first and the last.
    pub shown_per_s: f64,
    /// Median time to render a frame, over the last frames, ms.
    pub render_ms_median: f64,
    /// Median time from the request of a view to its display, over the last frames, ms.
    pub latency_ms_median: f64,
    /// Median time of one pass of the window (input, panels, upload, drawing), over the last
    /// passes, ms.
    pub pass_ms_median: f64,
    /// Size of the last frame, pixels.
    pub frame_size_px: [u32; 2],
    /// Mean scale of the rendered frames per side: 1 if all had full resolution.
    pub scale_mean: f64,
}

/// Errors of [`run`](crate::run).
#[derive(Debug, thiserror::Error)]
pub enum ViewerError {
    /// There is no display to open a window on.
    #[error("there is no display to open a window on ({0})")]
    NoDisplay(String),
    /// The display offers no OpenGL, as some remote desktops do.
    #[error("this display has no OpenGL to draw with, as on some remote desktops ({0})")]
    NoOpenGl(String),
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
    /// A scripted run met an error that an interactive window would have shown as a message.
    #[error("{0}")]
    Scripted(String),
}
