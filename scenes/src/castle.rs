//! `castle`: a castle's wall with an open gate between two towers, and the keep in the court
//! behind, after the scene of the paper on view-dependent geometry (Evers-Senne and Koch), where a
//! gate in front of the castle causes occlusion.

use crate::mesh::{Mesh, Vertex};
use crate::texture::{fractal, mix, noise, paint, shade};
use glam::{DVec2, DVec3};
use headbox_scene::material::Texture;
use headbox_scene::scene::Scene;
use std::f64::consts::PI;

/// Height of the wall, metres.
const WALL_M: f64 = 5.0;
/// Front face of the wall, z, metres.
const FRONT_Z: f64 = -7.0;
/// Back face of the wall, z, metres.
const BACK_Z: f64 = -8.2;
/// Half of the gate's width, metres.
const GATE_M: f64 = 1.3;
/// Height at which the gate's arch starts, metres.
const SPRING_M: f64 = 2.0;
/// Period of a texture, metres.
const TILE_M: f64 = 2.4;

/// Builds the scene for eyes within 1.2 m of (0, 1.7, 0) that look along -z.
pub(crate) fn build(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let sand = mesh.textured("wall", stones([0.70, 0.62, 0.48], seed));
    let grey = mesh.textured("tower", stones([0.55, 0.54, 0.52], seed + 1));
    let blue = mesh.textured("keep", stones([0.50, 0.47, 0.50], seed + 2));
    let grass = mesh.textured(
        "ground",
        paint(512, 512, |u, v| {
            shade([0.32, 0.42, 0.20], 0.5 + fractal(u, v, 24, 24, seed))
        }),
    );
    let wood = mesh.textured("wood", planks(seed));
    mesh.add_rectangle(
        DVec3::new(-30.0, 0.0, 4.0),
        DVec3::X * 60.0,
        DVec3::NEG_Z * 44.0,
        3.0,
        grass,
    );
    for side in [-1.0, 1.0] {
        let (inner, outer) = (side * GATE_M, side * 12.0);
        let low = DVec3::new(f64::min(inner, outer), 0.0, BACK_Z);
        mesh.add_block(low, [f64::max(inner, outer), WALL_M, FRONT_Z], TILE_M, sand);
        let tower = DVec3::new(side * 3.1, 0.0, FRONT_Z + 0.2);
        mesh.add_tube(
            &[
                (tower, 1.15),
                (tower + DVec3::Y * 6.4, 1.0),
                (tower + DVec3::Y * 6.8, 1.25),
            ],
            64,
            TILE_M,
            grey,
        );
        // A leaf of the gate, opened toward the court.
        let hinge = DVec3::new(side * (GATE_M - 0.06), 0.0, BACK_Z - 1.25);
        mesh.add_block(
            hinge - DVec3::X * 0.05,
            hinge + DVec3::new(0.05, SPRING_M + 0.3, 1.25),
            1.2,
            wood,
        );
    }
    add_arch(&mut mesh, sand);
    for i in -12..12 {
        let x = f64::from(i) + 0.2;
        let merlon = DVec3::new(x, WALL_M, FRONT_Z - 0.4);
        mesh.add_block(merlon, merlon + DVec3::new(0.6, 0.7, 0.4), TILE_M, sand);
    }
    // The court: the keep with a bay, and a well with a beam.
    mesh.add_block([-9.0, 0.0, -22.0], [9.0, 9.0, -17.0], TILE_M, blue);
    mesh.add_block([-1.1, 0.0, -17.0], [1.7, 6.0, -15.6], TILE_M, grey);
    mesh.add_cylinder(DVec3::new(0.55, 0.0, -11.5), 0.55, 0.8, 48, grey);
    for beam in [0.05, 1.0] {
        let foot = DVec3::new(beam, 0.0, -11.55);
        mesh.add_block(foot, foot + DVec3::new(0.1, 2.0, 0.1), 1.2, wood);
    }
    mesh.add_block([0.0, 2.0, -11.6], [1.15, 2.1, -11.4], 1.2, wood);
    mesh.finish("castle", DVec3::new(0.0, 1.7, 0.0), 1.2)
}

/// Adds the wall above the gate, and the vault under it.
fn add_arch(mesh: &mut Mesh, material: u32) {
    const STEPS: usize = 32;
    let arch = |step: usize, z: f64| {
        let angle = PI * (1.0 - step as f64 / STEPS as f64);
        DVec3::new(GATE_M * angle.cos(), SPRING_M + GATE_M * angle.sin(), z)
    };
    let vertex =
        |at: DVec3, normal: DVec3| Vertex::new(at, normal, DVec2::new(at.x, at.y) / TILE_M);
    for (z, normal) in [(FRONT_Z, DVec3::Z), (BACK_Z, DVec3::NEG_Z)] {
        mesh.add_grid(STEPS, 1, material, |step, row| {
            let at = arch(if z == FRONT_Z { step } else { STEPS - step }, z);
            vertex(
                if row == 0 {
                    at
                } else {
                    DVec3::new(at.x, WALL_M, z)
                },
                normal,
            )
        });
    }
    mesh.add_grid(STEPS, 1, material, |step, row| {
        let at = arch(step, if row == 0 { BACK_Z } else { FRONT_Z });
        let inward = DVec3::new(-at.x, SPRING_M - at.y, 0.0).normalize_or(DVec3::NEG_Y);
        Vertex::new(
            at,
            inward,
            DVec2::new(step as f64 * PI * GATE_M / STEPS as f64, at.z) / TILE_M,
        )
    });
}

/// Rows of hewn stones with joints, each stone with its own shade.
fn stones(color: [f64; 3], seed: u64) -> Texture {
    paint(1024, 1024, |u, v| {
        let row = (v * 8.0).floor();
        let (along, up) = ((u * 4.0 + 0.5 * row).rem_euclid(4.0), (v * 8.0).fract());
        let is_joint = along.fract() < 0.03 || up < 0.06;
        let shaded = 0.62
            + 0.4 * noise(along.floor() / 4.0 + 0.1, (row + 0.5) / 8.0, 4, 8, seed)
            + 0.3 * fractal(u, v, 32, 32, seed);
        if is_joint {
            shade(color, 0.42)
        } else {
            mix(shade(color, shaded), [0.4, 0.36, 0.3], 0.15)
        }
    })
}

/// Vertical planks.
fn planks(seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        let edge = (u * 6.0).fract() < 0.06;
        shade(
            [0.36, 0.24, 0.14],
            if edge {
                0.4
            } else {
                0.6 + 0.5 * fractal(u, v, 64, 4, seed)
            },
        )
    })
}
