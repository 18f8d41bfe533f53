//! Frame sources: anything that turns a camera into a frame.

use crate::input::bounds::EyeBounds;
use crate::input::pose::Pose;
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_core::view::{FrameReport, FrameRequest, Navigation, RoomMap, Setting};
use std::path::Path;
use std::sync::mpsc::Receiver;

/// Renderer of frames. Lives on the render thread, which is the only one that calls it, and may be
/// slow: the window never waits for it.
pub trait FrameSource: Send {
    /// Title of the window: a file name and its kind.
    fn title(&self) -> String;

    /// Start pose, to which the key "centre" returns.
    fn start_pose(&self) -> Pose;

    /// Box in which the eye may move (the headbox); `None` leaves it free.
    fn bounds(&self) -> Option<EyeBounds> {
        None
    }

    /// Headboxes of a source that can capture others, and that renders a preview outside of them;
    /// `None` for other sources.
    fn headboxes(&self) -> Option<Headboxes> {
        None
    }

    /// Captures another headbox or shows another one, and returns one sentence that reports the
    /// result. The window then asks for [`Self::bounds`], [`Self::start_pose`] and
    /// [`Self::settings`] again.
    ///
    /// # Errors
    /// One sentence for the person at the window.
    fn request_headbox(&mut self, _request: HeadboxRequest) -> Result<String, String> {
        Err("This view has no other headbox.".into())
    }

    /// Navigation mode.
    fn navigation(&self) -> Navigation {
        Navigation::Fly
    }

    /// Speed of the eye with a key held, metres per second. By default the headbox's half width in
    /// one second, or walking speed.
    fn speed_m_per_s(&self) -> f64 {
        self.bounds()
            .map_or(1.4, |bounds| bounds.half_size.max_element().max(1e-3))
    }

    /// Floor plan on which the eye is shown, for sources with rooms.
    fn plan(&self) -> Option<RoomMap> {
        None
    }

    /// Notes on the file, one sentence each; shown as messages when it is opened.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// Explanations of the terms in the panel (names of figures, facts, options), one sentence
    /// each; shown as tooltips.
    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        &[]
    }

    /// Axes and unit of the scene's file, in which cameras and paths are saved, as on the command
    /// line.
    fn file_frame(&self) -> FileFrame {
        FileFrame::default()
    }

    /// Settings of the source's own panel, in order. The window shows them, keeps their values, and
    /// passes them back with each request; called when the source is opened, and after
    /// [`Self::request_headbox`], which must not change their ids.
    fn settings(&self) -> Vec<Setting> {
        Vec::new()
    }

    /// Renders the request into `pixels`: `request.camera`'s width x height, row 0 on top, sRGB
    /// with 8 bits per channel, premultiplied; alpha 255 where the scene covers the pixel. The
    /// window's background shows through transparent pixels. Every pixel must be written: the
    /// buffer holds an older frame.
    ///
    /// # Errors
    /// One sentence for the person at the window; the last good frame stays.
    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String>;

    /// Writes the file of a button of the panel ([`Setting::save`]), and returns one sentence that
    /// reports the result. The person has chosen `path`, and agreed if it replaces a file.
    ///
    /// # Errors
    /// One sentence for the person at the window.
    fn save(&mut self, id: &str, _path: &Path) -> Result<String, String> {
        Err(format!("\"{id}\" is nothing that this view can save."))
    }
}

/// Headboxes of a source.
#[derive(Clone, Debug, PartialEq)]
pub struct Headboxes {
    /// Box of each, in order of capture.
    pub bounds: Vec<EyeBounds>,
    /// Index of the one that is shown.
    pub shown: usize,
}

/// Request of another headbox.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HeadboxRequest {
    /// Capture a cube.
    Capture {
        /// Centre, world metres.
        centre: DVec3,
        /// Half of the edge length, metres.
        half_size_m: f64,
    },
    /// Show the headbox with this index.
    Show(usize),
}

/// Files and scenes that the window can open: the start page, drag and drop, the file list. Lives
/// on the render thread.
pub trait Library: Send {
    /// Entries of the start page, in order.
    fn entries(&self) -> Vec<Entry>;

    /// Renders the thumbnail of an entry, 4:3 with straight corners; called when the thread is
    /// idle.
    fn thumbnail(&mut self, _entry: &Entry) -> Option<Thumbnail> {
        None
    }

    /// File extensions that [`Self::open_file`] understands, without the dot, for the file list.
    fn extensions(&self) -> Vec<String>;

    /// Opens an entry of the start page by its id.
    ///
    /// # Errors
    /// One sentence for the person at the window.
    fn open_entry(&mut self, id: &str) -> Result<Box<dyn FrameSource>, String>;

    /// Opens a file.
    ///
    /// # Errors
    /// One sentence for the person at the window.
    fn open_file(&mut self, path: &Path) -> Result<Box<dyn FrameSource>, String>;
}

/// An entry of the start page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Argument of [`Library::open_entry`].
    pub id: String,
    /// Short name.
    pub name: String,
    /// One sentence.
    pub description: String,
}

/// A small image: `width` x `height` opaque sRGB pixels, row 0 on top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Thumbnail {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Pixels, `width * height` of them.
    pub pixels: Vec<[u8; 4]>,
}

impl Thumbnail {
    /// Uploads the thumbnail as a texture; `None` if the number of pixels differs from its size.
    pub(crate) fn texture(&self, ctx: &egui::Context, name: &str) -> Option<egui::TextureHandle> {
        let size = [self.width as usize, self.height as usize];
        (size[0] * size[1] == self.pixels.len()).then(|| {
            let image =
                egui::ColorImage::from_rgba_unmultiplied(size, bytemuck::cast_slice(&self.pixels));
            ctx.load_texture(name, image, egui::TextureOptions::LINEAR)
        })
    }
}

/// A source that another thread is opening; the window reports this until it arrives.
pub struct PendingSource {
    /// Name of the file or scene being opened.
    pub name: String,
    /// The source, or one sentence with the error.
    pub source: Receiver<Result<Box<dyn FrameSource>, String>>,
}
