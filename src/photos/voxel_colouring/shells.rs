//! Spacing of shells: between successive shells no candidate moves by more than [`STEP_PX`] in a
//! photograph.

use super::photograph::Photograph;
use glam::DVec3;

/// Maximum number of shells.
const MAX_SHELLS: usize = 4096;

/// Largest motion in a photograph from shell to shell, pixels.
const STEP_PX: f64 = 2.0;

/// Farthest shell, relative to the distance of the cameras from the centre: beyond, no motion is
/// distinguishable from that at infinity.
const FARTHEST: f64 = 200.0;

/// Side of the grid of a photograph's pixels whose visibility in the others is tested.
const GRID: usize = 5;

/// Returns the eye depths of shells, metres, near to far, at which at least `min_views` photographs
/// see the same point; empty if there are none.
pub(super) fn depths(photographs: &[Photograph], min_views: usize) -> Vec<f64> {
    let reach = photographs
        .iter()
        .map(|photograph| photograph.eye.abs().max_element())
        .fold(0.0, f64::max);
    if reach <= 0.0 || min_views == 0 {
        return Vec::new();
    }
    let mut shells = Vec::new();
    let mut depth = reach / 100.0;
    while depth < reach * FARTHEST && shells.len() < MAX_SHELLS {
        match step(photographs, depth, min_views) {
            Some(step) => {
                shells.push(depth);
                depth += step;
            }
            None => depth *= 1.02,
        }
    }
    shells
}

/// Returns the step from a shell to the next; `None` if too few photographs see any of it.
fn step(photographs: &[Photograph], depth: f64, min_views: usize) -> Option<f64> {
    let inside = || {
        photographs
            .iter()
            .filter(|photograph| photograph.is_inside(depth))
    };
    let mut fastest: f64 = 0.0;
    for photograph in inside() {
        for point in photograph.points_on_shell(depth, GRID) {
            let seen = || inside().filter(|other| other.project(point).is_some());
            if seen().count() >= min_views {
                fastest = seen()
                    .map(|other| motion(other, point, depth))
                    .fold(fastest, f64::max);
            }
        }
    }
    let slowest = 1.0 / (depth * 0.1); // far away hardly anything moves
    (fastest > 0.0).then(|| STEP_PX / fastest.max(slowest))
}

/// Returns the motion of a point in a photograph, pixels per metre of the shells' growth.
fn motion(photograph: &Photograph, point: DVec3, depth: f64) -> f64 {
    let ray = point / depth;
    let sight = (point - photograph.eye).normalize_or_zero();
    ray.cross(sight).length() * photograph.pixels_per_metre(point)
}
