//! Default placement of the headbox.

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
/// Minimum height above the floor for a standing person, metres.
const HEADROOM_M: f64 = 1.9;
/// Radius around a standing person in which a floor must be level, metres: excludes tables and
/// shelves.
const STANDING_ROOM_M: f64 = 0.6;
/// Maximum height difference of floors of one storey, metres.
const STOREY_M: f64 = 0.5;
/// Maximum horizontal distance of candidate positions from detail, metres.
const DETAIL_REACH_M: f64 = 10.0;
/// Maximum horizontal distance from detail of the positions that tell whether it is in rooms,
/// metres: farther ones are mostly outside of a small house.
const ROOM_REACH_M: f64 = 2.0;
/// Number of seeded candidate positions.
pub(super) const TRIES: u32 = 600;
/// Clearance beyond which a standing position does not improve, metres.
const SUFFICIENT_CLEARANCE_M: f64 = 1.0;
/// Median distance beyond which a standing position does not improve, metres.
const SUFFICIENT_MEDIAN_M: f64 = 10.0;
/// Minimum clearance of a standing position, metres.
const MIN_CLEARANCE_M: f64 = 0.2;
/// Minimum median distance of a standing position, metres.
const MIN_MEDIAN_M: f64 = 1.0;
/// Number of best positions whose views are compared.
const SHORTLIST: usize = 64;
/// Minimum clearance of a free position relative to the scene's diagonal; less is a gap between
/// objects.
const MIN_CLEARANCE_SHARE: f64 = 0.05;
/// Minimum fraction of standing positions under a level ceiling in a scene that has rooms.
const MIN_COVERED: f64 = 0.05;
/// Minimum fraction of standing positions within [`ROOM_REACH_M`] of detail in rooms, in a scene of
/// rooms on large grounds.
const MIN_ROOMS_NEAR_DETAIL: f64 = 0.33;
/// Minimum fraction of directions with surfaces at a covered position that is in a room, and not
/// under a tree or a bridge.
const ROOM_ENCLOSED: f64 = 0.9;
/// Minimum fraction of directions with surfaces inside a room; fewer means next to objects.
const MIN_ENCLOSED: f64 = 0.75;
/// Minimum fraction of visible back faces ([`Surroundings::backs`]) inside a solid, such as a house
/// that is modelled from outside.
const SOLID_BACKS: f64 = 0.99;

/// Maximum distance from the scene, in its diagonals: beyond, it is less than a pixel wide on the
/// largest face (2/8192 of its depth).
const MAX_DIAGONALS_AWAY: f64 = 4096.0;

/// Error of placing a headbox.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum HeadboxError {
    /// The centre is not finite.
    #[error("a headbox about {0}; its centre must be three finite numbers")]
    Centre(DVec3),
    /// The scene would be invisible from there.
    #[error(
        "a headbox about {centre}, so far from the scene that nothing of it would be seen; it reaches from {low} to {high} (metres, Y up)"
    )]
    TooFar {
        /// Requested centre, world metres.
        centre: DVec3,
        /// Lowest corner of the scene.
        low: DVec3,
        /// Highest corner of the scene.
        high: DVec3,
    },
    /// The size is out of range.
    #[error("a headbox of half-size {0} m; it must lie between 1e-9 and 1e9 m")]
    HalfSize(f64),
}

/// Returns the headbox of a scene, world metres: the given values, else those of the scene's file,
/// else [`suggest_headbox`].
///
/// # Errors
/// [`HeadboxError`] if there is no such box.
pub fn place_headbox(
    scene: &Arc<Scene>,
    centre: Option<DVec3>,
    half_size_m: Option<f64>,
) -> Result<Headbox, HeadboxError> {
    let [low, high] = scene.bounds();
    let tracer = || Tracer::new(Arc::clone(scene), (low + high) / 2.0);
    let suggested = match centre {
        Some(_) => None,
        None => Some(scene.headbox.unwrap_or_else(|| suggest_headbox(&tracer()))),
    };
    let centre = centre
        .or(suggested.map(|headbox| headbox.centre))
        .unwrap_or_default();
    let half_size_m = half_size_m
        .or(suggested.map(|headbox| headbox.half_size_m))
        .unwrap_or_else(|| suggest_half_size(&tracer(), centre));
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

/// Suggests the half-size of a headbox about a world position: half the clearance (a cube's corner
/// is 1.73 half-sizes away), but at most a twentieth of the scene's diagonal; if the position
/// touches geometry, a hundredth of the diagonal.
pub(super) fn suggest_half_size(tracer: &Tracer, centre: DVec3) -> f64 {
    let [low, high] = tracer.scene().bounds();
    let diagonal = (high - low).length();
    let fitting = 0.5 * look_around(tracer, centre).clearance_m;
    if fitting < 1e-4 * diagonal {
        0.01 * diagonal
    } else {
        fitting.min(0.05 * diagonal)
    }
}

/// Reduces a half-size to what a number of rays can fill: disocclusions grow with the headbox, and
/// are found by the rays left after one for every pixel of the faces.
///
/// `rays_per_pixel` is the number of rays over the pixels of all faces. With 16, the paper's
/// density, the half-size is unchanged; with fewer it falls with their square root, to a quarter at
/// least.
pub fn fitting_half_size(half_size_m: f64, rays_per_pixel: f64) -> f64 {
    /// 32^4 strata of 16 rays on faces of 1024 pixels.
    const AMPLE_RAYS_PER_PIXEL: f64 = 16.0;
    half_size_m
        * (rays_per_pixel / AMPLE_RAYS_PER_PIXEL)
            .sqrt()
            .clamp(0.25, 1.0)
}

/// Suggests a headbox at the eyes of a person standing on a floor, at the best of some seeded
/// positions, anywhere and near detail, by clearance and view; without room to stand, at a free
/// position in the lower part of the scene's bounding box; without one (a statue, a tree, a house
/// without ground), in front of the scene.
pub fn suggest_headbox(tracer: &Tracer) -> Headbox {
    let centre = standing_place(tracer)
        .or_else(|| free_place(tracer))
        .unwrap_or_else(|| place_in_front(tracer));
    Headbox {
        centre,
        half_size_m: suggest_half_size(tracer, centre),
    }
}

/// Returns the `i`-th random position in a box.
pub(super) fn seeded_place(i: u32, low: DVec3, high: DVec3) -> DVec3 {
    let [x, y, z, _] = random4([i, 0xb0c5, 0, 0]).map(|r| f64::from(unit_float(r)));
    low + (high - low) * DVec3::new(x, y, z)
}

/// Returns the `i`-th random position near a triangle, at most `reach_m` beside it: detail is where
/// triangles are. In a scene without triangles any position.
fn place_near_detail(tracer: &Tracer, i: u32, reach_m: f64, [low, high]: [DVec3; 2]) -> DVec3 {
    let scene = tracer.scene();
    let [pick, turn, share, _] = random4([i, 0xde7a, 0, 0]).map(|r| f64::from(unit_float(r)));
    let triangle = (pick * scene.triangles.len() as f64) as usize;
    if triangle >= scene.triangles.len() {
        return seeded_place(i, low, high);
    }
    let middle = scene.corners(triangle as u32).iter().sum::<DVec3>() / 3.0;
    let angle = turn * std::f64::consts::TAU;
    let offset = DVec3::new(angle.cos(), 0.0, angle.sin()) * (share * reach_m);
    (middle + offset).clamp(low, high)
}

/// Returns the best free position in the lower part of the scene's bounding box.
fn free_place(tracer: &Tracer) -> Option<DVec3> {
    let [low, high] = tracer.scene().bounds();
    let diagonal = (high - low).length();
    // The lower part of the box: scenes are usually viewed from near the ground.
    let [floor, ceiling] = [0.1, 0.6].map(|share| low.y + (high.y - low.y) * share);
    let (low, high) = (
        DVec3::new(low.x, floor, low.z),
        DVec3::new(high.x, ceiling, high.z),
    );
    let score = |around: Surroundings| {
        if around.clearance_m >= MIN_CLEARANCE_SHARE * diagonal && around.enclosed >= MIN_ENCLOSED {
            around.clearance_m * around.enclosed * around.enclosed
        } else {
            0.0
        }
    };
    find_best(
        tracer,
        (0..TRIES).map(|i| seeded_place(i, low, high)),
        score,
    )
}

/// A floor on which a person can stand.
pub(super) struct Floor {
    place: DVec3,
    /// True under a level ceiling.
    is_covered: bool,
    /// True where nearly all directions show surfaces: in a room, not under a tree or a bridge.
    is_enclosed: bool,
    /// False inside a solid.
    is_open: bool,
}

impl Floor {
    fn new(tracer: &Tracer, place: DVec3) -> Self {
        let ceiling = cast(tracer, place + DVec3::Y * 0.4, Vec3::Y);
        let around = look_around(tracer, place + DVec3::Y * EYE_HEIGHT_M);
        Self {
            place,
            is_covered: ceiling
                .is_some_and(|hit| tracer.scene().geometric_normal(hit.primitive).y.abs() > 0.7),
            is_enclosed: around.enclosed >= ROOM_ENCLOSED,
            is_open: around.backs < SOLID_BACKS,
        }
    }
}

/// Returns the floors below positions on which a person can stand.
fn floors_below(tracer: &Tracer, places: impl Iterator<Item = DVec3>) -> Vec<Floor> {
    let places: Vec<DVec3> = places.collect();
    places
        .into_par_iter()
        .filter_map(|place| find_floor(tracer, place))
        .map(|place| Floor::new(tracer, place))
        .collect()
}

/// Returns the floors below random positions in the scene's bounds.
pub(super) fn floors_anywhere(tracer: &Tracer) -> Vec<Floor> {
    let [low, high] = tracer.scene().bounds();
    floors_below(tracer, (0..TRIES).map(|i| seeded_place(i, low, high)))
}

/// Returns the floors below random positions at most `reach_m` beside detail.
fn floors_near_detail(tracer: &Tracer, reach_m: f64) -> Vec<Floor> {
    let bounds = tracer.scene().bounds();
    let places = (0..TRIES).map(|i| place_near_detail(tracer, i, reach_m, bounds));
    floors_below(tracer, places)
}

/// Returns true if the scene is one of rooms: many of its floors are covered, or many of those near
/// detail are in rooms.
pub(super) fn has_rooms(tracer: &Tracer, anywhere: &[Floor]) -> bool {
    let is_share = |floors: &[Floor], is_room: fn(&Floor) -> bool, share: f64| {
        let open = floors.iter().filter(|floor| floor.is_open);
        let rooms = open.clone().filter(|floor| is_room(floor)).count();
        rooms > 0 && rooms as f64 >= share * open.count() as f64
    };
    is_share(anywhere, |floor| floor.is_covered, MIN_COVERED)
        || is_share(
            &floors_near_detail(tracer, ROOM_REACH_M),
            |floor| floor.is_covered && floor.is_enclosed,
            MIN_ROOMS_NEAR_DETAIL,
        )
}

/// Returns the eye position at the best standing position. Rooms come before the roof above them,
/// which is emptier and often larger, and before the ground around them.
fn standing_place(tracer: &Tracer) -> Option<DVec3> {
    let anywhere = floors_anywhere(tracer);
    let has_rooms = has_rooms(tracer, &anywhere);
    let floors: Vec<Floor> = anywhere
        .into_iter()
        .chain(floors_near_detail(tracer, DETAIL_REACH_M))
        .filter(|floor| !has_rooms || floor.is_covered)
        .collect();
    // Floors inside solids take part: the roofs of these are another storey.
    let storey = busiest_storey(&floors)?;
    let on_storey = floors
        .into_iter()
        .filter(|floor| floor.is_open && (floor.place.y - storey).abs() <= STOREY_M);
    find_best(
        tracer,
        on_storey.map(|floor| floor.place + DVec3::Y * EYE_HEIGHT_M),
        standing_score,
    )
}

/// Returns the score of a standing position from its surroundings: 0 in a narrow gap.
pub(super) fn standing_score(around: Surroundings) -> f64 {
    if around.clearance_m < MIN_CLEARANCE_M || around.median_m < MIN_MEDIAN_M {
        return 0.0;
    }
    // Saturates at the threshold: a room with one open side is best seen from that side, not from
    // its far corner.
    let enclosed = (around.enclosed / MIN_ENCLOSED).min(1.0);
    around.clearance_m.min(SUFFICIENT_CLEARANCE_M)
        * around.median_m.min(SUFFICIENT_MEDIAN_M)
        * enclosed
        * enclosed
}

/// Returns the position with the highest product of score and interest of its view, among those
/// with the highest scores above zero; the first of equals.
fn find_best(
    tracer: &Tracer,
    places: impl Iterator<Item = DVec3>,
    score: impl Fn(Surroundings) -> f64,
) -> Option<DVec3> {
    let scored = places.map(|place| (look_around(tracer, place), place));
    let mut scored: Vec<(f64, DVec3)> = scored
        .filter(|(around, _)| around.backs < SOLID_BACKS)
        .map(|(around, place)| (score(around), place))
        .filter(|(score, _)| *score > 0.0)
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.truncate(SHORTLIST);
    let products: Vec<(f64, DVec3)> = scored
        .into_par_iter()
        .map(|(score, place)| (score * best_view(tracer, place).interest, place))
        .collect();
    let greatest = products.iter().map(|(p, _)| *p).fold(0.0, f64::max);
    products
        .into_iter()
        .find(|(product, _)| *product >= greatest)
        .map(|(_, place)| place)
}

/// Returns a position in front of the scene (+Z), at the height of its middle, from which it just
/// fits into a frame of 4:3 with a vertical field of view of 60 degrees.
pub(super) fn place_in_front(tracer: &Tracer) -> DVec3 {
    /// Half the height and half the width of the frame, as tangents.
    const HALF_FRAME: [f64; 2] = [0.577, 0.770];
    let [low, high] = tracer.scene().bounds();
    let half_size = (high - low) / 2.0;
    let distance = (half_size.y / HALF_FRAME[0]).max(half_size.x / HALF_FRAME[1]);
    // A flat scene that is seen edge-on is viewed from outside of its box, too.
    let distance = distance.max(0.1 * half_size.length());
    (low + high) / 2.0 + DVec3::Z * (half_size.z + distance)
}

/// Returns the floor below a position, if a person can stand there.
pub(super) fn find_floor(tracer: &Tracer, place: DVec3) -> Option<DVec3> {
    let down = cast(tracer, place, Vec3::NEG_Y)?;
    let floor = place - DVec3::Y * f64::from(down.t);
    let is_flat = tracer.scene().geometric_normal(down.primitive).y.abs() > 0.9;
    let knee = floor + DVec3::Y * 0.4;
    let headroom = cast(tracer, knee, Vec3::Y).map_or(f64::INFINITY, |up| f64::from(up.t) + 0.4);
    (is_flat && headroom >= HEADROOM_M && is_level_around(tracer, floor)).then_some(floor)
}

/// Returns true if a floor is level around a position.
fn is_level_around(tracer: &Tracer, floor: DVec3) -> bool {
    const PLACES: u32 = 8;
    (0..PLACES).all(|i| {
        let angle = f64::from(i) / f64::from(PLACES) * std::f64::consts::TAU;
        let offset = DVec3::new(angle.cos(), 0.0, angle.sin()) * STANDING_ROOM_M;
        let knee = floor + offset + DVec3::Y * 0.4;
        cast(tracer, knee, Vec3::NEG_Y).is_some_and(|down| (f64::from(down.t) - 0.4).abs() < 0.25)
    })
}

/// Returns the floor height with the most positions within half a storey's tolerance; the lowest of
/// equals.
fn busiest_storey(floors: &[Floor]) -> Option<f64> {
    let heights = || floors.iter().map(|floor| floor.place.y);
    let neighbours = |y: f64| {
        heights()
            .filter(|other| (other - y).abs() <= STOREY_M / 2.0)
            .count()
    };
    heights()
        .map(|y| (neighbours(y), -y))
        .max_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))
        .map(|(_, y)| -y)
}
