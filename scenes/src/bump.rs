//! `bump`: a plane with a hemisphere and a pyramid, after figure 3 of Shade et al. 1998, with
//! textures that make distortions visible.

use crate::mesh::{Mesh, Vertex};
use crate::texture::{checkerboard, mix, noise, paint};
use glam::{DVec2, DVec3};
use headbox_scene::material::Texture;
use headbox_scene::scene::Scene;
use std::f64::consts::FRAC_PI_2;

/// Half of the plane's edge, metres.
const HALF: f64 = 2.0;

/// Builds the scene: the plane is z = 0, and the shapes rise toward +z, where the headbox is.
pub(crate) fn build(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let plane = mesh.textured(
        "plane",
        checks([0.85, 0.83, 0.78], [0.25, 0.33, 0.45], seed),
    );
    // Bands between parallels and meridians.
    let (orange, cream) = ([0.90, 0.45, 0.20], [0.98, 0.90, 0.75]);
    let dome = mesh.textured(
        "hemisphere",
        checkerboard([256; 2], [4.0, 6.0], orange, cream),
    );
    let pyramid = mesh.textured(
        "pyramid",
        checks([0.30, 0.60, 0.35], [0.92, 0.95, 0.80], seed + 1),
    );

    let corner = DVec3::new(-HALF, -HALF, 0.0);
    mesh.add_rectangle(
        corner,
        DVec3::X * HALF * 2.0,
        DVec3::Y * HALF * 2.0,
        1.0,
        plane,
    );
    add_dome(&mut mesh, DVec3::new(-0.8, 0.1, 0.0), 0.7, dome);
    add_pyramid(&mut mesh, DVec3::new(0.9, -0.1, 0.0), 0.65, 0.9, pyramid);
    mesh.finish("bump", DVec3::new(0.0, 0.0, 3.0), 0.5)
}

/// Adds a hemisphere that rises toward +z.
fn add_dome(mesh: &mut Mesh, centre: DVec3, radius: f64, material: u32) {
    const SIDES: usize = 96;
    const ROWS: usize = 32;
    mesh.add_grid(SIDES, ROWS, material, |column, row| {
        let place = DVec2::new(column as f64 / SIDES as f64, row as f64 / ROWS as f64);
        let (sin, cos) = (place.x * std::f64::consts::TAU).sin_cos();
        let height = place.y * FRAC_PI_2;
        let rim = if row == ROWS { 0.0 } else { height.cos() };
        let normal = DVec3::new(cos * rim, sin * rim, height.sin());
        Vertex::new(
            centre + normal * radius,
            normal,
            place * DVec2::new(4.0, 1.0),
        )
    });
}

/// Adds a square pyramid that rises toward +z.
fn add_pyramid(mesh: &mut Mesh, centre: DVec3, half: f64, height: f64, material: u32) {
    let foot = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| centre + DVec3::new(x, y, 0.0) * half);
    let apex = centre + DVec3::Z * height;
    for side in 0..4 {
        let (a, b) = (foot[side], foot[(side + 1) % 4]);
        let normal = (b - a).cross(apex - a).normalize_or_zero();
        let corners = [
            (a, DVec2::ZERO),
            (b, DVec2::X * 2.0),
            (apex, DVec2::new(1.0, 2.0)),
        ];
        let triangle = corners
            .map(|(position, texcoord)| mesh.add_vertex(Vertex::new(position, normal, texcoord)));
        mesh.add_triangle(triangle, material);
    }
}

/// Four by four checks separated by thin lines and slightly mottled, so that all are different.
fn checks(light: [f64; 3], dark: [f64; 3], seed: u64) -> Texture {
    paint(256, 256, |u, v| {
        let (x, y) = (u * 4.0, v * 4.0);
        let on_line = [x, y].iter().any(|t| (t - t.round()).abs() < 0.04);
        let is_light = (x.floor() + y.floor()) % 2.0 == 0.0;
        let base = if is_light { light } else { dark };
        let mottled = mix(base, [0.5, 0.5, 0.5], 0.35 * noise(u, v, 8, 8, seed));
        if on_line { [0.1, 0.1, 0.1] } else { mottled }
    })
}
