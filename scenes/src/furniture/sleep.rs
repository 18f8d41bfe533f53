//! Furniture of bedrooms and studies; `place` is the middle of the back on the floor.

use super::{Piece, unit_bounds};
use crate::finishes::Finishes;
use crate::mesh::Mesh;
use glam::{DVec3, dvec3};
use headbox_core::random::Rng;

/// Adds a double bed, its head at the wall, between two night tables: 2.7 m by 2.1 m.
pub(crate) fn bed(mesh: &mut Mesh, place: DVec3, turn: f64, linen: u32, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    piece.block([-0.85, 0.0, 0.01], [0.85, 1.05, 0.06], 0.9, finishes.oak);
    piece.block([-0.82, 0.12, 0.06], [0.82, 0.3, 2.08], 0.9, finishes.oak);
    for (x, z) in [(-0.75, 0.2), (0.75, 0.2), (-0.75, 1.95), (0.75, 1.95)] {
        piece.block(
            [x - 0.03, 0.0, z - 0.03],
            [x + 0.03, 0.12, z + 0.03],
            1.0,
            finishes.oak,
        );
    }
    piece.cushion([-0.8, 0.29, 0.08], [0.8, 0.52, 2.06], finishes.lacquer);
    piece.cushion([-0.84, 0.42, 0.7], [0.84, 0.58, 2.1], linen);
    for side in [-1.0, 1.0] {
        let middle = 0.4 * side;
        piece.cushion(
            [middle - 0.33, 0.5, 0.12],
            [middle + 0.33, 0.66, 0.55],
            finishes.curtain,
        );
        let night = 1.1 * side;
        piece.block(
            [night - 0.22, 0.05, 0.02],
            [night + 0.22, 0.5, 0.42],
            0.8,
            finishes.oak,
        );
        for y in [0.08, 0.29] {
            piece.block(
                [night - 0.2, y, 0.42],
                [night + 0.2, y + 0.19, 0.435],
                0.5,
                finishes.walnut,
            );
            piece.ball(dvec3(night, y + 0.1, 0.445), 0.014, finishes.metal);
        }
        piece.block(
            [night - 0.1, 0.5, 0.1],
            [night + 0.06, 0.53, 0.32],
            1.0,
            finishes.books[1],
        );
    }
}

/// Adds a wardrobe of `width` (at least 0.6 m) with a door per half metre, 2.15 m high and 0.6 m
/// deep.
pub(crate) fn wardrobe(
    mesh: &mut Mesh,
    place: DVec3,
    turn: f64,
    width: f64,
    wood: u32,
    finishes: &Finishes,
) {
    let mut piece = Piece::new(mesh, place, turn);
    let half = width / 2.0;
    piece.block([-half, 0.0, 0.01], [half, 0.08, 0.55], 0.9, finishes.metal);
    piece.block([-half, 0.08, 0.01], [half, 2.15, 0.57], 0.9, wood);
    let doors = (width / 0.5).round().max(1.0);
    for door in 0..doors as usize {
        let [left, right] = unit_bounds(width, door, doors);
        piece.block(
            [left + 0.004, 0.09, 0.572],
            [right - 0.004, 2.14, 0.59],
            0.7,
            wood,
        );
        for (low, high) in [(0.2, 1.0), (1.1, 2.03)] {
            piece.block(
                [left + 0.08, low, 0.59],
                [right - 0.08, high, 0.6],
                0.6,
                wood,
            );
        }
        let grip = if door % 2 == 0 {
            right - 0.045
        } else {
            left + 0.045
        };
        piece.pipe(
            [[grip, 0.98, 0.615], [grip, 1.16, 0.615]],
            0.008,
            finishes.metal,
        );
    }
}

/// Adds a low cabinet of `width` with drawers, 0.75 m high and 0.45 m deep, with a vase and books.
pub(crate) fn cabinet(
    mesh: &mut Mesh,
    place: DVec3,
    turn: f64,
    width: f64,
    finishes: &Finishes,
    rng: &Rng,
) {
    let mut piece = Piece::new(mesh, place, turn);
    let half = width / 2.0;
    for (x, z) in [
        (-half + 0.03, 0.03),
        (half - 0.07, 0.03),
        (-half + 0.03, 0.38),
        (half - 0.07, 0.38),
    ] {
        piece.block([x, 0.0, z], [x + 0.04, 0.15, z + 0.04], 1.0, finishes.metal);
    }
    piece.block(
        [-half, 0.15, 0.01],
        [half, 0.75, 0.44],
        0.9,
        finishes.walnut,
    );
    let columns = (width / 0.6).round().max(1.0);
    for (column, row) in
        (0..columns as usize).flat_map(|column| (0..3).map(move |row| (column, row)))
    {
        let [left, right] = unit_bounds(width, column, columns);
        let low = 0.16 + 0.195 * f64::from(row);
        piece.block(
            [left + 0.005, low, 0.44],
            [right - 0.005, low + 0.185, 0.455],
            0.5,
            finishes.oak,
        );
        piece.ball(
            dvec3((left + right) / 2.0, low + 0.1, 0.47),
            0.014,
            finishes.metal,
        );
    }
    let mut random = rng.fork(0);
    let vase = random.between(-0.6, 0.6) * half;
    let profile = [
        (0.0, 0.04),
        (0.08, 0.09),
        (0.18, 0.1),
        (0.27, 0.04),
        (0.31, 0.05),
    ];
    let path = profile.map(|(y, radius)| (piece.at(dvec3(vase, 0.75 + y, 0.22)), radius));
    let material = finishes.fruit[(random.unit() * 3.0) as usize % 3];
    piece.mesh.add_tube(&path, 24, 1.0, material);
    let books = if vase > 0.0 { vase - 0.5 } else { vase + 0.3 };
    for (i, material) in finishes.books.into_iter().enumerate().take(4) {
        let y = 0.75 + 0.035 * i as f64;
        let inset = random.between(0.0, 0.03);
        let low = [books + inset, y, 0.1];
        let high = [books + 0.2 - inset, y + 0.033, 0.36];
        piece.block(low, high, 1.0, material);
    }
}

/// Adds a desk with a screen, a keyboard and papers, 1.4 m by 0.7 m.
pub(crate) fn desk(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    piece.block([-0.7, 0.71, 0.01], [0.7, 0.74, 0.7], 0.9, finishes.oak);
    for x in [-0.66, 0.62] {
        piece.block([x, 0.0, 0.05], [x + 0.04, 0.71, 0.66], 0.9, finishes.metal);
    }
    piece.block([0.25, 0.3, 0.1], [0.6, 0.71, 0.64], 0.9, finishes.walnut);
    for y in [0.32, 0.45, 0.58] {
        piece.block([0.26, y, 0.64], [0.59, y + 0.12, 0.655], 0.5, finishes.oak);
    }
    piece.block([-0.36, 0.86, 0.16], [0.26, 1.22, 0.19], 1.0, finishes.metal);
    piece.block(
        [-0.345, 0.875, 0.19],
        [0.245, 1.205, 0.192],
        0.0,
        finishes.pictures[0],
    );
    piece.block([-0.08, 0.74, 0.14], [-0.02, 0.9, 0.16], 1.0, finishes.metal);
    piece.block([-0.18, 0.74, 0.08], [0.08, 0.75, 0.26], 1.0, finishes.metal);
    piece.block(
        [-0.26, 0.74, 0.38],
        [0.16, 0.758, 0.52],
        1.0,
        finishes.lacquer,
    );
    piece.block(
        [-0.62, 0.74, 0.2],
        [-0.42, 0.775, 0.48],
        1.0,
        finishes.books[4],
    );
    piece.block(
        [-0.6, 0.775, 0.22],
        [-0.44, 0.8, 0.45],
        1.0,
        finishes.books[0],
    );
}
