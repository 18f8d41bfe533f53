//! A frame asked for, and what is reported about it.

use super::SettingValues;
use crate::camera::Camera;
use crate::frame::Frame;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// One frame to render.
#[derive(Clone, Debug)]
pub struct FrameRequest {
    /// The camera; its width and height are those of the frame.
    pub camera: Camera,
    /// The values of the view's settings.
    pub settings: Arc<SettingValues>,
    /// True if the eye is in motion: a view may skip work that is visible only at rest.
    pub moving: bool,
    /// True if the frame must be complete: what a view would load or build in the background is
    /// waited for. The wait does not count as frame time.
    pub complete: bool,
    /// True if the frame must have the eye depth of each pixel, in views that support it.
    pub depth: bool,
}

impl FrameRequest {
    /// A complete frame at rest, without depth.
    pub fn complete(camera: Camera, settings: Arc<SettingValues>) -> Self {
        Self {
            camera,
            settings,
            moving: false,
            complete: true,
            depth: false,
        }
    }
}

/// A rendered frame, held by the view until the next one.
#[derive(Debug)]
pub struct Rendered<'a> {
    /// Colours, coverage, and eye depth if it was asked for and the view supports it. Alpha is 255
    /// where something was seen.
    pub frame: &'a Frame,
    /// Times, figures and warnings.
    pub report: FrameReport,
}

/// Report on a rendered frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Time by stage, in the order of the work; drawn as the rolling chart.
    pub stages: Vec<Stage>,
    /// Wall time of the frame in milliseconds, without waiting for what was loaded or built.
    pub ms: f64,
    /// Pixels of which nothing is known.
    pub hole_pixels: u64,
    /// Further figures.
    pub figures: Vec<Figure>,
    /// Facts in words, such as the name of the room.
    pub facts: Vec<Fact>,
    /// Sentences about what the frame lacks, such as an image that could not be read.
    pub warnings: Vec<String>,
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
