//! Furniture of kitchens, stores and workshops; `place` is the middle of the back on the floor.

use super::{Piece, unit_bounds};
use crate::finishes::Finishes;
use crate::mesh::Mesh;
use glam::{DVec3, dvec3};
use headbox_core::random::Rng;

/// Adds a row of kitchen cabinets of `width` with a worktop, a sink, a hob and a few jars; 0.92 m
/// high, 0.62 m deep.
pub(crate) fn counter(
    mesh: &mut Mesh,
    place: DVec3,
    turn: f64,
    width: f64,
    finishes: &Finishes,
    rng: &Rng,
) {
    let mut piece = Piece::new(mesh, place, turn);
    let half = width / 2.0;
    piece.block([-half, 0.0, 0.01], [half, 0.1, 0.54], 1.0, finishes.metal);
    piece.block(
        [-half, 0.1, 0.01],
        [half, 0.88, 0.58],
        1.0,
        finishes.lacquer,
    );
    piece.block(
        [-half - 0.01, 0.88, 0.0],
        [half + 0.01, 0.92, 0.62],
        0.8,
        finishes.walnut,
    );
    let units = (width / 0.6).round().max(1.0);
    for unit in 0..units as usize {
        let [left, right] = unit_bounds(width, unit, units);
        let drawers: &[(f64, f64)] = if unit % 2 == 0 {
            &[(0.12, 0.87)]
        } else {
            &[(0.12, 0.4), (0.41, 0.66), (0.67, 0.87)]
        };
        for &(low, high) in drawers {
            piece.block(
                [left + 0.003, low, 0.58],
                [right - 0.003, high, 0.6],
                1.0,
                finishes.oak,
            );
            let grip = [
                dvec3(left + 0.15, high - 0.06, 0.62),
                dvec3(right - 0.15, high - 0.06, 0.62),
            ];
            piece.pipe(grip, 0.007, finishes.metal);
        }
    }
    let (sink, hob) = (-half + width * 0.3, -half + width * 0.75);
    piece.block(
        [sink - 0.25, 0.92, 0.12],
        [sink + 0.25, 0.926, 0.52],
        1.0,
        finishes.metal,
    );
    let tap = [
        dvec3(sink, 0.92, 0.08),
        dvec3(sink, 1.2, 0.08),
        dvec3(sink, 1.22, 0.25),
        dvec3(sink, 1.14, 0.28),
    ];
    piece.pipe(tap, 0.014, finishes.lacquer);
    piece.block(
        [hob - 0.28, 0.92, 0.07],
        [hob + 0.28, 0.928, 0.57],
        1.0,
        finishes.books[5],
    );
    for (x, z) in [(-0.14, 0.2), (0.14, 0.2), (-0.14, 0.44), (0.14, 0.44)] {
        let ring = piece.at(dvec3(hob + x, 0.928, z));
        piece
            .mesh
            .add_cylinder(ring, 0.085, 0.004, 24, finishes.metal);
    }
    let pot = piece.at(dvec3(hob - 0.14, 0.932, 0.44));
    piece.mesh.add_cylinder(pot, 0.1, 0.14, 28, finishes.clay);
    let mut random = rng.fork(1);
    for jar in 0..5 {
        let at = piece.at(dvec3(sink + 0.34 + 0.09 * f64::from(jar), 0.92, 0.1));
        piece.mesh.add_cylinder(
            at,
            0.035,
            random.between(0.09, 0.2),
            16,
            finishes.fruit[jar as usize % 3],
        );
    }
}

/// Adds a refrigerator, 0.7 m by 0.66 m by 1.9 m.
pub(crate) fn fridge(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    piece.block([-0.35, 0.02, 0.02], [0.35, 1.9, 0.6], 1.0, finishes.lacquer);
    for (low, high) in [(0.04, 0.7), (0.72, 1.89)] {
        piece.block(
            [-0.345, low, 0.6],
            [0.345, high, 0.66],
            1.0,
            finishes.lacquer,
        );
        let grip = [
            dvec3(-0.29, high - 0.1, 0.69),
            dvec3(-0.29, high - 0.5, 0.69),
        ];
        piece.pipe(grip, 0.012, finishes.metal);
    }
}

/// Adds a washing machine with a round door, 0.6 m wide and deep.
pub(crate) fn washer(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    piece.block([-0.3, 0.01, 0.02], [0.3, 0.85, 0.58], 1.0, finishes.lacquer);
    piece.block(
        [-0.29, 0.72, 0.58],
        [0.29, 0.84, 0.59],
        1.0,
        finishes.books[4],
    );
    piece.ball(dvec3(0.2, 0.78, 0.595), 0.03, finishes.metal);
    let rim = [
        (dvec3(0.0, 0.4, 0.58), 0.2),
        (dvec3(0.0, 0.4, 0.61), 0.19),
        (dvec3(0.0, 0.4, 0.612), 0.15),
    ];
    let glass = [rim[2], (dvec3(0.0, 0.4, 0.6), 0.001)];
    for (path, material) in [
        (rim.as_slice(), finishes.metal),
        (glass.as_slice(), finishes.books[5]),
    ] {
        let path: Vec<_> = path
            .iter()
            .map(|&(p, radius)| (piece.at(p), radius))
            .collect();
        piece.mesh.add_tube(&path, 32, 1.0, material);
    }
}

/// Adds an open rack of `width`, 1.9 m high and 0.4 m deep, with boxes and jars on five boards.
pub(crate) fn rack(
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
        (-half, 0.02),
        (half - 0.035, 0.02),
        (-half, 0.365),
        (half - 0.035, 0.365),
    ] {
        piece.block(
            [x, 0.0, z],
            [x + 0.035, 1.9, z + 0.035],
            1.0,
            finishes.metal,
        );
    }
    for board in 0..5_u32 {
        let y = 0.12 + 0.42 * f64::from(board);
        piece.block([-half, y, 0.02], [half, y + 0.025, 0.4], 0.8, finishes.oak);
        let mut random = rng.fork(10 + u64::from(board));
        let mut x = -half + 0.05;
        while x < half - 0.3 {
            let size = random.between(0.1, 0.24);
            let material = if random.unit() < 0.5 {
                finishes.books[(random.unit() * 6.0) as usize % 6]
            } else {
                finishes.fruit[(random.unit() * 3.0) as usize % 3]
            };
            let high = random.between(0.1, 0.26);
            if random.unit() < 0.5 {
                let low = dvec3(x, y + 0.026, 0.06);
                piece.block(low, low + dvec3(size, high, 0.28), 1.0, material);
            } else {
                let base = piece.at(dvec3(x + size / 2.0, y + 0.026, 0.2));
                piece
                    .mesh
                    .add_cylinder(base, size / 2.0, high, 24, material);
            }
            x += size + random.between(0.02, 0.12);
        }
    }
}

/// Adds a workbench with a vice, planks and tools on the wall, 2 m by 0.7 m.
pub(crate) fn workbench(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    piece.block([-1.0, 0.82, 0.01], [1.0, 0.9, 0.7], 0.8, finishes.oak);
    for x in [-0.95, 0.83] {
        for z in [0.05, 0.55] {
            piece.block([x, 0.0, z], [x + 0.12, 0.82, z + 0.1], 0.8, finishes.walnut);
        }
    }
    piece.block([-0.83, 0.2, 0.05], [0.83, 0.24, 0.65], 0.8, finishes.oak);
    for (i, material) in finishes.books.into_iter().enumerate() {
        let x = -0.75 + 0.26 * i as f64;
        piece.block(
            [x, 0.24, 0.15],
            [x + 0.2, 0.4 + 0.03 * i as f64, 0.5],
            1.0,
            material,
        );
    }
    piece.block([0.5, 0.9, 0.45], [0.7, 1.02, 0.72], 1.0, finishes.metal);
    piece.pipe(
        [[0.6, 0.96, 0.72], [0.6, 0.96, 0.86]],
        0.015,
        finishes.lacquer,
    );
    piece.block(
        [-0.9, 1.25, 0.005],
        [0.9, 1.95, 0.025],
        0.8,
        finishes.walnut,
    );
    for tool in 0..9 {
        let x = -0.78 + 0.19 * f64::from(tool);
        let length = 0.2 + 0.05 * f64::from(tool * 5 % 7);
        piece.pipe(
            [[x, 1.85, 0.045], [x, 1.85 - length, 0.045]],
            0.014,
            finishes.fruit[tool as usize % 3],
        );
        piece.block(
            [x - 0.04, 1.85, 0.03],
            [x + 0.04, 1.89, 0.06],
            1.0,
            finishes.metal,
        );
    }
}
