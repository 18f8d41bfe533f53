//! Default placement of the headbox and default viewing direction.
//!
//! | module | content |
//! |---|---|
//! | `place` | the headbox: at eye height on a floor if there is one, else in free space with surroundings, else in front of the scene |
//! | `view` | the direction with the most to see |
//! | `check` | warnings about a requested headbox |

mod check;
mod place;
#[cfg(test)]
mod tests;
mod view;

pub use check::{HeadboxFlaw, HeadboxWarning, check_headbox};
pub use place::{EYE_HEIGHT_M, HeadboxError, fitting_half_size, place_headbox, suggest_headbox};
pub use view::suggest_view;

use crate::bvh::{Hit, Ray, Tracer};
use glam::{DVec3, Vec3};

/// Number of directions in which clearance is measured.
const DIRECTIONS: u32 = 128;

/// Statistics of the surfaces around a point.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Surroundings {
    /// Distance to the nearest surface, metres; infinite without any.
    clearance_m: f64,
    /// Median distance of the surfaces, metres; infinite without any.
    median_m: f64,
    /// Fraction of directions with a surface.
    enclosed: f64,
    /// Fraction of these surfaces whose back side is visible. Floors do not count, which may be
    /// those of the ground that a building stands on, nor party walls: two surfaces in one plane
    /// that face away from each other.
    backs: f64,
}

/// Measures the surroundings of a world position (128 directions, evenly spread).
fn look_around(tracer: &Tracer, world: DVec3) -> Surroundings {
    let mut distances = Vec::with_capacity(DIRECTIONS as usize);
    let [mut fronts, mut backs] = [0u32; 2];
    for i in 0..DIRECTIONS {
        let direction = spread_direction(i);
        if let Some(hit) = cast(tracer, world, direction) {
            distances.push(hit.t);
            let normal = tracer.scene().geometric_normal(hit.primitive);
            let is_floor = direction.y < 0.0 && normal.y.abs() > 0.9;
            if is_floor {
                continue;
            }
            if normal.dot(direction) > 0.0 {
                backs += 1;
            } else if !is_party_wall(tracer, world, direction, hit.t) {
                fronts += 1;
            }
        }
    }
    distances.sort_by(f32::total_cmp);
    let hits = distances.len() as f64;
    let distance_m = |i: usize| distances.get(i).map_or(f64::INFINITY, |t| f64::from(*t));
    Surroundings {
        clearance_m: distance_m(0),
        median_m: distance_m(distances.len() / 2),
        enclosed: hits / f64::from(DIRECTIONS),
        backs: f64::from(backs) / f64::from((fronts + backs).max(1)),
    }
}

/// Returns true if a ray from a world position meets a back side in the plane of a front side at
/// distance `t`.
fn is_party_wall(tracer: &Tracer, world: DVec3, direction: Vec3, t: f32) -> bool {
    /// Maximum distance of the two sides, relative to `t`, and in metres.
    const APART: [f32; 2] = [1e-5, 1e-3];
    let apart = APART[0] * t + APART[1];
    let ray = Ray {
        t_min: (t - apart).max(0.0),
        t_max: t + apart,
        ..Ray::new((world - tracer.origin()).as_vec3(), direction)
    };
    let mut has_back = false;
    tracer.all_hits(&ray, &mut |hit| {
        has_back |= tracer
            .scene()
            .geometric_normal(hit.primitive)
            .dot(direction)
            > 0.0;
    });
    has_back
}

/// Returns the `i`-th of [`DIRECTIONS`] unit vectors, evenly spread.
fn spread_direction(i: u32) -> Vec3 {
    let y = 1.0 - 2.0 * (i as f32 + 0.5) / DIRECTIONS as f32;
    let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos(); // the golden angle
    let radius = (1.0 - y * y).sqrt();
    Vec3::new(radius * cos, y, radius * sin)
}

/// Returns the closest hit of a ray from a world position.
fn cast(tracer: &Tracer, world: DVec3, direction: Vec3) -> Option<Hit> {
    let origin = (world - tracer.origin()).as_vec3();
    tracer.closest(&Ray::new(origin, direction))
}
