//! Placement of the headbox, in the axes and unit of its scene's file.

use crate::messages::UsageError;
use glam::DVec3;
use headbox_core::file_frame::FileFrame;
use headbox_core::headbox::Headbox;
use headbox_scene::scene::Scene;
use headbox_trace::viewpoint::{self, HeadboxError};
use std::sync::Arc;

/// Places the headbox: as requested, in the file's axes and unit, else as the scene suggests, else
/// in free space.
pub(crate) fn place_headbox(
    scene: &Arc<Scene>,
    center: Option<DVec3>,
    half_size: Option<f64>,
) -> Result<Headbox, UsageError> {
    let centre = center.map(|center| scene.frame.world_from_file(center));
    let half_size_m = half_size.map(|half_size| half_size * scene.frame.unit_m);
    viewpoint::place_headbox(scene, centre, half_size_m)
        .map_err(|error| UsageError(in_file_units(&error, &scene.frame)))
}

/// Formats an error in the file's axes and unit.
fn in_file_units(error: &HeadboxError, frame: &FileFrame) -> String {
    match *error {
        HeadboxError::TooFar { centre, low, high } => {
            let [centre, low, high] = [centre, low, high].map(|point| frame.file_from_world(point));
            format!(
                "a headbox about {} is so far from the scene that nothing is visible; choose a place near the scene, which reaches \
                 from {} to {} (in the file's axes and unit)",
                triple(centre),
                triple(low.min(high)),
                triple(low.max(high))
            )
        }
        HeadboxError::HalfSize(metres) => {
            let [half_size, least, most] =
                [metres, 1e-9, 1e9].map(|metres| figure(metres / frame.unit_m));
            format!(
                "a headbox of half-size {half_size}; choose one between {least} and {most} (in the file's unit)"
            )
        }
        HeadboxError::Centre(_) => error.to_string(),
    }
}

/// Rounds a length to four significant digits.
fn rounded(length: f64) -> f64 {
    let digits = (3.0 - length.abs().max(f64::MIN_POSITIVE).log10().floor()).clamp(0.0, 12.0);
    let scale = 10_f64.powf(digits);
    // Adding zero drops the sign of -0.
    (length * scale).round() / scale + 0.0
}

/// Formats a length with four significant digits, and an exponent where there would be many zeros.
pub(crate) fn figure(length: f64) -> String {
    match length.abs() {
        1e7.. => format!("{length:.3e}").replace(".000e", "e"),
        size if size > 0.0 && size < 1e-5 => format!("{length:.3e}").replace(".000e", "e"),
        _ => rounded(length).to_string(),
    }
}

/// Formats a position as the command line takes it.
pub(crate) fn triple(position: DVec3) -> String {
    position.to_array().map(figure).join(",")
}
