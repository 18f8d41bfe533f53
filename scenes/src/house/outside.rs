//! Outside of the house: facade, roof and garden.

use super::floor::{Fill, Floor, point};
use super::palette::Palette;
use super::shell::walls;
use crate::mesh::{Mesh, Vertex};
use crate::texture::fractal;
use glam::{DVec2, DVec3, dvec3};
use headbox_core::random::Rng;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Height of the ground, metres; the floors are at 0.
const GROUND: f64 = -0.15;
/// Heights of the lower and upper side of the slab under the roof, metres.
const SLAB: [f64; 2] = [3.1, 3.25];
/// Overhang of the roof beyond the middles of the walls, metres.
const EAVES: f64 = 0.75;
/// Factor of the length of cells in the garden: grass needs fewer triangles per area.
const COARSER: f64 = 8.0;
/// Factor of the number of sides of plants, which are distant.
const PLANTS: f64 = 0.5;

/// Adds the outside cell.
pub(super) fn add(mesh: &mut Mesh, plan: &Floor, palette: &Palette, rng: &Rng, furnished: bool) {
    let heights = [GROUND - 0.15, SLAB[0] + 0.05];
    let rows: Vec<f64> = plan
        .openings
        .iter()
        .filter(|o| o.cells[1] == plan.outside())
        .flat_map(|o| o.heights)
        .collect();
    for wall in walls(plan, plan.outside(), heights) {
        wall.add_face(mesh, &rows, 2.0, palette.stucco);
        for hole in &wall.holes {
            wall.add_reveals(mesh, hole, true, 1.0, palette.finishes.plaster);
            wall.add_casing(mesh, hole, palette.finishes.lacquer);
            if hole.fill == Fill::Window {
                let sill = hole.heights[0];
                let a = wall.in_front(hole.span[0] - 0.08, sill - 0.06, 0.001);
                let b = wall.in_front(hole.span[1] + 0.08, sill, 0.06);
                mesh.add_block(a.min(b), a.max(b), 1.0, palette.paving);
            } else {
                // A step, or a terrace in front of the widest door.
                let (aside, out) = if hole.fill == Fill::Free {
                    (2.4, 3.2)
                } else {
                    (0.35, 0.9)
                };
                let a = wall.in_front(hole.span[0] - aside, GROUND - 0.05, 0.0);
                let b = wall.in_front(hole.span[1] + aside, -0.03, out);
                mesh.add_block(a.min(b), a.max(b), 1.2, palette.paving);
            }
        }
    }
    add_roof(mesh, plan, palette);
    let fine = mesh.fineness;
    mesh.fineness.edge_m *= COARSER;
    let corner = dvec3(-34.0, GROUND, 28.0);
    mesh.add_rectangle(
        corner,
        DVec3::X * 68.0,
        DVec3::NEG_Z * 56.0,
        2.5,
        palette.finishes.lawn,
    );
    if furnished {
        mesh.fineness.round *= PLANTS;
        add_garden(mesh, plan, palette, rng);
    }
    mesh.fineness = fine;
}

/// Adds a slab with a hipped roof, and a chimney.
fn add_roof(mesh: &mut Mesh, plan: &Floor, palette: &Palette) {
    let [low, high] = [plan.low - EAVES, plan.high + EAVES];
    mesh.add_block(
        [low.x, SLAB[0], low.y],
        [high.x, SLAB[1], high.y],
        1.0,
        palette.finishes.lacquer,
    );
    let eaves = |x: f64, z: f64| dvec3(x, SLAB[1] + 0.001, z);
    let [a, b, c, d] = [
        eaves(low.x, low.y),
        eaves(high.x, low.y),
        eaves(high.x, high.y),
        eaves(low.x, high.y),
    ];
    let reach = (high.y - low.y) / 2.0;
    let ridge = |x: f64| dvec3(x, SLAB[1] + 0.38 * reach, (low.y + high.y) / 2.0);
    let (west, east) = (ridge(low.x + reach), ridge(high.x - reach));
    for [left, right, top_right, top_left] in [
        [d, c, east, west],
        [b, a, west, east],
        [c, b, east, east],
        [a, d, west, west],
    ] {
        let slope = ((left + right) / 2.0).distance((top_left + top_right) / 2.0);
        let columns = mesh.cells(2.0 * left.distance(right));
        let rows = mesh.cells(2.0 * slope);
        let normal = (right - left).cross(top_left - left).normalize_or_zero();
        mesh.add_grid(columns, rows, palette.roof, |column, row| {
            let (s, t) = (column as f64 / columns as f64, row as f64 / rows as f64);
            let top = if top_left == top_right {
                top_left
            } else {
                top_left.lerp(top_right, s)
            };
            let position = if row == rows {
                top
            } else {
                left.lerp(right, s).lerp(top, t)
            };
            let texcoord = DVec2::new(
                (position - left).dot((right - left).normalize_or_zero()),
                t * slope,
            ) / 2.4;
            Vertex::new(position, normal, texcoord)
        });
    }
    let chimney = dvec3(high.x * 0.3, 0.0, 1.5);
    mesh.add_block(
        chimney + DVec3::Y * 4.0,
        chimney + dvec3(0.6, 7.2, 0.9),
        1.0,
        palette.stucco,
    );
}

/// Adds hedges around the lawn, trees and bushes.
fn add_garden(mesh: &mut Mesh, plan: &Floor, palette: &Palette, rng: &Rng) {
    let mut random = rng.fork(900);
    for (x, z, along_x, length) in [
        (0.0, -25.0, true, 60.0),
        (0.0, 25.0, true, 60.0),
        (-31.0, 0.0, false, 48.0),
        (31.0, 0.0, false, 48.0),
    ] {
        let half = if along_x {
            dvec3(length / 2.0, 0.0, 0.6)
        } else {
            dvec3(0.6, 0.0, length / 2.0)
        };
        let centre = dvec3(x, GROUND, z);
        mesh.add_block(
            centre - half,
            centre + half + DVec3::Y * 1.7,
            2.5,
            palette.leaves[2],
        );
    }
    let house = plan.high + 3.2;
    let mut trees = 0;
    while trees < 16 {
        let (x, z) = (random.between(-28.0, 28.0), random.between(-22.0, 22.0));
        let (radius, trunk) = (random.between(1.2, 2.4), random.between(1.4, 2.6));
        if x.abs() < house.x + radius && z.abs() < house.y + radius {
            continue;
        }
        add_tree(
            mesh,
            dvec3(x, GROUND, z),
            radius,
            trunk,
            palette,
            &mut random,
        );
        trees += 1;
    }
    // Bushes below some of the windows.
    let has_bushes = |span: [f64; 2]| (span[0] * 7.0).floor() % 2.0 == 0.0;
    for opening in plan
        .openings
        .iter()
        .filter(|o| o.fill == Fill::Window && has_bushes(o.span))
    {
        let out = if opening.plane > 0.0 { 1.1 } else { -1.1 };
        for &along in &opening.span {
            let mut centre = point(opening.axis, opening.plane + out, along, GROUND + 0.3);
            centre += dvec3(random.between(-0.2, 0.2), 0.0, random.between(-0.2, 0.2));
            let material = palette.leaves[(random.unit() * 3.0) as usize % 3];
            add_clump(
                mesh,
                centre,
                random.between(0.35, 0.55),
                material,
                (along * 1000.0) as i64 as u64,
            );
        }
    }
}

fn add_tree(
    mesh: &mut Mesh,
    foot: DVec3,
    radius: f64,
    trunk: f64,
    palette: &Palette,
    random: &mut Rng,
) {
    let top = foot + DVec3::Y * (trunk + radius);
    mesh.add_tube(
        &[(foot, 0.2), (foot + DVec3::Y * trunk, 0.14), (top, 0.06)],
        12,
        1.0,
        palette.finishes.walnut,
    );
    for clump in 0..5 {
        let around = f64::from(clump) * TAU / 4.0 + random.between(-0.4, 0.4);
        let aside = if clump == 4 { 0.0 } else { 0.55 };
        let offset = dvec3(
            around.cos() * aside,
            if clump == 4 { 0.55 } else { 0.0 },
            around.sin() * aside,
        );
        let material = palette.leaves[(random.unit() * 3.0) as usize % 3];
        let seed = (random.unit() * 1e9) as u64;
        add_clump(
            mesh,
            top + offset * radius,
            radius * random.between(0.55, 0.75),
            material,
            seed,
        );
    }
}

/// Adds a clump of leaves: a sphere with dents.
fn add_clump(mesh: &mut Mesh, centre: DVec3, radius: f64, material: u32, seed: u64) {
    let (columns, rows) = (mesh.sides(24), mesh.sides(12));
    mesh.add_grid(columns, rows, material, |column, row| {
        // The seam and the poles are exact, so that the seam is closed and triangles without area
        // are detected.
        let u = (column % columns) as f64 / columns as f64;
        let v = row as f64 / rows as f64;
        let (longitude, latitude) = (u * TAU, v * PI - FRAC_PI_2);
        let is_pole = row == 0 || row == rows;
        let rim = if is_pole { 0.0 } else { latitude.cos() };
        let direction = dvec3(
            longitude.cos() * rim,
            latitude.sin(),
            -longitude.sin() * rim,
        );
        let dent = if is_pole {
            0.5
        } else {
            fractal(u, v, 6, 5, seed)
        };
        Vertex::new(
            centre + direction * radius * (0.72 + 0.5 * dent),
            DVec3::ZERO,
            DVec2::new(u, v) * 4.0,
        )
    });
}
