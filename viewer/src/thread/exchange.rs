//! Messages between the window and its render thread.

use crate::input::bounds::EyeBounds;
use crate::input::pose::Pose;
use crate::playback::eye_path::CameraPath;
use crate::source::{Entry, FrameSource, HeadboxRequest, Headboxes, Thumbnail};
use crate::thread::slot::{Inbox, Slot, lock};
use crate::window::system_dialog::SystemQuestion;
use egui::{Color32, ColorImage};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::view::{FrameReport, Navigation, RoomMap, Setting, SettingValues};
use std::{
    path::PathBuf,
    sync::{Arc, Mutex},
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

/// Request that is never skipped.
pub(crate) enum Order {
    /// Replaces the source.
    Open(Location),
    /// Closes the source.
    Close,
    /// Has the source write the file of a button of its panel.
    Save { id: &'static str, path: PathBuf },
    /// Captures or shows another headbox.
    Headbox(HeadboxRequest),
    /// Renders a path to PNG files.
    Export(ExportOrder),
    /// Cancels the running export.
    CancelExport,
    /// Measures the depth of a point of the view.
    Probe(Probe),
}

/// Measurement of the depth of a point of the view.
#[derive(Clone, Debug)]
pub(crate) struct Probe {
    /// Id of the source that the window showed.
    pub source_id: u64,
    /// Pose from which the point is seen.
    pub pose: Pose,
    /// Camera of a few pixels about the point.
    pub camera: Camera,
    pub settings: Arc<SettingValues>,
    pub goal: ProbeGoal,
}

/// Use of a measured point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ProbeGoal {
    /// The eye orbits about the point.
    Orbit,
    /// The eye turns to the point and approaches it.
    Approach,
}

/// Export of a path: one PNG file per pose.
pub(crate) struct ExportOrder {
    pub path: CameraPath,
    pub size: [u32; 2],
    pub settings: Arc<SettingValues>,
    pub dir: PathBuf,
}

/// View to render: for each camera, one picture per setting set.
#[derive(Clone, Debug)]
pub(crate) struct Job {
    /// Id of the source that the window showed.
    pub source_id: u64,
    /// Serial number of the job.
    pub number: u64,
    /// Cameras from left to right on the screen.
    pub cameras: Vec<Camera>,
    /// A, or A and B.
    pub sets: Vec<Arc<SettingValues>>,
    pub moving: bool,
    /// Scale of each side of the frame relative to the viewport, at most 1.
    pub scale: f64,
    /// Time of the request.
    pub issued: Instant,
    /// Number of earlier renderings of this job (for a source that converges).
    pub round: u32,
    /// Index of the replayed pose, if every pose must be shown.
    pub replayed: Option<usize>,
}

/// One rendered image and its report.
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
    pub headboxes: Option<Headboxes>,
    pub navigation: Navigation,
    pub speed_m_per_s: f64,
    pub plan: Option<RoomMap>,
    pub file_frame: FileFrame,
    pub settings: Vec<Setting>,
    pub notes: Vec<String>,
    pub terms: &'static [(&'static str, &'static str)],
}

impl SourceInfo {
    /// Returns the explanation of a term.
    pub(crate) fn term(&self, name: &str) -> Option<&'static str> {
        self.terms
            .iter()
            .find(|(term, _)| *term == name)
            .map(|(_, sentence)| *sentence)
    }

    pub(crate) fn new(source: &dyn FrameSource, id: u64) -> Self {
        Self {
            id,
            title: source.title(),
            start_pose: source.start_pose(),
            bounds: source.bounds(),
            headboxes: source.headboxes(),
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

/// Event from the render thread to the window.
pub(crate) enum Event {
    /// A source is ready. `orders` is the number of orders to open or close so far: the event is
    /// obsolete if the window has issued more.
    Opened {
        /// Description of the source.
        info: Box<SourceInfo>,
        /// Number of orders to open or close so far.
        orders: u64,
    },
    /// The source shows another headbox.
    HeadboxChanged(Box<SourceInfo>),
    /// Opening failed; the previous source stays.
    OpenFailed {
        /// Error message.
        error: String,
        /// Same as for [`Self::Opened`].
        orders: u64,
    },
    /// A point was measured; without a point if nothing is there or the source has no depth.
    Probed {
        /// The measurement.
        probe: Box<Probe>,
        /// The point, world metres.
        point: Option<DVec3>,
    },
    /// The source panicked and was dropped.
    Lost(String),
    /// Error message.
    Error(String),
    /// Confirmation message.
    Done(String),
    /// Entries of the start page, and the extensions of files that can be opened.
    Library {
        entries: Vec<Entry>,
        extensions: Vec<String>,
    },
    /// Thumbnail of an entry.
    Thumbnail { id: String, thumbnail: Thumbnail },
    /// A dialog of the desktop was answered; without a path if it was closed.
    Chosen {
        /// The question.
        question: SystemQuestion,
        /// The answer.
        path: Option<PathBuf>,
        /// False if there was no dialog.
        is_shown: bool,
    },
    /// Number of frames written and total number, of the running export; `None` when it has ended.
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
    /// Returns a buffer of `len` pixels, from the pool if possible.
    pub(crate) fn buffer(&self, len: usize) -> Vec<Color32> {
        let used = lock(&self.pool).pop();
        let mut buffer = used.unwrap_or_default();
        buffer.resize(len, Color32::TRANSPARENT);
        buffer
    }

    /// Returns the buffers of pictures that are not shared to the pool.
    pub(crate) fn recycle(&self, pictures: impl IntoIterator<Item = Picture>) {
        let buffers = pictures
            .into_iter()
            .filter_map(|picture| Arc::into_inner(picture.image));
        let mut pool = lock(&self.pool);
        pool.extend(buffers.map(|image| image.pixels));
        pool.truncate(Self::MAX_POOLED);
    }

    /// Maximum number of pooled buffers: two frames of four pictures (stereo, A and B).
    const MAX_POOLED: usize = 8;
}

/// Callback by which the thread notifies the window.
pub(crate) type WakeCallback = Arc<dyn Fn() + Send + Sync>;
