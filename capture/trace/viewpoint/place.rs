//! Where the headbox goes.

use super::view::best_view;
use super::{Surroundings, cast, look_around};
use crate::bvh::Tracer;
use crate::sampler::{random4, unit_float};
use glam::{DVec3, Vec3};
use headbox_core::headbox::Headbox;
use headbox_scene::scene::Scene;
use rayon::prelude::*;
use std::sync::Arc;

/// Height of a standing person's eyes above the floor, metres.
pub const EYE_HEIGHT_M: f64 = 1.6;
/// A person needs this much from the floor to what is above, metres.
const HEADROOM_M: f64 = 1.9;
/// A floor goes on at its own height so far around a standing person, metres: a table or a shelf
/// does not.
const STANDING_ROOM_M: f64 = 0.6;
/// Floors that differ by less are one storey, metres.
const STOREY_M: f64 = 0.5;
/// Seeded tries.
const TRIES: u32 = 600;
/// More clearance than this makes a standing place no better, metres.
const AMPLE_M: f64 = 1.0;
/// And what is around farther away than this, metres.
const ROOMY_M: f64 = 10.0;

/// With less clearance, or half of what is around within arm's length, nobody would stand there,
/// metres.
const NARROW_M: f64 = 0.2;
const ARMS_LENGTH_M: f64 = 1.0;
/// Of the best places so many are looked from.
const SHORTLIST: usize = 64;
/// A free place with less clearance than this share of the scene's diagonal is a nook between its
/// parts.
const CRAMPED: f64 = 0.05;
/// And one with surfaces in fewer directions than this share is beside things rather than within a
/// room.
const WITHIN_WALLS: f64 = 0.75;
/// Where this share of what is seen shows its back, the eye is within a solid.
const WITHIN_A_SOLID: f64 = 0.99;

/// A scene this many of its diagonals away is less than a pixel wide on the largest face: 2/8192 of
/// its depth.
const MAX_DIAGONALS_AWAY: f64 = 4096.0;

/// Why a headbox cannot be placed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum HeadboxError {
    /// Its centre is nowhere.
    #[error("a headbox about {0}; its centre must be three finite numbers")]
    Centre(DVec3),
    /// Nothing of the scene would be seen from there.
    #[error(
        "a headbox about {centre}, so far from the scene that nothing of it would be seen; it reaches from {low} to {high} (metres, Y up)"
    )]
    TooFar {
        /// Its centre, world metres.
        centre: DVec3,
        /// Lowest corner of the scene.
        low: DVec3,
        /// Highest corner of the scene.
        high: DVec3,
    },
    /// It is too small or too large to be worked with.
    #[error("a headbox of half-size {0} m; it must lie between 1e-9 and 1e9 m")]
    HalfSize(f64),
}

/// The headbox of a scene, world metres: what is given of it, else what the scene suggests, else
/// free space.
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
    let centre = centre
        .or(suggested.map(|headbox| headbox.centre))
        .unwrap_or_default();
    let half_size_m = half_size_m
        .or(suggested.map(|headbox| headbox.half_size_m))
        .unwrap_or_else(|| suggest_half_size(&scout(), centre));
    if !centre.is_finite() {
        return Err(HeadboxError::Centre(centre));
    }
    if (centre - centre.clamp(low, high)).length() > MAX_DIAGONALS_AWAY * (high - low).length() {
        return Err(HeadboxError::TooFar { centre, low, high });
    }
    if !(1e-9..=1e9).contains(&half_size_m) {
        return Err(HeadboxError::HalfSize(half_size_m));
    }
    Ok(Headbox {
        centre,
        half_size_m,
    })
}

/// A half-size for a headbox about a world position: half the clearance (a cube's corner is 1.73
/// half-sizes away), but at most a twentieth of the scene's diagonal; if the position touches
/// geometry, a hundredth of the diagonal.
pub fn suggest_half_size(tracer: &Tracer, centre: DVec3) -> f64 {
    let [low, high] = tracer.scene().bounds();
    let diagonal = (high - low).length();
    let fitting = 0.5 * look_around(tracer, centre).clearance_m;
    if fitting < 1e-4 * diagonal {
        0.01 * diagonal
    } else {
        fitting.min(0.05 * diagonal)
    }
}

/// The part of a half-size that so many rays can fill: what the eye uncovers on its way from the
/// centre grows with the headbox's edge, and is found by the rays that are left once every pixel of
/// the faces has had one.
///
/// `rays_per_pixel` is rays traced over pixels of all faces. With 16, the paper's density, all of
/// the half-size is kept, with fewer a share that falls with their square root, but at least a
/// quarter.
pub fn fitting_half_size(half_size_m: f64, rays_per_pixel: f64) -> f64 {
    /// 32^4 strata of 16 rays on faces of 1024 pixels.
    const AMPLE_RAYS_PER_PIXEL: f64 = 16.0;
    half_size_m
        * (rays_per_pixel / AMPLE_RAYS_PER_PIXEL)
            .sqrt()
            .clamp(0.25, 1.0)
}

/// A headbox about the eyes of a person who stands on a floor, with as much clearance and as much
/// to see around as seeded tries find; where no try finds room to stand, about a free place in the
/// lower part of the scene's box; and of what has no such place within, as a statue, a tree or a
/// house without ground, before it.
pub fn suggest_headbox(tracer: &Tracer) -> Headbox {
    let centre = standing_place(tracer)
        .or_else(|| free_place(tracer))
        .unwrap_or_else(|| place_before(tracer));
    Headbox {
        centre,
        half_size_m: suggest_half_size(tracer, centre),
    }
}

/// The `i`-th place of the scene's box, evenly spread at random.
fn seeded_place(i: u32, low: DVec3, high: DVec3) -> DVec3 {
    let [x, y, z, _] = random4([i, 0xb0c5, 0, 0]).map(|r| f64::from(unit_float(r)));
    low + (high - low) * DVec3::new(x, y, z)
}

fn free_place(tracer: &Tracer) -> Option<DVec3> {
    let [low, high] = tracer.scene().bounds();
    let diagonal = (high - low).length();
    // The lower part of the box: people look at scenes from near the ground.
    let (lower, upper) = (0.1, 0.6);
    let [floor, ceiling] = [lower, upper].map(|share| low.y + (high.y - low.y) * share);
    let (low, high) = (
        DVec3::new(low.x, floor, low.z),
        DVec3::new(high.x, ceiling, high.z),
    );
    let score = |around: Surroundings| {
        let is_within = around.clearance_m >= CRAMPED * diagonal && around.enclosed >= WITHIN_WALLS;
        if is_within {
            around.clearance_m * around.enclosed * around.enclosed
        } else {
            0.0
        }
    };
    best_of(
        tracer,
        (0..TRIES).map(|i| seeded_place(i, low, high)),
        score,
    )
}

/// Where a person's eyes are, at the best of the places where one can stand.
fn standing_place(tracer: &Tracer) -> Option<DVec3> {
    let [low, high] = tracer.scene().bounds();
    let tries = (0..TRIES).map(|i| seeded_place(i, low, high));
    let floors: Vec<DVec3> = tries
        .filter_map(|place| floor_below(tracer, place))
        .collect();
    let storey = busiest_storey(&floors)?;
    let on_storey = floors
        .into_iter()
        .filter(|floor| (floor.y - storey).abs() <= STOREY_M);
    best_of(
        tracer,
        on_storey.map(|floor| floor + DVec3::Y * EYE_HEIGHT_M),
        standing_score,
    )
}

/// How well one stands where this is around: 0 in a nook.
pub(super) fn standing_score(around: Surroundings) -> f64 {
    if around.clearance_m < NARROW_M || around.median_m < ARMS_LENGTH_M {
        return 0.0;
    }
    // Within walls is within walls: a room with one side open is best seen from that side, not from
    // its far corner.
    let within = (around.enclosed / WITHIN_WALLS).min(1.0);
    around.clearance_m.min(AMPLE_M) * around.median_m.min(ROOMY_M) * within * within
}

/// Of the places with the highest scores above zero that of which the score times what there is to
/// see is highest; of equals the first.
fn best_of(
    tracer: &Tracer,
    places: impl Iterator<Item = DVec3>,
    score: impl Fn(Surroundings) -> f64,
) -> Option<DVec3> {
    let scored = places.map(|place| (look_around(tracer, place), place));
    let open = scored.filter(|(around, _)| around.backs < WITHIN_A_SOLID);
    let mut scored: Vec<(f64, DVec3)> =
        open.map(|(around, place)| (score(around), place)).collect();
    scored.retain(|(score, _)| *score > 0.0);
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.truncate(SHORTLIST);
    let seen: Vec<(f64, DVec3)> = scored
        .into_par_iter()
        .map(|(score, place)| (score * best_view(tracer, place).interest, place))
        .collect();
    let most = seen.iter().map(|(seen, _)| *seen).fold(0.0, f64::max);
    seen.into_iter()
        .find(|(seen, _)| *seen >= most)
        .map(|(_, place)| place)
}

/// A place in front of the scene (+Z) from which all of it fits into a view of 60 degrees: at the
/// height of a person's eyes, or of its middle if that is lower.
fn place_before(tracer: &Tracer) -> DVec3 {
    let [low, high] = tracer.scene().bounds();
    let (middle, distance) = ((low + high) / 2.0, (high - low).length());
    let eye_y = (low.y + EYE_HEIGHT_M)
        .min(middle.y)
        .max(high.y - 0.55 * distance);
    (middle + DVec3::Z * distance).with_y(eye_y)
}

/// The floor straight below a place, if a person can stand there.
fn floor_below(tracer: &Tracer, place: DVec3) -> Option<DVec3> {
    let down = cast(tracer, place, Vec3::NEG_Y)?;
    let floor = place - DVec3::Y * f64::from(down.t);
    let is_flat = tracer.scene().geometric_normal(down.primitive).y.abs() > 0.9;
    let knee = floor + DVec3::Y * 0.4;
    let headroom = cast(tracer, knee, Vec3::Y).map_or(f64::INFINITY, |up| f64::from(up.t) + 0.4);
    (is_flat && headroom >= HEADROOM_M && goes_on_around(tracer, floor)).then_some(floor)
}

/// Whether a floor goes on at its own height around a place.
fn goes_on_around(tracer: &Tracer, floor: DVec3) -> bool {
    const PLACES: u32 = 8;
    (0..PLACES).all(|i| {
        let angle = f64::from(i) / f64::from(PLACES) * std::f64::consts::TAU;
        let offset = DVec3::new(angle.cos(), 0.0, angle.sin()) * STANDING_ROOM_M;
        let knee = floor + offset + DVec3::Y * 0.4;
        cast(tracer, knee, Vec3::NEG_Y).is_some_and(|down| (f64::from(down.t) - 0.4).abs() < 0.25)
    })
}

/// The height of floor at which most of the places are.
fn busiest_storey(floors: &[DVec3]) -> Option<f64> {
    let company = |floor: &DVec3| {
        floors
            .iter()
            .filter(|other| (other.y - floor.y).abs() <= STOREY_M / 2.0)
            .count()
    };
    // Of equals the lowest.
    floors
        .iter()
        .map(|floor| (company(floor), -floor.y))
        .max_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))
        .map(|(_, y)| -y)
}
