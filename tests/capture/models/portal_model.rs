//! Portal models: every kind of defect is found, reported in a sentence, and repaired if it would
//! break a walkthrough.

use glam::{DVec2, DVec3, dvec3};
use headbox_model::{Cell, Finding, Flaw, Portal, PortalModel, Prism, Severity, Shape};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_trace::bvh::Tracer;
use std::sync::Arc;

/// Adds a rectangle.
fn rectangle(scene: &mut Scene, corner: DVec3, right: DVec3, up: DVec3) {
    let first = scene.positions.len() as u32;
    scene
        .positions
        .extend([corner, corner + right, corner + right + up, corner + up]);
    scene
        .triangles
        .extend([[0, 1, 2], [0, 2, 3]].map(|c: [u32; 3]| Triangle {
            vertices: c.map(|v| first + v),
            material: 0,
        }));
}

/// Floor, ceiling and four walls of a room of 4 m by 2.5 m by 3 m from x on, its wall at `x + 4`
/// (`open_right`) or at `x` open from z = 1 to z = 2 up to 2 m.
fn room(scene: &mut Scene, x: f64, open_right: bool) {
    let (near, far) = (dvec3(x, 0.0, 0.0), dvec3(x + 4.0, 2.5, 3.0));
    let size = far - near;
    rectangle(scene, near, DVec3::X * size.x, DVec3::Z * size.z);
    rectangle(
        scene,
        near + DVec3::Y * size.y,
        DVec3::X * size.x,
        DVec3::Z * size.z,
    );
    rectangle(scene, near, DVec3::X * size.x, DVec3::Y * size.y);
    rectangle(
        scene,
        near + DVec3::Z * size.z,
        DVec3::X * size.x,
        DVec3::Y * size.y,
    );
    let (open, closed) = if open_right {
        (far.x, near.x)
    } else {
        (near.x, far.x)
    };
    rectangle(
        scene,
        dvec3(closed, 0.0, 0.0),
        DVec3::Z * size.z,
        DVec3::Y * size.y,
    );
    rectangle(scene, dvec3(open, 0.0, 0.0), DVec3::Z, DVec3::Y * size.y);
    rectangle(scene, dvec3(open, 0.0, 2.0), DVec3::Z, DVec3::Y * size.y);
    rectangle(scene, dvec3(open, 2.0, 1.0), DVec3::Z, DVec3::Y * 0.5);
}

fn cell(name: &str, x: f64, triangles: std::ops::Range<u32>) -> Cell {
    let outline = [(x, 0.0), (x + 4.0, 0.0), (x + 4.0, 3.0), (x, 3.0)]
        .map(DVec2::from)
        .to_vec();
    Cell {
        name: name.into(),
        space: vec![Prism {
            outline,
            floor_y: 0.0,
            ceiling_y: 2.5,
        }],
        triangles,
    }
}

/// Two rooms side by side with a door between, in empty space.
fn two_rooms() -> PortalModel {
    let mut scene = Scene {
        materials: vec![Material::default()],
        ..Scene::default()
    };
    room(&mut scene, 0.0, true);
    let middle = scene.triangles.len() as u32;
    room(&mut scene, 4.0, false);
    let end = scene.triangles.len() as u32;
    let door = [
        [4.0, 0.0, 1.0],
        [4.0, 0.0, 2.0],
        [4.0, 2.0, 2.0],
        [4.0, 2.0, 1.0],
    ]
    .map(DVec3::from)
    .to_vec();
    PortalModel {
        scene,
        cells: vec![
            cell("left", 0.0, 0..middle),
            cell("right", 4.0, middle..end),
            Cell {
                name: "outside".into(),
                space: Vec::new(),
                triangles: end..end,
            },
        ],
        portals: vec![Portal {
            name: "door".into(),
            cells: [0, 1],
            polygon: door,
        }],
        outside: Some(2),
    }
}

/// Findings on the portal of the two rooms after a change.
fn findings_after(change: impl Fn(&mut PortalModel)) -> Vec<Finding> {
    let mut model = two_rooms();
    change(&mut model);
    let mut findings = model.check();
    findings.retain(|f| !matches!(f, Finding::Unreachable { .. }));
    let mended = model.repair();
    let leaves_out = findings
        .iter()
        .any(|f| f.portal().is_some() && f.severity() == Severity::Error);
    assert_eq!(
        model.portals.is_empty(),
        leaves_out || mended.contains(&Finding::NoPortals)
    );
    findings
}

#[test]
fn sound_model_has_no_findings() {
    let findings = two_rooms().check();
    let names: Vec<String> = findings.iter().map(ToString::to_string).collect();
    assert_eq!(
        names,
        ["cell 2 (outside) cannot be reached through portals from left"]
    );
}

#[test]
fn every_defect_of_a_portal_is_named() {
    let shape = |corners: &[[f64; 3]]| {
        let polygon: Vec<DVec3> = corners.iter().copied().map(DVec3::from).collect();
        match findings_after(|m| m.portals[0].polygon = polygon.clone()).as_slice() {
            [Finding::Shape { shape, .. }] => *shape,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(
        shape(&[[4.0, 0.0, 1.0], [4.0, 0.0, 2.0]]),
        Shape::Corners(2)
    );
    assert_eq!(
        shape(&[[4.0, 0.0, 1.0], [4.0, f64::NAN, 2.0], [4.0, 1.0, 1.0]]),
        Shape::NotFinite
    );
    assert_eq!(
        shape(&[[4.0, 0.0, 1.0], [4.0, 0.0, 2.0], [4.0, 0.0, 1.5]]),
        Shape::NoArea
    );
    assert_eq!(shape(&[[4.0, 0.0, 1.0]; 4]), Shape::NoArea);
    let bent = shape(&[
        [4.0, 0.0, 1.0],
        [4.0, 0.0, 2.0],
        [4.1, 2.0, 2.0],
        [4.0, 2.0, 1.0],
    ]);
    assert!(
        matches!(bent, Shape::NotPlanar(off) if (0.01..0.1).contains(&off)),
        "{bent:?}"
    );
    let eight = [
        [4.0, 0.0, 1.0],
        [4.0, 2.0, 2.0],
        [4.0, 0.0, 2.0],
        [4.0, 2.0, 1.0],
    ];
    assert_eq!(shape(&eight), Shape::CrossesItself);
    let lopsided_eight = [
        [4.0, 0.0, 1.0],
        [4.0, 2.0, 2.0],
        [4.0, 0.3, 2.0],
        [4.0, 2.0, 1.0],
    ];
    assert_eq!(shape(&lopsided_eight), Shape::CrossesItself);
    let arrow = [
        [4.0, 0.0, 1.0],
        [4.0, 0.5, 1.5],
        [4.0, 0.0, 2.0],
        [4.0, 2.0, 1.5],
    ];
    assert_eq!(shape(&arrow), Shape::NotConvex);

    let one = |change: fn(&mut PortalModel)| match findings_after(change).as_slice() {
        [finding] => finding.to_string(),
        other => panic!("{other:?}"),
    };
    assert_eq!(
        one(|m| m.portals[0].cells[1] = 7),
        "portal 0 (door) leads to cell 7, but there are 3 cells; it is left out"
    );
    assert_eq!(
        one(|m| m.portals[0].cells[1] = 0),
        "portal 0 (door) has left on both of its sides; it is left out"
    );
    assert!(one(|m| m.portals[0].polygon.reverse()).contains("clockwise"));
    let moved = one(|m| m.portals[0].polygon.iter_mut().for_each(|p| p.x -= 1.0));
    assert!(
        moved.starts_with("portal 0 (door) does not touch right;"),
        "{moved}"
    );
    assert!(one(|m| m.portals.clear()).starts_with("there is no portal"));
}

#[test]
fn small_polygon_defects_are_accepted() {
    let on_edge = [
        [4.0, 0.0, 1.0],
        [4.0, 0.0, 1.5],
        [4.0, 0.0, 2.0],
        [4.0, 2.0, 2.0],
        [4.000_05, 2.0, 1.0],
    ];
    assert_eq!(
        findings_after(|m| m.portals[0].polygon = on_edge.map(DVec3::from).to_vec()),
        []
    );
}

#[test]
fn repair_reverses_portal() {
    let mut model = two_rooms();
    let polygon = model.portals[0].polygon.clone();
    model.portals[0].polygon.reverse();
    assert!(matches!(
        model.repair().as_slice(),
        [Finding::Clockwise { portal: 0, .. }, ..]
    ));
    assert_eq!(model.portals[0].polygon, polygon);
}

/// Findings have the final indices of portals; a portal that was left out leads nowhere.
#[test]
fn omitted_portals_are_numbered_last() {
    let mut model = two_rooms();
    let sound = model.portals[0].clone();
    let bent = Portal {
        name: "bent".into(),
        cells: [1, 2],
        polygon: sound.polygon[..2].to_vec(),
    };
    let reversed = Portal {
        polygon: sound.polygon.iter().rev().copied().collect(),
        ..sound.clone()
    };
    model.portals = vec![bent, sound.clone(), reversed];
    let found: Vec<(Option<usize>, Severity)> = model
        .repair()
        .iter()
        .map(|f| (f.portal(), f.severity()))
        .collect();
    let expected = [
        (Some(1), Severity::Warning),
        (Some(2), Severity::Error),
        (None, Severity::Warning),
    ];
    assert_eq!(
        found, expected,
        "turned round, left out, and the outside is out of reach"
    );
    assert!(model.portals.len() == 2 && model.portals.iter().all(|portal| *portal == sound));
}

#[test]
fn invalid_spaces_are_named() {
    let flaws = |change: fn(&mut Prism)| {
        let mut model = two_rooms();
        change(&mut model.cells[0].space[0]);
        let flaw = |finding: Finding| match finding {
            Finding::Space {
                cell: 0,
                part: 0,
                flaw,
                ..
            } => Some(flaw),
            _ => None,
        };
        model.check().into_iter().find_map(flaw)
    };
    assert_eq!(flaws(|_| {}), None);
    assert_eq!(
        flaws(|prism| prism.outline.truncate(2)),
        Some(Flaw::NoOutline)
    );
    assert_eq!(
        flaws(|prism| prism.outline[1].x = f64::INFINITY),
        Some(Flaw::NoOutline)
    );
    assert_eq!(
        flaws(|prism| prism.ceiling_y = prism.floor_y),
        Some(Flaw::NoHeight)
    );
    assert_eq!(
        flaws(|prism| prism.ceiling_y = f64::NAN),
        Some(Flaw::NoHeight)
    );
    assert_eq!(
        flaws(|prism| prism.outline.swap(1, 2)),
        Some(Flaw::CrossesItself)
    );
}

#[test]
fn cells_without_space_or_access_are_named() {
    let mut model = two_rooms();
    model.cells[1].space.clear();
    assert!(
        model
            .check()
            .iter()
            .any(|f| f.to_string() == "cell 1 (right) has no space, so no eye can be in it")
    );
    let mut only_outside = two_rooms();
    only_outside.cells.drain(..2);
    only_outside.portals.clear();
    only_outside.outside = Some(0);
    assert_eq!(only_outside.check(), [Finding::NoCells]);
    let empty = PortalModel {
        scene: Scene::default(),
        cells: Vec::new(),
        portals: Vec::new(),
        outside: None,
    };
    assert_eq!(empty.check(), [Finding::NoCells]);
}

#[test]
fn rays_find_leaks() {
    let leaks = |model: &PortalModel| {
        let tracer = Tracer::new(Arc::new(model.scene.clone()), DVec3::new(4.0, 1.0, 1.5));
        model.leaks(&tracer, 512, 1)
    };
    let model = two_rooms();
    assert_eq!(leaks(&model), []);

    let mut undeclared = two_rooms();
    undeclared.portals.clear();
    let pairs: Vec<[String; 2]> = leaks(&undeclared)
        .into_iter()
        .map(|finding| match finding {
            Finding::Leak { from, into, .. } => [from, into],
            other => panic!("{other}"),
        })
        .collect();
    assert_eq!(
        pairs,
        [["left", "right"], ["right", "left"]].map(|pair| pair.map(String::from))
    );

    // Without its last wall, the right room is open to the outside.
    let mut open = two_rooms();
    let wall = open.cells[1].triangles.start as usize + 8;
    for triangle in wall..wall + 2 {
        open.scene.triangles[triangle].vertices = open.scene.triangles[wall - 2].vertices;
    }
    assert!(leaks(&open).iter().any(
        |f| matches!(f, Finding::Leak { from, into, .. } if from == "right" && into == "outside")
    ));
}
