//! Heights of ceilings, and restored ceilings.

use super::plan::home::{Home, Room};
use super::plan::walls::Wall;
use crate::distance_to_outline;
use glam::DVec2;

/// Maximum distance from a room's corner of the end of a wall that carries the ceiling there,
/// centimetres: rooms are drawn to the faces of walls, and the centre lines of joined walls end a
/// wall's thickness apart.
const CORNER_REACH: f64 = 60.0;

/// Least height of such a wall, as a share of the storey's height; counters and parapets are lower.
const MIN_HEIGHT_SHARE: f64 = 0.75;

/// Maximum distance from a room's outline of the faces of its walls, and of adjacent rooms without
/// a wall between, centimetres.
const ADJACENT: f64 = 40.0;

/// Step along an outline, centimetres.
const STEP: f64 = 10.0;

/// Maximum number of steps along an edge.
const MAX_STEPS: f64 = 300.0;

/// Least share of an outline along walls or other rooms for a ceiling; a terrace has less.
const MIN_ENCLOSED: f64 = 0.8;

impl Home {
    /// Raises the ceilings of the topmost storey, except flat ones, to its walls, which may be
    /// higher than the storey and slope under a roof. Each corner gets the height of the highest
    /// wall that ends there, or else of the nearest high wall. Low walls count if a wall slopes:
    /// under a roof they are not parapets.
    pub(super) fn raise_ceilings(&mut self) {
        let is_raised = |room: &&mut Room| room.is_topmost && !room.ceiling_is_flat;
        for room in self.rooms.iter_mut().filter(is_raised) {
            let walls = || self.walls.iter().filter(|wall| wall.is_on_storey_of(room));
            let ends: Vec<(DVec2, f64)> = walls().flat_map(upper_ends).collect();
            let high = room.floor + MIN_HEIGHT_SHARE * (room.ceiling() - room.floor);
            let least = if walls().any(|wall| wall.heights[0] != wall.heights[1]) {
                f64::NEG_INFINITY
            } else {
                high
            };
            for (corner, ceiling) in room.outline.iter().zip(&mut room.ceilings) {
                let distance = |(end, _): &&(DVec2, f64)| end.distance(*corner);
                let here = ends
                    .iter()
                    .filter(|end| distance(end) <= CORNER_REACH && end.1 >= least)
                    .map(|(_, top)| *top)
                    .reduce(f64::max);
                let nearest = || {
                    let high = ends.iter().filter(|(_, top)| *top >= high);
                    high.min_by(|a, b| distance(a).total_cmp(&distance(b)))
                        .map(|(_, top)| *top)
                };
                *ceiling = here.or_else(nearest).unwrap_or(*ceiling);
            }
        }
    }

    /// Returns the number of rooms below the topmost storey whose ceiling stays level although
    /// walls of theirs slope.
    pub(super) fn rooms_under_slopes(&self) -> usize {
        let is_sloping = |room: &&Room| {
            let corner_is_near = |wall: &Wall| {
                let ends = [wall.start, wall.end];
                room.outline
                    .iter()
                    .any(|corner| ends.iter().any(|end| end.distance(*corner) <= CORNER_REACH))
            };
            self.walls.iter().any(|wall| {
                wall.heights[0] != wall.heights[1]
                    && wall.is_on_storey_of(room)
                    && corner_is_near(wall)
            })
        };
        let below = |room: &&Room| room.covered && !room.is_topmost;
        self.rooms.iter().filter(below).filter(is_sloping).count()
    }

    /// Restores ceilings that were switched off: if no room of a home has one, rooms enclosed by
    /// walls or other rooms get theirs. Returns their number.
    pub(super) fn restore_ceilings(&mut self) -> usize {
        if self.rooms.iter().any(|room| room.covered) {
            return 0;
        }
        let enclosed: Vec<usize> = (0..self.rooms.len())
            .filter(|&index| self.is_enclosed(index))
            .collect();
        for &index in &enclosed {
            (self.rooms[index].covered, self.rooms[index].ceiling_is_new) = (true, true);
        }
        enclosed.len()
    }

    /// Returns true if most of a room's outline is along walls or other rooms.
    fn is_enclosed(&self, index: usize) -> bool {
        let room = &self.rooms[index];
        let walls: Vec<&Wall> = self
            .walls
            .iter()
            .filter(|wall| wall.is_on_storey_of(room) && wall.is_high_in(room))
            .collect();
        let others: Vec<&Room> = self
            .rooms
            .iter()
            .enumerate()
            .filter(|&(i, other)| i != index && other.floor == room.floor)
            .map(|(_, r)| r)
            .collect();
        let is_closed = |p: DVec2| {
            walls.iter().any(|wall| {
                distance_to_outline(&[wall.start, wall.end], p) <= wall.thickness / 2.0 + ADJACENT
            }) || others
                .iter()
                .any(|other| distance_to_outline(&other.outline, p) <= ADJACENT)
        };
        let (mut all, mut closed) = (0u32, 0u32);
        for (from, to) in room.outline.iter().zip(room.outline.iter().cycle().skip(1)) {
            let steps = (from.distance(*to) / STEP).ceil().min(MAX_STEPS) as usize;
            for step in 0..steps {
                all += 1;
                closed += u32::from(is_closed(
                    from.lerp(*to, (step as f64 + 0.5) / steps as f64),
                ));
            }
        }
        f64::from(closed) >= MIN_ENCLOSED * f64::from(all)
    }
}

impl Wall {
    /// Returns true if the wall is on the storey of a room.
    fn is_on_storey_of(&self, room: &Room) -> bool {
        self.bottom == room.floor
    }

    /// Returns true if the wall is higher than a parapet in a room.
    fn is_high_in(&self, room: &Room) -> bool {
        self.heights[0].min(self.heights[1]) >= (room.ceiling() - room.floor) / 2.0
    }
}

/// Returns the ends of a wall in plan, with the heights of its upper edge.
fn upper_ends(wall: &Wall) -> [(DVec2, f64); 2] {
    [
        (wall.start, wall.bottom + wall.heights[0]),
        (wall.end, wall.bottom + wall.heights[1]),
    ]
}
