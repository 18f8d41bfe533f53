//! Where to look from, and where to, when nobody says.
//!
//! | file | what |
//! |---|---|
//! | `place` | the headbox: a person standing on a floor where there is one, else free space with something around it |
//! | `view` | the direction with the most to see |

mod place;
#[cfg(test)]
mod tests;
mod view;

pub use place::{EYE_HEIGHT_M, HeadboxError, fitting_half_size, place_headbox, suggest_half_size, suggest_headbox};
pub use view::suggest_view;

use crate::trace::{Hit, Ray, Tracer};
use glam::{DVec3, Vec3};

/// Directions in which clearance is measured.
const DIRECTIONS: u32 = 128;

/// What rays in all directions from a point find.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Distance to the nearest surface found, metres; infinite if none was.
    pub clearance_m: f64,
    /// Share of directions in which there is a surface.
    pub enclosed: f64,
}

/// What a person takes for up where pictures were taken with `pictures_up` upward: +Y, unless that shows them on their side.
pub fn level_up(pictures_up: Option<DVec3>) -> DVec3 {
    /// Cosine of 45 degrees: cameras may look down, or up, and +Y is still up.
    const LEVEL: f64 = std::f64::consts::FRAC_1_SQRT_2;
    pictures_up.filter(|up| up.y < LEVEL).unwrap_or(DVec3::Y)
}

/// Looks around from a world position (128 directions, evenly spread).
pub fn look_around(tracer: &Tracer, world: DVec3) -> Surroundings {
    let (mut nearest, mut hits) = (f32::INFINITY, 0);
    for i in 0..DIRECTIONS {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / DIRECTIONS as f32;
        let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos(); // the golden angle
        let rim = (1.0 - y * y).sqrt();
        if let Some(hit) = cast(tracer, world, Vec3::new(rim * cos, y, rim * sin)) {
            nearest = nearest.min(hit.t);
            hits += 1;
        }
    }
    Surroundings { clearance_m: f64::from(nearest), enclosed: f64::from(hits) / f64::from(DIRECTIONS) }
}

/// What a ray from a world position meets first.
fn cast(tracer: &Tracer, world: DVec3, direction: Vec3) -> Option<Hit> {
    let origin = (world - tracer.origin()).as_vec3();
    tracer.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY })
}
