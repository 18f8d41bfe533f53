//! Placement of furniture at walls, clear of doors and windows, or in the middle of a room.

use super::floor::{Fill, Floor, Purpose};
use super::palette::Palette;
use super::shell::Wall;
use crate::furniture;
use crate::mesh::Mesh;
use glam::{DVec2, DVec3, Vec3Swizzles, dvec3};
use headbox_core::random::Rng;
use std::f64::consts::{FRAC_PI_2, PI};

/// FurnitureKind of furniture, with its size if that is variable, metres.
#[derive(Clone, Copy)]
enum FurnitureKind {
    Bed,
    Wardrobe(f64),
    Cabinet(f64),
    Desk,
    Shelf,
    Sofa,
    LowTable,
    Table { length: f64, chairs: usize },
    Rug(f64, f64),
    Counter(f64),
    Fridge,
    Washer,
    Rack(f64),
    Workbench,
    Bath,
    Basin,
    Toilet,
    Plant,
    FloorLamp,
    Chair,
}

impl FurnitureKind {
    /// Returns width along the wall, height, and depth into the room, metres.
    fn size(self) -> DVec3 {
        match self {
            Self::Bed => dvec3(2.7, 1.1, 2.15),
            Self::Wardrobe(width) => dvec3(width, 2.2, 0.65),
            Self::Cabinet(width) => dvec3(width, 1.1, 0.5),
            Self::Desk => dvec3(1.45, 1.3, 1.35),
            Self::Shelf => dvec3(1.85, 2.15, 0.35),
            Self::Sofa => dvec3(2.2, 0.9, 1.0),
            Self::LowTable => dvec3(1.1, 0.5, 0.7),
            Self::Table { length, .. } => dvec3(length + 0.2, 1.0, 2.2),
            Self::Rug(width, depth) => dvec3(width, 0.0, depth),
            Self::Counter(width) => dvec3(width + 0.02, 1.06, 0.65),
            Self::Fridge => dvec3(0.75, 1.95, 0.75),
            Self::Washer => dvec3(0.65, 0.9, 0.65),
            Self::Rack(width) => dvec3(width + 0.05, 1.95, 0.45),
            Self::Workbench => dvec3(2.05, 1.95, 0.9),
            Self::Bath => dvec3(1.72, 0.8, 0.8),
            Self::Basin => dvec3(0.86, 1.95, 0.55),
            Self::Toilet => dvec3(0.6, 0.85, 0.75),
            Self::Plant => dvec3(1.2, 1.3, 1.2),
            Self::FloorLamp => dvec3(0.65, 1.75, 0.65),
            Self::Chair => dvec3(0.55, 1.0, 0.55),
        }
    }

    fn is_freestanding(self) -> bool {
        matches!(self, Self::LowTable | Self::Table { .. } | Self::Rug(..))
    }

    /// Adds the piece; `back` is the middle of its back on the floor, or its centre if it is
    /// freestanding.
    fn build(self, mesh: &mut Mesh, back: DVec3, turn: f64, palette: &Palette, rng: &Rng) {
        let f = &palette.finishes;
        let into_room = dvec3(turn.sin(), 0.0, turn.cos());
        let middle = back + into_room * (self.size().z / 2.0);
        let pick = (rng.fork(77).unit() * 3.0) as usize % 3;
        match self {
            Self::Bed => furniture::bed(mesh, back, turn, palette.linens[pick], f),
            Self::Wardrobe(width) => {
                let wood = [f.oak, f.walnut, f.lacquer][pick];
                furniture::wardrobe(mesh, back, turn, width, wood, f);
            }
            Self::Cabinet(width) => furniture::cabinet(mesh, back, turn, width, f, rng),
            Self::Desk => {
                furniture::desk(mesh, back, turn, f);
                let away = 0.2 * (rng.fork(78).unit() - 0.5);
                furniture::chair(mesh, back + into_room * 1.0, turn + PI + away, f);
            }
            Self::Shelf => furniture::shelf(mesh, back + into_room * 0.016, turn, f, rng),
            Self::Sofa => furniture::sofa(mesh, back + into_room * 0.47, turn - FRAC_PI_2, f),
            Self::LowTable => {
                furniture::table(mesh, back, turn, dvec3(1.0, 0.4, 0.6), [f.walnut, f.walnut]);
            }
            Self::Table { length, chairs } => {
                add_table(mesh, back, turn, length, chairs, palette, rng);
            }
            Self::Rug(width, depth) => {
                let is_turned = (turn / FRAC_PI_2).round() as i64 % 2 != 0;
                let (x, z) = if is_turned {
                    (depth, width)
                } else {
                    (width, depth)
                };
                let half = dvec3(x / 2.0, 0.0, z / 2.0);
                mesh.add_block(
                    back - half + DVec3::Y * 0.001,
                    back + half + DVec3::Y * 0.012,
                    0.0,
                    f.rug,
                );
            }
            Self::Counter(width) => furniture::counter(mesh, back, turn, width, f, rng),
            Self::Fridge => furniture::fridge(mesh, back, turn, f),
            Self::Washer => furniture::washer(mesh, back, turn, f),
            Self::Rack(width) => furniture::rack(mesh, back, turn, width, f, rng),
            Self::Workbench => furniture::workbench(mesh, back, turn, f),
            Self::Bath => furniture::bath(mesh, back, turn, f),
            Self::Basin => furniture::basin(mesh, back, turn, f),
            Self::Toilet => furniture::toilet(mesh, back, turn, f),
            Self::Plant => furniture::plant(mesh, middle, 0.7, f, rng),
            Self::FloorLamp => furniture::floor_lamp(mesh, middle, f),
            Self::Chair => furniture::chair(mesh, middle, turn, f),
        }
    }
}

/// Adds a table with chairs along its sides and a bowl of fruit.
fn add_table(
    mesh: &mut Mesh,
    place: DVec3,
    turn: f64,
    length: f64,
    chairs: usize,
    palette: &Palette,
    rng: &Rng,
) {
    let f = &palette.finishes;
    furniture::table(mesh, place, turn, dvec3(length, 0.74, 0.95), [f.oak, f.oak]);
    let right = dvec3(turn.cos(), 0.0, -turn.sin());
    let into = dvec3(turn.sin(), 0.0, turn.cos());
    let mut random = rng.fork(5);
    let per_side = chairs.div_ceil(2);
    for chair in 0..chairs {
        let along = length * ((chair / 2) as f64 + 0.5) / per_side as f64 - length / 2.0;
        let side = if chair % 2 == 0 { 1.0 } else { -1.0 };
        let at = place + right * along + into * side * random.between(0.6, 0.8);
        let facing = if chair % 2 == 0 { turn + PI } else { turn };
        furniture::chair(mesh, at, facing + random.between(-0.25, 0.25), f);
    }
    furniture::fruit_bowl(mesh, place + dvec3(0.0, 0.74, 0.0), f);
}

/// Returns the furniture of a room, most important first.
fn furniture_list(purpose: Purpose) -> &'static [FurnitureKind] {
    use FurnitureKind::*;
    match purpose {
        Purpose::Bedroom => &[
            Bed,
            Wardrobe(1.8),
            Rug(2.4, 1.7),
            Cabinet(1.2),
            Shelf,
            Desk,
            Plant,
            Chair,
            FloorLamp,
        ],
        Purpose::Bathroom => &[Basin, Toilet, Bath, Cabinet(0.7), Wardrobe(0.6)],
        Purpose::Study => &[
            Desk,
            Shelf,
            Shelf,
            Rug(2.0, 1.5),
            Cabinet(1.2),
            Plant,
            Chair,
        ],
        Purpose::Dining => &[
            Table {
                length: 2.4,
                chairs: 6,
            },
            Cabinet(1.8),
            Rug(3.2, 2.4),
            Shelf,
            Plant,
            Chair,
            Plant,
            Cabinet(1.2),
        ],
        Purpose::Kitchen => &[
            Counter(3.0),
            Table {
                length: 1.5,
                chairs: 4,
            },
            Fridge,
            Counter(1.8),
            Wardrobe(1.0),
            Plant,
            Counter(1.2),
        ],
        Purpose::Pantry => &[Rack(1.4), Rack(1.4), Rack(1.0), Rack(0.8)],
        Purpose::Utility => &[Washer, Washer, Rack(1.2), Basin, Rack(1.0)],
        Purpose::Corridor => &[
            Rug(4.0, 1.0),
            Cabinet(1.2),
            Plant,
            Chair,
            Cabinet(0.6),
            Plant,
            Chair,
        ],
        Purpose::Hall => &[Cabinet(1.2), Rug(2.2, 1.2), Plant, Chair],
        Purpose::Dressing => &[
            Wardrobe(2.0),
            Wardrobe(1.5),
            Rug(1.6, 1.1),
            Chair,
            Cabinet(1.2),
            Wardrobe(1.0),
        ],
        Purpose::Foyer => &[
            Cabinet(1.2),
            Rug(2.0, 1.4),
            Wardrobe(1.5),
            Chair,
            Plant,
            Chair,
            Plant,
        ],
        Purpose::Living => &[
            LowTable,
            Sofa,
            Sofa,
            Rug(3.4, 2.6),
            Shelf,
            Shelf,
            Cabinet(1.8),
            FloorLamp,
            Plant,
            Sofa,
            Cabinet(1.2),
            Plant,
            Chair,
            Shelf,
        ],
        Purpose::Library => &[
            Shelf,
            Shelf,
            Shelf,
            Desk,
            Rug(2.2, 1.6),
            Shelf,
            FloorLamp,
            Chair,
            LowTable,
            Shelf,
            Plant,
            Shelf,
        ],
        Purpose::Workshop => &[
            Workbench,
            Rack(1.6),
            Rack(1.2),
            Cabinet(1.2),
            Rack(1.0),
            Chair,
        ],
    }
}

/// Occupied part of a room: a rectangle in plan between two heights, metres.
struct OccupiedBox {
    low: DVec2,
    high: DVec2,
    heights: [f64; 2],
}

/// Places furniture in the free space of a room.
pub(super) struct Furnisher<'a> {
    walls: &'a [Wall<'a>],
    /// Least (x, z) of the visible faces of the walls.
    low: DVec2,
    /// Greatest (x, z) of the visible faces of the walls.
    high: DVec2,
    occupied: Vec<OccupiedBox>,
}

impl<'a> Furnisher<'a> {
    pub(super) fn new(plan: &Floor, cell: usize, walls: &'a [Wall<'a>]) -> Self {
        let room = &plan.rooms[cell];
        let half =
            |plane: DVec2| DVec2::new(plan.half_wall(0, plane.x), plan.half_wall(1, plane.y));
        let mut furnisher = Self {
            walls,
            low: room.low + half(room.low),
            high: room.high - half(room.high),
            occupied: Vec::new(),
        };
        for wall in walls {
            for hole in &wall.holes {
                let is_door = hole.fill != Fill::Window;
                let (aside, depth) = match hole.fill {
                    Fill::Leaf => (0.12, 1.0),
                    Fill::Free => (0.12, 0.7),
                    Fill::Window => (0.0, 0.3),
                };
                let bottom = if is_door { 0.0 } else { hole.heights[0] - 0.03 };
                let span = [hole.span[0] - aside, hole.span[1] + aside];
                furnisher.occupy_wall(wall, span, depth, [bottom, 9.0]);
            }
        }
        furnisher
    }

    /// Marks part of a wall and the floor in front of it as occupied.
    fn occupy_wall(&mut self, wall: &Wall, span: [f64; 2], depth: f64, heights: [f64; 2]) {
        let [low, high] = footprint(wall, span, depth);
        self.occupied.push(OccupiedBox { low, high, heights });
    }

    /// Marks a rectangle about a point of the plan as occupied between two heights.
    pub(super) fn occupy(&mut self, centre: DVec2, half: DVec2, heights: [f64; 2]) {
        self.occupied.push(OccupiedBox {
            low: centre - half,
            high: centre + half,
            heights,
        });
    }

    fn is_free(&self, low: DVec2, high: DVec2, heights: [f64; 2]) -> bool {
        let clear = |t: &OccupiedBox| {
            low.cmpge(t.high).any()
                || high.cmple(t.low).any()
                || heights[0] >= t.heights[1]
                || heights[1] <= t.heights[0]
        };
        low.cmpge(self.low).all() && high.cmple(self.high).all() && self.occupied.iter().all(clear)
    }

    /// Occupies a free part of a wall of the given width, depth and heights; returns the middle of
    /// its back, and the rotation of a piece there. Tries walls and positions in random order.
    fn place_at_wall(
        &mut self,
        random: &mut Rng,
        width: f64,
        depth: f64,
        heights: [f64; 2],
    ) -> Option<(DVec3, f64)> {
        const STEP: f64 = 0.1;
        const GAP: f64 = 0.012;
        let first = (random.unit() * 4.0) as usize;
        let from_the_end = random.unit() < 0.5;
        for wall in (0..4).filter_map(|i| self.walls.get((first + i) % 4)) {
            let from = wall.span[0] + GAP + width / 2.0;
            let to = wall.span[1] - GAP - width / 2.0;
            let places = ((to - from) / STEP).floor();
            for i in 0..=places.max(-1.0) as i64 {
                let offset = STEP * i as f64;
                let along = if from_the_end {
                    to - offset
                } else {
                    from + offset
                };
                let span = [along - width / 2.0, along + width / 2.0];
                let [low, high] = footprint(wall, span, depth);
                // With a tolerance of 1 mm.
                if self.is_free(low + 1e-3, high - 1e-3, heights) {
                    self.occupy_wall(wall, span, depth, heights);
                    return Some((wall.in_front(along, heights[0], 0.004), wall.turn()));
                }
            }
        }
        None
    }

    /// Occupies the free place that is nearest to the middle of the room; returns its centre.
    fn place_in_middle(&mut self, size: DVec3, is_turned: bool) -> Option<DVec3> {
        const STEP: f64 = 0.2;
        let half = if is_turned {
            DVec2::new(size.z, size.x)
        } else {
            DVec2::new(size.x, size.z)
        } / 2.0;
        let centre = (self.low + self.high) / 2.0;
        let reach = |extent: f64| (extent / 2.0 / STEP) as i32;
        let columns = reach(self.high.x - self.low.x);
        let rows = reach(self.high.y - self.low.y);
        let mut places: Vec<(i32, i32)> = (-rows..=rows)
            .flat_map(|row| (-columns..=columns).map(move |column| (column, row)))
            .collect();
        places.sort_by_key(|(column, row)| column * column + row * row);
        let heights = [0.0, size.y];
        let at = places
            .into_iter()
            .map(|(column, row)| centre + DVec2::new(column.into(), row.into()) * STEP)
            .find(|&at| self.is_free(at - half, at + half, heights))?;
        self.occupy(at, half, heights);
        Some(dvec3(at.x, 0.0, at.y))
    }

    /// Furnishes the room with up to `share` (0 to 1) of the furniture of its purpose, curtains and
    /// pictures.
    pub(super) fn furnish(
        &mut self,
        mesh: &mut Mesh,
        purpose: Purpose,
        share: f64,
        palette: &Palette,
        rng: &Rng,
    ) {
        let long_in_z = (self.high - self.low).y > (self.high - self.low).x;
        let kinds = furniture_list(purpose);
        self.hang_curtains(mesh, purpose, share, palette);
        let count = (share * kinds.len() as f64) as usize;
        for (i, kind) in kinds.iter().enumerate().take(count) {
            let rng = rng.fork(100 + i as u64);
            let size = kind.size();
            let place = if kind.is_freestanding() {
                let turn = if long_in_z { FRAC_PI_2 } else { 0.0 };
                self.place_in_middle(size, long_in_z).map(|at| (at, turn))
            } else {
                self.place_at_wall(&mut rng.fork(1), size.x, size.z, [0.0, size.y])
            };
            if let Some((at, turn)) = place {
                kind.build(mesh, at, turn, palette, &rng);
            }
        }
        self.hang_pictures(mesh, purpose, share, palette, rng);
    }

    /// Adds a pair of curtains at every window with free space for them.
    fn hang_curtains(&mut self, mesh: &mut Mesh, purpose: Purpose, share: f64, palette: &Palette) {
        const WIDE: f64 = 0.3;
        let has_curtains = !matches!(
            purpose,
            Purpose::Bathroom | Purpose::Kitchen | Purpose::Pantry | Purpose::Workshop
        );
        if !has_curtains || share < 0.5 {
            return;
        }
        let walls = self.walls;
        for wall in walls {
            for hole in wall.holes.iter().filter(|hole| hole.fill == Fill::Window) {
                for [from, to] in [
                    [hole.span[0] - WIDE, hole.span[0] - 0.01],
                    [hole.span[1] + 0.01, hole.span[1] + WIDE],
                ] {
                    let [low, high] = footprint(wall, [from, to], 0.2);
                    if !self.is_free(low, high, [0.0, 2.4]) {
                        continue;
                    }
                    self.occupy_wall(wall, [from, to], 0.2, [0.0, 2.4]);
                    let top = hole.heights[1] + 0.1;
                    let begin = wall.in_front(from, top, 0.1);
                    let along = wall.in_front(to, top, 0.1) - begin;
                    furniture::curtain(mesh, begin, along, top - 0.04, palette.finishes.curtain);
                }
            }
        }
    }

    /// Adds pictures to free parts of the walls.
    fn hang_pictures(
        &mut self,
        mesh: &mut Mesh,
        purpose: Purpose,
        share: f64,
        palette: &Palette,
        rng: &Rng,
    ) {
        let pictures = match purpose {
            Purpose::Pantry
            | Purpose::Utility
            | Purpose::Workshop
            | Purpose::Bathroom
            | Purpose::Dressing => 0,
            Purpose::Living | Purpose::Corridor => 5,
            _ => 3,
        };
        for i in 0..(f64::from(pictures) * share) as u64 {
            let mut random = rng.fork(300 + i);
            let width = random.between(0.55, 1.1);
            let height = 0.75 * width;
            let heights = [1.6 - height / 2.0 - 0.05, 1.6 + height / 2.0 + 0.05];
            let place = self.place_at_wall(&mut random, width + 0.25, 0.05, heights);
            let Some((back, turn)) = place else {
                continue;
            };
            let right = dvec3(turn.cos(), 0.0, -turn.sin());
            let out = dvec3(turn.sin(), 0.0, turn.cos());
            let f = &palette.finishes;
            let canvas = f.pictures[(random.unit() * 3.0) as usize % 3];
            let frame = if random.unit() < 0.5 { f.walnut } else { f.oak };
            let centre = dvec3(back.x, 1.6, back.z) + out * 0.015;
            furniture::picture(
                mesh,
                centre,
                right,
                DVec2::new(width, height),
                canvas,
                frame,
            );
        }
    }
}

/// Returns the plan extent of a part of a wall and the floor in front of it: least and greatest
/// (x, z).
fn footprint(wall: &Wall, [from, to]: [f64; 2], depth: f64) -> [DVec2; 2] {
    let a = wall.in_front(from, 0.0, 0.0);
    let b = wall.in_front(to, 0.0, depth);
    [a.min(b).xz(), a.max(b).xz()]
}

/// Adds ceiling lamps to rooms with little daylight, one per five metres.
pub(super) fn hang_lamps(mesh: &mut Mesh, plan: &Floor, cell: usize, palette: &Palette) {
    let room = &plan.rooms[cell];
    let is_dim = matches!(
        room.purpose,
        Purpose::Corridor | Purpose::Hall | Purpose::Dressing | Purpose::Pantry | Purpose::Foyer
    );
    if !is_dim {
        return;
    }
    let size = room.high - room.low;
    let centre = (room.low + room.high) / 2.0;
    let lamps = (size.max_element() / 5.0).round().max(1.0);
    let along = if size.x > size.y {
        DVec2::new(size.x, 0.0)
    } else {
        DVec2::new(0.0, size.y)
    };
    for lamp in 0..lamps as usize {
        let at = centre + along * ((lamp as f64 + 0.5) / lamps - 0.5);
        let place = dvec3(at.x, room.ceiling - 0.45, at.y);
        furniture::pendant(mesh, place, room.ceiling, &palette.finishes);
    }
}
