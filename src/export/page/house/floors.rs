//! Walkable area of a house, a grid per storey.
//!
//! A node is free if an eye above it is in a room and no surface at its height is nearer than a
//! shoulder; also in doors, because a model may have closed leaves. Windows are never free.

use glam::{DVec2, DVec3, Vec3};
use headbox_house::house::{EYE_HEIGHT_M, House, REVEAL_M};
use headbox_house::portal_opening::Opening;
use headbox_house::walk_path::door;
use headbox_model::{Portal, Prism};
use headbox_trace::bvh::Ray;
use rayon::prelude::*;
use serde_json::{Value, json};

/// Distance between nodes, metres, unless a storey is very large.
const STEP_M: f64 = 0.05;
/// Maximum number of nodes along a side.
const MAX_NODES: f64 = 2000.0;
/// Floors nearer than this belong to one storey, metres.
const STOREY_M: f64 = 0.5;
/// Height below which a space is a window niche rather than a room, metres.
const ROOM_M: f64 = 1.8;
/// Horizontal distance between the eye and surfaces, metres; twice this exceeds the step, so that
/// even a thin sheet cannot be crossed.
const SHOULDER_M: f32 = 0.15;

/// Walkable grid of a storey.
#[derive(Debug)]
pub(super) struct Floor {
    /// Height of the eye, and position of the first node (x, z); world metres.
    eye_y: f64,
    low: DVec2,
    step: f64,
    columns: usize,
    rows: usize,
    /// Row by row: 1 for a free node, else 0.
    pub(super) free: Vec<u8>,
}

impl Floor {
    pub(super) fn header(&self, origin: DVec3) -> Value {
        let low = [self.low.x - origin.x, self.low.y - origin.z];
        json!({
            "height": self.eye_y - origin.y, "low": low, "step": self.step, "columns": self.columns, "rows": self.rows,
        })
    }
}

/// Portal as seen by a walker.
struct WalkablePortal {
    opening: Opening,
    is_door: bool,
}

impl WalkablePortal {
    fn new(house: &House, portal: &Portal) -> Option<Self> {
        let opening = Opening::new(portal, 0)?;
        let is_door = portal.cells.iter().all(|cell| {
            house.plan().outside == Some(*cell) || door(house.plan(), portal, *cell).is_some()
        });
        Some(Self { opening, is_door })
    }

    /// Returns true if an eye is in the opening, away from its jambs.
    fn contains(&self, eye: DVec3) -> bool {
        let aside = self.opening.right * f64::from(SHOULDER_M).min(self.opening.half.x / 2.0);
        self.opening.distance_in_front(eye).abs() < REVEAL_M
            && [eye - aside, eye + aside]
                .iter()
                .all(|p| self.opening.contains(*p))
    }
}

/// Returns the walkable grids of a house, the lowest storey first.
pub(super) fn floors(house: &House) -> Vec<Floor> {
    let is_room =
        |prism: &&Prism| prism.floor_y.is_finite() && prism.ceiling_y - prism.floor_y >= ROOM_M;
    let rooms = || {
        house
            .plan()
            .cells
            .iter()
            .flat_map(|cell| &cell.space)
            .filter(is_room)
    };
    let mut heights: Vec<f64> = rooms().map(|prism| prism.floor_y).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup_by(|next, kept| *next - *kept < STOREY_M);
    let passages: Vec<WalkablePortal> = house
        .plan()
        .portals
        .iter()
        .filter_map(|portal| WalkablePortal::new(house, portal))
        .collect();
    let storey = |height: &f64| {
        let here: Vec<&Prism> = rooms()
            .filter(|prism| (0.0..STOREY_M).contains(&(prism.floor_y - height)))
            .collect();
        floor(house, &passages, &here, height + EYE_HEIGHT_M)
    };
    heights.iter().filter_map(storey).collect()
}

fn floor(
    house: &House,
    passages: &[WalkablePortal],
    rooms: &[&Prism],
    eye_y: f64,
) -> Option<Floor> {
    let corners = || {
        rooms
            .iter()
            .flat_map(|prism| prism.outline.iter().copied())
            .filter(|p| p.is_finite())
    };
    let (low, high) = (corners().reduce(DVec2::min)?, corners().reduce(DVec2::max)?);
    let step = STEP_M.max((high - low).max_element() / MAX_NODES);
    let [columns, rows] =
        [high.x - low.x, high.y - low.y].map(|side| (side / step).ceil() as usize + 1);
    let at = |i: usize| {
        DVec3::new(
            low.x + (i % columns) as f64 * step,
            eye_y,
            low.y + (i / columns) as f64 * step,
        )
    };
    let free = (0..columns * rows)
        .into_par_iter()
        .map(|i| u8::from(is_free(house, passages, at(i))));
    Some(Floor {
        eye_y,
        low,
        step,
        columns,
        rows,
        free: free.collect(),
    })
}

fn is_free(house: &House, passages: &[WalkablePortal], eye: DVec3) -> bool {
    let in_room = house
        .find_cell(eye)
        .is_some_and(|cell| house.plan().outside != Some(cell));
    let holds = |is_door: bool| {
        passages
            .iter()
            .any(|passage| passage.is_door == is_door && passage.contains(eye))
    };
    in_room && (holds(true) || !holds(false) && has_elbow_room(house, eye))
}

/// Returns true if no surface is within a shoulder's width of an eye, in eight directions.
fn has_elbow_room(house: &House, eye: DVec3) -> bool {
    let origin = (eye - house.tracer().origin()).as_vec3();
    let diagonal = std::f32::consts::FRAC_1_SQRT_2;
    let half = [
        [1.0, 0.0],
        [diagonal, diagonal],
        [0.0, 1.0],
        [-diagonal, diagonal],
    ];
    half.iter()
        .flat_map(|[x, z]| [Vec3::new(*x, 0.0, *z), Vec3::new(-x, 0.0, -z)])
        .all(|direction| {
            !house.tracer().occluded(&Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max: SHOULDER_M,
            })
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_house::walk_path::WalkPath;

    /// Numbers of the places that one can walk to from another, in steps to neighbours.
    fn reached(floor: &Floor, from: usize) -> Vec<usize> {
        let (mut seen, mut left) = (vec![false; floor.free.len()], vec![from]);
        while let Some(i) = left.pop() {
            if floor.free[i] == 0 || std::mem::replace(&mut seen[i], true) {
                continue;
            }
            let (column, row) = (i % floor.columns, i / floor.columns);
            left.extend(
                [
                    (column > 0).then(|| i - 1),
                    (column + 1 < floor.columns).then(|| i + 1),
                    (row > 0).then(|| i - floor.columns),
                    (row + 1 < floor.rows).then(|| i + floor.columns),
                ]
                .into_iter()
                .flatten(),
            );
        }
        (0..seen.len()).filter(|i| seen[*i]).collect()
    }

    #[test]
    fn walk_grid_reaches_rooms_not_through_walls() {
        let mut model = headbox_scenes::house(0, 6_000);
        model.repair();
        let house = House::new(model).expect("a house");
        let all = floors(&house);
        let [floor] = all.as_slice() else {
            panic!("one storey, not {}", all.len())
        };
        let eye = WalkPath::first(&house)
            .expect("a camera")
            .expect("a room")
            .eye();
        let place = |p: DVec3| {
            let [column, row] =
                [p.x - floor.low.x, p.z - floor.low.y].map(|d| (d / floor.step).round() as usize);
            row * floor.columns + column
        };
        let at = |i: usize| {
            let (column, row) = ((i % floor.columns) as f64, (i / floor.columns) as f64);
            DVec3::new(
                floor.low.x + column * floor.step,
                floor.eye_y,
                floor.low.y + row * floor.step,
            )
        };
        let reached = reached(floor, place(eye));
        let mut entered = vec![false; house.plan().cells.len()];
        for i in &reached {
            let cell = house.find_cell(at(*i)).expect("in a room") as usize;
            entered[cell] = true;
        }
        let outside = house.plan().outside.expect("an outside") as usize;
        let left_out: Vec<usize> = (0..entered.len()).filter(|cell| !entered[*cell]).collect();
        assert_eq!(left_out, [outside], "of {} cells", entered.len());
        // From each place to those beside it there is no wall but closed leaves in doors.
        let passages: Vec<WalkablePortal> = house
            .plan()
            .portals
            .iter()
            .filter_map(|p| WalkablePortal::new(&house, p))
            .collect();
        for i in reached {
            let from = at(i);
            for (beside, direction) in [(i + 1, Vec3::X), (i + floor.columns, Vec3::Z)] {
                let both = floor.free.get(beside) == Some(&1)
                    && (beside % floor.columns != 0 || direction == Vec3::Z);
                if !both
                    || passages
                        .iter()
                        .any(|p| p.is_door && (p.contains(from) || p.contains(at(beside))))
                {
                    continue;
                }
                let origin = (from - house.tracer().origin()).as_vec3();
                let ray = Ray {
                    origin,
                    direction,
                    t_min: 0.0,
                    t_max: floor.step as f32,
                };
                assert!(
                    !house.tracer().occluded(&ray),
                    "from {from} along {direction}"
                );
            }
        }
    }

    #[test]
    fn windows_are_not_passed() {
        let mut model = headbox_scenes::house(0, 6_000);
        model.repair();
        let house = House::new(model).expect("a house");
        let outside = house.plan().outside;
        let passages = house
            .plan()
            .portals
            .iter()
            .map(|p| (p, WalkablePortal::new(&house, p).expect("an area")));
        let (doors, windows): (Vec<_>, Vec<_>) = passages.partition(|(_, passage)| passage.is_door);
        assert!(
            doors.len() > 10 && windows.len() > 10,
            "{} doors, {} windows",
            doors.len(),
            windows.len()
        );
        let high = |(_, passage): &(&Portal, WalkablePortal)| passage.opening.half.y * 2.0 > 1.9;
        assert!(
            doors.iter().all(high)
                && windows
                    .iter()
                    .all(|(p, _)| outside.is_some_and(|o| p.cells.contains(&o)))
        );
    }
}
