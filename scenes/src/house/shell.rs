//! Walls with their openings, floors and ceilings.
//!
//! A wall is built twice, once for the cell on each side, and each half ends in the middle of its
//! thickness: there the portal lies, and the reveals of both halves meet on its edges. Floors and
//! ceilings reach to the middle of the walls, and walls run on a little past each other in the
//! corners, so that no ray slips between them.

use super::floor::{Fill, Floor, Opening, point};
use crate::finishes::Finishes;
use crate::furniture;
use crate::mesh::{Mesh, Vertex};
use glam::{DVec2, DVec3};

/// Overlap of a wall with the other wall at a corner, metres: less than the thinnest half wall.
const OVERLAP: f64 = 0.04;

/// One side of a wall, as its cell sees it.
pub(super) struct Wall<'a> {
    /// The axis it is perpendicular to: 0 is x, 1 is z.
    axis: usize,
    /// +1 or -1: where its cell lies on that axis.
    toward: f64,
    /// Coordinates of the visible face and of the middle of the wall, on that axis.
    face: f64,
    middle: f64,
    /// Extent of the visible face on the other axis, and its heights.
    pub(super) span: [f64; 2],
    /// Extent between the walls at its ends; the rest is inside these.
    corners: [f64; 2],
    heights: [f64; 2],
    pub(super) holes: Vec<&'a Opening>,
}

/// The four walls around a rectangle of visible faces, seen from inside it (a room) or from outside
/// (the house).
pub(super) fn walls<'a>(plan: &'a Floor, cell: usize, heights: [f64; 2]) -> Vec<Wall<'a>> {
    let room = plan.rooms.get(cell);
    let inward = if room.is_some() { 1.0 } else { -1.0 };
    let (low, high) = room.map_or((plan.low, plan.high), |room| (room.low, room.high));
    let half = |axis: usize, plane: f64| plan.half_wall(axis, plane) * inward;
    let mut walls = Vec::new();
    for axis in 0..2 {
        let along = 1 - axis;
        let run_on = if room.is_some() { OVERLAP } else { 0.0 };
        let from = low[along] + half(along, low[along]) - run_on;
        let to = high[along] - half(along, high[along]) + run_on;
        for (middle, side) in [(low[axis], 1.0), (high[axis], -1.0)] {
            let toward = side * inward;
            let face = middle + half(axis, middle) * side;
            let in_this = |opening: &&Opening| {
                opening.cells.contains(&cell) && opening.axis == axis && opening.plane == middle
            };
            let holes = plan.openings.iter().filter(in_this).collect();
            let corners = [from + run_on, to - run_on];
            walls.push(Wall {
                axis,
                toward,
                face,
                middle,
                span: [from, to],
                corners,
                heights,
                holes,
            });
        }
    }
    walls
}

/// Coordinates from `from` to `to`, both exactly, in equal steps.
fn steps(mesh: &Mesh, from: f64, to: f64) -> Vec<f64> {
    let cells = mesh.cells((to - from).abs());
    let inner = (1..cells).map(|i| from + (to - from) * i as f64 / cells as f64);
    std::iter::once(from).chain(inner).chain([to]).collect()
}

/// Sorted coordinates without repetition.
fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

impl Wall<'_> {
    /// A point of the wall at a coordinate on its axis.
    fn at(&self, along: f64, y: f64, plane: f64) -> DVec3 {
        point(self.axis, plane, along, y)
    }

    /// Unit vector from the wall into its cell.
    pub(super) fn normal(&self) -> DVec3 {
        self.at(0.0, 0.0, self.toward)
    }

    /// A point `out` metres in front of the visible face.
    pub(super) fn before(&self, along: f64, y: f64, out: f64) -> DVec3 {
        self.at(along, y, self.face + self.toward * out)
    }

    /// Rotation of a piece of furniture with its back to the wall.
    pub(super) fn turn(&self) -> f64 {
        let normal = self.normal();
        normal.x.atan2(normal.z)
    }

    /// A lattice of cells over two lists of coordinates, its front on the side of `normal`.
    fn lattice(
        mesh: &mut Mesh,
        [across, up]: [&[f64]; 2],
        normal: DVec3,
        tile: f64,
        material: u32,
        at: impl Fn(f64, f64) -> DVec3,
    ) {
        let (Some((a, z)), Some((b, y))) =
            (across.first().zip(across.last()), up.first().zip(up.last()))
        else {
            return;
        };
        // Columns run so that columns x rows points along the normal.
        let reversed = (at(*z, *b) - at(*a, *b))
            .cross(at(*a, *y) - at(*a, *b))
            .dot(normal)
            < 0.0;
        mesh.add_grid(across.len() - 1, up.len() - 1, material, |column, row| {
            let (s, t) = (
                across[if reversed {
                    across.len() - 1 - column
                } else {
                    column
                }],
                up[row],
            );
            Vertex::new(at(s, t), normal, DVec2::new(s, t) / tile)
        });
    }

    /// The visible face, cut out at its openings. `rows` are further heights at which it is cut.
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
            let is_hole = |hole: &&&Opening| {
                hole.span[0] <= x[0]
                    && x[1] <= hole.span[1]
                    && hole.heights[0] <= y[0]
                    && y[1] <= hole.heights[1]
            };
            if self.holes.iter().any(|hole| is_hole(&hole)) {
                continue;
            }
            let lists = [steps(mesh, x[0], x[1]), steps(mesh, y[0], y[1])];
            let at = |along: f64, y: f64| self.at(along, y, self.face);
            Self::lattice(
                mesh,
                [&lists[0], &lists[1]],
                self.normal(),
                tile,
                material,
                at,
            );
        }
    }

    /// This half of the reveals of an opening, with a sill unless the cell's own floor runs on
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
        let (along, up) = (
            steps(mesh, hole.span[0], hole.span[1]),
            steps(mesh, hole.heights[0], hole.heights[1]),
        );
        for (i, &end) in hole.span.iter().enumerate() {
            let inward = self.along() * if i == 0 { 1.0 } else { -1.0 };
            Self::lattice(mesh, [&depth, &up], inward, tile, material, |plane, y| {
                self.at(end, y, plane)
            });
        }
        for (&y, normal) in hole.heights.iter().zip([DVec3::Y, DVec3::NEG_Y]) {
            if with_sill || normal == DVec3::NEG_Y {
                Self::lattice(
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

    /// Unit vector along the wall, toward greater coordinates.
    fn along(&self) -> DVec3 {
        self.at(1.0, 0.0, 0.0)
    }

    /// A box on the wall: two corners as (along, y, metres before the face).
    fn block(&self, mesh: &mut Mesh, a: DVec3, b: DVec3, tile: f64, material: u32) {
        let [a, b] = [a, b].map(|p| self.before(p.x, p.y, p.z));
        mesh.add_block(a.min(b), a.max(b), tile, material);
    }

    /// Boards around an opening, on the visible face.
    pub(super) fn add_casing(&self, mesh: &mut Mesh, hole: &Opening, material: u32) {
        const WIDE: f64 = 0.07;
        let ([from, to], [sill, lintel]) = (hole.span, hole.heights);
        for (a, b) in [(from - WIDE, from), (to, to + WIDE)] {
            self.block(
                mesh,
                DVec3::new(a, sill, 0.001),
                DVec3::new(b, lintel, 0.018),
                0.8,
                material,
            );
        }
        let top = DVec3::new(to + WIDE, lintel + WIDE, 0.018);
        self.block(
            mesh,
            DVec3::new(from - WIDE, lintel, 0.001),
            top,
            0.8,
            material,
        );
    }

    /// The frame of a window, or the open leaf of a door if it opens into `cell`.
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
                // Hinged at the end that is nearer to a corner of the room, and open at a right
                // angle.
                let at_start = from - self.span[0] < self.span[1] - to;
                let hinge = if at_start { from - 0.045 } else { to + 0.005 };
                let leaf = furniture::DoorLeaf {
                    width: to - from - 0.01,
                    height: lintel - 0.015,
                    thickness: 0.04,
                };
                let corner = self.before(hinge, 0.01, 0.022);
                furniture::door_leaf(mesh, corner, self.normal(), self.along(), &leaf, finishes);
            }
            Fill::Leaf | Fill::Free => {}
        }
    }

    /// A frame with a cross of bars behind the middle of the wall, and a board on the sill.
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
            self.block(
                mesh,
                DVec3::new(a, low, far),
                DVec3::new(b, high, near),
                0.8,
                white,
            );
        }
        let end = DVec3::new(to + 0.05, sill + 0.002, 0.1);
        self.block(
            mesh,
            DVec3::new(from - 0.05, sill - 0.03, 0.001),
            end,
            0.8,
            white,
        );
    }

    /// A board along the foot of the wall, between the doors.
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
                let end = DVec3::new(from - 0.07, 0.08, 0.014);
                self.block(mesh, DVec3::new(begin, 0.001, 0.001), end, 0.8, material);
            }
            begin = to + 0.07;
        }
    }
}

/// A floor (its front up) or a ceiling (its front down) of a room at height `y`, out to the middle
/// of its walls. What lies under the walls has vertices of its own, and so has what lies in each
/// opening: light baked into vertices must not be shared between what is seen and what is buried.
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
    // On each axis: under the first wall, the open floor, under the second wall.
    let bands = [0, 1].map(|axis| {
        let (low, high) = (room.low[axis], room.high[axis]);
        let inner = [
            low + plan.half_wall(axis, low),
            high - plan.half_wall(axis, high),
        ];
        [[low, inner[0]], inner, [inner[1], high]]
    });
    // The stretches of a band along one axis, cut at the openings in the wall that it follows on
    // the other.
    let stretches = |axis: usize, band: usize, wall: usize| {
        let [from, to] = bands[axis][band];
        let plane = [room.low, room.high][wall / 2][1 - axis];
        let here = |o: &&Opening| o.cells.contains(&cell) && o.axis != axis && o.plane == plane;
        let ends = plan.openings.iter().filter(here).flat_map(|o| o.span);
        let inside = ends.filter(|end| (from..to).contains(end) && wall != 1);
        sorted(inside.chain([from, to]).collect())
    };
    for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
        let (xs, zs) = (stretches(0, i, j), stretches(1, j, i));
        for (x, z) in xs
            .windows(2)
            .flat_map(|x| zs.windows(2).map(move |z| (x, z)))
        {
            let lists = [steps(mesh, x[0], x[1]), steps(mesh, z[0], z[1])];
            Wall::lattice(
                mesh,
                [&lists[0], &lists[1]],
                normal,
                tile,
                material,
                |x, z| DVec3::new(x, y, z),
            );
        }
    }
}
