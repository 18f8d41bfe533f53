//! Spacing of shells: no photograph sees a candidate move by more than a pixel from one to the
//! next.

use super::photograph::Photograph;
use glam::DVec3;

/// The most shells; beyond, steps are larger.
const MOST: usize = 4096;

/// Largest motion in a photograph from shell to shell, pixels.
const STEP_PX: f64 = 2.0;

/// Beyond so many times the distance between the cameras nothing moves that is told apart from
/// infinity.
const FARTHEST: f64 = 200.0;

/// Pixels of a photograph, to a side of a grid, for which others are asked whether they see the
/// same.
const GRID: usize = 5;

/// Eye depths of shells, metres, near to far: where at least `least` photographs see the same. None
/// if there is no such place.
pub(super) fn depths(photographs: &[Photograph], least: usize) -> Vec<f64> {
    let reach = photographs
        .iter()
        .map(|photograph| photograph.eye().abs().max_element())
        .fold(0.0, f64::max);
    if reach <= 0.0 || least == 0 {
        return Vec::new();
    }
    let mut shells = Vec::new();
    let mut depth = reach / 100.0;
    while depth < reach * FARTHEST && shells.len() < MOST {
        match step(photographs, depth, least) {
            Some(step) => {
                shells.push(depth);
                depth += step;
            }
            None => depth *= 1.02,
        }
    }
    shells
}

/// The step from a shell to the next; `None` if too few photographs see any of it.
fn step(photographs: &[Photograph], depth: f64, least: usize) -> Option<f64> {
    let inside = || {
        photographs
            .iter()
            .filter(|photograph| photograph.is_inside(depth))
    };
    let mut fastest: f64 = 0.0;
    for photograph in inside() {
        for point in photograph.points_on_shell(depth, GRID) {
            let seen = || inside().filter(|other| other.project(point).is_some());
            if seen().count() >= least {
                fastest = seen()
                    .map(|other| motion(other, point, depth))
                    .fold(fastest, f64::max);
            }
        }
    }
    let slowest = 1.0 / (depth * 0.1); // far away nothing moves
    (fastest > 0.0).then(|| STEP_PX / fastest.max(slowest))
}

/// Pixels that a point moves in a photograph, per metre of the shells' growth.
fn motion(photograph: &Photograph, point: DVec3, depth: f64) -> f64 {
    let ray = point / depth;
    let sight = (point - photograph.eye()).normalize_or_zero();
    ray.cross(sight).length() * photograph.pixels_a_metre(point)
}
