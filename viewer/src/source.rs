//! Frame sources: anything that turns a camera into a frame.

use crate::input::bounds::EyeBounds;
use crate::input::pose::Pose;
use crate::setting::{Setting, SettingValues};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use std::{
    path::Path,
    sync::{Arc, mpsc::Receiver},
    time::{Duration, Instant},
};

/// Something that can be looked at. Lives on the render thread, which is the only one that calls
/// it, and may take its time there: the window never waits for it.
pub trait FrameSource: Send {
    /// Title of the window: a file name and its kind.
    fn title(&self) -> String;

    /// Start pose, to which the key "centre" returns.
    fn start_pose(&self) -> Pose;

    /// The box in which the eye may move (the headbox); `None` leaves it free.
    fn bounds(&self) -> Option<EyeBounds> {
        None
    }

    /// Navigation mode.
    fn navigation(&self) -> Navigation {
        Navigation::Fly
    }

    /// Speed of the eye with a key held, metres per second. By default the headbox's half width in
    /// one second, or a stroll.
    fn speed_m_per_s(&self) -> f64 {
        self.bounds()
            .map_or(1.4, |bounds| bounds.half_size.max_element().max(1e-3))
    }

    /// A plan to show the eye on, for sources with rooms.
    fn plan(&self) -> Option<RoomMap> {
        None
    }

    /// Notes on the file, a sentence each; shown as messages when it is opened.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// A sentence for each term that the panel shows (names of figures, facts, options), shown
    /// where the pointer rests on it.
    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        &[]
    }

    /// The axes and unit of the scene's file, in which cameras and paths are saved, as on the
    /// command line.
    fn file_frame(&self) -> FileFrame {
        FileFrame::default()
    }

    /// The source's own panel, in order. The window shows the settings, keeps their values, and
    /// passes them back with each request; asked once, when the source is opened.
    fn settings(&self) -> Vec<Setting> {
        Vec::new()
    }

    /// Renders the request into `pixels`: `request.camera`'s width x height, row 0 on top, sRGB
    /// with 8 bits per channel, alpha 255 where something was seen (premultiplied elsewhere; what
    /// is transparent shows the window's background). Every pixel must be written: the buffer holds
    /// an older frame.
    ///
    /// # Errors
    /// One sentence for the person at the window; the last good frame stays.
    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String>;

    /// Does what a button of the panel ([`Setting::action`]) says, and returns one sentence that
    /// says what was done.
    ///
    /// # Errors
    /// One sentence for the person at the window.
    fn act(&mut self, action: &str) -> Result<String, String> {
        Err(format!(
            "\"{action}\" is not something that this view can do."
        ))
    }
}

/// Files and scenes that the window can open: the start page, drag and drop, the file list. Lives
/// on the render thread.
pub trait Library: Send {
    /// Entries of the start page, in order.
    fn entries(&self) -> Vec<Entry>;

    /// The picture of an entry, 4:3 with straight corners, made when the thread has nothing else to
    /// do.
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

/// One offer of the start page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Argument of [`Library::open_entry`].
    pub id: String,
    /// Short name.
    pub name: String,
    /// One sentence.
    pub description: String,
}

/// A small picture: `width` x `height` opaque sRGB pixels, row 0 on top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Thumbnail {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// The pixels, `width * height` of them.
    pub pixels: Vec<[u8; 4]>,
}

impl Thumbnail {
    /// Uploads it as a texture; `None` if the number of pixels differs from its size.
    pub(crate) fn texture(&self, ctx: &egui::Context, name: &str) -> Option<egui::TextureHandle> {
        let size = [self.width as usize, self.height as usize];
        (size[0] * size[1] == self.pixels.len()).then(|| {
            let image =
                egui::ColorImage::from_rgba_unmultiplied(size, bytemuck::cast_slice(&self.pixels));
            ctx.load_texture(name, image, egui::TextureOptions::LINEAR)
        })
    }
}

/// Navigation mode.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Navigation {
    /// Forward is where one looks.
    #[default]
    Fly,
    /// Forward stays level.
    Walk,
    /// The eye circles a point and looks at it (sprites).
    Orbit {
        /// The point, world metres.
        pivot: DVec3,
        /// The nearest that the eye comes to it, metres.
        nearest: f64,
    },
}

/// One frame to make.
#[derive(Clone, Debug)]
pub struct FrameRequest {
    /// The view; its width and height are those of the pixels to fill.
    pub camera: Camera,
    /// The values of the source's settings.
    pub settings: Arc<SettingValues>,
    /// True if the eye is in motion: a source may skip work that is visible only at rest.
    pub moving: bool,
}

/// Report on a rendered frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Time by stage, in the order of the work; drawn as the rolling chart.
    pub stages: Vec<Stage>,
    /// Further figures.
    pub figures: Vec<Figure>,
    /// Facts in words, such as the name of the room.
    pub facts: Vec<Fact>,
    /// Legend of the colours, if they are not those of the scene: shown in a corner of the frame.
    pub legend: Vec<Swatch>,
    /// Tells if the same request would give a better frame: the window repeats it while there is no
    /// newer one.
    pub refinement: Refinement,
    /// Work in the background that will make it better: shown as a strip over the frame.
    pub ongoing: Option<Ongoing>,
}

/// Work that is not done yet.
#[derive(Clone, Debug, PartialEq)]
pub struct Ongoing {
    /// Description of the work, a few words.
    pub what: String,
    /// Share that is done, 0 to 1.
    pub share: f64,
    /// Estimated remaining time, if known.
    pub left: Option<Duration>,
}

impl Ongoing {
    /// Work of which `share` was done since `begun`, at an even pace; no time is told before there
    /// is one to go by.
    pub fn since(what: impl Into<String>, share: f64, begun: Instant) -> Self {
        /// Shares below this say nothing about the pace.
        const LEAST: f64 = 0.02;
        let share = if share.is_finite() {
            share.clamp(0.0, 1.0)
        } else {
            0.0
        };
        let left = (share >= LEAST).then(|| begun.elapsed().mul_f64((1.0 - share) / share));
        Self {
            what: what.into(),
            share,
            left,
        }
    }
}

/// A source that is being opened elsewhere: the window shows that it is until there is one.
pub struct PendingSource {
    /// Name of the file or scene being opened.
    pub name: String,
    /// The source, or one sentence why there is none.
    pub source: Receiver<Result<Box<dyn FrameSource>, String>>,
}

/// Potential for improvement of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Refinement {
    /// It is as good as it gets.
    #[default]
    Done,
    /// The next call makes it better; an export calls until it is done.
    Next,
    /// Something works on it in the background (a capture, an error map): worth another look after
    /// this long. An export does not wait for it.
    Later(Duration),
}

/// Time spent in one stage of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// Name, the same in every frame.
    pub name: &'static str,
    /// Wall time in milliseconds.
    pub ms: f64,
}

/// One figure about a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Name, the same in every frame.
    pub name: &'static str,
    /// Value in `unit`.
    pub value: f64,
    /// Unit as it is printed behind the value, or "" for a bare number.
    pub unit: &'static str,
}

/// One thing known about a frame, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fact {
    /// Name, the same in every frame.
    pub name: &'static str,
    /// Text of the fact.
    pub text: String,
}

/// One line of a legend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Swatch {
    /// sRGB.
    pub color: [u8; 3],
    /// Meaning, with its unit.
    pub label: String,
}

/// A plan of rooms seen from above, in world metres: (x, z) pairs, as x grows to the right and z
/// downward on the page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomMap {
    /// The rooms.
    pub rooms: Vec<Room>,
    /// Doors and other openings, as line segments.
    pub openings: Vec<[[f64; 2]; 2]>,
}

/// One room of a [`RoomMap`].
#[derive(Clone, Debug, PartialEq)]
pub struct Room {
    /// Name.
    pub name: String,
    /// Corners of the floor, a simple polygon.
    pub outline: Vec<[f64; 2]>,
}

impl RoomMap {
    /// The first room whose outline holds the eye, by the even-odd rule.
    pub fn room_at(&self, eye: DVec3) -> Option<usize> {
        self.rooms
            .iter()
            .position(|room| room.holds([eye.x, eye.z]))
    }
}

impl Room {
    fn holds(&self, [x, z]: [f64; 2]) -> bool {
        let next = self.outline.iter().cycle().skip(1);
        let crossings = self
            .outline
            .iter()
            .zip(next)
            .filter(|&(&[ax, az], &[bx, bz])| {
                let spans = (az > z) != (bz > z);
                spans && x < ax + (z - az) / (bz - az) * (bx - ax)
            });
        crossings.count() % 2 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn the_plan_knows_the_room() {
        let room = |name: &str, outline: &[[f64; 2]]| Room {
            name: name.into(),
            outline: outline.to_vec(),
        };
        let ell = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 1.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [0.0, 3.0],
        ];
        let square = [[1.0, 1.0], [4.0, 1.0], [4.0, 3.0], [1.0, 3.0]];
        let plan = RoomMap {
            rooms: vec![room("ell", &ell), room("square", &square)],
            openings: vec![],
        };
        assert_eq!(plan.room_at(dvec3(0.5, 1.6, 2.0)), Some(0));
        assert_eq!(plan.room_at(dvec3(3.0, -9.0, 0.5)), Some(0));
        assert_eq!(plan.room_at(dvec3(2.0, 0.0, 2.0)), Some(1));
        assert_eq!(plan.room_at(dvec3(5.0, 0.0, 2.0)), None);
    }
}
