//! `ward`: a storey of a hospital: 40 windowless rooms along a corridor, lit by 500 ceiling panels.
//!
//! The hard case of many lights: a dozen of the 500 light the visible surfaces, a few more shine
//! through a door, and all others are occluded by walls.

use crate::finishes::Finishes;
use crate::furniture;
use crate::mesh::Mesh;
use glam::{DMat3, DVec2, DVec3, dvec3};
use headbox_scene::scene::Scene;
use std::f64::consts::FRAC_PI_2;

/// Rooms along each side of the corridor.
const ROOMS: usize = 20;

/// Width of a room between the middles of its walls, metres.
const PITCH: f64 = 4.0;
/// Half of the corridor's width, metres.
const CORRIDOR: f64 = 1.2;
/// Depth of the rooms, metres.
const DEPTH: f64 = 5.0;
/// Height of the rooms, metres.
const HEIGHT: f64 = 2.7;

/// Thickness of walls, metres.
const WALL: f64 = 0.12;

/// Start and end of a door along its room, and its height, metres.
const DOOR: [f64; 3] = [0.6, 1.8, 2.1];

/// Number of panels of a room, across and along it.
const PANELS: [usize; 2] = [3, 4];
/// Number of panels of the corridor.
const CORRIDOR_PANELS: usize = 20;
/// Edge of a panel, metres.
const PANEL: f64 = 0.45;

struct Materials {
    wall: u32,
    floor: u32,
    panel: u32,
    linen: u32,
    finishes: Finishes,
}

pub(crate) fn build(seed: u64) -> Scene {
    let mut mesh = Mesh::default();
    let materials = Materials {
        wall: mesh.plain("wall", [0.72, 0.74, 0.70]),
        floor: mesh.plain("linoleum", [0.35, 0.42, 0.40]),
        panel: mesh.emissive("panel", [6.0, 5.9, 5.5]),
        linen: mesh.plain("linen", [0.78, 0.78, 0.76]),
        finishes: Finishes::new(&mut mesh, seed),
    };
    add_shell(&mut mesh, &materials);
    for i in 0..CORRIDOR_PANELS {
        let x = PITCH * ROOMS as f64 * (i as f64 + 0.5) / CORRIDOR_PANELS as f64;
        add_panel(&mut mesh, dvec3(x, HEIGHT, 0.0), &materials);
    }
    for room in 0..2 * ROOMS {
        add_room(
            &mut mesh,
            (room / 2) as f64 * PITCH,
            if room % 2 == 0 { 1.0 } else { -1.0 },
            &materials,
        );
    }
    let centre = dvec3(PITCH * 7.0 + 2.2, 1.5, CORRIDOR + WALL + 2.0);
    mesh.finish("ward", centre, 0.3)
}

/// Adds floor, ceiling and outer walls.
fn add_shell(mesh: &mut Mesh, materials: &Materials) {
    let (length, far) = (PITCH * ROOMS as f64, CORRIDOR + WALL + DEPTH);
    let slab = |mesh: &mut Mesh, low: f64, high: f64, material: u32| {
        mesh.add_block(
            [-WALL, low, -far - WALL],
            [length + WALL, high, far + WALL],
            1.0,
            material,
        );
    };
    slab(mesh, -0.2, 0.0, materials.floor);
    slab(mesh, HEIGHT, HEIGHT + 0.2, materials.wall);
    for side in [-1.0, 1.0] {
        let (a, b) = (side * far, side * (far + WALL));
        mesh.add_block(
            [-WALL, 0.0, a.min(b)],
            [length + WALL, HEIGHT, a.max(b)],
            1.0,
            materials.wall,
        );
        let (a, b) = if side < 0.0 {
            (-WALL, 0.0)
        } else {
            (length, length + WALL)
        };
        mesh.add_block([a, 0.0, -far], [b, HEIGHT, far], 1.0, materials.wall);
    }
}

/// Adds a panel that emits light downward, 1 cm below the ceiling at `place`.
fn add_panel(mesh: &mut Mesh, place: DVec3, materials: &Materials) {
    let corner = place - dvec3(PANEL / 2.0, 0.01, PANEL / 2.0);
    mesh.add_rectangle(
        corner,
        DVec3::X * PANEL,
        DVec3::Z * PANEL,
        0.0,
        materials.panel,
    );
}

/// Adds a room that starts at `x`, on one side of the corridor: two walls, a door, panels and
/// furniture.
fn add_room(mesh: &mut Mesh, x: f64, side: f64, materials: &Materials) {
    let at = |along: f64, height: f64, away: f64| dvec3(x + along, height, side * away);
    let block = |mesh: &mut Mesh, a: DVec3, b: DVec3| {
        mesh.add_block(a.min(b), a.max(b), 1.0, materials.wall);
    };
    let (near, inner, far) = (CORRIDOR, CORRIDOR + WALL, CORRIDOR + WALL + DEPTH);
    let [from, to, lintel] = DOOR;
    block(mesh, at(0.0, 0.0, near), at(from, HEIGHT, inner));
    block(mesh, at(to, 0.0, near), at(PITCH, HEIGHT, inner));
    block(mesh, at(from, lintel, near), at(to, HEIGHT, inner));
    if x > 0.0 {
        block(
            mesh,
            at(-WALL / 2.0, 0.0, inner),
            at(WALL / 2.0, HEIGHT, far),
        );
    }
    for i in 0..PANELS[0] * PANELS[1] {
        let share = |i: usize, of: usize| (i as f64 + 0.5) / of as f64;
        let along = share(i % PANELS[0], PANELS[0]) * PITCH;
        let away = share(i / PANELS[0], PANELS[1]) * DEPTH;
        add_panel(mesh, at(along, HEIGHT, inner + away), materials);
    }
    add_furniture(mesh, &at, side, materials);
}

/// Adds a bed, a table with a chair, and a picture.
fn add_furniture(
    mesh: &mut Mesh,
    at: &dyn Fn(f64, f64, f64) -> DVec3,
    side: f64,
    materials: &Materials,
) {
    let (inner, finishes) = (CORRIDOR + WALL, &materials.finishes);
    let bed = at(PITCH - 1.3, 0.0, inner + 3.6);
    mesh.add_box(
        bed + DVec3::Y * 0.42,
        dvec3(1.05, 0.06, 0.48),
        DMat3::IDENTITY,
        0.6,
        finishes.metal,
    );
    mesh.add_cushion(
        bed + DVec3::Y * 0.58,
        dvec3(1.02, 0.1, 0.46),
        DMat3::IDENTITY,
        0.5,
        materials.linen,
    );
    mesh.add_cushion(
        bed + dvec3(0.75, 0.7, 0.0),
        dvec3(0.22, 0.07, 0.34),
        DMat3::IDENTITY,
        0.5,
        materials.linen,
    );
    for (dx, dz) in [(-1.0, -0.4), (-1.0, 0.4), (1.0, -0.4), (1.0, 0.4)] {
        mesh.add_cylinder(bed + dvec3(dx, 0.0, dz), 0.03, 0.4, 12, finishes.metal);
    }
    let table = at(0.75, 0.0, inner + 4.0);
    furniture::table(
        mesh,
        table,
        0.0,
        dvec3(0.9, 0.72, 0.7),
        [finishes.oak, finishes.metal],
    );
    furniture::chair(
        mesh,
        table - dvec3(0.0, 0.0, side * 0.75),
        if side > 0.0 { 0.0 } else { 2.0 * FRAC_PI_2 },
        finishes,
    );
    let right = DVec3::X * side;
    let picture = at(PITCH / 2.0, 1.6, inner + DEPTH - 0.02);
    furniture::picture(
        mesh,
        picture,
        -right,
        DVec2::new(1.1, 0.8),
        finishes.pictures[0],
        finishes.oak,
    );
}
