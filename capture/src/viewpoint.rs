//! Where to look from when nobody says: free space with something to see around it.

use crate::sampler::{random4, unit_float};
use crate::scene::{Headbox, Scene};
use crate::trace::{Ray, Tracer};
use glam::{DVec3, Vec3};
use std::sync::Arc;

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

/// Looks around from a world position (128 directions, evenly spread).
pub fn look_around(tracer: &Tracer, world: DVec3) -> Surroundings {
    let origin = (world - tracer.origin()).as_vec3();
    let (mut nearest, mut hits) = (f32::INFINITY, 0);
    for i in 0..DIRECTIONS {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / DIRECTIONS as f32;
        let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos(); // the golden angle
        let rim = (1.0 - y * y).sqrt();
        let direction = Vec3::new(rim * cos, y, rim * sin);
        if let Some(hit) = tracer.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }) {
            nearest = nearest.min(hit.t);
            hits += 1;
        }
    }
    Surroundings { clearance_m: f64::from(nearest), enclosed: f64::from(hits) / f64::from(DIRECTIONS) }
}

/// Why a headbox cannot be placed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum HeadboxError {
    /// Its centre is nowhere.
    #[error("a headbox about {0}; its centre must be three finite numbers")]
    Centre(DVec3),
    /// It is too small or too large to be worked with.
    #[error("a headbox of half-size {0} m; it must lie between 1e-9 and 1e9 m")]
    HalfSize(f64),
}

/// The headbox of a scene, world metres: what is given of it, else what the scene suggests, else free space.
///
/// # Errors
/// [`HeadboxError`] if there is no such box.
pub fn place_headbox(
    scene: &Arc<Scene>,
    centre: Option<DVec3>,
    half_size_m: Option<f64>,
) -> Result<Headbox, HeadboxError> {
    let [low, high] = scene.bounds();
    let scout = || Tracer::new(Arc::clone(scene), (low + high) / 2.0);
    let suggested = match centre {
        Some(_) => None,
        None => Some(scene.headbox.unwrap_or_else(|| suggest_headbox(&scout()))),
    };
    let centre = centre.or(suggested.map(|headbox| headbox.centre)).unwrap_or_default();
    let half_size_m = half_size_m
        .or(suggested.map(|headbox| headbox.half_size_m))
        .unwrap_or_else(|| suggest_half_size(&scout(), centre));
    if !centre.is_finite() {
        return Err(HeadboxError::Centre(centre));
    }
    if !(1e-9..=1e9).contains(&half_size_m) {
        return Err(HeadboxError::HalfSize(half_size_m));
    }
    Ok(Headbox { centre, half_size_m })
}

/// A half-size for a headbox about a world position: half the clearance (a cube's corner is 1.73 half-sizes away), but
/// at most a twentieth of the scene's diagonal; if the position touches geometry, a hundredth of the diagonal.
pub fn suggest_half_size(tracer: &Tracer, centre: DVec3) -> f64 {
    let [low, high] = tracer.scene().bounds();
    let diagonal = (high - low).length();
    let fitting = 0.5 * look_around(tracer, centre).clearance_m;
    if fitting < 1e-4 * diagonal { 0.01 * diagonal } else { fitting.min(0.05 * diagonal) }
}

/// A headbox in free space, with as much clearance and as much to see around it as seeded tries in the scene's
/// bounding box find.
pub fn suggest_headbox(tracer: &Tracer) -> Headbox {
    const TRIES: u32 = 400;
    let [low, high] = tracer.scene().bounds();
    let mut best = (f64::NEG_INFINITY, (low + high) / 2.0);
    for i in 0..TRIES {
        let [x, y, z, _] = random4([i, 0xb0c5, 0, 0]).map(|r| f64::from(unit_float(r)));
        // The lower part of the box: people look at scenes from near the ground.
        let place = low + (high - low) * DVec3::new(x, 0.1 + 0.5 * y, z);
        let around = look_around(tracer, place);
        let score = around.clearance_m.min((high - low).length()) * around.enclosed * around.enclosed;
        if score > best.0 {
            best = (score, place);
        }
    }
    Headbox { centre: best.1, half_size_m: suggest_half_size(tracer, best.1) }
}
