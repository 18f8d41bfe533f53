//! `sprites`: four layers with relief, clearly separated in depth, seen from the headbox toward -z:
//! suitable for sprites with depth (Shade et al. 1998, figure 1).

use crate::mesh::{Mesh, Vertex};
use crate::texture::{checkerboard, fractal, mix, paint, shade};
use glam::{DVec2, DVec3};
use headbox_scene::material::Texture;
use headbox_scene::scene::Scene;

/// A band of land across the view.
struct Ridge {
    /// Mean distance, metres.
    distance: f64,
    /// Amplitude of the bulge toward the eye, metres.
    relief: f64,
    /// Half of its width, metres.
    half_width: f64,
    /// Mean height of its crest above the eye, metres.
    crest: f64,
    /// Amplitude of the crest, metres.
    swing: f64,
    color: [f64; 3],
}

/// Builds the scene, from back to front: mountains, hills, balloons, boulders.
pub(crate) fn build(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let mountains = Ridge {
        distance: 14.0,
        relief: 1.0,
        half_width: 14.0,
        crest: 2.6,
        swing: 1.5,
        color: [0.55, 0.60, 0.72],
    };
    let hills = Ridge {
        distance: 8.5,
        relief: 0.7,
        half_width: 9.0,
        crest: -0.3,
        swing: 0.7,
        color: [0.42, 0.56, 0.30],
    };
    add_ridge(&mut mesh, "mountains", &mountains, seed);
    add_ridge(&mut mesh, "hills", &hills, seed + 1);
    let (red, cream) = ([0.85, 0.20, 0.15], [0.98, 0.90, 0.70]);
    let stripes = checkerboard([256, 64], [16.0, 3.0], red, cream);
    let balloon = mesh.textured("balloon", stripes);
    for (x, y, radius) in [(-1.5, 0.9, 0.75), (1.7, 0.35, 0.6)] {
        mesh.add_ball(DVec3::new(x, y, -5.0), radius, 64, balloon);
    }
    let boulder = mesh.textured("boulder", mottled([0.50, 0.44, 0.38], seed + 2));
    for (x, y, radius) in [
        (-0.9, -0.75, 0.40),
        (-0.15, -0.85, 0.30),
        (0.75, -0.70, 0.45),
    ] {
        mesh.add_ball(DVec3::new(x, y, -2.3), radius, 64, boulder);
    }
    mesh.finish("sprites", DVec3::ZERO, 0.5)
}

fn add_ridge(mesh: &mut Mesh, name: &str, ridge: &Ridge, seed: u64) {
    const COLUMNS: usize = 160;
    const ROWS: usize = 48;
    let foot = -0.6 * ridge.distance;
    let material = mesh.textured(name, mottled(ridge.color, seed));
    let at = |column: f64, row: f64| {
        let (u, v) = (column / COLUMNS as f64, row / ROWS as f64);
        let top = ridge.crest + ridge.swing * (2.0 * fractal(u, 0.37, 6, 1, seed) - 1.0);
        let swell = ridge.relief * (2.0 * fractal(u, 0.5 * v, 5, 3, seed + 7) - 1.0);
        DVec3::new(
            (2.0 * u - 1.0) * ridge.half_width,
            foot + (top - foot) * v,
            swell - ridge.distance,
        )
    };
    mesh.add_grid(COLUMNS, ROWS, material, |column, row| {
        let (x, y) = (column as f64, row as f64);
        let normal = (at(x + 0.5, y) - at(x - 0.5, y))
            .cross(at(x, y + 0.5) - at(x, y - 0.5))
            .normalize_or_zero();
        Vertex::new(
            at(x, y),
            normal,
            DVec2::new(x / COLUMNS as f64 * 4.0, y / ROWS as f64),
        )
    });
}

fn mottled(color: [f64; 3], seed: u64) -> Texture {
    paint(512, 256, |u, v| {
        let patch = fractal(u, v, 8, 8, seed);
        let grain = fractal(u, v, 64, 64, seed + 1);
        mix(
            shade(color, 0.6 + 0.8 * patch),
            shade(color, 0.3),
            0.5 * grain,
        )
    })
}
