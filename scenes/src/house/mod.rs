//! `house`: a furnished one-storey house of 18 rooms in a garden, as cells and portals, after the
//! Brooks House of Rafferty et al. 1998 (19 cells, 52 portals and 1,744,000 polygons; R-N3).

mod floor;
mod furnish;
mod outside;
mod palette;
mod shell;

use crate::mesh::{Fineness, Mesh};
use floor::{Floor, Purpose};
use furnish::{Furnisher, hang_lamps};
use glam::{DVec2, DVec3};
use headbox_core::random::Rng;
use headbox_model::{Cell, Portal, PortalModel, Prism};
use headbox_scene::scene::Scene;
use palette::{Palette, TILE_M};
use shell::{add_slab, walls};

/// Default number of triangles of [`house`], that of the paper's house.
pub const HOUSE_TRIANGLES: usize = 1_744_000;

/// Margin of a cell below its floor and above its ceiling, metres: a point on the floor is in the
/// room.
const SLAB_DEPTH: f64 = 0.05;

/// Height of the eye in the suggested headbox, metres.
const EYE: f64 = 1.5;

/// Generates a furnished one-storey house of 18 rooms and corridors with doors and windows, in a
/// garden: 19 cells (the last is the outside) and 52 portals. The seed moves walls and doors,
/// mirrors the plan, and chooses furniture and finishes.
///
/// Portals are in the middle of their wall's thickness. Each cell contains its half of the wall,
/// reveals included, so that the triangles and portals of a cell form a closed surface. No triangle
/// crosses a portal.
///
/// Walls and furniture are tessellated in discrete steps to at most `triangle_budget` triangles (a
/// few per cent less; a fifth less for small budgets). A small budget leaves out furniture; the
/// bare walls (some 4,600 triangles) remain for any budget.
pub fn house(seed: u64, triangle_budget: usize) -> PortalModel {
    let plan = Floor::new(&Rng::new(seed));
    let mut mesh = Mesh::default();
    let palette = Palette::new(&mut mesh, seed);
    // The finest step within the budget, by bisection: finer steps have no fewer triangles.
    let (mut fits, mut too_many) = (Detail::COARSEST, Detail::FINEST + 1);
    while too_many - fits > 1 {
        let middle = (fits + too_many) / 2;
        let detail = Detail::new(middle);
        let mut count = Mesh::counting(detail.fineness);
        build(&mut count, &plan, &detail, &palette, seed);
        if count.triangle_count() <= triangle_budget {
            fits = middle;
        } else {
            too_many = middle;
        }
    }
    let detail = Detail::new(fits);
    mesh.fineness = detail.fineness;
    let ends = build(&mut mesh, &plan, &detail, &palette, seed);
    assemble(mesh, &plan, &ends)
}

/// Generates the house as a scene.
pub(crate) fn build_scene(seed: u64) -> Scene {
    house(seed, HOUSE_TRIANGLES).scene
}

/// One step of tessellation.
struct Detail {
    fineness: Fineness,
    /// Share of the furniture that is placed, 0 to 1.
    furniture: f64,
}

impl Detail {
    /// Coarsest step: bare walls.
    const COARSEST: i32 = -80;
    /// Finest step: cells of 4 mm.
    const FINEST: i32 = 240;
    /// Number of steps that halve the length of a cell.
    const STEPS: f64 = 32.0;

    fn new(step: i32) -> Self {
        let scale = (f64::from(step) / Self::STEPS).exp2();
        Self {
            fineness: Fineness {
                edge_m: 0.7 / scale,
                round: scale.sqrt().clamp(0.25, 8.0),
            },
            furniture: (1.0 + f64::from(step) / f64::from(-Self::COARSEST)).clamp(0.0, 1.0),
        }
    }
}

/// Builds all cells in order; returns the number of triangles after each cell.
fn build(mesh: &mut Mesh, plan: &Floor, detail: &Detail, palette: &Palette, seed: u64) -> Vec<u32> {
    let rng = Rng::new(seed);
    let mut ends = Vec::new();
    for cell in 0..plan.rooms.len() {
        let rng = rng.fork(1000 + cell as u64);
        add_room(mesh, plan, cell, detail, palette, &rng);
        ends.push(mesh.triangle_count() as u32);
    }
    outside::add(mesh, plan, palette, &rng.fork(999), detail.furniture > 0.3);
    ends.push(mesh.triangle_count() as u32);
    ends
}

fn add_room(
    mesh: &mut Mesh,
    plan: &Floor,
    cell: usize,
    detail: &Detail,
    palette: &Palette,
    rng: &Rng,
) {
    let room = &plan.rooms[cell];
    let finishes = &palette.finishes;
    let mut random = rng.fork(0);
    let wall_material = palette.wall_material(room.purpose, &mut random);
    let floor = palette.floor_material(room.purpose, &mut random);
    add_slab(mesh, plan, cell, 0.0, true, TILE_M, floor);
    add_slab(mesh, plan, cell, room.ceiling, false, 2.0, finishes.plaster);
    let walls = walls(plan, cell, [0.0, room.ceiling]);
    for wall in &walls {
        wall.add_face(mesh, &[], TILE_M, wall_material);
        for hole in &wall.holes {
            wall.add_reveals(mesh, hole, hole.heights[0] > 0.0, 1.0, finishes.plaster);
        }
    }
    if detail.furniture <= 0.0 {
        return;
    }
    for wall in &walls {
        for hole in &wall.holes {
            if hole.heights[0] == 0.0 {
                wall.add_casing(mesh, hole, finishes.lacquer);
            }
            wall.add_filling(mesh, hole, cell, finishes);
        }
        if room.purpose != Purpose::Bathroom {
            wall.add_skirting(mesh, finishes.lacquer);
        }
    }
    hang_lamps(mesh, plan, cell, palette);
    let mut furnisher = Furnisher::new(plan, cell, &walls);
    if room.purpose == Purpose::Living {
        // Keeps the headbox free.
        furnisher.occupy(headbox_centre(plan, cell), DVec2::splat(0.6), [0.9, 2.1]);
    }
    furnisher.furnish(mesh, room.purpose, detail.furniture, palette, rng);
}

fn headbox_centre(plan: &Floor, cell: usize) -> DVec2 {
    (plan.rooms[cell].low + plan.rooms[cell].high) / 2.0
}

/// Assembles the model; `ends`: number of triangles after each cell.
fn assemble(mesh: Mesh, plan: &Floor, ends: &[u32]) -> PortalModel {
    let living = plan
        .rooms
        .iter()
        .position(|room| room.purpose == Purpose::Living)
        .unwrap_or(0);
    let centre = headbox_centre(plan, living);
    let scene = mesh.finish("house", DVec3::new(centre.x, EYE, centre.y), 0.4);
    let space = |room: &floor::Room| {
        let ([x0, z0], [x1, z1]) = (room.low.to_array(), room.high.to_array());
        Prism {
            outline: [[x0, z0], [x1, z0], [x1, z1], [x0, z1]]
                .map(DVec2::from)
                .to_vec(),
            floor_y: -SLAB_DEPTH,
            ceiling_y: room.ceiling + SLAB_DEPTH,
        }
    };
    let names = plan
        .rooms
        .iter()
        .map(|room| (room.name, vec![space(room)]))
        .chain([("Outside", Vec::new())]);
    let begins = std::iter::once(0).chain(ends.iter().copied());
    let cells = names.zip(begins.zip(ends));
    let cells = cells.map(|((name, space), (from, &to))| Cell {
        name: name.into(),
        space,
        triangles: from..to,
    });
    let portals = plan.openings.iter().map(|opening| Portal {
        name: opening.name.clone(),
        cells: opening.cells.map(|cell| cell as u32),
        polygon: opening.polygon(plan),
    });
    PortalModel {
        scene,
        cells: cells.collect(),
        portals: portals.collect(),
        outside: Some(plan.outside() as u32),
    }
}
