//! Up axis and unit of OBJ files are inferred correctly: for scenes that others wrote, and for the
//! built-in ones written in any axes and unit.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use glam::DVec3;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_scene::load::{LoadOptions, load};
use headbox_scene::scene::Scene;
use std::fmt::Write;
use std::path::Path;

/// Scenes with more triangles are thinned out: what their areas say stays.
const MOST_TRIANGLES: usize = 40_000;

/// A scene as OBJ in a frame of its own, with the names of its materials or without.
fn obj_text(scene: &Scene, frame: &FileFrame, names: bool) -> String {
    let mut text = String::new();
    let mut material = u32::MAX;
    for triangle in scene
        .triangles
        .iter()
        .step_by(scene.triangles.len().div_ceil(MOST_TRIANGLES))
    {
        for vertex in triangle.vertices {
            let DVec3 { x, y, z } = frame.file_from_world(scene.positions[vertex as usize]);
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
        if names && material != triangle.material {
            material = triangle.material;
            writeln!(
                text,
                "usemtl {}",
                scene.materials[material as usize].name.replace(' ', "_")
            )
            .unwrap();
        }
        writeln!(text, "f -3 -2 -1").unwrap();
    }
    text
}

fn guess(text: &str) -> (FileFrame, Vec<String>) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("scene.obj");
    std::fs::write(&path, text).unwrap();
    let scene = load(&path, &LoadOptions::default()).unwrap();
    (scene.frame, scene.summary.notes)
}

#[test]
fn room_is_upright_in_any_axes() {
    let scene = headbox_scenes::build("interior", 0).unwrap();
    for up in [UpAxis::Y, UpAxis::Z] {
        for unit_m in [1.0, 0.01, 0.001] {
            let frame = FileFrame { up, unit_m };
            let (found, notes) = guess(&obj_text(&scene, &frame, true));
            assert_eq!(found, frame, "{notes:?}");
            let told = notes
                .iter()
                .any(|note| note.contains("--up y") || note.contains("--unit m"));
            assert_eq!(told, frame != FileFrame::default(), "{frame:?}: {notes:?}");
        }
    }
    let frame = FileFrame {
        up: UpAxis::Z,
        unit_m: 0.01,
    };
    assert_eq!(
        guess(&obj_text(&scene, &frame, false)).0,
        frame,
        "also without names"
    );
}

#[test]
fn houses_and_trees_are_upright() {
    for name in ["house", "tree"] {
        let scene = headbox_scenes::build(name, 0).unwrap();
        for (up, unit_m) in [
            (UpAxis::Y, 1.0),
            (UpAxis::Z, 1.0),
            (UpAxis::Y, 0.01),
            (UpAxis::Z, 0.001),
        ] {
            let frame = FileFrame { up, unit_m };
            for names in [true, false] {
                let (found, notes) = guess(&obj_text(&scene, &frame, names));
                assert_eq!(found, frame, "{name}, names {names}: {notes:?}");
            }
        }
    }
}

#[test]
fn named_relief_stays_upright() {
    for name in [
        "bump",
        "sprites",
        "poles",
        "edge-on",
        "contact",
        "far-offset",
        "miniature",
    ] {
        let scene = headbox_scenes::build(name, 0).unwrap();
        let text = obj_text(&scene, &FileFrame::default(), true);
        let (found, notes) = guess(&format!("# {name}, metres, Y up\n{text}"));
        assert_eq!(found.up, UpAxis::Y, "{name}: {notes:?}");
    }
}

#[test]
fn exporter_comment_counts() {
    let scene = headbox_scenes::build("interior", 0).unwrap();
    let text = obj_text(&scene, &FileFrame::default(), false);
    assert_eq!(
        guess(&format!("# File units = inches\n{text}")).0.unit_m,
        0.0254
    );
    assert_eq!(
        guess(&format!("# Up axis: Z\n# units: mm\n{text}")).0,
        FileFrame {
            up: UpAxis::Z,
            unit_m: 0.001
        }
    );
}

#[test]
fn user_options_override_inference() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("scene.obj");
    let scene = headbox_scenes::build("interior", 0).unwrap();
    std::fs::write(
        &path,
        obj_text(
            &scene,
            &FileFrame {
                up: UpAxis::Z,
                unit_m: 0.01,
            },
            true,
        ),
    )
    .unwrap();
    let said = load(
        &path,
        &LoadOptions {
            up: Some(UpAxis::Y),
            unit_m: Some(1.0),
        },
    )
    .unwrap();
    assert_eq!(said.frame, FileFrame::default());
    let half = load(
        &path,
        &LoadOptions {
            up: None,
            unit_m: Some(0.5),
        },
    )
    .unwrap();
    assert_eq!(
        half.frame,
        FileFrame {
            up: UpAxis::Z,
            unit_m: 0.5
        }
    );
}

#[test]
fn real_scenes_upright_in_any_axes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let known = [
        ("small_house/small_house.obj", UpAxis::Z, 1.0),
        ("willowgarage/willowgarage.obj", UpAxis::Z, 1.0),
        ("apartment/home.obj", UpAxis::Y, 0.01),
        ("medieval_building/Medieval_building.obj", UpAxis::Y, 1.0),
        ("trees/tree_1/tree_1.obj", UpAxis::Y, 0.01),
        ("trees/tree_2/tree_2.obj", UpAxis::Y, 0.01),
        ("trees/tree_3/tree_3.obj", UpAxis::Y, 0.01),
        ("trees/tree_4/tree_4.obj", UpAxis::Y, 0.01),
        ("cornell_box/cornell_box.obj", UpAxis::Y, 0.01),
    ];
    for (name, up, unit_m) in known {
        let path = folder.join(name);
        if !path.is_file() {
            eprintln!("skipped: {name} is not here");
            continue;
        }
        let scene = load(&path, &LoadOptions::default()).unwrap();
        assert_eq!(
            scene.frame,
            FileFrame { up, unit_m },
            "{name}: {:?}",
            scene.summary.notes
        );
        for (up, unit_m) in [
            (UpAxis::Y, 0.001),
            (UpAxis::Z, 1.0),
            (UpAxis::Z, 0.01),
            (UpAxis::Z, 0.001),
        ] {
            let frame = FileFrame { up, unit_m };
            let (found, notes) = guess(&obj_text(&scene, &frame, true));
            // What evidence is too thin for is told: a box as high as wide, whose lamp's material
            // got lost.
            let is_told = notes.iter().any(|note| note.contains("too little for"));
            assert!(
                found == frame || is_told,
                "{name}: {found:?}, not {frame:?}; {notes:?}"
            );
        }
    }
}

/// A box without a lid, of two triangles a side, in metres along (width, height, depth) in the
/// file's axes.
fn coarse_box([x, y, z]: [f64; 3]) -> String {
    let mut text = String::new();
    for corner in 0..8 {
        let at = |bit: u32, length: f64| if corner >> bit & 1 == 1 { length } else { 0.0 };
        writeln!(text, "v {} {} {}", at(0, x), at(1, y), at(2, z)).unwrap();
    }
    for side in [
        "1 2 6 5", "1 5 7 3", "2 4 8 6", "1 3 4 2", "5 6 8 7", "3 7 8 4",
    ] {
        writeln!(text, "f {side}").unwrap();
    }
    text
}

#[test]
fn coarse_room_height_is_its_walls() {
    let (frame, notes) = guess(&coarse_box([400.0, 270.0, 500.0]));
    assert_eq!(
        frame,
        FileFrame {
            up: UpAxis::Y,
            unit_m: 0.01
        },
        "{notes:?}"
    );
    let note = notes
        .iter()
        .find(|note| note.contains("centimetres"))
        .unwrap();
    // A fiftieth of the walls at the top and at the bottom does not count.
    assert!(note.contains("2.6 m high and 5.0 m wide"), "{note}");
}

/// A box of which the groups say what its sides are, floor and ceiling across Z, as modellers write
/// rooms.
fn named_room(lengths: [f64; 3], kind: &str) -> String {
    let names = [
        "Floor",
        "WallEast",
        "Ceiling",
        "WallWest",
        "WallNorth",
        "WallSouth",
    ];
    let [x, y, z] = lengths;
    let mut text: String = coarse_box([x, y, z])
        .lines()
        .filter(|line| line.starts_with('v'))
        .fold(String::new(), |text, line| text + line + "\n");
    for (name, side) in names.iter().zip([
        "1 2 4 3", "2 4 8 6", "5 6 8 7", "1 3 7 5", "3 4 8 7", "1 2 6 5",
    ]) {
        writeln!(text, "{kind} {name}\nf {side}").unwrap();
    }
    text
}

#[test]
fn group_names_give_up_and_unit() {
    for kind in ["g", "o"] {
        let (frame, notes) = guess(&named_room([260.0, 260.0, 260.0], kind));
        assert_eq!(
            frame,
            FileFrame {
                up: UpAxis::Z,
                unit_m: 0.01
            },
            "{notes:?}"
        );
    }
    // Without the names nothing tells.
    let nameless = named_room([260.0, 260.0, 260.0], "#");
    assert_ne!(
        guess(&nameless).0,
        FileFrame {
            up: UpAxis::Z,
            unit_m: 0.01
        }
    );
}

/// A room as written by a script: closed, boxes with corners of their own, no names, millimetres.
#[test]
fn objects_on_floor_give_up() {
    let boxes = [
        ([-100.0, -100.0, -200.0], [8100.0, 4100.0, 0.0]),
        ([-100.0, -100.0, 2600.0], [8100.0, 4100.0, 2750.0]),
        ([-100.0, -100.0, 0.0], [8100.0, 0.0, 2600.0]),
        ([-100.0, 4000.0, 0.0], [8100.0, 4100.0, 2600.0]),
        ([-100.0, 0.0, 0.0], [0.0, 4000.0, 2600.0]),
        ([8000.0, 0.0, 0.0], [8100.0, 4000.0, 2600.0]),
        ([5000.0, 0.0, 0.0], [5120.0, 1500.0, 2600.0]),
        ([5000.0, 2400.0, 0.0], [5120.0, 4000.0, 2600.0]),
        ([5000.0, 1500.0, 2050.0], [5120.0, 2400.0, 2600.0]),
        ([4000.0, 500.0, 0.0], [4600.0, 1100.0, 900.0]),
        ([500.0, 3200.0, 0.0], [2500.0, 3900.0, 850.0]),
        ([2600.0, 3300.0, 0.0], [3200.0, 3900.0, 1900.0]),
        ([300.0, 600.0, 0.0], [900.0, 1200.0, 450.0]),
        ([1200.0, 600.0, 0.0], [1700.0, 1100.0, 480.0]),
        ([3500.0, 1800.0, 0.0], [4100.0, 2400.0, 700.0]),
    ];
    for up in [UpAxis::Y, UpAxis::Z] {
        let mut text = String::new();
        for (low, high) in boxes {
            // Seen from outside: sides that face any way would say that a ground does.
            for face in [
                [0, 2, 3, 1],
                [4, 5, 7, 6],
                [0, 1, 5, 4],
                [2, 6, 7, 3],
                [0, 4, 6, 2],
                [1, 3, 7, 5],
            ] {
                for corner in face {
                    let [x, y, z] = [0, 1, 2].map(|axis| {
                        if corner >> axis & 1 == 1 {
                            high[axis]
                        } else {
                            low[axis]
                        }
                    });
                    match up {
                        UpAxis::Z => writeln!(text, "v {x} {y} {z}").unwrap(),
                        UpAxis::Y => writeln!(text, "v {x} {z} {}", -y).unwrap(),
                    }
                }
                text += "f -4 -3 -2 -1\n";
            }
        }
        let (frame, notes) = guess(&text);
        assert_eq!(frame, FileFrame { up, unit_m: 0.001 }, "{notes:?}");
    }
}

#[test]
fn no_evidence_warns_and_takes_y() {
    let (frame, notes) = guess(&coarse_box([3.0, 3.0, 3.0]));
    assert_eq!(frame, FileFrame::default());
    assert!(
        notes
            .iter()
            .any(|note| note.contains("Y is taken as up") && note.contains("--up z")),
        "{notes:?}"
    );
    let said = format!("# Y up, metres\n{}", coarse_box([3.0, 3.0, 3.0]));
    assert!(
        !guess(&said)
            .1
            .iter()
            .any(|note| note.contains("taken as up"))
    );
}

/// A quadrilateral in `rows` by `rows` parts: corner, two edges.
fn patch(text: &mut String, corner: DVec3, [u, v]: [DVec3; 2], rows: u32) {
    for (i, j) in (0..rows * rows).map(|k| (f64::from(k % rows), f64::from(k / rows))) {
        for (a, b) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            let DVec3 { x, y, z } = corner + (u * (i + a) + v * (j + b)) / f64::from(rows);
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
        writeln!(text, "f -4 -3 -2 -1").unwrap();
    }
}

/// A room as written by a kitchen planner: decimetres, far from the origin both ways, no ceiling,
/// walls with two sides.
#[test]
fn open_far_room_is_upright() {
    let [x, y, z] = [DVec3::X * 68.0, DVec3::Y * 40.0, DVec3::Z * 27.0];
    let corner = DVec3::new(82.0, 119.0, -0.5);
    let mut text = String::new();
    for (side, back) in [(0.0, 1.0), (1.0, 0.0)] {
        patch(
            &mut text,
            corner + y * side,
            [[x, z], [z, x]][side as usize],
            4,
        );
        patch(
            &mut text,
            corner + x * side,
            [[y, z], [z, y]][back as usize],
            4,
        );
    }
    patch(&mut text, corner, [x, y], 4);
    // A worktop along the wall.
    patch(&mut text, corner + z * 0.33, [x, y * 0.15], 4);
    let (frame, notes) = guess(&text);
    assert_eq!(
        frame,
        FileFrame {
            up: UpAxis::Z,
            unit_m: 1.0
        },
        "{notes:?}"
    );
    assert!(
        notes[0].contains("m high") && notes[0].contains("--unit dm"),
        "a kitchen of 27 m is told: {notes:?}"
    );
}

#[test]
fn named_ground_is_flat_painting_upright() {
    let flat = |name: &str| {
        let mut text = format!("g {name}\n");
        patch(
            &mut text,
            DVec3::new(-40.0, -25.0, 0.0),
            [DVec3::X * 80.0, DVec3::Y * 50.0],
            4,
        );
        guess(&text)
    };
    let (field, notes) = flat("stadium_grass");
    assert_eq!(field.up, UpAxis::Z, "{notes:?}");
    let (picture, notes) = flat("poster");
    assert_eq!((picture, notes), (FileFrame::default(), Vec::new()));
}
