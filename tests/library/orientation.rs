//! Guesses of the up axis and the unit of OBJ files: real scenes, built-in scenes in any axes and
//! unit, and rooms without names.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use glam::DVec3;
use headbox_core::file_frame::{FileFrame, UpAxis};
use headbox_core::read_note::ReadNote;
use headbox_scene::load::{LoadOptions, load};
use headbox_scene::scene::Scene;
use std::fmt::Write;
use std::path::Path;

/// Larger scenes are written with every n-th triangle, which hardly changes their areas.
const MAX_TRIANGLES: usize = 40_000;

const Y_M: FileFrame = y_up(1.0);
const Z_CM: FileFrame = z_up(0.01);

const fn y_up(unit_m: f64) -> FileFrame {
    let up = UpAxis::Y;
    FileFrame { unit_m, up }
}

const fn z_up(unit_m: f64) -> FileFrame {
    let up = UpAxis::Z;
    FileFrame { unit_m, up }
}

/// Writes a scene as an OBJ in a frame, with or without the names of its materials.
fn obj_text(scene: &Scene, frame: &FileFrame, has_names: bool) -> String {
    let mut text = String::new();
    let mut material = u32::MAX;
    let step = scene.triangles.len().div_ceil(MAX_TRIANGLES);
    for triangle in scene.triangles.iter().step_by(step) {
        for vertex in triangle.vertices {
            let DVec3 { x, y, z } = frame.file_from_world(scene.positions[vertex as usize]);
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
        if has_names && material != triangle.material {
            material = triangle.material;
            let name = scene.materials[material as usize].name.replace(' ', "_");
            writeln!(text, "usemtl {name}").unwrap();
        }
        text += "f -3 -2 -1\n";
    }
    text
}

fn load_text(text: &str, options: &LoadOptions) -> (FileFrame, Vec<ReadNote>) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("scene.obj");
    std::fs::write(&path, text).unwrap();
    let scene = load(&path, options).unwrap();
    (scene.frame, scene.summary.notes)
}

fn guess(text: &str) -> (FileFrame, Vec<ReadNote>) {
    load_text(text, &LoadOptions::default())
}

#[test]
fn builtin_scenes_are_upright_in_any_axes() {
    for name in ["interior", "house", "tree"] {
        let scene = headbox_scenes::build(name, 0).unwrap();
        for unit_m in [1.0, 0.01, 0.001] {
            for frame in [y_up(unit_m), z_up(unit_m)] {
                for has_names in [true, false] {
                    let (found, notes) = guess(&obj_text(&scene, &frame, has_names));
                    assert_eq!(found, frame, "{name}, names {has_names}: {notes:?}");
                    let is_reported = notes.iter().any(|note| note.contains("if that is wrong"));
                    assert_eq!(is_reported, frame != Y_M, "{name}, {frame:?}: {notes:?}");
                }
            }
        }
    }
}

#[test]
fn real_scenes_are_upright_in_any_axes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    for (name, expected) in [
        ("small_house/small_house.obj", z_up(1.0)),
        ("willowgarage/willowgarage.obj", z_up(1.0)),
        ("apartment/home.obj", y_up(0.01)),
        ("medieval_building/Medieval_building.obj", y_up(1.0)),
        ("trees/tree_1/tree_1.obj", y_up(0.01)),
        ("trees/tree_2/tree_2.obj", y_up(0.01)),
        ("trees/tree_3/tree_3.obj", y_up(0.01)),
        ("trees/tree_4/tree_4.obj", y_up(0.01)),
        ("cornell_box/cornell_box.obj", y_up(0.01)),
    ] {
        let path = folder.join(name);
        if !path.is_file() {
            eprintln!("skipped: {name} is absent");
            continue;
        }
        let scene = load(&path, &LoadOptions::default()).unwrap();
        assert_eq!(scene.frame, expected, "{name}: {:?}", scene.summary.notes);
        for frame in [y_up(0.001), z_up(1.0), Z_CM, z_up(0.001)] {
            let (found, notes) = guess(&obj_text(&scene, &frame, true));
            assert_eq!(found, frame, "{name}: {notes:?}");
        }
    }
}

#[test]
fn comments_override_evidence() {
    for name in ["bump", "sprites", "poles", "edge-on", "far-offset"] {
        let scene = headbox_scenes::build(name, 0).unwrap();
        let text = obj_text(&scene, &Y_M, true);
        let (found, notes) = guess(&format!("# {name}, metres, Y up\n{text}"));
        assert_eq!(found.up, UpAxis::Y, "{name}: {notes:?}");
    }
    let scene = headbox_scenes::build("interior", 0).unwrap();
    let text = obj_text(&scene, &Y_M, false);
    let (inches, _) = guess(&format!("# File units = inches\n{text}"));
    assert_eq!(inches, y_up(0.0254));
    let (millimetres, _) = guess(&format!("# Up axis: Z\n# units: mm\n{text}"));
    assert_eq!(millimetres, z_up(0.001));
}

#[test]
fn options_override_guess() {
    let scene = headbox_scenes::build("interior", 0).unwrap();
    let text = obj_text(&scene, &Z_CM, true);
    assert_eq!(load_text(&text, &Y_M.into()).0, Y_M);
    let unit_only = LoadOptions {
        up: None,
        unit_m: Some(0.5),
    };
    assert_eq!(load_text(&text, &unit_only).0, z_up(0.5));
}

/// Writes the corners of a box and its sides, two triangles each, after lines with `names`.
fn box_text([x, y, z]: [f64; 3], names: [&str; 6]) -> String {
    let mut text = String::new();
    for corner in 0..8 {
        let at = |bit: u32, length: f64| if corner >> bit & 1 == 1 { length } else { 0.0 };
        writeln!(text, "v {} {} {}", at(0, x), at(1, y), at(2, z)).unwrap();
    }
    let sides = [
        "1 2 4 3", "2 4 8 6", "5 6 8 7", "1 3 7 5", "3 4 8 7", "1 2 6 5",
    ];
    for (name, side) in names.iter().zip(sides) {
        writeln!(text, "{name}\nf {side}").unwrap();
    }
    text
}

#[test]
fn box_of_room_size_is_in_centimetres() {
    let (frame, notes) = guess(&box_text([400.0, 270.0, 500.0], [""; 6]));
    assert_eq!(frame, y_up(0.01), "{notes:?}");
    let is_height = |note: &ReadNote| note.contains("0.01 m, which makes the scene 2.7 m high");
    assert!(notes.iter().any(is_height), "{notes:?}");
}

#[test]
fn cube_without_evidence_is_y_up_with_note() {
    let cube = box_text([3.0; 3], [""; 6]);
    let (frame, notes) = guess(&cube);
    assert_eq!(frame, Y_M);
    let is_doubt = |note: &ReadNote| note.contains("Y is taken as up") && note.contains("--up z");
    assert!(notes.iter().any(is_doubt), "{notes:?}");
    let (_, notes) = guess(&format!("# Y up, metres\n{cube}"));
    assert!(!notes.iter().any(is_doubt), "{notes:?}");
}

#[test]
fn cube_with_named_floor_stands_on_it() {
    for names in [
        ["g Floor", "g East", "g Ceiling", "g West", "g North", "g S"],
        ["o Floor", "o East", "o Ceiling", "o West", "o North", "o S"],
        [
            "usemtl floor",
            "usemtl wall",
            "usemtl floor",
            "usemtl wall",
            "",
            "",
        ],
    ] {
        let (frame, notes) = guess(&box_text([260.0; 3], names));
        assert_eq!(frame, Z_CM, "{notes:?}");
    }
}

/// A room written by a script: closed, without names, in millimetres.
#[test]
fn closed_room_with_furniture_is_upright() {
    let boxes = [
        ([-100, -100, -200], [8100, 4100, 0]),
        ([-100, -100, 2600], [8100, 4100, 2750]),
        ([-100, -100, 0], [8100, 0, 2600]),
        ([-100, 4000, 0], [8100, 4100, 2600]),
        ([-100, 0, 0], [0, 4000, 2600]),
        ([8000, 0, 0], [8100, 4000, 2600]),
        ([5000, 0, 0], [5120, 1500, 2600]),
        ([5000, 2400, 0], [5120, 4000, 2600]),
        ([5000, 1500, 2050], [5120, 2400, 2600]),
        ([4000, 500, 0], [4600, 1100, 900]),
        ([500, 3200, 0], [2500, 3900, 850]),
        ([2600, 3300, 0], [3200, 3900, 1900]),
        ([300, 600, 0], [900, 1200, 450]),
        ([1200, 600, 0], [1700, 1100, 480]),
        ([3500, 1800, 0], [4100, 2400, 700]),
    ];
    for frame in [y_up(0.001), z_up(0.001)] {
        let mut text = String::new();
        for ends in boxes {
            for corner in 0..8 {
                let ends: [[i32; 3]; 2] = ends.into();
                let [x, y, z] = [0, 1, 2].map(|axis| ends[corner >> axis & 1][axis]);
                match frame.up {
                    UpAxis::Z => writeln!(text, "v {x} {y} {z}").unwrap(),
                    UpAxis::Y => writeln!(text, "v {x} {z} {}", -y).unwrap(),
                }
            }
            text += "f -8 -6 -5 -7\nf -4 -3 -1 -2\nf -8 -7 -3 -4\n";
            text += "f -6 -2 -1 -5\nf -8 -4 -2 -6\nf -7 -5 -1 -3\n";
        }
        let (found, notes) = guess(&text);
        assert_eq!(found, frame, "{notes:?}");
    }
}

/// Writes a quadrilateral as four by four faces.
fn patch(text: &mut String, corner: DVec3, [u, v]: [DVec3; 2]) {
    for (i, j) in (0..16).map(|k| (f64::from(k % 4), f64::from(k / 4))) {
        for (a, b) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            let DVec3 { x, y, z } = corner + (u * (i + a) + v * (j + b)) / 4.0;
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
        writeln!(text, "f -4 -3 -2 -1").unwrap();
    }
}

/// A room written by a kitchen planner: decimetres, far from the origin, no ceiling, walls with two
/// sides.
#[test]
fn open_room_far_from_origin_is_upright() {
    let [x, y, z] = [DVec3::X * 68.0, DVec3::Y * 40.0, DVec3::Z * 27.0];
    let corner = DVec3::new(82.0, 119.0, -0.5);
    let mut text = String::new();
    patch(&mut text, corner, [x, z]);
    patch(&mut text, corner, [z, y]);
    patch(&mut text, corner + y, [z, x]);
    patch(&mut text, corner + x, [y, z]);
    patch(&mut text, corner, [x, y]);
    // A worktop along a wall.
    patch(&mut text, corner + z * 0.33, [x, y * 0.15]);
    let (frame, notes) = guess(&text);
    assert_eq!(frame, z_up(1.0), "{notes:?}");
    let is_height = |note: &ReadNote| note.contains("27.0 m high") && note.contains("--unit cm");
    assert!(notes.iter().any(is_height), "{notes:?}");
}

#[test]
fn flat_scene_is_ground_only_by_name() {
    let flat = |name: &str| {
        let mut text = format!("g {name}\n");
        let sides = [DVec3::X * 80.0, DVec3::Y * 50.0];
        patch(&mut text, DVec3::new(-40.0, -25.0, 0.0), sides);
        guess(&text)
    };
    assert_eq!(flat("stadium_grass").0.up, UpAxis::Z);
    assert_eq!(flat("poster"), (Y_M, Vec::new()));
}
