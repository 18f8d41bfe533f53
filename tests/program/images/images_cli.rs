//! Promises of the command line about image sets: every command for captures of scenes accepts a
//! folder of images.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use crate::run::{fails, headbox, outputs};
use image::{ImageBuffer, Luma, Rgb, RgbImage};
use std::fmt::Write as _;
use std::path::Path;

/// Half sizes of the room, metres.
const HALF: [f64; 3] = [2.0, 1.5, 2.0];
pub(super) const SIZE: [u32; 2] = [96, 72];
pub(super) const DEPTH_FOCAL: f64 = 90.0;

/// Largest error of the castle's cameras, metres.
const STEP_M: f64 = 0.05;

/// Remaining share of the error: these images have about ten pixels per degree fewer than the
/// sensors for which registration is made.
const LEFT: f64 = 0.1;

/// Frames of a sensor that rotates in a room; its colour camera has a focal length of `color_focal`
/// pixels.
pub(super) fn room(folder: &Path, color_focal: f64) {
    std::fs::create_dir(folder.join("room")).unwrap();
    for i in 0..8u32 {
        let (sin, cos) = (f64::from(i) * 0.07).sin_cos();
        // X right, Y down, Z forward, turned about the vertical.
        let ray = |x: u32, y: u32, focal: f64| {
            let [u, v] = [(x, SIZE[0]), (y, SIZE[1])]
                .map(|(at, side)| (f64::from(at) + 0.5 - f64::from(side) / 2.0) / focal);
            [cos * u + sin, v, cos - sin * u]
        };
        let wall = |ray: [f64; 3]| {
            (0..3)
                .map(|k| HALF[k] / ray[k].abs())
                .fold(f64::INFINITY, f64::min)
        };
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
        RgbImage::from_fn(SIZE[0], SIZE[1], color)
            .save(name("color.png"))
            .unwrap();
        ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(SIZE[0], SIZE[1], depth)
            .save(name("depth.png"))
            .unwrap();
        std::fs::write(
            name("pose.txt"),
            format!("{cos} 0 {sin} 0\n0 1 0 0\n{} 0 {cos} 0\n0 0 0 1\n", -sin),
        )
        .unwrap();
    }
    let mut intrinsics = String::new();
    let [cx, cy] = SIZE.map(|side| f64::from(side) / 2.0 - 0.5);
    writeln!(
        intrinsics,
        "{DEPTH_FOCAL} 0 {cx}\n0 {DEPTH_FOCAL} {cy}\n0 0 1"
    )
    .unwrap();
    std::fs::write(folder.join("room/camera-intrinsics.txt"), intrinsics).unwrap();
}

#[test]
fn folder_of_images_works_in_every_command() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), DEPTH_FOCAL);
    let of_sets = |flag: &str| format!("{flag} is for folders of images");
    for flag in ["--no-registration", "--refine-poses"] {
        fails(
            dir.path(),
            2,
            &["render", "x.ldi", "-o", "x.png", flag],
            &of_sets(flag),
        );
    }
    let (_, quick) = outputs(
        dir.path(),
        &["render", "room", "-o", "as-given.png", "--no-registration"],
    );
    assert!(!quick.contains("registration"), "{quick}");
    let picture = std::fs::read(dir.path().join("room/frame-000003.color.png")).unwrap();
    let onto_itself = [
        "render",
        "room",
        "-o",
        "room/frame-000003.color.png",
        "--no-registration",
    ];
    fails(
        dir.path(),
        2,
        &onto_itself,
        "room/frame-000003.color.png cannot be written",
    );
    assert_eq!(
        std::fs::read(dir.path().join("room/frame-000003.color.png")).unwrap(),
        picture
    );
    for (flag, value) in [
        ("--shard", "1/2"),
        ("--face-size", "256"),
        ("--light-samples", "9"),
        ("--sun", "off"),
    ] {
        let said = format!("{flag} has no meaning for images; leave it out");
        fails(
            dir.path(),
            2,
            &["capture", "room", "-o", "x.ldi", flag, value],
            &said,
        );
    }
    fails(
        dir.path(),
        2,
        &["capture", "room", "-o", "x.ldi", "--agreement", "9"],
        "--agreement is for folders of photographs without depth",
    );
    let (info, _) = outputs(dir.path(), &["info", "room", "--json"]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(
        (info["kind"].as_str(), info["with_depth"].as_u64()),
        (Some("images"), Some(8))
    );
    let (_, said) = outputs(dir.path(), &["capture", "room", "-o", "room.ldi"]);
    assert!(said.contains("kept as given"), "{said}");
    let (info, _) = outputs(dir.path(), &["info", "room.ldi", "--json"]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    let capture = &info["capture"];
    // Colours of photographs are stored as they are.
    assert_eq!(
        (&capture["tone"], &capture["light"]["tone"]),
        (&"srgb-clipped".into(), &"srgb-clipped".into())
    );
    let camera = ["--size", "96x72", "--fov", "40", "--json"];
    let render = |file: &str, output: &str| {
        let (stats, _) = outputs(
            dir.path(),
            &[["render", file, "-o", output].as_slice(), &camera].concat(),
        );
        serde_json::from_str::<serde_json::Value>(&stats).unwrap()["hole_fraction"]
            .as_f64()
            .unwrap()
    };
    // Both start with the direction of the images, and show the same.
    assert!(render("room", "a.png") < 0.3 && render("room.ldi", "b.png") < 0.3);
    let pictures = ["a.png", "b.png"].map(|name| std::fs::read(dir.path().join(name)).unwrap());
    assert!(
        pictures[0] == pictures[1],
        "a folder and its capture look the same"
    );
    let (summary, _) = outputs(
        dir.path(),
        &["report", "room", "--hold-out", "4", "-o", "out"],
    );
    assert!(
        ["| nearest |", "| live-3 |", "| ldi |"]
            .iter()
            .all(|row| summary.contains(row)),
        "{summary}"
    );
    let rows = ["nearest", "single", "multi", "blended", "averaged"]
        .map(|name| format!("| geometry-{name} |"));
    assert!(rows.iter().all(|row| summary.contains(row)), "{summary}");
    assert!(dir.path().join("out/report.json").is_file());
}

#[test]
fn a_folder_of_images_is_drawn_by_view_dependent_geometry() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), DEPTH_FOCAL);
    let render = |output: &str, more: &[&str]| {
        let base = [
            "render", "room", "-o", output, "--size", "96x72", "--fov", "40",
        ];
        headbox(dir.path(), &[base.as_slice(), more].concat())
    };
    for variant in [
        "geometry-nearest",
        "geometry-single",
        "geometry-multi",
        "geometry-blended",
        "geometry-averaged",
    ] {
        let drawn = render(
            "g.png",
            &[
                "--variant",
                variant,
                "--grid",
                "3",
                "--cameras",
                "4",
                "--json",
            ],
        );
        let stats: serde_json::Value = serde_json::from_slice(&drawn.stdout).unwrap();
        assert_eq!(stats["variant"], variant);
        assert!(
            stats["hole_fraction"].as_f64().unwrap() < 0.3,
            "{variant}: {stats}"
        );
    }
    // The views look along +Z in their file's axes.
    let away = render(
        "away.png",
        &[
            "--variant",
            "geometry-blended",
            "--eye",
            "0,0,0",
            "--look-at",
            "0,0,-1",
        ],
    );
    let said = String::from_utf8(away.stderr).unwrap();
    assert!(
        away.status.success() && said.contains("none of the 8 cameras") && said.contains("empty"),
        "{said}"
    );
    for (wrong, expected) in [
        (vec!["--cameras", "3"], "--variant geometry-blended"),
        (
            vec!["--variant", "geometry-blended", "--keep-holes"],
            "--keep-holes",
        ),
        (vec!["--variant", "geometry-other"], "geometry-averaged"),
    ] {
        let refused = render("no.png", &wrong);
        let said = String::from_utf8(refused.stderr).unwrap();
        assert!(
            refused.status.code() == Some(2) && said.contains(expected),
            "{wrong:?}: {said}"
        );
        assert!(!dir.path().join("no.png").exists());
    }
}

#[test]
#[cfg(feature = "viewer")]
fn overlays_are_painted_without_a_window() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), DEPTH_FOCAL);
    let render = |more: &[&str]| {
        let base = [
            "render", "room", "-o", "o.png", "--size", "96x72", "--fov", "40",
        ];
        headbox(dir.path(), &[base.as_slice(), more].concat())
    };
    let picture = || std::fs::read(dir.path().join("o.png")).unwrap();
    assert!(render(&["--variant", "geometry-blended"]).status.success());
    let plain = picture();
    let mut legends = Vec::new();
    for overlay in ["camera", "owners", "mesh", "age", "coverage", "holes"] {
        let said = render(&[
            "--variant",
            "geometry-blended",
            "--overlay",
            overlay,
            "--json",
        ]);
        let said: serde_json::Value = serde_json::from_slice(&said.stdout).unwrap();
        let legend = said["legend"].as_array().unwrap().clone();
        assert!(
            said["overlay"] == overlay && !legend.is_empty() && !legends.contains(&legend),
            "{said}"
        );
        assert!(picture() != plain, "{overlay}");
        legends.push(legend);
    }
    let depth = render(&["--overlay", "depth"]);
    assert!(
        depth.status.success()
            && String::from_utf8(depth.stdout)
                .unwrap()
                .contains("overlay depth"),
        "of a cube"
    );
    assert!(picture() != plain);
    let refused = render(&["--variant", "geometry-blended", "--overlay", "depth"]);
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(
        refused.status.code() == Some(2) && said.contains("none, holes, coverage, camera"),
        "{said}"
    );
}

#[test]
fn colours_of_another_lens_are_registered_unless_refused() {
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), 80.0);
    let psnr = |more: &[&str]| {
        let (_, said) = outputs(
            dir.path(),
            &[
                ["report", "room", "--hold-out", "4", "-o", "out"].as_slice(),
                more,
            ]
            .concat(),
        );
        let report: serde_json::Value =
            serde_json::from_slice(&std::fs::read(dir.path().join("out/report.json")).unwrap())
                .unwrap();
        let rows = report["rows"].as_array().unwrap();
        let of_all: Vec<f64> = rows
            .iter()
            .filter(|row| row["variant"] == "ldi")
            .map(|row| row["psnr_db"].as_f64().unwrap())
            .collect();
        (of_all.iter().sum::<f64>() / of_all.len() as f64, said)
    };
    let (registered, said) = psnr(&[]);
    assert!(
        said.contains("another camera") && said.contains("not 90.0"),
        "{said}"
    );
    let (given, said) = psnr(&["--no-registration"]);
    assert!(!said.contains("registration"), "{said}");
    assert!(
        registered > given + 3.0,
        "{registered} dB registered, {given} dB as given"
    );
}

/// Exact images with perturbed poses return to their relative positions; exact poses stay.
#[test]
fn slightly_wrong_poses_are_refined() {
    let dir = tempfile::tempdir().unwrap();
    let truth = [
        "truth",
        "builtin:castle",
        "--images",
        "4x2",
        "-o",
        "castle",
        "--size",
        "160x120",
        "--samples",
        "1",
        "--unlit",
    ];
    outputs(dir.path(), &truth);
    let eyes = |more: &[&str]| -> (Vec<[f64; 3]>, String) {
        let (out, said) = outputs(
            dir.path(),
            &[&["images", "castle", "--json"], more].concat(),
        );
        let told: serde_json::Value = serde_json::from_str(&out).unwrap();
        (
            told["views"]
                .as_array()
                .unwrap()
                .iter()
                .map(|view| serde_json::from_value(view["eye"].clone()).unwrap())
                .collect(),
            said,
        )
    };
    let (exact, _) = eyes(&[]);
    let (stayed, said) = eyes(&["--refine-poses"]);
    assert!(
        stayed == exact && said.contains("poses: kept as given"),
        "{said}"
    );
    let file = dir.path().join("castle/transforms.json");
    let mut set: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    for (i, frame) in (0..).zip(set["frames"].as_array_mut().unwrap()) {
        let matrix = &mut frame["transform_matrix"];
        // Rotated about the vertical by up to 0.6 degrees, and moved by up to 3 % of the distance
        // between the cameras.
        let angle = 0.01 * f64::from(i * 5 % 8 - 3) / 4.0;
        let (sin, cos) = angle.sin_cos();
        for column in 0..3 {
            let [x, z] = [0, 2].map(|row| matrix[row][column].as_f64().unwrap());
            matrix[0][column] = (cos * x + sin * z).into();
            matrix[2][column] = (cos * z - sin * x).into();
        }
        for row in 0..3 {
            matrix[row][3] = (matrix[row][3].as_f64().unwrap()
                + STEP_M * f64::from((i * 3 + row as i32 * 5) % 8 - 3) / 4.0)
                .into();
        }
    }
    std::fs::write(&file, set.to_string()).unwrap();
    let (given, _) = eyes(&[]);
    let (found, said) = eyes(&["--refine-poses"]);
    assert!(said.contains("poses: refined by"), "{said}");
    // The position of the whole set is undetermined.
    let from_mean = |eyes: &[[f64; 3]]| -> Vec<[f64; 3]> {
        let mean =
            [0, 1, 2].map(|k| eyes.iter().map(|eye| eye[k]).sum::<f64>() / eyes.len() as f64);
        eyes.iter()
            .map(|eye| [0, 1, 2].map(|k| eye[k] - mean[k]))
            .collect()
    };
    let off = |eyes: &[[f64; 3]]| -> f64 {
        let pairs = from_mean(eyes).into_iter().zip(from_mean(&exact));
        (pairs
            .map(|(a, b)| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>())
            .sum::<f64>()
            / eyes.len() as f64)
            .sqrt()
    };
    let [before, after] = [&given, &found].map(|eyes| off(eyes));
    assert!(after < before * LEFT, "{before} m, {after} m: {said}");
    let (_, again) = eyes(&["--refine-poses"]);
    assert_eq!(again, said, "kept");
}

#[test]
fn captures_of_images_keep_the_memory_limit() {
    let capture = |side: u32, focal: u32, limit: &str, refused: Option<&str>| {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        RgbImage::new(side, side).save(path("a.png")).unwrap();
        ImageBuffer::from_pixel(side, side, Luma([2000u16]))
            .save(path("depth.png"))
            .unwrap();
        let set = format!(
            r#"{{"w": {side}, "h": {side}, "fl_x": {focal}, "fl_y": {focal}, "cx": {0}, "cy": {0},
            "frames": [{{"file_path": "a.png", "depth_file_path": "depth.png",
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}]}}"#,
            side / 2
        );
        std::fs::write(path("transforms.json"), set).unwrap();
        let arguments = [
            "capture",
            "transforms.json",
            "-o",
            "a.ldi",
            "--memory",
            limit,
        ];
        match refused {
            Some(needed) => {
                let message = format!("merging the images needs at least {needed} MiB");
                fails(dir.path(), 1, &arguments, &message);
            }
            None => _ = outputs(dir.path(), &arguments),
        }
        assert_eq!(path("a.ldi").exists(), refused.is_none());
    };
    // Faces of 4,000 pixels: their offsets.
    capture(64, 2000, "256", Some("367"));
    capture(64, 2000, "1500", None);
    // Faces of 16 pixels: the samples of an image.
    capture(2048, 8, "110", Some("96"));
    // Faces of 2,000 pixels: the layers of its samples.
    capture(2048, 1000, "200", Some("168"));
}
