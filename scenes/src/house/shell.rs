//! Walls with their openings, floors and ceilings.
//!
//! Each of the two cells at a wall has its own half of it, which ends in the middle of the wall's
//! thickness: there is the portal, and the reveals of both halves meet at its edges. Floors and
//! ceilings extend to the middle of the walls, and walls overlap a little in the corners, so that
//! no ray leaks between them.

use super::floor::{Fill, Floor, Opening, point};
use crate::finishes::Finishes;
use crate::furniture;
use crate::mesh::{Mesh, Vertex};
use glam::{DVec2, DVec3};

/// Overlap of two walls at a corner, metres: less than the thinnest half wall.
const OVERLAP: f64 = 0.04;

/// One side of a wall, which belongs to one cell.
pub(super) struct Wall<'a> {
    /// Axis perpendicular to the wall: 0 is x, 1 is z.
    axis: usize,
    /// Direction from the wall into its cell on `axis`, +1 or -1.
    toward: f64,
    /// Coordinate of the visible face on `axis`, metres.
    face: f64,
    /// Coordinate of the middle of the wall on `axis`, metres.
    middle: f64,
    /// Extent on the other axis, overlaps included, metres.
    pub(super) span: [f64; 2],
    /// Extent on the other axis between the adjacent walls, metres.
    corners: [f64; 2],
    /// Heights of the lower and upper edge, metres.
    heights: [f64; 2],
    pub(super) holes: Vec<&'a Opening>,
}

/// Returns the four walls of a room as seen from inside, or of the house as seen from outside.
pub(super) fn walls<'a>(plan: &'a Floor, cell: usize, heights: [f64; 2]) -> Vec<Wall<'a>> {
    let room = plan.rooms.get(cell);
    let inward = if room.is_some() { 1.0 } else { -1.0 };
    let (low, high) = room.map_or((plan.low, plan.high), |room| (room.low, room.high));
    let half = |axis: usize, plane: f64| plan.half_wall(axis, plane) * inward;
    let mut walls = Vec::new();
    for axis in 0..2 {
        let along = 1 - axis;
        let overlap = if room.is_some() { OVERLAP } else { 0.0 };
        let from = low[along] + half(along, low[along]) - overlap;
        let to = high[along] - half(along, high[along]) + overlap;
        for (middle, side) in [(low[axis], 1.0), (high[axis], -1.0)] {
            let is_here = |opening: &&Opening| {
                opening.cells.contains(&cell) && opening.axis == axis && opening.plane == middle
            };
            walls.push(Wall {
                axis,
                toward: side * inward,
                face: middle + half(axis, middle) * side,
                middle,
                span: [from, to],
                corners: [from + overlap, to - overlap],
                heights,
                holes: plan.openings.iter().filter(is_here).collect(),
            });
        }
    }
    walls
}

/// Divides `from..=to` into equal cells; returns their bounds, both ends exact.
fn steps(mesh: &Mesh, from: f64, to: f64) -> Vec<f64> {
    let cells = mesh.cells((to - from).abs());
    let inner = (1..cells).map(|i| from + (to - from) * i as f64 / cells as f64);
    std::iter::once(from).chain(inner).chain([to]).collect()
}

/// Sorts coordinates and removes duplicates.
fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

impl Wall<'_> {
    /// Returns the point at `along` and `y` in a plane perpendicular to the wall's axis.
    fn at(&self, along: f64, y: f64, plane: f64) -> DVec3 {
        point(self.axis, plane, along, y)
    }

    /// Returns the unit vector from the wall into its cell.
    fn normal(&self) -> DVec3 {
        self.at(0.0, 0.0, self.toward)
    }

    /// Returns a point `out` metres in front of the visible face.
    pub(super) fn in_front(&self, along: f64, y: f64, out: f64) -> DVec3 {
        self.at(along, y, self.face + self.toward * out)
    }

    /// Returns the rotation of a piece of furniture with its back to the wall, radians.
    pub(super) fn turn(&self) -> f64 {
        let normal = self.normal();
        normal.x.atan2(normal.z)
    }

    /// Adds a grid over two lists of coordinates, with its front on the side of `normal`.
    fn add_lattice(
        mesh: &mut Mesh,
        [across, up]: [&[f64]; 2],
        normal: DVec3,
        tile: f64,
        material: u32,
        at: impl Fn(f64, f64) -> DVec3,
    ) {
        let (columns, rows) = (across.len() - 1, up.len() - 1);
        // The order of columns is such that columns x rows is parallel to the normal.
        let origin = at(across[0], up[0]);
        let reversed = (at(across[columns], up[0]) - origin)
            .cross(at(across[0], up[rows]) - origin)
            .dot(normal)
            < 0.0;
        mesh.add_grid(columns, rows, material, |column, row| {
            let s = across[if reversed { columns - column } else { column }];
            let t = up[row];
            Vertex::new(at(s, t), normal, DVec2::new(s, t) / tile)
        });
    }

    /// Adds the visible face without its openings. `rows`: further heights at which it is divided.
    pub(super) fn add_face(&self, mesh: &mut Mesh, rows: &[f64], tile: f64, material: u32) {
        let corners = self.span.into_iter().chain(self.corners);
        let columns = sorted(
            corners
                .chain(self.holes.iter().flat_map(|hole| hole.span))
                .collect(),
        );
        let own_rows = self
            .heights
            .into_iter()
            .chain(self.holes.iter().flat_map(|hole| hole.heights));
        let rows = sorted(own_rows.chain(rows.iter().copied()).collect());
        for (x, y) in columns
            .windows(2)
            .flat_map(|x| rows.windows(2).map(move |y| (x, y)))
        {
            let is_hole = self.holes.iter().any(|hole| {
                hole.span[0] <= x[0]
                    && x[1] <= hole.span[1]
                    && hole.heights[0] <= y[0]
                    && y[1] <= hole.heights[1]
            });
            if is_hole {
                continue;
            }
            let (across, up) = (steps(mesh, x[0], x[1]), steps(mesh, y[0], y[1]));
            let at = |along: f64, y: f64| self.at(along, y, self.face);
            Self::add_lattice(mesh, [&across, &up], self.normal(), tile, material, at);
        }
    }

    /// Adds this half of the reveals of an opening, with a sill unless the cell's floor continues
    /// through it.
    pub(super) fn add_reveals(
        &self,
        mesh: &mut Mesh,
        hole: &Opening,
        with_sill: bool,
        tile: f64,
        material: u32,
    ) {
        let depth = steps(mesh, self.face, self.middle);
        let along = steps(mesh, hole.span[0], hole.span[1]);
        let up = steps(mesh, hole.heights[0], hole.heights[1]);
        for (i, &end) in hole.span.iter().enumerate() {
            let inward = self.along() * if i == 0 { 1.0 } else { -1.0 };
            Self::add_lattice(mesh, [&depth, &up], inward, tile, material, |plane, y| {
                self.at(end, y, plane)
            });
        }
        for (&y, normal) in hole.heights.iter().zip([DVec3::Y, DVec3::NEG_Y]) {
            if with_sill || normal == DVec3::NEG_Y {
                Self::add_lattice(
                    mesh,
                    [&along, &depth],
                    normal,
                    tile,
                    material,
                    |along, plane| self.at(along, y, plane),
                );
            }
        }
    }

    /// Returns the unit vector along the wall, toward greater coordinates.
    fn along(&self) -> DVec3 {
        self.at(1.0, 0.0, 0.0)
    }

    /// Adds a box on the wall between two corners (along, y, distance in front of the face).
    fn add_block(&self, mesh: &mut Mesh, a: [f64; 3], b: [f64; 3], material: u32) {
        let [a, b] = [a, b].map(|[along, y, out]| self.in_front(along, y, out));
        mesh.add_block(a.min(b), a.max(b), 0.8, material);
    }

    /// Adds boards around an opening, on the visible face.
    pub(super) fn add_casing(&self, mesh: &mut Mesh, hole: &Opening, material: u32) {
        const WIDE: f64 = 0.07;
        let ([from, to], [sill, lintel]) = (hole.span, hole.heights);
        for (a, b) in [(from - WIDE, from), (to, to + WIDE)] {
            self.add_block(mesh, [a, sill, 0.001], [b, lintel, 0.018], material);
        }
        let top = [to + WIDE, lintel + WIDE, 0.018];
        self.add_block(mesh, [from - WIDE, lintel, 0.001], top, material);
    }

    /// Adds the frame of a window, or the open leaf of a door if it opens into `cell`.
    pub(super) fn add_filling(
        &self,
        mesh: &mut Mesh,
        hole: &Opening,
        cell: usize,
        finishes: &Finishes,
    ) {
        let ([from, to], lintel) = (hole.span, hole.heights[1]);
        match hole.fill {
            Fill::Window => self.add_window(mesh, hole, finishes.lacquer),
            Fill::Leaf if hole.cells[0] == cell => {
                // Hinged at the end nearer to a corner of the room, and open at a right angle.
                let at_start = from - self.span[0] < self.span[1] - to;
                let hinge = if at_start { from - 0.045 } else { to + 0.005 };
                let leaf = furniture::DoorLeaf {
                    width: to - from - 0.01,
                    height: lintel - 0.015,
                    thickness: 0.04,
                };
                let corner = self.in_front(hinge, 0.01, 0.022);
                furniture::door_leaf(mesh, corner, self.normal(), self.along(), &leaf, finishes);
            }
            Fill::Leaf | Fill::Free => {}
        }
    }

    /// Adds a frame with a cross of bars in front of the middle of the wall, and a sill board.
    fn add_window(&self, mesh: &mut Mesh, hole: &Opening, white: u32) {
        let ([from, to], [sill, lintel]) = (hole.span, hole.heights);
        let back = (self.face - self.middle).abs();
        let (near, far, bar) = (-back + 0.055, -back + 0.006, 0.05);
        let mut bars = vec![
            [from, to, sill, sill + bar],
            [from, to, lintel - bar, lintel],
        ];
        let mut uprights = vec![from, to - bar];
        if to - from > 1.0 {
            uprights.push((from + to - bar) / 2.0);
        }
        bars.extend(
            uprights
                .into_iter()
                .map(|x| [x, x + bar, sill + bar, lintel - bar]),
        );
        for [a, b, low, high] in bars {
            self.add_block(mesh, [a, low, far], [b, high, near], white);
        }
        let end = [to + 0.05, sill + 0.002, 0.1];
        self.add_block(mesh, [from - 0.05, sill - 0.03, 0.001], end, white);
    }

    /// Adds a board along the foot of the wall, between the doors.
    pub(super) fn add_skirting(&self, mesh: &mut Mesh, material: u32) {
        let mut doors: Vec<[f64; 2]> = self
            .holes
            .iter()
            .filter(|hole| hole.heights[0] == 0.0)
            .map(|hole| hole.span)
            .collect();
        doors.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut begin = self.corners[0];
        for [from, to] in doors.into_iter().chain([[self.corners[1] + 0.07, 0.0]]) {
            if from - 0.07 > begin {
                let end = [from - 0.07, 0.08, 0.014];
                self.add_block(mesh, [begin, 0.001, 0.001], end, material);
            }
            begin = to + 0.07;
        }
    }
}

/// Adds a floor (front up) or a ceiling (front down) of a room at height `y`, to the middle of its
/// walls. The parts below the walls and in the openings have separate vertices: light baked into
/// vertices must not be shared between visible and hidden parts.
pub(super) fn add_slab(
    mesh: &mut Mesh,
    plan: &Floor,
    cell: usize,
    y: f64,
    up: bool,
    tile: f64,
    material: u32,
) {
    let room = &plan.rooms[cell];
    let normal = if up { DVec3::Y } else { DVec3::NEG_Y };
    // On each axis: below the first wall, the open floor, below the second wall.
    let bands = [0, 1].map(|axis| {
        let (low, high) = (room.low[axis], room.high[axis]);
        let inner = [
            low + plan.half_wall(axis, low),
            high - plan.half_wall(axis, high),
        ];
        [[low, inner[0]], inner, [inner[1], high]]
    });
    // Bounds of the parts of a band along one axis, divided at the openings of the adjacent wall.
    let parts = |axis: usize, band: usize, wall: usize| {
        let [from, to] = bands[axis][band];
        let plane = [room.low, room.high][wall / 2][1 - axis];
        let is_here = |o: &&Opening| o.cells.contains(&cell) && o.axis != axis && o.plane == plane;
        let ends = plan.openings.iter().filter(is_here).flat_map(|o| o.span);
        let inside = ends.filter(|end| (from..to).contains(end) && wall != 1);
        sorted(inside.chain([from, to]).collect())
    };
    for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
        let (xs, zs) = (parts(0, i, j), parts(1, j, i));
        for (x, z) in xs
            .windows(2)
            .flat_map(|x| zs.windows(2).map(move |z| (x, z)))
        {
            let (across, up) = (steps(mesh, x[0], x[1]), steps(mesh, z[0], z[1]));
            let at = |x, z| DVec3::new(x, y, z);
            Wall::add_lattice(mesh, [&across, &up], normal, tile, material, at);
        }
    }
}
