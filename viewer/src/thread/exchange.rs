//! Messages between the window and its render thread.

use crate::input::bounds::EyeBounds;
use crate::input::pose::Pose;
use crate::playback::eye_path::CameraPath;
use crate::source::{Entry, FrameSource, Thumbnail};
use crate::thread::slot::{Inbox, Slot};
use egui::{Color32, ColorImage};
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::view::{FrameReport, Navigation, RoomMap};
use headbox_core::view::{Setting, SettingValues};
use std::{
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
    time::Instant,
};

/// File or entry to open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Location {
    /// An entry of the start page, by id.
    Entry(String),
    /// A file.
    File(PathBuf),
}

/// Work that is never skipped.
pub(crate) enum Order {
    /// Replace the source.
    Open(Location),
    /// Let go of the source.
    Close,
    /// Press a button of the source's panel.
    Act(&'static str),
    /// Render a path to PNG files.
    Export(ExportOrder),
    /// Leave the rest of the running export.
    CancelExport,
}

/// A path to be written as frames.
pub(crate) struct ExportOrder {
    pub path: CameraPath,
    pub size: [u32; 2],
    pub settings: Arc<SettingValues>,
    pub dir: PathBuf,
}

/// A view to render: for each camera, one picture per setting set.
#[derive(Clone, Debug)]
pub(crate) struct Job {
    /// Source for which it was meant.
    pub source_id: u64,
    /// Number of the job, counted by the window.
    pub number: u64,
    /// From left to right on the screen.
    pub cameras: Vec<Camera>,
    /// A, or A and B.
    pub sets: Vec<Arc<SettingValues>>,
    pub moving: bool,
    /// Share of each side of the frame that is rendered.
    pub scale: f64,
    /// When the window first wished for this view.
    pub issued: Instant,
    /// Number of times it was rendered before (for a source that converges).
    pub round: u32,
    /// Index of the replayed pose, if every pose is to be shown.
    pub replayed: Option<usize>,
}

/// One rendered picture with what the source said about it.
#[derive(Clone)]
pub(crate) struct Picture {
    pub image: Arc<ColorImage>,
    pub report: FrameReport,
}

/// A finished frame; pictures in the order cameras x sets.
pub(crate) struct FinishedFrame {
    pub job: Job,
    pub pictures: Vec<Picture>,
    pub render_ms: f64,
}

/// Description of a source, sent when it is opened.
#[derive(Clone, Debug)]
pub(crate) struct SourceInfo {
    pub id: u64,
    pub title: String,
    pub start_pose: Pose,
    pub bounds: Option<EyeBounds>,
    pub navigation: Navigation,
    pub speed_m_per_s: f64,
    pub plan: Option<RoomMap>,
    pub file_frame: FileFrame,
    pub settings: Vec<Setting>,
    pub notes: Vec<String>,
    pub terms: &'static [(&'static str, &'static str)],
}

impl SourceInfo {
    /// The sentence behind a term.
    pub(crate) fn term(&self, name: &str) -> Option<&'static str> {
        self.terms
            .iter()
            .find(|(term, _)| *term == name)
            .map(|(_, sentence)| *sentence)
    }

    pub(crate) fn of(source: &dyn FrameSource, id: u64) -> Self {
        Self {
            id,
            title: source.title(),
            start_pose: source.start_pose(),
            bounds: source.bounds(),
            navigation: source.navigation(),
            speed_m_per_s: source.speed_m_per_s(),
            plan: source.plan(),
            file_frame: source.file_frame(),
            settings: source.settings(),
            notes: source.notes(),
            terms: source.terms(),
        }
    }
}

/// News from the thread.
pub(crate) enum Event {
    /// A source is ready.
    Opened(Box<SourceInfo>),
    /// Opening failed; what was shown before stays.
    OpenFailed(String),
    /// The source broke down and is gone.
    Lost(String),
    /// Something did not work.
    Error(String),
    /// Something was done.
    Done(String),
    /// Entries of the start page, and the extensions of files that can be opened.
    Offers {
        entries: Vec<Entry>,
        extensions: Vec<String>,
    },
    /// The picture of an entry.
    Thumbnail { id: String, thumbnail: Thumbnail },
    /// Frames written by the running export, `None` when it has ended.
    Exported(Option<[usize; 2]>),
}

/// State shared by both sides.
#[derive(Default)]
pub(crate) struct Shared {
    pub inbox: Inbox<Order, Job>,
    pub finished: Slot<FinishedFrame>,
    pool: Mutex<Vec<Vec<Color32>>>,
}

impl Shared {
    /// A pixel buffer of `len` pixels, a used one if there is one.
    pub(crate) fn buffer(&self, len: usize) -> Vec<Color32> {
        let used = self
            .pool
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop();
        let mut buffer = used.unwrap_or_default();
        buffer.resize(len, Color32::TRANSPARENT);
        buffer
    }

    /// Gives the buffers of pictures that nobody else holds back to the renderer.
    pub(crate) fn recycle(&self, pictures: impl IntoIterator<Item = Picture>) {
        let buffers = pictures
            .into_iter()
            .filter_map(|picture| Arc::into_inner(picture.image));
        let mut pool = self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        pool.extend(buffers.map(|image| image.pixels));
        pool.truncate(Self::MAX_POOLED);
    }

    /// Two frames of four pictures (stereo, A and B).
    const MAX_POOLED: usize = 8;
}

/// Callback by which the thread notifies the window.
pub(crate) type WakeCallback = Arc<dyn Fn() + Send + Sync>;
