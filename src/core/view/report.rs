//! Request of a frame, and the report about it.

use super::SettingValues;
use crate::camera::Camera;
use crate::frame::Frame;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Frame to render.
#[derive(Clone, Debug)]
pub struct FrameRequest {
    /// Camera; its width and height are those of the frame.
    pub camera: Camera,
    /// Values of the view's settings.
    pub settings: Arc<SettingValues>,
    /// True if the eye is in motion: a view may skip work that is only visible at rest.
    pub moving: bool,
    /// True if the frame must be complete: the view waits for work that it would otherwise do in
    /// the background. The wait does not count as frame time.
    pub complete: bool,
    /// True if the frame must have the eye depth of each pixel, in views that support it.
    pub depth: bool,
}

impl FrameRequest {
    /// Requests a complete frame at rest, without depth.
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

/// Rendered frame, owned by the view until the next one.
#[derive(Debug)]
pub struct Rendered<'a> {
    /// Colours, coverage, and eye depth if requested and supported. Alpha is 255 where something
    /// was seen.
    pub frame: &'a Frame,
    /// Times, figures and warnings.
    pub report: FrameReport,
}

/// Report on a rendered frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Times of the stages, in order; drawn as the rolling chart.
    pub stages: Vec<Stage>,
    /// Wall time of the frame in milliseconds, without waiting for background work.
    pub ms: f64,
    /// Number of hole pixels.
    pub hole_pixels: u64,
    /// Eye depth in the middle of the frame, metres; `None` if it was not requested, if nothing is
    /// there, or if the view has no depth.
    pub depth_m: Option<f64>,
    /// Further figures.
    pub figures: Vec<Figure>,
    /// Facts in words, such as the name of the room.
    pub facts: Vec<Fact>,
    /// Warnings about the frame, a sentence each, such as an image that could not be read.
    pub warnings: Vec<String>,
    /// Legend of an overlay's colours: shown in a corner of the frame.
    pub legend: Vec<Swatch>,
    /// State of refinement: the window repeats a request that would give a better frame while there
    /// is no newer one.
    pub refinement: Refinement,
    /// Background work that will improve it: shown as a strip over the frame.
    pub ongoing: Option<Ongoing>,
}

/// Background work in progress.
#[derive(Clone, Debug, PartialEq)]
pub struct Ongoing {
    /// Description of the work in a few words.
    pub what: String,
    /// Completed share, 0 to 1.
    pub share: f64,
    /// Estimated remaining time, if known.
    pub left: Option<Duration>,
}

impl Ongoing {
    /// Describes work of which `share` was completed since `begun`, and estimates the remaining
    /// time at the same pace, once the share is large enough.
    pub fn since(what: impl Into<String>, share: f64, begun: Instant) -> Self {
        /// Smallest share from which the pace can be estimated.
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
    /// The frame is final.
    #[default]
    Done,
    /// The next call improves it; an export calls until it is done.
    Next,
    /// Background work (a capture, an error map) improves it: render again after this time. An
    /// export does not wait for it.
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

/// Figure about a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Name, the same in every frame.
    pub name: &'static str,
    /// Value in `unit`.
    pub value: f64,
    /// Unit as it is printed behind the value, or "" for a bare number.
    pub unit: &'static str,
}

/// Fact about a frame, as text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fact {
    /// Name, the same in every frame.
    pub name: &'static str,
    /// Text of the fact.
    pub text: String,
}

/// Line of a legend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Swatch {
    /// sRGB.
    pub color: [u8; 3],
    /// Meaning, with its unit.
    pub label: String,
}
