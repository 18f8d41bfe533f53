//! The floor plan: rooms, and the openings in their walls. Pure numbers, no triangles.

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

/// A room between the middles of its walls.
#[derive(Clone, Debug)]
pub(super) struct Room {
    pub(super) name: &'static str,
    pub(super) purpose: Purpose,
    /// Least and greatest (x, z) in the middles of the walls, metres.
    pub(super) low: DVec2,
    pub(super) high: DVec2,
    /// Height of the ceiling, metres.
    pub(super) ceiling: f64,
}

/// Filling of an opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fill {
    /// A door that stands open, its leaf in the first cell of the opening.
    Leaf,
    /// Nothing.
    Free,
    /// A window with a frame and bars in the room's half of the wall.
    Window,
}

/// A rectangular opening in the wall between two cells.
#[derive(Clone, Debug)]
pub(super) struct Opening {
    pub(super) name: String,
    /// The two cells; the outside is [`Floor::outside`]. The first is a room.
    pub(super) cells: [usize; 2],
    pub(super) fill: Fill,
    /// The axis that the wall is perpendicular to: 0 is x, 1 is z.
    pub(super) axis: usize,
    /// Middle of the wall on that axis.
    pub(super) plane: f64,
    /// Extent of the opening along the wall (on the other axis).
    pub(super) span: [f64; 2],
    /// Heights of its lower and upper edge.
    pub(super) heights: [f64; 2],
}

/// A whole floor.
#[derive(Clone, Debug)]
pub(super) struct Floor {
    pub(super) rooms: Vec<Room>,
    pub(super) openings: Vec<Opening>,
    /// Least and greatest (x, z) in the middles of the outer walls.
    pub(super) low: DVec2,
    pub(super) high: DVec2,
}

/// Thickness of the walls between rooms, metres.
const INNER_WALL: f64 = 0.14;
/// Thickness of the outer walls, metres.
const OUTER_WALL: f64 = 0.34;

/// North to south: where the bands of rooms, corridors and rooms begin and end.
const BANDS: [f64; 4] = [0.0, 5.5, 7.4, 14.0];
/// Boundary between pantry and utility room.
const PANTRY: f64 = 2.7;
/// Largest random shift of a wall between two rooms of a band, metres.
const SHIFT: f64 = 0.25;

/// West to east: rooms of the northern band, with the x at which each begins.
const NORTH: [(f64, &str, Purpose); 6] = [
    (0.0, "Bedroom 1", Purpose::Bedroom),
    (4.5, "Bathroom 1", Purpose::Bathroom),
    (7.0, "Bedroom 2", Purpose::Bedroom),
    (11.0, "Study", Purpose::Study),
    (14.5, "Dining room", Purpose::Dining),
    (19.0, "Kitchen", Purpose::Kitchen),
];
/// The north-eastern corner is divided into two.
const CORNER: f64 = 24.0;
const MIDDLE: [(f64, &str, Purpose); 3] = [
    (0.0, "West corridor", Purpose::Corridor),
    (11.0, "Hall", Purpose::Hall),
    (17.0, "East corridor", Purpose::Corridor),
];
const SOUTH: [(f64, &str, Purpose); 7] = [
    (0.0, "Bedroom 3", Purpose::Bedroom),
    (5.0, "Bathroom 2", Purpose::Bathroom),
    (7.5, "Dressing room", Purpose::Dressing),
    (10.0, "Foyer", Purpose::Foyer),
    (13.5, "Living room", Purpose::Living),
    (20.5, "Library", Purpose::Library),
    (24.0, "Workshop", Purpose::Workshop),
];
const EAST_END: f64 = 27.0;

/// Doors between rooms: the room that the leaf opens into, the other, and how wide the opening is.
/// Without a leaf where it is wider than 1 m.
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

/// Openings to the outside: the room, the side of the house, where along the room's wall (0 to 1),
/// width, and the heights of sill and lintel. A sill of 0 makes a door.
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

/// Widest opening that still has a leaf.
const WIDEST_LEAF: f64 = 1.0;

/// Lintel of the doors between rooms.
const DOOR_HEIGHT: f64 = 2.05;

/// Room that every opening keeps from the ends of its wall, measured from the middle of the
/// crossing walls: the thickest half wall and a casing.
const END: f64 = 0.3;

/// A side of the house.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    West,
    East,
    North,
    South,
}

/// Half of the thickness of the wall in the plane `at` of a floor whose outer walls have their
/// middles at `ends`.
pub(super) fn half_thickness(at: f64, ends: [f64; 2]) -> f64 {
    if ends.contains(&at) {
        OUTER_WALL / 2.0
    } else {
        INNER_WALL / 2.0
    }
}

impl Floor {
    pub(super) fn new(rng: &Rng) -> Self {
        let mut draw = rng.fork(0);
        let mirrored = draw.unit() < 0.5;
        let mut rooms = Vec::new();
        let mut band = |rooms: &mut Vec<Room>,
                        list: &[(f64, &'static str, Purpose)],
                        from: f64,
                        to: f64,
                        end: f64| {
            // The ends of the band and the edge of the corner stay; the rest moves a little.
            let mut begins: Vec<f64> = list
                .iter()
                .map(|room| room.0 + SHIFT * (2.0 * draw.unit() - 1.0))
                .collect();
            begins[0] = list[0].0;
            begins.push(end);
            for (i, &(_, name, purpose)) in list.iter().enumerate() {
                let (low, high) = (DVec2::new(begins[i], from), DVec2::new(begins[i + 1], to));
                rooms.push(Room {
                    name,
                    purpose,
                    low,
                    high,
                    ceiling: ceiling(purpose),
                });
            }
        };
        band(&mut rooms, &NORTH, BANDS[0], BANDS[1], CORNER);
        let corner = [
            ("Pantry", Purpose::Pantry, BANDS[0], PANTRY),
            ("Utility room", Purpose::Utility, PANTRY, BANDS[1]),
        ];
        for (name, purpose, from, to) in corner {
            let (low, high) = (DVec2::new(CORNER, from), DVec2::new(EAST_END, to));
            rooms.push(Room {
                name,
                purpose,
                low,
                high,
                ceiling: ceiling(purpose),
            });
        }
        band(&mut rooms, &MIDDLE, BANDS[1], BANDS[2], EAST_END);
        band(&mut rooms, &SOUTH, BANDS[2], BANDS[3], EAST_END);
        // About the origin, and perhaps the other way round.
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

    /// The outside cell: the one after the rooms.
    pub(super) fn outside(&self) -> usize {
        self.rooms.len()
    }

    /// Half of the thickness of the wall in a plane perpendicular to `axis`.
    pub(super) fn half_wall(&self, axis: usize, plane: f64) -> f64 {
        half_thickness(plane, [self.low[axis], self.high[axis]])
    }

    fn room(&self, name: &str) -> Option<usize> {
        self.rooms.iter().position(|room| room.name == name)
    }

    fn add_doors(&mut self, draw: &mut Rng) {
        for (into, from, width) in DOORS {
            let place = draw.between(0.25, 0.75);
            let (Some(a), Some(b)) = (self.room(into), self.room(from)) else {
                continue;
            };
            let (r, s) = (&self.rooms[a], &self.rooms[b]);
            // The axis on which one room ends where the other begins.
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
            let span = within(wall, place, width);
            let fill = if width > WIDEST_LEAF {
                Fill::Free
            } else {
                Fill::Leaf
            };
            let height = if width > WIDEST_LEAF {
                DOOR_HEIGHT + 0.1
            } else {
                DOOR_HEIGHT
            };
            let name = format!("{into} - {from}");
            self.openings.push(Opening {
                name,
                cells: [a, b],
                fill,
                axis,
                plane,
                span,
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
            let span = within([r.low[along], r.high[along]], place, width);
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
            let name = format!("{name} {what} {:?}", side).to_lowercase();
            let cells = [room, self.outside()];
            self.openings.push(Opening {
                name,
                cells,
                fill,
                axis,
                plane,
                span,
                heights,
            });
        }
    }
}

/// A span of `width` at a place (0 to 1) of what a wall has room for.
fn within([from, to]: [f64; 2], place: f64, width: f64) -> [f64; 2] {
    let (first, last) = (from + END, to - END - width);
    let begin = first + (last - first) * place;
    [begin, begin + width]
}

fn ceiling(purpose: Purpose) -> f64 {
    match purpose {
        Purpose::Living | Purpose::Dining | Purpose::Library => 2.95,
        Purpose::Corridor | Purpose::Pantry | Purpose::Utility | Purpose::Dressing => 2.5,
        _ => 2.7,
    }
}

impl Opening {
    /// Corners of the opening in the middle of the wall, counter-clockwise seen from its first
    /// cell.
    pub(super) fn polygon(&self, plan: &Floor) -> Vec<DVec3> {
        let at = |along: f64, y: f64| point(self.axis, self.plane, along, y);
        let [from, to] = self.span;
        let [sill, lintel] = self.heights;
        let corners = vec![
            at(from, sill),
            at(to, sill),
            at(to, lintel),
            at(from, lintel),
        ];
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let room = &plan.rooms[self.cells[0]];
        let to_room = (room.low[self.axis] + room.high[self.axis]) / 2.0 - self.plane;
        let faces_room = normal[[0, 2][self.axis]] * to_room > 0.0;
        if faces_room {
            corners
        } else {
            corners.into_iter().rev().collect()
        }
    }
}

/// The point at `plane` on `axis` (0 is x, 1 is z), `along` on the other axis, and height `y`.
pub(super) fn point(axis: usize, plane: f64, along: f64, y: f64) -> DVec3 {
    if axis == 0 {
        DVec3::new(plane, y, along)
    } else {
        DVec3::new(along, y, plane)
    }
}
