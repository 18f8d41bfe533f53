//! The floor plan: rooms and the openings in their walls, without triangles.

use glam::{DVec2, DVec3};
use headbox_core::random::Rng;

/// Use of a room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Bedroom,
    Bathroom,
    Study,
    Dining,
    Kitchen,
    Pantry,
    Utility,
    Corridor,
    Hall,
    Dressing,
    Foyer,
    Living,
    Library,
    Workshop,
}

/// A rectangular room, bounded by the middles of its walls.
#[derive(Clone, Debug)]
pub(super) struct Room {
    pub(super) name: &'static str,
    pub(super) purpose: Purpose,
    /// Least (x, z), metres.
    pub(super) low: DVec2,
    /// Greatest (x, z), metres.
    pub(super) high: DVec2,
    /// Height of the ceiling, metres.
    pub(super) ceiling: f64,
}

/// Filling of an opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fill {
    /// An open door, its leaf in the first cell of the opening.
    Leaf,
    /// No filling.
    Free,
    /// A window with a frame and bars in the room's half of the wall.
    Window,
}

/// A rectangular opening in the wall between two cells.
#[derive(Clone, Debug)]
pub(super) struct Opening {
    pub(super) name: String,
    /// Adjacent cells: a room, and a room or [`Floor::outside`].
    pub(super) cells: [usize; 2],
    pub(super) fill: Fill,
    /// Axis perpendicular to the wall: 0 is x, 1 is z.
    pub(super) axis: usize,
    /// Coordinate of the middle of the wall on `axis`, metres.
    pub(super) plane: f64,
    /// Extent along the wall, on the other axis, metres.
    pub(super) span: [f64; 2],
    /// Heights of the lower and upper edge, metres.
    pub(super) heights: [f64; 2],
}

/// Floor plan.
#[derive(Clone, Debug)]
pub(super) struct Floor {
    pub(super) rooms: Vec<Room>,
    pub(super) openings: Vec<Opening>,
    /// Least (x, z) of the middles of the outer walls, metres.
    pub(super) low: DVec2,
    /// Greatest (x, z) of the middles of the outer walls, metres.
    pub(super) high: DVec2,
}

/// Thickness of the walls between rooms, metres.
const INNER_WALL: f64 = 0.14;
/// Thickness of the outer walls, metres.
const OUTER_WALL: f64 = 0.34;

/// Boundaries of the bands of rooms, corridors and rooms, from north to south, metres.
const BANDS: [f64; 4] = [0.0, 5.5, 7.4, 14.0];
/// Boundary between pantry and utility room, metres.
const PANTRY: f64 = 2.7;
/// Largest random shift of a wall between two rooms of a band, metres.
const SHIFT: f64 = 0.25;

/// Rooms of the northern band from west to east: start, metres; name; purpose.
const NORTH: [(f64, &str, Purpose); 6] = [
    (0.0, "Bedroom 1", Purpose::Bedroom),
    (4.5, "Bathroom 1", Purpose::Bathroom),
    (7.0, "Bedroom 2", Purpose::Bedroom),
    (11.0, "Study", Purpose::Study),
    (14.5, "Dining room", Purpose::Dining),
    (19.0, "Kitchen", Purpose::Kitchen),
];
/// Start of the north-eastern corner, which contains two rooms, metres.
const CORNER: f64 = 24.0;
/// Rooms of the middle band.
const MIDDLE: [(f64, &str, Purpose); 3] = [
    (0.0, "West corridor", Purpose::Corridor),
    (11.0, "Hall", Purpose::Hall),
    (17.0, "East corridor", Purpose::Corridor),
];
/// Rooms of the southern band.
const SOUTH: [(f64, &str, Purpose); 7] = [
    (0.0, "Bedroom 3", Purpose::Bedroom),
    (5.0, "Bathroom 2", Purpose::Bathroom),
    (7.5, "Dressing room", Purpose::Dressing),
    (10.0, "Foyer", Purpose::Foyer),
    (13.5, "Living room", Purpose::Living),
    (20.5, "Library", Purpose::Library),
    (24.0, "Workshop", Purpose::Workshop),
];
/// Eastern end of all bands, metres.
const EAST_END: f64 = 27.0;

/// Doors between rooms: the room that the leaf opens into, the other room, and the width, metres.
/// Doors wider than 1 m have no leaf.
const DOORS: [(&str, &str, f64); 29] = [
    ("Bedroom 1", "West corridor", 0.88),
    ("Bathroom 1", "West corridor", 0.8),
    ("Bathroom 1", "Bedroom 1", 0.8),
    ("Bedroom 2", "West corridor", 0.88),
    ("Study", "Hall", 0.88),
    ("Study", "Bedroom 2", 0.88),
    ("Dining room", "Study", 0.88),
    ("Dining room", "Hall", 1.1),
    ("Kitchen", "Dining room", 1.6),
    ("Kitchen", "East corridor", 0.88),
    ("Kitchen", "Pantry", 0.8),
    ("Utility room", "Pantry", 0.8),
    ("Utility room", "East corridor", 0.88),
    ("Kitchen", "Utility room", 0.8),
    ("Hall", "West corridor", 1.2),
    ("Hall", "East corridor", 1.2),
    ("Bedroom 3", "West corridor", 0.88),
    ("Bathroom 2", "Bedroom 3", 0.8),
    ("Bathroom 2", "West corridor", 0.8),
    ("Dressing room", "West corridor", 0.8),
    ("Dressing room", "Foyer", 0.8),
    ("Foyer", "Hall", 1.3),
    ("Living room", "Foyer", 1.4),
    ("Living room", "Hall", 1.3),
    ("Living room", "East corridor", 0.98),
    ("Library", "Living room", 1.8),
    ("Library", "East corridor", 0.88),
    ("Workshop", "Library", 0.88),
    ("Workshop", "East corridor", 0.88),
];

/// Openings to the outside: room, side of the house, position along the room's wall (0 to 1), width
/// and heights of sill and lintel, metres. An opening with a sill of 0 is a door.
const OUTER: [(&str, Side, f64, f64, [f64; 2]); 23] = [
    ("Bedroom 1", Side::North, 0.5, 1.6, [0.9, 2.2]),
    ("Bedroom 1", Side::West, 0.5, 1.4, [0.9, 2.2]),
    ("Bathroom 1", Side::North, 0.5, 0.8, [1.2, 2.1]),
    ("Bedroom 2", Side::North, 0.5, 1.8, [0.9, 2.2]),
    ("Study", Side::North, 0.5, 1.6, [0.9, 2.2]),
    ("Dining room", Side::North, 0.08, 1.3, [0.5, 2.3]),
    ("Dining room", Side::North, 0.92, 1.3, [0.5, 2.3]),
    ("Kitchen", Side::North, 0.25, 1.5, [1.1, 2.2]),
    ("Kitchen", Side::North, 0.8, 1.2, [1.1, 2.2]),
    ("Pantry", Side::North, 0.5, 0.6, [1.4, 2.1]),
    ("Bedroom 3", Side::South, 0.5, 1.8, [0.9, 2.2]),
    ("Bedroom 3", Side::West, 0.5, 1.4, [0.9, 2.2]),
    ("Bathroom 2", Side::South, 0.5, 0.8, [1.2, 2.1]),
    ("Living room", Side::South, 0.05, 1.5, [0.5, 2.4]),
    ("Living room", Side::South, 0.95, 1.5, [0.5, 2.4]),
    ("Library", Side::South, 0.5, 1.6, [0.7, 2.3]),
    ("Workshop", Side::South, 0.5, 1.4, [1.0, 2.2]),
    ("Workshop", Side::East, 0.5, 1.4, [1.0, 2.2]),
    ("West corridor", Side::West, 0.5, 0.9, [0.9, 2.2]),
    ("East corridor", Side::East, 0.5, 0.96, [0.0, 2.1]),
    ("Foyer", Side::South, 0.5, 1.0, [0.0, 2.15]),
    ("Living room", Side::South, 0.5, 1.9, [0.0, 2.4]),
    ("Utility room", Side::East, 0.5, 0.9, [0.0, 2.1]),
];

/// Maximum width of an opening with a leaf, metres.
const WIDEST_LEAF: f64 = 1.0;

/// Height of the doors between rooms, metres.
const DOOR_HEIGHT: f64 = 2.05;

/// Minimum distance between an opening and the middle of an adjacent wall, metres: the thickest
/// half wall and a casing.
const END: f64 = 0.3;

/// A side of the house.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    West,
    East,
    North,
    South,
}

impl Floor {
    pub(super) fn new(rng: &Rng) -> Self {
        let mut random = rng.fork(0);
        let mirrored = random.unit() < 0.5;
        let mut rooms = Vec::new();
        let room = |name, purpose, [x0, x1]: [f64; 2], [z0, z1]: [f64; 2]| Room {
            name,
            purpose,
            low: DVec2::new(x0, z0),
            high: DVec2::new(x1, z1),
            ceiling: ceiling(purpose),
        };
        let mut add_band = |rooms: &mut Vec<Room>,
                            list: &[(f64, &'static str, Purpose)],
                            z: [f64; 2],
                            end: f64| {
            // The ends of the band are fixed; the other boundaries move a little.
            let mut bounds: Vec<f64> = list
                .iter()
                .map(|room| room.0 + SHIFT * (2.0 * random.unit() - 1.0))
                .collect();
            bounds[0] = list[0].0;
            bounds.push(end);
            for (&(_, name, purpose), x) in list.iter().zip(bounds.windows(2)) {
                rooms.push(room(name, purpose, [x[0], x[1]], z));
            }
        };
        let [north, middle, south, end] = BANDS;
        add_band(&mut rooms, &NORTH, [north, middle], CORNER);
        for (name, purpose, z) in [
            ("Pantry", Purpose::Pantry, [north, PANTRY]),
            ("Utility room", Purpose::Utility, [PANTRY, middle]),
        ] {
            rooms.push(room(name, purpose, [CORNER, EAST_END], z));
        }
        add_band(&mut rooms, &MIDDLE, [middle, south], EAST_END);
        add_band(&mut rooms, &SOUTH, [south, end], EAST_END);
        // Centred about the origin, and mirrored for half of the seeds.
        let centre = DVec2::new(EAST_END, BANDS[3]) / 2.0;
        for room in &mut rooms {
            let (low, high) = (room.low - centre, room.high - centre);
            let [west, east] = if mirrored {
                [-high.x, -low.x]
            } else {
                [low.x, high.x]
            };
            (room.low, room.high) = (DVec2::new(west, low.y), DVec2::new(east, high.y));
        }
        let mut plan = Self {
            rooms,
            openings: Vec::new(),
            low: -centre,
            high: centre,
        };
        plan.add_doors(&mut rng.fork(1));
        plan.add_outer_openings(mirrored);
        plan
    }

    /// Returns the index of the outside cell, which follows the rooms.
    pub(super) fn outside(&self) -> usize {
        self.rooms.len()
    }

    /// Returns half of the thickness of the wall in a plane perpendicular to `axis`, metres.
    pub(super) fn half_wall(&self, axis: usize, plane: f64) -> f64 {
        if [self.low[axis], self.high[axis]].contains(&plane) {
            OUTER_WALL / 2.0
        } else {
            INNER_WALL / 2.0
        }
    }

    fn room(&self, name: &str) -> Option<usize> {
        self.rooms.iter().position(|room| room.name == name)
    }

    fn add_doors(&mut self, random: &mut Rng) {
        for (into, from, width) in DOORS {
            let place = random.between(0.25, 0.75);
            let (Some(a), Some(b)) = (self.room(into), self.room(from)) else {
                continue;
            };
            let (r, s) = (&self.rooms[a], &self.rooms[b]);
            // The axis on which the rooms are adjacent.
            let touching = (0..2).find_map(|axis| {
                let planes = [(r.high[axis], s.low[axis]), (r.low[axis], s.high[axis])];
                planes
                    .into_iter()
                    .find(|(end, begin)| end == begin)
                    .map(|(plane, _)| (axis, plane))
            });
            let Some((axis, plane)) = touching else {
                continue;
            };
            let along = 1 - axis;
            let wall = [
                r.low[along].max(s.low[along]),
                r.high[along].min(s.high[along]),
            ];
            let (fill, height) = if width > WIDEST_LEAF {
                (Fill::Free, DOOR_HEIGHT + 0.1)
            } else {
                (Fill::Leaf, DOOR_HEIGHT)
            };
            self.openings.push(Opening {
                name: format!("{into} - {from}"),
                cells: [a, b],
                fill,
                axis,
                plane,
                span: place_span(wall, place, width),
                heights: [0.0, height],
            });
        }
    }

    fn add_outer_openings(&mut self, mirrored: bool) {
        for (name, side, place, width, heights) in OUTER {
            let Some(room) = self.room(name) else {
                continue;
            };
            let r = &self.rooms[room];
            let to_the_east = (side == Side::East) != mirrored;
            let (axis, plane) = match side {
                Side::North => (1, r.low.y),
                Side::South => (1, r.high.y),
                Side::West | Side::East if to_the_east => (0, r.high.x),
                Side::West | Side::East => (0, r.low.x),
            };
            let along = 1 - axis;
            let place = if mirrored && along == 0 {
                1.0 - place
            } else {
                place
            };
            let span = place_span([r.low[along], r.high[along]], place, width);
            let fill = match heights[0] {
                0.0 if width > WIDEST_LEAF => Fill::Free,
                0.0 => Fill::Leaf,
                _ => Fill::Window,
            };
            let what = if fill == Fill::Window {
                "window"
            } else {
                "way out"
            };
            self.openings.push(Opening {
                name: format!("{name} {what} {:?}", side).to_lowercase(),
                cells: [room, self.outside()],
                fill,
                axis,
                plane,
                span,
                heights,
            });
        }
    }
}

/// Returns a span of `width` at a position (0 to 1) within the extent of a wall.
fn place_span([from, to]: [f64; 2], place: f64, width: f64) -> [f64; 2] {
    let (first, last) = (from + END, to - END - width);
    let begin = first + (last - first) * place;
    [begin, begin + width]
}

/// Returns the height of a room's ceiling, metres.
fn ceiling(purpose: Purpose) -> f64 {
    match purpose {
        Purpose::Living | Purpose::Dining | Purpose::Library => 2.95,
        Purpose::Corridor | Purpose::Pantry | Purpose::Utility | Purpose::Dressing => 2.5,
        _ => 2.7,
    }
}

impl Opening {
    /// Returns the corners of the opening in the middle of the wall, counter-clockwise as seen from
    /// its first cell.
    pub(super) fn polygon(&self, plan: &Floor) -> Vec<DVec3> {
        let at = |along: f64, y: f64| point(self.axis, self.plane, along, y);
        let [from, to] = self.span;
        let [sill, lintel] = self.heights;
        let mut corners = vec![
            at(from, sill),
            at(to, sill),
            at(to, lintel),
            at(from, lintel),
        ];
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let room = &plan.rooms[self.cells[0]];
        let to_room = (room.low[self.axis] + room.high[self.axis]) / 2.0 - self.plane;
        let faces_room = normal[[0, 2][self.axis]] * to_room > 0.0;
        if !faces_room {
            corners.reverse();
        }
        corners
    }
}

/// Returns the point at `plane` on `axis` (0 is x, 1 is z), `along` on the other axis, and height
/// `y`.
pub(super) fn point(axis: usize, plane: f64, along: f64, y: f64) -> DVec3 {
    if axis == 0 {
        DVec3::new(plane, y, along)
    } else {
        DVec3::new(along, y, plane)
    }
}
