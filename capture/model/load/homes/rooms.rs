//! Rooms of a home: cells, and portals between them.

use super::additions;
use super::plan::home::{Home, Opening, Room};
use super::sweethome::UNIT_M;
use crate::{Cell, Portal, PortalModel, Prism};
use glam::{DVec2, DVec3};

/// Distance from the wall's faces within which a room is searched, centimetres: rooms are often
/// drawn slightly short of walls.
const REACH: f64 = 40.0;
/// Step of the search, centimetres.
const STEP: f64 = 1.0;

/// Greatest height of a door above its room's floor, metres; windows are higher.
const MAX_DOOR_SILL_M: f64 = 0.05;

/// Returns a cell for each room with a ceiling.
pub(super) fn room_cells(home: &Home, notes: &mut Vec<String>) -> Vec<Cell> {
    let cell = |(index, room): (usize, &Room)| {
        if !room.covered {
            notes.push(format!(
                "{} has no ceiling and is part of the outside",
                room_name(index, room)
            ));
            return None;
        }
        let prism = Prism {
            outline: room.outline.iter().map(|&corner| corner * UNIT_M).collect(),
            floor_y: room.floor * UNIT_M,
            ceiling_y: room.ceiling() * UNIT_M,
        };
        Some(Cell::new(room_name(index, room), vec![prism]))
    };
    home.rooms.iter().enumerate().filter_map(cell).collect()
}

fn room_name(index: usize, room: &Room) -> String {
    if room.name.is_empty() {
        format!("Room {}", index + 1)
    } else {
        room.name.clone()
    }
}

/// Adds the portal of a door or window, and the space in the wall to the rooms on its two sides.
pub(super) fn add_portal(model: &mut PortalModel, opening: &Opening) {
    let across = opening.across();
    let half = opening.along * (opening.width / 2.0);
    let [bottom, top] = opening.heights;
    let (middle, rooms) = RoomSearch { model, opening }.middle_and_rooms();
    for (found, side) in rooms.into_iter().zip([1.0, -1.0]) {
        if let Some((cell, distance)) = found {
            let far = across * (side * (distance + STEP));
            let outline = [
                middle - half,
                middle + half,
                middle + half + far,
                middle - half + far,
            ];
            let outline = outline.map(|corner| corner * UNIT_M);
            let prism = Prism {
                outline: outline.to_vec(),
                floor_y: bottom * UNIT_M,
                ceiling_y: top * UNIT_M,
            };
            let floor_y = model.cells[cell as usize].space[0].floor_y;
            if (prism.floor_y - floor_y).abs() < MAX_DOOR_SILL_M {
                additions::threshold(&mut model.scene, outline, floor_y);
            }
            model.cells[cell as usize].space.push(prism);
        }
    }
    let corner = |end: DVec2, y: f64| DVec3::new(end.x, y, end.y) * UNIT_M;
    let (left, right) = (middle - half, middle + half);
    // `across` is `along` rotated from x toward z, so that `along x up` is parallel to it, toward
    // the first cell.
    let polygon = vec![
        corner(left, bottom),
        corner(right, bottom),
        corner(right, top),
        corner(left, top),
    ];
    let outside = model.outside.unwrap_or_default();
    let cells = rooms.map(|found| found.map_or(outside, |(cell, _)| cell));
    model.portals.push(Portal {
        name: opening.name.clone(),
        cells,
        polygon,
    });
}

/// Search for the rooms on both sides of an opening.
struct RoomSearch<'a> {
    model: &'a PortalModel,
    opening: &'a Opening,
}

impl RoomSearch<'_> {
    /// Returns the room at a signed distance from the middle of the wall.
    fn room_at(&self, distance: f64) -> Option<u32> {
        let opening = self.opening;
        let at = (opening.in_wall() + opening.across() * distance) * UNIT_M;
        let y = (opening.heights[0] + opening.heights[1]) / 2.0 * UNIT_M;
        self.model
            .cell_at(DVec3::new(at.x, y, at.y))
            .filter(|&cell| self.model.outside != Some(cell))
    }

    /// Returns the nearest room on a side, other than `except`, and its distance from the middle of
    /// the wall.
    fn nearest_room(&self, side: f64, except: Option<u32>) -> Option<(u32, f64)> {
        let steps = ((self.opening.wall_thickness / 2.0 + REACH) / STEP) as usize;
        let mut distances = (1..=steps).map(|step| step as f64 * STEP);
        distances.find_map(|distance| {
            let room = self
                .room_at(side * distance)
                .filter(|&room| Some(room) != except)?;
            Some((room, distance))
        })
    }

    /// Returns the position of the portal, and the rooms in front of and behind it with their
    /// distances: the middle of the wall, or the end of a room that was drawn through the whole
    /// wall.
    fn middle_and_rooms(&self) -> (DVec2, [Option<(u32, f64)>; 2]) {
        let rooms = [1.0, -1.0].map(|side| self.nearest_room(side, None));
        let middle = self.opening.in_wall();
        let (Some((front, _)), Some((back, _))) = (rooms[0], rooms[1]) else {
            return (middle, rooms);
        };
        if front != back {
            return (middle, rooms);
        }
        let beyond = |side: f64| {
            self.nearest_room(side, Some(front))
                .map(|(room, distance)| (room, distance, side))
        };
        let nearer = [beyond(1.0), beyond(-1.0)]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((room, distance, side)) = nearer else {
            return (middle, rooms);
        };
        let end = (0..)
            .map(|step| f64::from(step) * STEP)
            .take_while(|d| *d < distance)
            .filter(|d| self.room_at(side * d) == Some(front))
            .last()
            .unwrap_or(0.0);
        let mut shifted = [Some((front, 0.0)), Some((room, distance - end))];
        if side > 0.0 {
            shifted.reverse();
        }
        (middle + self.opening.across() * (side * end), shifted)
    }
}
