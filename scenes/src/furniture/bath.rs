//! Furniture of bathrooms; `place` is the middle of the back on the floor.

use super::Piece;
use crate::finishes::Finishes;
use crate::mesh::Mesh;
use glam::{DVec3, dvec3};
use std::f64::consts::FRAC_PI_2;

/// Adds a bathtub, 1.7 m along the wall and 0.75 m deep, with its tap at the left.
pub(crate) fn bath(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    let white = finishes.lacquer;
    // A hollow tub of four walls and a floor.
    piece.block([-0.85, 0.0, 0.01], [0.85, 0.14, 0.75], 0.5, white);
    piece.block([-0.85, 0.14, 0.01], [0.85, 0.56, 0.09], 0.5, white);
    piece.block([-0.85, 0.14, 0.67], [0.85, 0.56, 0.75], 0.5, white);
    piece.block([-0.85, 0.14, 0.09], [-0.72, 0.56, 0.67], 0.5, white);
    piece.block([0.72, 0.14, 0.09], [0.85, 0.56, 0.67], 0.5, white);
    let tap = [
        dvec3(-0.79, 0.56, 0.38),
        dvec3(-0.79, 0.72, 0.38),
        dvec3(-0.62, 0.72, 0.38),
        dvec3(-0.6, 0.68, 0.38),
    ];
    piece.pipe(tap, 0.014, finishes.metal);
    for z in [0.3, 0.46] {
        piece.ball(dvec3(-0.79, 0.59, z), 0.03, finishes.metal);
    }
}

/// Adds a basin on a cabinet, 0.8 m by 0.48 m, with a mirror-like panel above.
pub(crate) fn basin(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    piece.block([-0.4, 0.1, 0.01], [0.4, 0.8, 0.45], 0.8, finishes.oak);
    for x in [-0.39, 0.005] {
        piece.block([x, 0.12, 0.45], [x + 0.385, 0.78, 0.465], 0.8, finishes.oak);
        piece.ball(
            dvec3(if x < 0.0 { -0.04 } else { 0.04 }, 0.66, 0.475),
            0.013,
            finishes.metal,
        );
    }
    let white = finishes.lacquer;
    piece.block([-0.42, 0.8, 0.01], [0.42, 0.84, 0.48], 1.0, white);
    let bowl = piece.at(dvec3(0.0, 0.99, 0.25));
    piece.mesh.add_sphere(bowl, 0.2, -0.95, -0.3, 40, white);
    let tap = [
        dvec3(0.0, 0.84, 0.05),
        dvec3(0.0, 1.06, 0.05),
        dvec3(0.0, 1.07, 0.17),
        dvec3(0.0, 1.03, 0.19),
    ];
    piece.pipe(tap, 0.013, finishes.metal);
    piece.block([-0.35, 1.2, 0.005], [0.35, 1.95, 0.03], 0.6, finishes.metal);
    piece.block(
        [-0.33, 1.22, 0.03],
        [0.33, 1.93, 0.034],
        0.0,
        finishes.lacquer,
    );
}

/// Adds a toilet, 0.4 m by 0.68 m.
pub(crate) fn toilet(mesh: &mut Mesh, place: DVec3, turn: f64, finishes: &Finishes) {
    let mut piece = Piece::new(mesh, place, turn);
    let white = finishes.lacquer;
    piece.cushion([-0.2, 0.4, 0.01], [0.2, 0.8, 0.2], white);
    piece.block([-0.11, 0.0, 0.1], [0.11, 0.3, 0.5], 1.0, white);
    let bowl = piece.at(dvec3(0.0, 0.4, 0.44));
    piece
        .mesh
        .add_sphere(bowl, 0.22, -FRAC_PI_2, 0.0, 32, white);
    piece.mesh.add_cylinder(bowl, 0.22, 0.04, 32, white);
    piece.ball(dvec3(0.0, 0.81, 0.1), 0.02, finishes.metal);
}
