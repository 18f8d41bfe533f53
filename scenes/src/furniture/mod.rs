//! Furniture. A piece has local axes: +x along the wall behind it, +z into the room.

mod bath;
mod door;
mod kitchen;
mod sleep;

pub(crate) use bath::{basin, bath, toilet};
pub(crate) use door::{DoorLeaf, door_leaf};
pub(crate) use kitchen::{counter, fridge, rack, washer, workbench};
pub(crate) use sleep::{bed, cabinet, desk, wardrobe};

use crate::finishes::Finishes;
use crate::mesh::{Mesh, Vertex};
use glam::{DMat3, DVec2, DVec3, dvec3};
use headbox_core::random::Rng;
use std::f64::consts::{PI, TAU};

/// Piece of furniture under construction: the mesh and the local frame, at a place on the floor,
/// rotated about the vertical.
struct Piece<'a> {
    mesh: &'a mut Mesh,
    place: DVec3,
    world_from_piece: DMat3,
}

impl<'a> Piece<'a> {
    fn new(mesh: &'a mut Mesh, place: DVec3, turn: f64) -> Self {
        Self {
            mesh,
            place,
            world_from_piece: DMat3::from_rotation_y(turn),
        }
    }

    /// Transforms a local point to the world.
    fn at(&self, p: DVec3) -> DVec3 {
        self.place + self.world_from_piece * p
    }

    /// Adds a box between two local corners.
    fn block(&mut self, low: impl Into<DVec3>, high: impl Into<DVec3>, tile: f64, material: u32) {
        let (low, high) = (low.into(), high.into());
        let centre = self.at((low + high) / 2.0);
        self.mesh.add_box(
            centre,
            (high - low) / 2.0,
            self.world_from_piece,
            tile,
            material,
        );
    }

    /// Adds a cushion between two local corners.
    fn cushion(&mut self, low: impl Into<DVec3>, high: impl Into<DVec3>, material: u32) {
        let (low, high) = (low.into(), high.into());
        let centre = self.at((low + high) / 2.0);
        self.mesh.add_cushion(
            centre,
            (high - low) / 2.0,
            self.world_from_piece,
            0.3,
            material,
        );
    }

    /// Adds a small ball, such as a knob, about a local point.
    fn ball(&mut self, centre: DVec3, radius: f64, material: u32) {
        let centre = self.at(centre);
        self.mesh.add_ball(centre, radius, 10, material);
    }

    /// Adds a bar or pipe of constant radius along a local path.
    fn pipe<const N: usize>(&mut self, path: [impl Into<DVec3>; N], radius: f64, material: u32) {
        let path = path.map(|p| (self.at(p.into()), radius));
        self.mesh.add_tube(&path, 8, 1.0, material);
    }

    /// Adds four legs of `thickness` under a rectangle of half-sizes `half_x`, `half_z`.
    fn legs(&mut self, half_x: f64, half_z: f64, height: f64, thickness: f64, material: u32) {
        for (x, z) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let foot = dvec3(x * (half_x - thickness), 0.0, z * (half_z - thickness));
            let half = dvec3(thickness / 2.0, 0.0, thickness / 2.0);
            self.block(foot - half, foot + half + DVec3::Y * height, 1.0, material);
        }
    }
}

/// Returns left and right end of unit `i` of `count` equal units of a piece of `width`.
fn unit_bounds(width: f64, i: usize, count: f64) -> [f64; 2] {
    [i, i + 1].map(|i| -width / 2.0 + width * i as f64 / count)
}

/// Adds a table of the given size, with materials of its top and its legs.
pub(crate) fn table(mesh: &mut Mesh, place: DVec3, turn: f64, size: DVec3, [top, legs]: [u32; 2]) {
    let mut piece = Piece::new(mesh, place, turn);
    let (half_x, half_z) = (size.x / 2.0, size.z / 2.0);
    piece.block(
        [-half_x, size.y - 0.035, -half_z],
        [half_x, size.y, half_z],
        1.0,
        top,
    );
    piece.legs(half_x, half_z, size.y - 0.035, 0.06, legs);
    let apron = dvec3(half_x - 0.09, 0.0, half_z - 0.09);
    piece.block(
        -apron + DVec3::Y * (size.y - 0.11),
        apron + DVec3::Y * (size.y - 0.04),
        1.0,
        legs,
    );
}

/// Adds a chair that faces +z before rotation.
pub(crate) fn chair(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    piece.legs(0.23, 0.23, 0.44, 0.045, finishes.walnut);
    piece.block(
        [-0.23, 0.44, -0.23],
        [0.23, 0.47, 0.23],
        0.6,
        finishes.walnut,
    );
    piece.block([-0.2, 0.47, -0.2], [0.2, 0.5, 0.2], 0.3, finishes.cushion);
    for x in [-0.2, -0.1, 0.0, 0.1, 0.2] {
        piece.block(
            [x - 0.014, 0.47, -0.22],
            [x + 0.014, 0.9, -0.195],
            0.6,
            finishes.walnut,
        );
    }
    piece.block(
        [-0.23, 0.88, -0.225],
        [0.23, 0.97, -0.19],
        0.6,
        finishes.walnut,
    );
}

/// Adds a sofa whose back is at -x before rotation.
pub(crate) fn sofa(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    piece.legs(0.42, 1.0, 0.12, 0.06, finishes.walnut);
    piece.block(
        [-0.45, 0.12, -1.05],
        [0.45, 0.28, 1.05],
        0.3,
        finishes.fabric,
    );
    piece.block(
        [-0.45, 0.28, -1.05],
        [-0.25, 0.82, 1.05],
        0.3,
        finishes.fabric,
    );
    for side in [-1.0_f64, 1.0] {
        let (inner, outer) = (0.85 * side, 1.05 * side);
        piece.block(
            [-0.25, 0.28, inner.min(outer)],
            [0.45, 0.6, inner.max(outer)],
            0.3,
            finishes.fabric,
        );
        let seat = 0.425 * side;
        piece.block(
            [-0.24, 0.285, seat - 0.415],
            [0.44, 0.43, seat + 0.415],
            0.3,
            finishes.fabric,
        );
    }
    // Two inclined cushions in the corners.
    for (z, turn) in [(-0.6, 0.3), (0.55, -0.25)] {
        let lean =
            piece.world_from_piece * DMat3::from_rotation_y(turn) * DMat3::from_rotation_z(0.35);
        let centre = piece.at(dvec3(-0.08, 0.66, z));
        piece
            .mesh
            .add_box(centre, dvec3(0.06, 0.2, 0.2), lean, 0.3, finishes.cushion);
    }
}

/// Adds a shelf with five rows of books; `place` is the middle of its back on the floor.
pub(crate) fn shelf(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes, rng: &Rng) {
    const HALF: f64 = 0.9;
    const DEPTH: f64 = 0.3;
    const STEP: f64 = 0.4;
    let mut piece = Piece::new(mesh, place, turn);
    piece.block([-HALF, 0.0, 0.0], [HALF, 2.1, 0.015], 0.8, finishes.oak);
    for x in [-HALF, HALF - 0.03] {
        piece.block([x, 0.0, 0.015], [x + 0.03, 2.1, DEPTH], 0.8, finishes.oak);
    }
    for board in 0..=5_u32 {
        let y = f64::from(board) * STEP + 0.05;
        piece.block(
            [-HALF + 0.03, y, 0.015],
            [HALF - 0.03, y + 0.025, DEPTH],
            0.8,
            finishes.oak,
        );
        if board == 5 {
            break;
        }
        let mut random = rng.fork(u64::from(board));
        let mut x = -HALF + 0.04;
        while x < HALF - 0.12 {
            let (thickness, height) = (random.between(0.015, 0.05), random.between(0.2, 0.32));
            let depth = random.between(0.16, 0.24);
            let material = finishes.books[(random.unit() * 6.0) as usize % 6];
            let low = dvec3(x, y + 0.026, 0.27 - depth);
            piece.block(low, low + dvec3(thickness, height, depth), 1.0, material);
            // Some gaps.
            x += thickness
                + if random.unit() < 0.08 {
                    random.between(0.05, 0.25)
                } else {
                    0.002
                };
        }
    }
}

/// Adds a framed picture; `right` (unit) is along the wall, and `right x up` points into the room.
pub(crate) fn picture(
    mesh: &mut Mesh,
    centre: DVec3,
    right: DVec3,
    size: DVec2,
    canvas: u32,
    frame: u32,
) {
    let out = right.cross(DVec3::Y);
    let world_from_wall = DMat3::from_cols(right, DVec3::Y, out);
    mesh.add_box(
        centre,
        dvec3(size.x / 2.0 + 0.03, size.y / 2.0 + 0.03, 0.015),
        world_from_wall,
        0.6,
        frame,
    );
    let corner = centre + out * 0.0155 - right * (size.x / 2.0) - DVec3::Y * (size.y / 2.0);
    mesh.add_rectangle(corner, right * size.x, DVec3::Y * size.y, 0.0, canvas);
}

/// Adds a floor lamp with an open shade around a luminous bulb.
pub(crate) fn floor_lamp(mesh: &mut Mesh, place: DVec3, finishes: &Finishes) {
    mesh.add_cylinder(place, 0.16, 0.025, 32, finishes.metal);
    mesh.add_cylinder(place + DVec3::Y * 0.025, 0.012, 1.43, 10, finishes.metal);
    bulb_in_shade(mesh, place + DVec3::Y * 1.5, 0.3, 0.2, finishes);
}

/// Adds a lamp that hangs from the ceiling at height `ceiling`.
pub(crate) fn pendant(mesh: &mut Mesh, place: DVec3, ceiling: f64, finishes: &Finishes) {
    let cord = [
        (place + DVec3::Y * 0.2, 0.004),
        (dvec3(place.x, ceiling, place.z), 0.004),
    ];
    mesh.add_tube(&cord, 6, 1.0, finishes.metal);
    bulb_in_shade(mesh, place, 0.22, 0.05, finishes);
}

fn bulb_in_shade(mesh: &mut Mesh, centre: DVec3, wide: f64, narrow: f64, finishes: &Finishes) {
    mesh.add_ball(centre, 0.06, 16, finishes.bulb);
    let shade = [
        (centre - DVec3::Y * 0.1, wide),
        (centre + DVec3::Y * 0.2, narrow),
    ];
    mesh.add_tube(&shade, 40, 1.0, finishes.shade);
}

/// Adds a potted plant with long, arched leaves of up to `reach` times 0.83 m.
pub(crate) fn plant(mesh: &mut Mesh, place: DVec3, reach: f64, finishes: &Finishes, rng: &Rng) {
    let pot = [
        (place, 0.13),
        (place + DVec3::Y * 0.3, 0.19),
        (place + DVec3::Y * 0.34, 0.2),
    ];
    mesh.add_tube(&pot, 32, 1.0, finishes.clay);
    mesh.add_disk(place + DVec3::Y * 0.002, 0.13, DVec3::Y, 32, finishes.clay);
    mesh.add_disk(
        place + DVec3::Y * 0.29,
        0.185,
        DVec3::Y,
        32,
        finishes.walnut,
    );
    let steps = mesh.sides(10);
    for leaf in 0..44_u64 {
        let mut random = rng.fork(leaf);
        let around = leaf as f64 * 2.399_963;
        let outward = dvec3(around.cos(), 0.0, around.sin());
        let side = outward.cross(DVec3::Y);
        let (length, rise) = (reach * random.between(0.4, 0.75), random.between(0.9, 1.5));
        let base = place + DVec3::Y * 0.29 + outward * random.between(0.0, 0.08);
        mesh.add_grid(2, steps, finishes.foliage, |column, row| {
            let (s, across) = (row as f64 / steps as f64, column as f64 - 1.0);
            // First up, then outward and down.
            let rib = base
                + (outward * s * (0.25 + 0.75 * s) + DVec3::Y * (s * rise - 1.05 * s * s)) * length;
            let width = 0.045 * (s * PI * 0.92 + 0.25).sin();
            Vertex::new(
                rib + side * across * width + DVec3::Y * 0.02 * across.abs(),
                DVec3::ZERO,
                DVec2::new(across, s),
            )
        });
    }
}

/// Adds a bowl of fruit.
pub(crate) fn fruit_bowl(mesh: &mut Mesh, place: DVec3, finishes: &Finishes) {
    mesh.add_cylinder(place, 0.07, 0.012, 32, finishes.lacquer);
    mesh.add_sphere(
        place + DVec3::Y * 0.17,
        0.16,
        -1.3,
        -0.35,
        48,
        finishes.lacquer,
    );
    for (i, material) in finishes.fruit.into_iter().cycle().take(6).enumerate() {
        let around = i as f64 / 5.0 * TAU;
        let reach = if i < 5 { 0.075 } else { 0.0 };
        let centre = place
            + dvec3(
                around.cos() * reach,
                if i < 5 { 0.1 } else { 0.15 },
                around.sin() * reach,
            );
        mesh.add_ball(centre, 0.042, 24, material);
    }
}

/// Adds a pleated curtain of `height` below an edge from `top` along `along`.
pub(crate) fn curtain(mesh: &mut Mesh, top: DVec3, along: DVec3, height: f64, material: u32) {
    let (columns, rows) = (mesh.sides(72), mesh.sides(12));
    let out = along.cross(DVec3::Y).normalize_or_zero();
    mesh.add_grid(columns, rows, material, |column, row| {
        let (s, t) = (column as f64 / columns as f64, row as f64 / rows as f64);
        let fold = (s * 9.0 * TAU).sin() * (0.025 + 0.015 * (1.0 - t));
        let position = top + along * s + out * fold - DVec3::Y * height * (1.0 - t);
        Vertex::new(
            position,
            DVec3::ZERO,
            DVec2::new(s * along.length(), t * height) / 0.3,
        )
    });
}
