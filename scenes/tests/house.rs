//! The built-in house keeps the promises of a portal model, at any seed and budget.

use glam::DVec3;
use headbox_model::{PortalModel, Prism};
use headbox_scenes::house;
use headbox_trace::bvh::Tracer;
use std::sync::Arc;

/// Small, so that the tests are quick; whole steps of fineness come within a fifth of it.
const BUDGET: usize = 30_000;

#[test]
fn house_has_cells_and_portals_of_paper() {
    for seed in 0..3 {
        let model = house(seed, BUDGET);
        assert_eq!(
            (model.cells.len(), model.portals.len()),
            (19, 52),
            "seed {seed}"
        );
        assert_eq!(model.scene.validate(), Ok(()), "seed {seed}");
        assert_eq!(model.outside, Some(18));
        let count = model.scene.triangles.len();
        assert!(
            (BUDGET * 4 / 5..=BUDGET).contains(&count),
            "seed {seed}: {count} triangles"
        );
    }
}

#[test]
fn triangle_runs_cover_scene_once() {
    let model = house(1, BUDGET);
    let mut end = 0;
    for cell in &model.cells {
        assert_eq!(cell.triangles.start, end, "{}", cell.name);
        end = cell.triangles.end;
        assert!(!cell.triangles.is_empty(), "{}", cell.name);
    }
    assert_eq!(end as usize, model.scene.triangles.len());
}

#[test]
fn triangle_budget_is_upper_bound() {
    let bare = house(1, 0).scene.triangles.len();
    assert!((2_000..8_000).contains(&bare), "{bare}");
    let mut previous = bare;
    for budget in [20_000, 60_000, 300_000] {
        let count = house(1, budget).scene.triangles.len();
        assert!(count <= budget && count > previous, "{count} of {budget}");
        previous = count;
    }
}

/// The middle of a portal, and its normal toward its first cell.
fn middle_and_normal(model: &PortalModel, portal: usize) -> (DVec3, DVec3) {
    let polygon = &model.portals[portal].polygon;
    let middle = polygon.iter().sum::<DVec3>() / polygon.len() as f64;
    (
        middle,
        (polygon[1] - polygon[0])
            .cross(polygon[2] - polygon[1])
            .normalize(),
    )
}

#[test]
fn portals_lie_between_their_two_cells() {
    for seed in 0..3 {
        let model = house(seed, 0);
        for (i, portal) in model.portals.iter().enumerate() {
            let (middle, normal) = middle_and_normal(&model, i);
            let sides = [0.01, -0.01].map(|step| model.cell_at(middle + normal * step));
            assert_eq!(
                sides,
                portal.cells.map(Some),
                "seed {seed}, {}",
                portal.name
            );
        }
    }
}

/// Returns the distance of a point outside a cell's box, in plan and height, metres; for the
/// outside cell, the distance inside the nearest room's box.
fn stray(model: &PortalModel, cell: usize, p: DVec3) -> f64 {
    let beyond = |prism: &Prism| {
        let (low, high) = (prism.outline[0], prism.outline[2]);
        let gaps = [
            low.x - p.x,
            p.x - high.x,
            low.y - p.z,
            p.z - high.y,
            prism.floor_y - p.y,
            p.y - prism.ceiling_y,
        ];
        gaps.into_iter().fold(f64::NEG_INFINITY, f64::max)
    };
    match model.cells[cell].space.first() {
        Some(prism) => beyond(prism),
        None => -model
            .cells
            .iter()
            .flat_map(|room| &room.space)
            .map(beyond)
            .fold(f64::INFINITY, f64::min),
    }
}

#[test]
fn no_triangle_crosses_into_another_cell() {
    /// Two units in the last place of the largest coordinate of a room, 14 m: pieces are turned by
    /// matrices.
    const ROUNDING_M: f64 = 4e-15;
    let model = house(0, 200_000);
    for (index, cell) in model.cells.iter().enumerate() {
        for triangle in
            &model.scene.triangles[cell.triangles.start as usize..cell.triangles.end as usize]
        {
            for p in triangle.vertices.map(|v| model.scene.positions[v as usize]) {
                let material = &model.scene.materials[triangle.material as usize].name;
                let stray = stray(&model, index, p);
                assert!(
                    stray <= ROUNDING_M,
                    "{material} of {} at {p} by {stray} m",
                    cell.name
                );
            }
        }
    }
}

#[test]
fn house_depends_on_seed_only() {
    let positions = |seed| house(seed, 20_000).scene.positions;
    assert!(positions(5) == positions(5));
    assert!(positions(5) != positions(6));
}

#[test]
fn house_is_sound_and_leak_free() {
    for budget in [0, 100_000] {
        let model = house(2, budget);
        assert_eq!(model.check(), []);
        let tracer = Tracer::new(Arc::new(model.scene.clone()), DVec3::ZERO);
        assert_eq!(model.leaks(&tracer, 400, 3), []);
    }
    // The test can fail: with a door forgotten, its two rooms leak into each other.
    let mut forgotten = house(2, 0);
    forgotten.portals.remove(0);
    let tracer = Tracer::new(Arc::new(forgotten.scene.clone()), DVec3::ZERO);
    assert!(!forgotten.leaks(&tracer, 400, 3).is_empty());
}
