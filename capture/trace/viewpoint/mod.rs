//! Where to look from, and where to, when nobody says.
//!
//! | file | what |
//! |---|---|
//! | `place` | the headbox: a person standing on a floor where there is one, else free space with something around it, else before it all |
//! | `view` | the direction with the most to see |

mod place;
#[cfg(test)]
mod tests;
mod view;

pub use place::{
    EYE_HEIGHT_M, HeadboxError, fitting_half_size, place_headbox, suggest_half_size,
    suggest_headbox,
};
pub use view::suggest_view;

use crate::bvh::{Hit, Ray, Tracer};
use glam::{DVec3, Vec3};

/// Directions in which clearance is measured.
const DIRECTIONS: u32 = 128;

/// What rays in all directions from a point find.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Distance to the nearest surface found, metres; infinite if none was.
    pub clearance_m: f64,
    /// Half of the surfaces found are farther away than this, metres; infinite if none was found.
    pub median_m: f64,
    /// Share of directions in which there is a surface.
    pub enclosed: f64,
    /// Share of these surfaces that are seen from their back.
    pub backs: f64,
}

/// What a person takes for up where pictures were taken with `pictures_up` upward: +Y, unless that
/// shows them on their side.
pub fn level_up(pictures_up: Option<DVec3>) -> DVec3 {
    /// Cosine of 45 degrees: cameras may look down, or up, and +Y is still up.
    const LEVEL: f64 = std::f64::consts::FRAC_1_SQRT_2;
    pictures_up.filter(|up| up.y < LEVEL).unwrap_or(DVec3::Y)
}

/// Looks around from a world position (128 directions, evenly spread).
pub fn look_around(tracer: &Tracer, world: DVec3) -> Surroundings {
    let (mut distances, mut backs) = (Vec::with_capacity(DIRECTIONS as usize), 0);
    for i in 0..DIRECTIONS {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / DIRECTIONS as f32;
        let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos(); // the golden angle
        let rim = (1.0 - y * y).sqrt();
        let direction = Vec3::new(rim * cos, y, rim * sin);
        if let Some(hit) = cast(tracer, world, direction) {
            distances.push(hit.t);
            backs += u32::from(
                tracer
                    .scene()
                    .geometric_normal(hit.primitive)
                    .dot(direction)
                    > 0.0,
            );
        }
    }
    distances.sort_by(f32::total_cmp);
    let hits = distances.len() as f64;
    let distance_m = |i: usize| distances.get(i).map_or(f64::INFINITY, |t| f64::from(*t));
    Surroundings {
        clearance_m: distance_m(0),
        median_m: distance_m(distances.len() / 2),
        enclosed: hits / f64::from(DIRECTIONS),
        backs: f64::from(backs) / hits.max(1.0),
    }
}

/// What a ray from a world position meets first.
fn cast(tracer: &Tracer, world: DVec3, direction: Vec3) -> Option<Hit> {
    let origin = (world - tracer.origin()).as_vec3();
    tracer.closest(&Ray {
        origin,
        direction,
        t_min: 0.0,
        t_max: f32::INFINITY,
    })
}
