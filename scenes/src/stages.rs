//! Scenes for lumigraphs, with the camera planes, fields of view and depths of table 4 of *Layered
//! Lumigraph with LOD Control*, in metres; and a glossy one.
//!
//! The camera plane is z = 0, the cameras look along -z, and the headbox has the edge of the camera
//! square.

use crate::mesh::{Mesh, Vertex};
use crate::texture::{checkerboard, fractal, mix, noise, paint, shade};
use glam::{DMat3, DVec2, DVec3};
use headbox_core::random::Rng;
use headbox_scene::material::Texture;
use headbox_scene::scene::Scene;
use std::f64::consts::TAU;

/// Builds `net`: a wavy net of knotted cord in front of balls and a painted wall, at 1.83 to 3.09
/// m, for a camera square of 1 m.
pub(crate) fn net(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let wall = mesh.textured("wall", plaster([0.52, 0.60, 0.68], seed));
    mesh.add_rectangle(
        DVec3::new(-4.0, -4.0, -3.088),
        DVec3::X * 8.0,
        DVec3::Y * 8.0,
        1.5,
        wall,
    );
    let (red, cream) = ([0.85, 0.32, 0.22], [0.95, 0.88, 0.70]);
    let bands = mesh.textured("ball", checkerboard([256; 2], [12.0, 8.0], red, cream));
    for (centre, radius) in [
        (DVec3::new(0.1, -0.2, -2.75), 0.28),
        (DVec3::new(-0.6, 0.5, -2.7), 0.2),
        (DVec3::new(0.75, 0.45, -2.8), 0.24),
    ] {
        mesh.add_ball(centre, radius, 48, bands);
    }
    let cord = mesh.textured("cord", rope([0.80, 0.72, 0.52], seed));
    let knot = mesh.plain("knot", [0.32, 0.24, 0.12]);
    const CELLS: u32 = 26;
    const STEPS: u32 = 6;
    let net = |u: f64, v: f64| {
        let wave = 0.16 * (u * 9.0 + v * 2.0).sin() + 0.1 * (v * 7.0 - u * 3.0).cos();
        DVec3::new(3.6 * (u - 0.5), 3.6 * (v - 0.5), -2.11 + wave)
    };
    let at = |i: u32| f64::from(i) / f64::from(CELLS * STEPS);
    for line in (0..=CELLS).map(|i| at(i * STEPS)) {
        let across: Vec<_> = (0..=CELLS * STEPS)
            .map(|i| (net(at(i), line), 0.006))
            .collect();
        let up: Vec<_> = (0..=CELLS * STEPS)
            .map(|i| (net(line, at(i)), 0.006))
            .collect();
        mesh.add_tube(&across, 8, 0.1, cord);
        mesh.add_tube(&up, 8, 0.1, cord);
        for i in 0..=CELLS {
            mesh.add_ball(net(at(i * STEPS), line), 0.013, 10, knot);
        }
    }
    mesh.finish("net", DVec3::ZERO, 0.5)
}

/// Builds `statue`: a figure of stone on a pedestal in front of a curtain, at 2.33 to 5.82 m, for a
/// camera square of 2 m.
pub(crate) fn statue(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let floor = mesh.textured("floor", tiles());
    mesh.add_rectangle(
        DVec3::new(-6.0, -1.6, -2.33),
        DVec3::X * 12.0,
        DVec3::NEG_Z * 3.6,
        1.0,
        floor,
    );
    let cloth = mesh.textured("curtain", plaster([0.46, 0.16, 0.18], seed));
    let fold = |i: usize| {
        let x = -6.0 + i as f64 * 0.05;
        DVec3::new(
            x,
            0.0,
            -5.66 - 0.15 * (x * 11.0).sin().abs() + 0.05 * (x * 3.1).sin().min(0.0),
        )
    };
    mesh.add_grid(240, 1, cloth, |column, row| {
        let place = fold(column) + DVec3::Y * if row == 0 { -1.6 } else { 4.0 };
        Vertex::new(place, DVec3::ZERO, DVec2::new(place.x, place.y) / 1.5)
    });
    let stone = mesh.textured("stone", plaster([0.72, 0.70, 0.66], seed + 1));
    let base = mesh.textured("pedestal", plaster([0.35, 0.36, 0.38], seed + 2));
    mesh.add_block([-0.55, -1.6, -3.75], [0.55, -0.9, -2.75], 0.8, base);
    // Surface of revolution: heights and radii of robe, waist, shoulders and neck.
    let profile = [
        (-0.9, 0.42),
        (-0.75, 0.40),
        (-0.4, 0.30),
        (0.0, 0.24),
        (0.25, 0.27),
        (0.45, 0.33),
        (0.58, 0.26),
        (0.66, 0.1),
        (0.74, 0.09),
    ];
    let body: Vec<_> = profile
        .iter()
        .map(|&(y, radius)| (DVec3::new(0.0, y, -3.25), radius))
        .collect();
    mesh.add_tube(&body, 64, 0.9, stone);
    mesh.add_ball(DVec3::new(0.0, 0.9, -3.23), 0.19, 48, stone);
    let arm = [
        (DVec3::new(0.3, 0.42, -3.2), 0.1),
        (DVec3::new(0.55, 0.1, -3.0), 0.085),
        (DVec3::new(0.4, 0.3, -2.6), 0.07),
        (DVec3::new(0.3, 0.5, -2.45), 0.05),
    ];
    mesh.add_tube(&arm, 32, 0.5, stone);
    mesh.add_ball(DVec3::new(0.28, 0.54, -2.43), 0.085, 32, stone);
    let other = [
        (DVec3::new(-0.3, 0.42, -3.25), 0.1),
        (DVec3::new(-0.5, 0.05, -3.2), 0.085),
        (DVec3::new(-0.36, -0.3, -3.05), 0.07),
    ];
    mesh.add_tube(&other, 32, 0.5, stone);
    mesh.finish("statue", DVec3::ZERO, 1.0)
}

/// Builds `blocks`: a heap of painted blocks, at 0.89 to 3.35 m, for a camera square of 1 m.
pub(crate) fn blocks(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let rng = Rng::new(seed);
    let wall = mesh.textured("wall", plaster([0.62, 0.60, 0.52], seed));
    mesh.add_rectangle(
        DVec3::new(-5.0, -5.0, -3.35),
        DVec3::X * 10.0,
        DVec3::Y * 10.0,
        1.2,
        wall,
    );
    let colors = [
        [0.75, 0.22, 0.18],
        [0.20, 0.42, 0.70],
        [0.90, 0.74, 0.25],
        [0.28, 0.55, 0.32],
        [0.85, 0.83, 0.78],
    ];
    let paints: Vec<u32> = (0..colors.len())
        .map(|i| mesh.textured("block", crate_side(colors[i], seed + i as u64)))
        .collect();
    for i in 0..70_u32 {
        let mut random = rng.fork(u64::from(i));
        // Uniform in the square root of depth: distant blocks are small and therefore more.
        let depth =
            (0.98f64.sqrt() + (3.1f64.sqrt() - 0.98f64.sqrt()) * f64::from(i) / 69.0).powi(2);
        let reach = 0.85 * depth;
        let centre = DVec3::new(
            random.between(-reach, reach),
            random.between(-reach, reach),
            -depth - 0.08,
        );
        let axis = random.in_cube(1.0).normalize_or(DVec3::Y);
        let turn = DMat3::from_axis_angle(axis, random.between(0.0, TAU));
        let half = DVec3::splat(0.035 * depth.max(1.2) + random.between(0.0, 0.03));
        mesh.add_box(
            centre,
            half.min(DVec3::splat((depth - 0.83) / 2.0)),
            turn,
            0.0,
            paints[i as usize % paints.len()],
        );
    }
    mesh.finish("blocks", DVec3::ZERO, 0.5)
}

/// Builds `lacquer`: varnished balls on a polished floor in front of a wall, at 1.9 to 4.2 m, for a
/// camera square of 1 m. Reflections move with the eye.
pub(crate) fn lacquer(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let wall = mesh.textured("wall", plaster([0.50, 0.53, 0.58], seed));
    mesh.add_rectangle(
        DVec3::new(-5.0, -1.0, -4.2),
        DVec3::X * 10.0,
        DVec3::Y * 6.0,
        1.5,
        wall,
    );
    let polished = mesh.textured("floor", tiles());
    mesh.glossy(polished, 0.15, 120.0);
    mesh.add_rectangle(
        DVec3::new(-5.0, -1.0, -1.2),
        DVec3::X * 10.0,
        DVec3::NEG_Z * 3.0,
        1.0,
        polished,
    );
    let balls = [
        (
            [0.62, 0.10, 0.08],
            DVec3::new(-0.75, -0.55, -2.7),
            0.45,
            40.0,
        ),
        (
            [0.10, 0.22, 0.48],
            DVec3::new(0.15, -0.62, -2.3),
            0.38,
            120.0,
        ),
        (
            [0.08, 0.30, 0.14],
            DVec3::new(0.95, -0.45, -3.1),
            0.55,
            20.0,
        ),
        ([0.55, 0.42, 0.12], DVec3::new(0.1, -0.5, -3.4), 0.5, 400.0),
    ];
    for (i, (color, centre, radius, exponent)) in balls.into_iter().enumerate() {
        let varnish = mesh.textured("varnish", plaster(color, seed + 1 + i as u64));
        mesh.glossy(varnish, 0.3, exponent);
        mesh.add_ball(centre, radius, 96, varnish);
    }
    mesh.finish("lacquer", DVec3::ZERO, 0.5)
}

/// Rough surface of one colour.
fn plaster(color: [f64; 3], seed: u64) -> Texture {
    paint(512, 512, |u, v| {
        shade(color, 0.65 + 0.5 * fractal(u, v, 16, 16, seed))
    })
}

/// Twisted strands of a cord.
fn rope(color: [f64; 3], seed: u64) -> Texture {
    paint(64, 64, |u, v| {
        let strand = 0.5 + 0.5 * ((u + v * 4.0) * TAU * 2.0).sin();
        shade(color, 0.55 + 0.35 * strand + 0.2 * noise(u, v, 8, 8, seed))
    })
}

fn tiles() -> Texture {
    paint(256, 256, |u, v| {
        let (x, y) = (u * 2.0, v * 2.0);
        let joint = [x, y].iter().any(|t| (t - t.round()).abs() < 0.02);
        let light = (x.floor() + y.floor()) % 2.0 == 0.0;
        if joint {
            [0.2; 3]
        } else if light {
            [0.78, 0.76, 0.72]
        } else {
            [0.45, 0.46, 0.48]
        }
    })
}

/// Side of a crate: boards in a frame.
fn crate_side(color: [f64; 3], seed: u64) -> Texture {
    paint(128, 128, |u, v| {
        let rim = [u, v].iter().any(|t| *t < 0.1 || *t > 0.9);
        let board = ((v * 5.0).fract() - 0.5).abs() > 0.45;
        let grain = 0.75 + 0.4 * noise(u, v, 4, 32, seed);
        let base = if rim {
            mix(color, [0.95, 0.93, 0.88], 0.5)
        } else {
            color
        };
        shade(base, if board && !rim { 0.45 } else { grain })
    })
}
