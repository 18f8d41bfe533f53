//! Promises of `--strict` and `--json` about what was lost or guessed while an input was read.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use crate::run::{fails, headbox, json, refused, succeeds};
use std::fmt::Write as _;
use std::path::Path;

/// Options of captures that take no time.
const FAST: [&str; 6] = ["--face-size", "16", "--strata", "2", "--rays", "1"];

/// Number of textures that are missing: more than a note on standard error names.
const TEXTURES: usize = 7;

/// Writes a box of 4x3x4 m as OBJ: `clean.obj`, and `lossy.obj` with a broken face and materials
/// whose textures are missing.
fn write_boxes(folder: &Path) {
    let mut text = String::from("# Y up, metres\nvt 0 0\n");
    for corner in 0..8 {
        let at = |bit: usize, side: f64| if corner >> bit & 1 == 1 { side } else { 0.0 };
        let (x, y, z) = (at(0, 4.0), at(1, 3.0), at(2, 4.0));
        writeln!(text, "v {x} {y} {z}").unwrap();
    }
    let quads = [
        [1, 2, 4, 3],
        [5, 7, 8, 6],
        [1, 3, 7, 5],
        [2, 6, 8, 4],
        [1, 5, 6, 2],
        [3, 4, 8, 7],
    ];
    let triangles = quads.map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    let (mut clean, mut lossy) = (text.clone(), format!("{text}mtllib lossy.mtl\n"));
    let mut materials = String::new();
    for (i, [a, b, c]) in triangles.iter().flatten().enumerate() {
        let face = format!("f {a}/1 {b}/1 {c}/1");
        writeln!(clean, "{face}").unwrap();
        writeln!(lossy, "usemtl m{}\n{face}", i % TEXTURES).unwrap();
    }
    for i in 0..TEXTURES {
        writeln!(materials, "newmtl m{i}\nmap_Kd missing{i}.png").unwrap();
    }
    lossy += "f 1/1 2/1 99/1\n";
    std::fs::write(folder.join("clean.obj"), clean).unwrap();
    std::fs::write(folder.join("lossy.obj"), lossy).unwrap();
    std::fs::write(folder.join("lossy.mtl"), materials).unwrap();
}

#[test]
fn strict_reading_of_scenes_refuses_losses() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    write_boxes(folder);
    let commands: [&[&str]; 5] = [
        &["capture", "lossy.obj", "-o", "a.ldi", "--strict"],
        &[
            "capture",
            "lossy.obj",
            "-o",
            "a.shard",
            "--shard",
            "1/2",
            "--strict",
        ],
        &["truth", "lossy.obj", "-o", "a.png", "--strict"],
        &["sprite", "lossy.obj", "-o", "a.sprite", "--strict"],
        &["lumigraph", "lossy.obj", "-o", "a.lumi", "--strict"],
    ];
    for command in commands {
        let message = refused(folder, 1, command);
        assert_eq!(message.lines().count(), 1, "{command:?}: {message}");
        for part in [
            "lossy.obj: strict reading refuses it",
            "7 textures could not be read",
            "1 face with a vertex index out of range left out",
        ] {
            assert!(message.contains(part), "{command:?}: {message}");
        }
        assert!(!folder.join(command[3]).exists(), "{command:?}");
    }
    let clean = ["capture", "clean.obj", "-o", "b.ldi", "--strict"];
    succeeds(folder, &[&clean, &FAST[..]].concat());
    // The capture reopens its scene, which has changed in the meantime.
    std::fs::copy(folder.join("lossy.obj"), folder.join("clean.obj")).unwrap();
    fails(
        folder,
        1,
        &["truth", "b.ldi", "-o", "b.png", "--strict"],
        "clean.obj: strict reading refuses it",
    );
    fails(
        folder,
        1,
        &[
            "render",
            "b.ldi",
            "lossy.obj@at=1,1,1",
            "-o",
            "b.png",
            "--strict",
        ],
        "lossy.obj: strict reading refuses it",
    );
}

#[test]
fn json_of_capture_has_complete_notes() {
    let dir = tempfile::tempdir().unwrap();
    write_boxes(dir.path());
    let command = ["capture", "lossy.obj", "-o", "a.ldi", "--json"];
    let output = headbox(dir.path(), &[&command, &FAST[..]].concat());
    let printed = String::from_utf8(output.stderr).unwrap();
    assert!(printed.contains("missing4.png"), "{printed}");
    assert!(printed.contains(") and 2 more\n"), "{printed}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let notes = report["notes"].as_array().unwrap();
    let textures = notes[0].as_str().unwrap();
    for i in 0..TEXTURES {
        let name = format!("missing{i}.png");
        assert!(textures.contains(&name), "{textures}");
    }
    assert_eq!(notes.len(), printed.matches("note: ").count(), "{printed}");
}

#[test]
fn strict_reading_of_images_refuses_losses() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let truth = ["truth", "builtin:bump", "-o", "set", "--images", "3x2"];
    let small = ["--size", "16x12", "--samples", "1", "--unlit"];
    succeeds(folder, &[&truth, &small[..]].concat());
    succeeds(folder, &["images", "set", "--strict"]);
    let file = folder.join("set/transforms.json");
    let mut set: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    for i in [1, 3] {
        set["frames"][i]["transform_matrix"][0][0] = "NaN".into();
    }
    std::fs::write(&file, set.to_string()).unwrap();
    let commands: [&[&str]; 4] = [
        &["images", "set", "--strict"],
        &["capture", "set", "-o", "a.ldi", "--strict"],
        &["render", "set", "-o", "a.png", "--strict"],
        &["sprite", "set", "-o", "a.sprite", "--strict"],
    ];
    for command in commands {
        fails(
            folder,
            1,
            command,
            "set: strict reading refuses it, as not all was read as it is written: left out 2 of 6 \
             frames: ",
        );
    }
    for command in [
        &["images", "set", "--json"][..],
        &[
            "capture",
            "set",
            "-o",
            "a.ldi",
            "--json",
            "--no-registration",
        ],
        &["info", "set", "--json"],
    ] {
        let notes = json(folder, command)["notes"].to_string();
        let frames = [1, 3].map(|i| set["frames"][i]["file_path"].as_str().unwrap());
        assert!(frames.iter().all(|name| notes.contains(name)), "{notes}");
    }
}
