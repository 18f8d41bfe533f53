//! Header of a capture.

use super::parameters::CaptureParameters;
use glam::DVec3;
use headbox_core::color::tone::ToneMap;
use headbox_core::file_frame::FileFrame;
use headbox_core::light_parameters::LightParameters;
use serde::{Deserialize, Serialize};

/// Header of a capture: its parameters and measurements; stored in the `.ldi` file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureInfo {
    /// Scene, as specified on the command line.
    pub scene: String,
    /// Centre of the headbox, world metres.
    pub centre: DVec3,
    /// Half of the headbox's edge length, metres.
    pub half_size_m: f64,
    /// Axes and unit of the scene's file.
    #[serde(flatten)]
    pub frame: FileFrame,
    /// Factor from linear radiance to the argument of `tone`.
    pub exposure: f32,
    /// Tone curve applied to exposed radiance.
    #[serde(default)]
    pub tone: ToneMap,
    /// Specified light; by default that of the scene.
    #[serde(default = "LightParameters::unspecified")]
    pub light: LightParameters,
    /// Parameters of rays, merging and light.
    #[serde(flatten)]
    pub parameters: CaptureParameters,
    /// Rays traced, all faces.
    pub rays_traced: u64,
    /// Share of the headbox that is occluded from its centre.
    pub blocked_share: f64,
    /// Default viewing direction: the horizontal direction with the most visible geometry, world
    /// axes; `None` in older files.
    #[serde(default)]
    pub ahead: Option<DVec3>,
    /// Default up direction if it is not +Y, world axes: for images taken with the camera on its
    /// side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<DVec3>,
    /// Default vertical field of view, degrees, if it is not 60: for images with a narrower one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fov_y_deg: Option<f64>,
    /// Per face of the ray domain: the estimated probability that one more ray would find a depth
    /// pixel that is not in the LDI (Good 1953: share of samples hit once); `None` if rays were not
    /// random.
    pub missing_estimate: [Option<f64>; 6],
    /// Holes of test frames; `None` if not measured.
    #[serde(default)]
    pub holes: Option<Holes>,
}

impl Default for CaptureInfo {
    /// Header without light of its own: colours are stored as they are.
    fn default() -> Self {
        Self {
            scene: String::new(),
            centre: DVec3::ZERO,
            half_size_m: 0.0,
            frame: FileFrame::default(),
            exposure: 0.0,
            tone: ToneMap::default(),
            light: LightParameters::unspecified(),
            parameters: CaptureParameters::default(),
            rays_traced: 0,
            blocked_share: 0.0,
            ahead: None,
            up: None,
            fov_y_deg: None,
            missing_estimate: [None; 6],
            holes: None,
        }
    }
}

/// Holes of frames, measured by comparing test frames from all over the headbox with rays
/// (`headbox_ldi::refine`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Holes {
    /// Share of the pixels of the last test frames that lack a surface which rays hit.
    pub share: f64,
    /// Standard error of `share`.
    pub standard_error: f64,
    /// The same share before any ray was aimed.
    pub share_before: f64,
    /// Number of rays that were aimed at missing samples, and kept.
    pub aimed_rays: u64,
    /// Number of rounds of test frames.
    pub rounds: u32,
}
