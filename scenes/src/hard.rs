//! Hard cases: small scenes that each stress one part of the system.

use crate::bump;
use crate::mesh::Mesh;
use crate::texture::checkerboard;
use glam::DVec3;
use headbox_core::headbox::Headbox;
use headbox_core::random::Rng;
use headbox_scene::material::Texture;
use headbox_scene::scene::Scene;
use std::f64::consts::TAU;

fn checks(a: [f64; 3], b: [f64; 3]) -> Texture {
    checkerboard([64; 2], [4.0; 2], a, b)
}

/// Builds `poles`: poles from 1 mm to 4 cm thick on rings from 2 m to 64 m, over a checkered
/// ground. Most are thinner than a pixel, with depth discontinuities between neighbours.
pub(crate) fn poles(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let rng = Rng::new(seed);
    let ground = mesh.textured("ground", checks([0.55, 0.55, 0.5], [0.35, 0.38, 0.35]));
    mesh.add_rectangle(
        DVec3::new(-80.0, 0.0, 80.0),
        DVec3::X * 160.0,
        DVec3::NEG_Z * 160.0,
        4.0,
        ground,
    );
    let paints = [
        [0.75, 0.15, 0.1],
        [0.85, 0.85, 0.8],
        [0.1, 0.25, 0.6],
        [0.8, 0.65, 0.1],
        [0.1, 0.1, 0.1],
    ];
    let paints = paints.map(|albedo| mesh.plain("pole", albedo));
    for ring in 0..6_u32 {
        let distance = 2.0 * f64::from(1_u32 << ring);
        for pole in 0..40_u32 {
            let mut random = rng.fork(u64::from(ring * 40 + pole));
            let around = (f64::from(pole) + random.between(0.0, 0.8)) / 40.0 * TAU;
            let reach = distance * random.between(1.0, 1.4);
            let base = DVec3::new(around.cos() * reach, 0.0, around.sin() * reach);
            let lean = DVec3::new(
                random.between(-0.3, 0.3),
                random.between(2.0, 6.0),
                random.between(-0.3, 0.3),
            );
            let radius = [0.0005, 0.002, 0.005, 0.02][pole as usize % 4];
            mesh.add_tube(
                &[(base, radius), (base + lean, radius)],
                6,
                1.0,
                paints[pole as usize % paints.len()],
            );
        }
    }
    mesh.finish("poles", DVec3::Y * 1.6, 0.5)
}

/// Builds `edge-on`: rectangles around the headbox whose planes contain its centre, so that they
/// are lines from there and areas from anywhere else; and a room around them.
pub(crate) fn edge_on(_seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let wall = mesh.textured("wall", checks([0.8, 0.8, 0.8], [0.6, 0.6, 0.65]));
    let blade = mesh.textured("blade", checks([0.8, 0.3, 0.2], [0.95, 0.85, 0.7]));
    add_room(&mut mesh, DVec3::splat(4.0), wall);
    // Around all three axes, so that every face of a cube contains some.
    for axis in 0..3 {
        let along = DVec3::AXES[axis];
        let (x_axis, y_axis) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
        for step in 0..8 {
            let turn = (f64::from(step) + 0.25) / 8.0 * TAU;
            let outward = x_axis * turn.cos() + y_axis * turn.sin();
            let low = outward * 1.2 - along * 0.35;
            mesh.add_rectangle(low, outward * 1.6, along * 0.7, 0.4, blade);
        }
    }
    mesh.finish("edge-on", DVec3::ZERO, 0.5)
}

/// Builds `contact`: a panel 1 mm in front of every face of the headbox, covering a quarter of it,
/// in a room.
pub(crate) fn contact(_seed: u64) -> Scene {
    const HALF: f64 = 0.5;
    const GAP: f64 = 0.001;
    let mut mesh = Mesh::default();
    let wall = mesh.textured("wall", checks([0.8, 0.8, 0.8], [0.5, 0.6, 0.7]));
    let panel = mesh.textured("panel", checks([0.2, 0.5, 0.3], [0.9, 0.9, 0.7]));
    add_room(&mut mesh, DVec3::splat(3.0), wall);
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let (right, up) = (DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3]);
            let corner = DVec3::AXES[axis] * side * (HALF + GAP) - up * HALF;
            mesh.add_rectangle(corner, right * HALF * side, up * HALF, 0.25, panel);
        }
    }
    mesh.finish("contact", DVec3::ZERO, HALF)
}

/// Builds `far-offset`: `bump` with adjacent stairs of 1 mm steps, moved by 1e5 m along every axis:
/// `f32` coordinates would be multiples of 8 mm.
pub(crate) fn far_offset(seed: u64) -> Scene {
    let mut scene = bump::build(seed);
    let mut stairs = Mesh::default();
    let step = stairs.textured("stairs", checks([0.7, 0.4, 0.6], [0.95, 0.9, 0.9]));
    for i in 0..40 {
        let height = 0.001 * f64::from(i + 1);
        let low = DVec3::new(-1.0 + 0.05 * f64::from(i), 1.2, 0.02);
        stairs.add_block(low, low + DVec3::new(0.05, 0.4, height), 0.1, step);
    }
    append(&mut scene, stairs.finish("stairs", DVec3::ZERO, 1.0));
    transformed(scene, "far-offset", 1.0, DVec3::new(1e5, 1e5, -1e5))
}

/// Builds `miniature`: `bump` scaled to a width of 1 mm.
pub(crate) fn miniature(seed: u64) -> Scene {
    transformed(bump::build(seed), "miniature", 1e-3 / 4.0, DVec3::ZERO)
}

/// Adds the geometry of another scene.
fn append(scene: &mut Scene, other: Scene) {
    let vertices = scene.positions.len() as u32;
    let materials = scene.materials.len() as u32;
    let textures = scene.textures.len() as u32;
    scene.positions.extend(other.positions);
    scene.normals.extend(other.normals);
    scene.texcoords.extend(other.texcoords);
    for mut triangle in other.triangles {
        triangle.vertices = triangle.vertices.map(|vertex| vertex + vertices);
        triangle.material += materials;
        scene.triangles.push(triangle);
    }
    for mut material in other.materials {
        material.albedo_texture = material.albedo_texture.map(|texture| texture + textures);
        scene.materials.push(material);
    }
    scene.textures.extend(other.textures);
}

/// Scales a scene about the origin and then moves it, with its headbox.
fn transformed(scene: Scene, name: &str, scale: f64, offset: DVec3) -> Scene {
    let place = |p: DVec3| p * scale + offset;
    Scene {
        name: name.into(),
        positions: scene.positions.into_iter().map(place).collect(),
        headbox: scene.headbox.map(|headbox| Headbox {
            centre: place(headbox.centre),
            half_size_m: headbox.half_size_m * scale,
        }),
        ..scene
    }
}

/// Adds a room about the origin without ceiling, so that sun and sky light it.
fn add_room(mesh: &mut Mesh, half: DVec3, wall: u32) {
    mesh.add_rectangle(
        -half + DVec3::Z * 2.0 * half.z,
        DVec3::X * 2.0 * half.x,
        DVec3::NEG_Z * 2.0 * half.z,
        1.0,
        wall,
    );
    for (right, reach) in [(DVec3::X, half.z), (DVec3::Z, half.x)] {
        for side in [-1.0, 1.0] {
            let right = right * half.dot(right) * side;
            let corner = right.normalize().cross(DVec3::NEG_Y) * reach - right - DVec3::Y * half.y;
            mesh.add_rectangle(corner, right * 2.0, DVec3::Y * 2.0 * half.y, 1.0, wall);
        }
    }
}
