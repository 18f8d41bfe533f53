//! Promises of the command line about image sets: every command that takes a scene's capture takes a folder of images.

#![expect(clippy::unwrap_used, reason = "in a test a panic is the failure report")]

use super::run::headbox;
use image::{ImageBuffer, Luma, Rgb, RgbImage};
use std::fmt::Write as _;
use std::path::Path;

fn succeeds(folder: &Path, arguments: &[&str]) -> (String, String) {
    let output = headbox(folder, arguments);
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert!(output.status.success(), "{arguments:?}: {err}");
    (out, err)
}

/// Where the walls of the room are, metres from its middle.
const HALF: [f64; 3] = [2.0, 1.5, 2.0];
const SIZE: [u32; 2] = [96, 72];
const DEPTH_FOCAL: f64 = 90.0;

/// Frames of a sensor that turns in a room; its colours are those of a lens of `color_focal` pixels.
fn room(folder: &Path, color_focal: f64) {
    std::fs::create_dir(folder.join("room")).unwrap();
    for i in 0..8u32 {
        let (sin, cos) = (f64::from(i) * 0.07).sin_cos();
        // X right, Y down, Z forward, turned about the vertical.
        let ray = |x: u32, y: u32, focal: f64| {
            let [u, v] =
                [(x, SIZE[0]), (y, SIZE[1])].map(|(at, side)| (f64::from(at) + 0.5 - f64::from(side) / 2.0) / focal);
            [cos * u + sin, v, cos - sin * u]
        };
        let wall = |ray: [f64; 3]| (0..3).map(|k| HALF[k] / ray[k].abs()).fold(f64::INFINITY, f64::min);
        let depth = |x, y| Luma([(wall(ray(x, y, DEPTH_FOCAL)) * 1000.0 + 0.5) as u16]);
        let color = |x, y| {
            let ray = ray(x, y, color_focal);
            let p = ray.map(|c| c * wall(ray));
            let level = |c: f64| {
                128.0
                    + 50.0 * (9.0 * p[0] + 5.0 * p[1] + 7.0 * p[2] + c).sin()
                    + 50.0 * (4.0 * p[0] - 8.0 * p[1] - 3.0 * p[2]).sin()
            };
            Rgb([0.0, 1.0, 2.0].map(|c| level(c) as u8))
        };
        let name = |ending: &str| folder.join(format!("room/frame-{i:06}.{ending}"));
        RgbImage::from_fn(SIZE[0], SIZE[1], color).save(name("color.png")).unwrap();
        ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(SIZE[0], SIZE[1], depth).save(name("depth.png")).unwrap();
        std::fs::write(name("pose.txt"), format!("{cos} 0 {sin} 0\n0 1 0 0\n{} 0 {cos} 0\n0 0 0 1\n", -sin)).unwrap();
    }
    let mut intrinsics = String::new();
    let [cx, cy] = SIZE.map(|side| f64::from(side) / 2.0 - 0.5);
    writeln!(intrinsics, "{DEPTH_FOCAL} 0 {cx}\n0 {DEPTH_FOCAL} {cy}\n0 0 1").unwrap();
    std::fs::write(folder.join("room/camera-intrinsics.txt"), intrinsics).unwrap();
}

#[test]
fn a_folder_of_images_is_captured_rendered_told_of_and_measured() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), DEPTH_FOCAL);
    let (info, _) = succeeds(dir.path(), &["info", "room", "--json"]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!((info["kind"].as_str(), info["with_depth"].as_u64()), (Some("images"), Some(8)));
    let (_, said) = succeeds(dir.path(), &["capture", "room", "-o", "room.ldi"]);
    assert!(said.contains("kept as given"), "{said}");
    let camera = ["--size", "96x72", "--fov", "40", "--json"];
    let render = |file: &str, output: &str| {
        let (stats, _) = succeeds(dir.path(), &[["render", file, "-o", output].as_slice(), &camera].concat());
        serde_json::from_str::<serde_json::Value>(&stats).unwrap()["hole_fraction"].as_f64().unwrap()
    };
    // Both look where the images look, and show the same.
    assert!(render("room", "a.png") < 0.3 && render("room.ldi", "b.png") < 0.3);
    let pictures = ["a.png", "b.png"].map(|name| std::fs::read(dir.path().join(name)).unwrap());
    assert!(pictures[0] == pictures[1], "a folder and its capture look the same");
    let (summary, _) = succeeds(dir.path(), &["report", "room", "--hold-out", "4", "-o", "out"]);
    assert!(["| nearest |", "| near |", "| ldi |"].iter().all(|row| summary.contains(row)), "{summary}");
    let rows = ["nearest", "single", "multi", "blended", "averaged"].map(|name| format!("| geometry-{name} |"));
    assert!(rows.iter().all(|row| summary.contains(row)), "{summary}");
    assert!(dir.path().join("out/report.json").is_file());
}

#[test]
fn a_folder_of_images_is_drawn_by_view_dependent_geometry() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), DEPTH_FOCAL);
    let render = |output: &str, more: &[&str]| {
        let base = ["render", "room", "-o", output, "--size", "96x72", "--fov", "40"];
        headbox(dir.path(), &[base.as_slice(), more].concat())
    };
    for variant in ["geometry-nearest", "geometry-single", "geometry-multi", "geometry-blended", "geometry-averaged"] {
        let drawn = render("g.png", &["--variant", variant, "--grid", "3", "--cameras", "4", "--json"]);
        let stats: serde_json::Value = serde_json::from_slice(&drawn.stdout).unwrap();
        assert_eq!(stats["variant"], variant);
        assert!(stats["hole_fraction"].as_f64().unwrap() < 0.3, "{variant}: {stats}");
    }
    // The views look along +Z in their file's axes.
    let away = render("away.png", &["--variant", "geometry-blended", "--eye", "0,0,0", "--look-at", "0,0,-1"]);
    let said = String::from_utf8(away.stderr).unwrap();
    assert!(away.status.success() && said.contains("none of the 8 cameras") && said.contains("empty"), "{said}");
    for (wrong, expected) in [
        (vec!["--cameras", "3"], "--variant geometry-blended"),
        (vec!["--variant", "geometry-blended", "--keep-holes"], "--keep-holes"),
        (vec!["--variant", "geometry-other"], "geometry-averaged"),
    ] {
        let refused = render("no.png", &wrong);
        let said = String::from_utf8(refused.stderr).unwrap();
        assert!(refused.status.code() == Some(2) && said.contains(expected), "{wrong:?}: {said}");
        assert!(!dir.path().join("no.png").exists());
    }
}

#[test]
fn colours_of_another_lens_are_registered_unless_that_is_forbidden() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), 80.0);
    let psnr = |more: &[&str]| {
        let (_, said) =
            succeeds(dir.path(), &[["report", "room", "--hold-out", "4", "-o", "out"].as_slice(), more].concat());
        let report: serde_json::Value =
            serde_json::from_slice(&std::fs::read(dir.path().join("out/report.json")).unwrap()).unwrap();
        let rows = report["rows"].as_array().unwrap();
        let of_all: Vec<f64> =
            rows.iter().filter(|row| row["variant"] == "ldi").map(|row| row["psnr_db"].as_f64().unwrap()).collect();
        (of_all.iter().sum::<f64>() / of_all.len() as f64, said)
    };
    let (registered, said) = psnr(&[]);
    assert!(said.contains("another camera") && said.contains("not 90.0"), "{said}");
    let (given, said) = psnr(&["--no-registration"]);
    assert!(!said.contains("registration"), "{said}");
    assert!(registered > given + 3.0, "{registered} dB registered, {given} dB as given");
}
