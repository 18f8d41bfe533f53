//! Promises of the command line about photographs without depth: voxel colouring, and depth by
//! stereo.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use super::images_cli::{DEPTH_FOCAL, room};
use crate::run::{headbox, outputs};
use image::{Rgb, RgbImage};
use std::fmt::Write as _;
use std::path::Path;
#[cfg(unix)]
use std::process::{Command, Stdio};
#[cfg(unix)]
use std::time::Duration;

/// Photographs of a patterned ball on black, by Middlebury's conventions, taken by cameras on an
/// arc that lie on their side.
fn ball(folder: &Path) {
    let (size, focal, turns) = (
        [64u32, 48u32],
        90.0,
        [-36.0f64, -24.0, -12.0, 0.0, 12.0, 24.0, 36.0],
    );
    std::fs::create_dir(folder.join("ball")).unwrap();
    let mut parameters = format!("{}\n", turns.len());
    for (i, degrees) in turns.iter().enumerate() {
        let (sin, cos) = degrees.to_radians().sin_cos();
        // Rows: right, down and ahead of a camera two metres from the ball; down is to its side.
        let rows = [[0.0, 1.0, 0.0], [-cos, 0.0, sin], [sin, 0.0, cos]];
        let eye = rows[2].map(|c: f64| -2.0 * c);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let color = |x: u32, y: u32| {
            let at = |v: u32, side: u32| (f64::from(v) + 0.5 - f64::from(side) / 2.0) / focal;
            let (u, v) = (at(x, size[0]), at(y, size[1]));
            let ray: [f64; 3] =
                std::array::from_fn(|k| u * rows[0][k] + v * rows[1][k] + rows[2][k]);
            let (a, b, c) = (dot(ray, ray), dot(ray, eye), dot(eye, eye) - 0.4 * 0.4);
            let root = b * b - a * c;
            if root < 0.0 {
                return Rgb([0, 0, 0]);
            }
            let t = (-b - root.sqrt()) / a;
            let p: [f64; 3] = std::array::from_fn(|k| eye[k] + ray[k] * t);
            let level = |c: f64| {
                150.0
                    + 45.0 * (9.0 * p[0] + 5.0 * p[1] + c).sin()
                    + 40.0 * (8.0 * p[1] - 7.0 * p[2] - c).sin()
            };
            Rgb([0.0, 1.0, 2.0].map(|c| level(c) as u8))
        };
        RgbImage::from_fn(size[0], size[1], color)
            .save(folder.join(format!("ball/ball{i}.png")))
            .unwrap();
        let [cx, cy] = size.map(|side| f64::from(side) / 2.0 - 0.5);
        write!(
            parameters,
            "ball{i}.png {focal} 0 {cx} 0 {focal} {cy} 0 0 1"
        )
        .unwrap();
        rows.iter()
            .flatten()
            .for_each(|r| write!(parameters, " {r}").unwrap());
        writeln!(parameters, " 0 0 2").unwrap();
    }
    std::fs::write(folder.join("ball/ball_par.txt"), parameters).unwrap();
}

#[test]
fn photographs_without_depth_are_captured_and_measured() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    let (said, _) = outputs(
        dir.path(),
        &[
            "capture", "ball", "-o", "ball.ldi", "--center", "0,0,-2", "--json",
        ],
    );
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert!(
        said["images"] == 7 && said["depth_pixels"].as_u64().unwrap() > 800,
        "{said}"
    );
    outputs(dir.path(), &["info", "ball.ldi", "--check"]);
    outputs(
        dir.path(),
        &[
            "render", "ball.ldi", "-o", "ball.png", "--size", "64x48", "--fov", "30",
        ],
    );
    // As in the photographs, which lie on their side: the direction along the arc is vertical in
    // them.
    let drawn = image::open(dir.path().join("ball.png")).unwrap().to_rgb8();
    let taken = image::open(dir.path().join("ball/ball3.png"))
        .unwrap()
        .to_rgb8();
    let apart = |a: &RgbImage, b: &RgbImage| {
        let differences = a
            .pixels()
            .zip(b.pixels())
            .map(|(a, b)| (0..3).map(|c| u32::from(a[c].abs_diff(b[c]))).sum::<u32>());
        f64::from(differences.sum::<u32>()) / f64::from(3 * a.width() * a.height())
    };
    // Dark rims widen a ball of 36 pixels by one pixel on each side.
    assert!(
        apart(&drawn, &taken) < 18.0,
        "{} levels",
        apart(&drawn, &taken)
    );
    let turned = image::imageops::rotate180(&taken);
    assert!(
        apart(&drawn, &turned) > 1.5 * apart(&drawn, &taken),
        "the frame stands as the photographs do"
    );
    let (summary, _) = outputs(
        dir.path(),
        &["report", "ball", "--hold-out", "4", "-o", "out"],
    );
    let covered = |row: &str| -> f64 {
        let line = summary
            .lines()
            .find(|line| line.starts_with(&format!("| {row} |")))
            .unwrap();
        line.split('|')
            .nth(5)
            .unwrap()
            .trim()
            .trim_end_matches(" %")
            .parse()
            .unwrap()
    };
    assert!(
        covered("photograph") == 100.0 && covered("ldi") > 85.0 && covered("ldi-beside") > 85.0,
        "{summary}"
    );
    assert!(
        std::fs::read_dir(dir.path().join("out")).unwrap().count() == 4,
        "two sheets, a table, a summary"
    );
    let face_size = |quality: &[&str]| {
        let captured = [
            ["capture", "ball", "-o", "q.ldi", "--json"].as_slice(),
            quality,
        ]
        .concat();
        let (said, _) = outputs(dir.path(), &captured);
        let said: serde_json::Value = serde_json::from_str(&said).unwrap();
        said["face_size"].as_u64().unwrap()
    };
    let [best, good, draft] = [
        vec![],
        vec!["--quality", "good"],
        vec!["--quality", "draft"],
    ]
    .map(|it| face_size(&it));
    assert_eq!([good, draft], [best / 2, best / 4]);
    let refused = headbox(
        dir.path(),
        &["capture", "ball", "-o", "no.ldi", "--backdrop", "255"],
    );
    let why = String::from_utf8(refused.stderr).unwrap();
    assert!(
        refused.status.code() == Some(1) && why.contains("agree on no surface"),
        "{why}"
    );
    for wrong in [["--agreement", "0"], ["--backdrop", "dim"]] {
        let refused = headbox(
            dir.path(),
            &[["capture", "ball", "-o", "no.ldi"].as_slice(), &wrong].concat(),
        );
        assert_eq!(refused.status.code(), Some(2), "{wrong:?}");
    }
    assert!(!dir.path().join("no.ldi").exists());
}

#[test]
fn depth_of_photographs_is_estimated_cached_and_compared() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    let json = |arguments: &[&str]| -> serde_json::Value {
        serde_json::from_str(&outputs(dir.path(), &[arguments, &["--json"]].concat()).0).unwrap()
    };
    let found = json(&["images", "ball", "--depth"]);
    // The ball covers a quarter of each image; its rim and the surfaces that only the outermost two
    // show stay unknown.
    let share = found["found_depth"]["share"].as_f64().unwrap();
    assert!(
        share > 0.12
            && share < 0.3
            && found["with_depth"] == 7
            && found["found_depth"]["known"].is_null(),
        "{found}"
    );
    let (said, notes) = outputs(dir.path(), &["images", "ball"]);
    assert!(
        said.contains("7 with depth") && notes.contains("estimated from the images"),
        "{said}{notes}"
    );
    // Two metres from the eyes, a radius of 0.4.
    let depth = found["median_depth_m"].as_f64().unwrap();
    assert!(depth > 1.6 && depth < 1.8, "{found}");
    let (_, said) = outputs(
        dir.path(),
        &[
            "render",
            "ball",
            "-o",
            "g.png",
            "--size",
            "64x48",
            "--variant",
            "geometry-averaged",
        ],
    );
    assert!(
        !said.contains("registration"),
        "colours and depth are of one camera: {said}"
    );
    let captured = json(&["capture", "ball", "-o", "ball.ldi"]);
    assert!(captured["images"] == 7, "{captured}");

    room(dir.path(), DEPTH_FOCAL);
    let refused = |arguments: &[&str], status: i32, expected: &str| {
        let output = headbox(dir.path(), arguments);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.code() == Some(status) && said.contains(expected),
            "{arguments:?}: {said}"
        );
    };
    refused(&["images", "room", "--depth"], 1, "-o FOLDER");
    refused(&["images", "room", "--depth", "-o", "ball"], 1, "not empty");
    refused(&["images", "room", "-o", "new"], 2, "--depth");
    // A camera that rotates about its eye gives no depth, and no half-written folder.
    refused(
        &["images", "room", "--depth", "-o", "new"],
        1,
        "no depth found in 8 photographs: none of them overlaps another from a different position",
    );
    assert!(!dir.path().join("new").exists());
    let wall = ["truth", "builtin:castle", "--images", "3x1", "-o", "wall"];
    outputs(
        dir.path(),
        &[wall.as_slice(), &["--size", "160x120", "--unlit"]].concat(),
    );
    let compared = json(&["images", "wall", "--depth", "-o", "new"]);
    let known = &compared["found_depth"]["known"];
    assert!(
        known["covered"].as_f64().unwrap() > 0.1
            && compared["views"].as_array().unwrap().len() == 3,
        "{compared}"
    );
    assert!(
        dir.path().join("new/transforms.json").is_file()
            && dir.path().join("new/images/00002.png").is_file()
    );
}

/// An interrupt while depth is estimated leaves an empty folder, which the next run accepts.
#[test]
#[cfg(unix)]
fn interrupted_depth_leaves_no_set() {
    let dir = tempfile::tempdir().unwrap();
    ball(dir.path());
    let arguments = ["images", "ball", "--depth", "-o", "new"];
    let mut child = Command::new(env!("CARGO_BIN_EXE_headbox"))
        .args(arguments)
        .current_dir(dir.path())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The copy is complete once its manifest is there, in a folder inside the new one.
    let new = dir.path().join("new");
    let entries = || std::fs::read_dir(&new).into_iter().flatten().flatten();
    let is_copied = || entries().any(|entry| entry.path().join("transforms.json").is_file());
    while !is_copied() {
        assert!(child.try_wait().unwrap().is_none(), "it ended too early");
        std::thread::sleep(Duration::from_millis(1));
    }
    Command::new("kill")
        .args(["-TERM", &child.id().to_string()])
        .status()
        .unwrap();
    let output = child.wait_with_output().unwrap();
    let problems = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{problems}");
    let left: Vec<_> = entries().map(|entry| entry.path()).collect();
    assert!(left.is_empty(), "{left:?}");
    outputs(dir.path(), &arguments);
    assert!(new.join("transforms.json").is_file() && entries().count() == 3);
}
