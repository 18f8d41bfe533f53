//! Portal culling never drops visible cells: lines of sight through boxes with random openings,
//! followed one by one.

use glam::{DVec2, DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::random::Rng;
use headbox_house::portal_culling::{CellView, Limits, Window, visible_cells};
use headbox_model::{Cell, Portal, PortalModel, Prism};
use headbox_scene::scene::Scene;

const SIDE: u32 = 4;

/// Rooms of one metre in a grid of 4 by 4, each with an opening to most of its neighbours: convex
/// polygons of three to seven corners, some as wide as the wall.
fn rooms(random: &mut Rng) -> PortalModel {
    let cell = |i: u32| {
        let (x, z) = (f64::from(i % SIDE), f64::from(i / SIDE));
        let corners = [[x, z], [x + 1.0, z], [x + 1.0, z + 1.0], [x, z + 1.0]];
        let space = vec![Prism {
            outline: corners.map(DVec2::from).to_vec(),
            floor_y: 0.0,
            ceiling_y: 1.0,
        }];
        Cell {
            name: format!("room {i}"),
            space,
            triangles: 0..0,
        }
    };
    let mut portals = Vec::new();
    for i in 0..SIDE * SIDE {
        for (step, along_x) in [(1, true), (SIDE, false)] {
            let border = if along_x {
                i % SIDE == SIDE - 1
            } else {
                i / SIDE == SIDE - 1
            };
            if border || random.unit() < 0.2 {
                continue;
            }
            let corner = |a: f64, y: f64| match along_x {
                true => dvec3(f64::from(i % SIDE) + 1.0, y, f64::from(i / SIDE) + a),
                false => dvec3(f64::from(i % SIDE) + a, y, f64::from(i / SIDE) + 1.0),
            };
            let corners = 3 + (random.unit() * 5.0) as u32;
            let (radius, turn) = (random.between(0.1, 0.5), random.between(0.0, 6.0));
            let polygon = (0..corners).map(|k| {
                let angle = turn + f64::from(k) / f64::from(corners) * std::f64::consts::TAU;
                corner(0.5 + radius * angle.cos(), 0.5 + radius * angle.sin())
            });
            let mut polygon: Vec<DVec3> = polygon.collect();
            // Counter-clockwise seen from cells[0], which lies at smaller x or z.
            let normal = (polygon[1] - polygon[0]).cross(polygon[2] - polygon[0]);
            if normal.x + normal.z > 0.0 {
                polygon.reverse();
            }
            let cells = if random.unit() < 0.5 {
                [i, i + step]
            } else {
                [i + step, i]
            };
            if cells[0] != i {
                polygon.reverse();
            }
            portals.push(Portal {
                name: format!("portal {}", portals.len()),
                cells,
                polygon,
            });
        }
    }
    PortalModel {
        scene: Scene::default(),
        cells: (0..SIDE * SIDE).map(cell).collect(),
        portals,
        outside: None,
    }
}

/// The portals through which a line of sight passes until it meets a wall.
fn line_of_sight(model: &PortalModel, eye: DVec3, direction: DVec3, mut cell: u32) -> Vec<u32> {
    let mut passed = Vec::new();
    while let Some((portal, behind)) = model.portals_from(cell).find(|&(portal, _)| {
        !passed.contains(&(portal as u32)) && passes(&model.portals[portal], cell, eye, direction)
    }) {
        passed.push(portal as u32);
        cell = behind;
    }
    passed
}

/// Returns true if a line crosses a portal out of a cell, by the signs of volumes.
fn passes(portal: &Portal, cell: u32, eye: DVec3, direction: DVec3) -> bool {
    let n = portal.polygon.len();
    (0..n).all(|k| {
        let (a, b) = (portal.polygon[k] - eye, portal.polygon[(k + 1) % n] - eye);
        let volume = a.cross(b).dot(direction);
        if portal.cells[0] == cell {
            volume < 0.0
        } else {
            volume > 0.0
        }
    })
}

fn contains(views: &[CellView], portals: &[u32], direction: DVec3) -> bool {
    views
        .iter()
        .any(|view| view.portals == portals && view.window.contains(direction, 1e-9))
}

#[test]
fn never_culls_what_shows() {
    let mut random = Rng::keyed(5);
    let (mut through, mut deepest) = (0, 0);
    for model_number in 0..12 {
        let model = rooms(&mut random);
        for view_number in 0..25 {
            let mut eye = dvec3(
                random.between(0.0, 4.0),
                random.between(0.05, 0.95),
                random.between(0.0, 4.0),
            );
            if view_number % 3 == 0 {
                // On a portal's plane, or very close to it on either side.
                let portal = &model.portals[view_number % model.portals.len()];
                let middle = portal.polygon.iter().sum::<DVec3>() / portal.polygon.len() as f64;
                eye = middle + random.in_cube([1e-12, 1e-6, 1e-4, 0.02][view_number % 4]);
            }
            let Some(cell) = model.cell_at(eye) else {
                continue;
            };
            let camera = Camera::look_at(
                eye,
                eye + random.in_cube(1.0),
                DVec3::Y,
                random.between(20.0, 120.0),
                [64, 48],
            );
            let Ok(camera) = camera else { continue };
            let views = visible_cells(&model, &camera, cell, &Limits::default(), |_, _| true).views;
            assert_eq!((views[0].cell, views[0].portals.len()), (cell, 0));
            for _ in 0..400 {
                let direction =
                    camera.direction(random.between(0.0, 64.0), random.between(0.0, 48.0));
                let portals = line_of_sight(&model, eye, direction, cell);
                for depth in 0..=portals.len() {
                    let seen = contains(&views, &portals[..depth], direction);
                    assert!(
                        seen,
                        "model {model_number}, view {view_number}: {portals:?} to depth {depth} from {eye}"
                    );
                }
                through += u32::from(!portals.is_empty());
                deepest = deepest.max(portals.len());
            }
        }
    }
    assert!(
        through > 10_000 && deepest >= 5,
        "{through} lines through portals, at most {deepest}"
    );
}

#[test]
fn windows_shrink_and_bound_their_pixels() {
    let mut random = Rng::keyed(9);
    let (mut windows, mut smaller) = (0, 0);
    for _ in 0..10 {
        let model = rooms(&mut random);
        let eye = dvec3(1.4, 0.5, 2.3);
        let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, 70.0, [80, 60])
            .expect("valid");
        for view in visible_cells(
            &model,
            &camera,
            model.cell_at(eye).expect("inside"),
            &Limits::default(),
            |_, _| true,
        )
        .views
        {
            let [columns, rows] = view.window.rectangle(&camera);
            for y in 0..60 {
                for x in 0..80 {
                    let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let inside = view.window.contains(direction, 0.0);
                    assert!(
                        !inside || (columns.contains(&x) && rows.contains(&y)),
                        "{x} {y} {columns:?} {rows:?}"
                    );
                }
            }
            windows += 1;
            smaller += u32::from(columns.len() * rows.len() < 80 * 60 / 4);
        }
    }
    assert!(
        smaller * 2 > windows,
        "{smaller} of {windows} windows are less than a quarter of the frame"
    );
}

#[test]
fn cycles_end_and_limits_hold() {
    let mut random = Rng::keyed(1);
    let model = rooms(&mut random);
    let eye = dvec3(1.5, 0.5, 1.5);
    let camera =
        Camera::look_at(eye, dvec3(2.5, 0.5, 1.6), DVec3::Y, 120.0, [64, 48]).expect("valid");
    let cell = model.cell_at(eye).expect("inside");
    let all = visible_cells(&model, &camera, cell, &Limits::default(), |_, _| true);
    assert!(all.views.len() > 4 && all.is_complete);
    let shallow = visible_cells(
        &model,
        &camera,
        cell,
        &Limits {
            depth: 1,
            ..Limits::default()
        },
        |_, _| true,
    );
    assert!(shallow.views.iter().all(|view| view.portals.len() <= 1) && !shallow.is_complete);
    assert!(shallow.views.len() < all.views.len());
    let few = visible_cells(
        &model,
        &camera,
        cell,
        &Limits {
            views: 2,
            ..Limits::default()
        },
        |_, _| true,
    );
    assert_eq!((few.views.len(), few.is_complete), (2, false));
    let mut refused = 0;
    let none = visible_cells(&model, &camera, cell, &Limits::default(), |_, _| {
        refused += 1;
        false
    });
    assert_eq!((none.views.len(), none.views[0].cell), (1, cell));
    assert!(refused > 0 && none.is_complete);
    assert_eq!(
        Window::from_camera(&camera).rectangle(&camera),
        [0..64, 0..48]
    );
}
