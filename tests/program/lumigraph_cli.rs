//! Promises of the command line about lumigraphs: capture, info, render, and one clear message per
//! error.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use super::run::{fails, headbox, json, succeeds};

const SMALL: [&str; 11] = [
    "lumigraph",
    "builtin:bump",
    "-o",
    "a.lumi",
    "--cameras",
    "3x2",
    "--size",
    "80x60",
    "--samples",
    "2",
    "--unlit",
];
const WALL: [&str; 6] = ["--plane", "0,0,3", "--normal", "0,0,-1", "--extent", "1"];

#[test]
fn a_scene_becomes_a_lumigraph_that_shows_it() {
    let dir = tempfile::tempdir().unwrap();
    let said = succeeds(dir.path(), &[SMALL.as_slice(), &WALL].concat());
    assert!(
        said.contains("3x2 images") && said.contains("headbox render a.lumi"),
        "{said}"
    );
    let info = json(dir.path(), &["info", "a.lumi", "--json"]);
    assert_eq!(
        (info["kind"].as_str(), info["ok"].as_bool()),
        (Some("lumigraph"), Some(true))
    );
    assert_eq!(
        (&info["cameras"], &info["size"]),
        (&serde_json::json!([3, 2]), &serde_json::json!([80, 60]))
    );
    assert_eq!(info["columns"], serde_json::json!([-0.5, 0.0, 0.5]));
    assert_eq!(
        info["rows"],
        serde_json::json!([-0.25, 0.25]),
        "rows have the columns' spacing"
    );
    assert_eq!(
        info["bytes"],
        std::fs::metadata(dir.path().join("a.lumi")).unwrap().len()
    );
    let layers = info["layers"].as_u64().unwrap();
    assert!((100..=255).contains(&layers), "{layers}");
    assert!(succeeds(dir.path(), &["info", "a.lumi", "--check"]).contains("ok"));

    let view = [
        "--eye",
        "0.1,0.1,3.2",
        "--look-at",
        "0.1,0,0",
        "--fov",
        "40",
        "--size",
        "80x60",
    ];
    let truth = [
        "truth",
        "builtin:bump",
        "-o",
        "t.png",
        "--samples",
        "16",
        "--unlit",
    ];
    succeeds(dir.path(), &[truth.as_slice(), &view].concat());
    let render = |more: &[&str]| {
        let arguments = ["render", "a.lumi", "-o", "r.png", "--json"];
        let rendered = json(dir.path(), &[arguments.as_slice(), &view, more].concat());
        let compared = json(dir.path(), &["compare", "r.png", "t.png", "--json"]);
        (rendered, compared["psnr_db"].as_f64().unwrap())
    };
    let (merged, db) = render(&[]);
    assert_eq!(
        (merged["variant"].as_str(), merged["hole_fraction"].as_f64()),
        (Some("shared"), Some(0.0))
    );
    // Six cameras of 80x60 pixels, in the colours of its textures.
    assert!(db > 19.0, "{db} dB");
    let (all, all_db) = render(&["--merge", "0"]);
    assert_eq!(
        all["statistics"]["layers"].as_u64(),
        Some(layers + 1),
        "and infinity"
    );
    assert!(merged["statistics"]["layers"].as_u64() < Some(layers / 4) && all_db > 19.0);
    let (whole, _) = render(&["--variant", "whole"]);
    assert_eq!(whole["variant"], "whole");

    #[cfg(feature = "viewer")]
    super::run::overlays_are_painted(
        dir.path(),
        "a.lumi",
        &["layer", "merged layers", "camera"],
        &view[..6],
    );

    // The default view is that of a camera in the middle of the others.
    assert!(succeeds(dir.path(), &["render", "a.lumi", "-o", "d.png"]).contains("lumigraph of"));
    let path =
        r#"{"poses": [{"eye": [0, 0, 3], "look_at": [0, 0, 0], "fov": 50}], "size": [16, 12]}"#;
    std::fs::write(dir.path().join("path.json"), path).unwrap();
    let frames = headbox(
        dir.path(),
        &["render", "a.lumi", "--path", "path.json", "-o", "frames"],
    );
    assert!(
        frames.status.success(),
        "{}",
        String::from_utf8_lossy(&frames.stderr)
    );
}

#[test]
fn planes_turned_about_a_place_are_light_slabs_of_one_file() {
    let dir = tempfile::tempdir().unwrap();
    let small = [
        SMALL.as_slice(),
        &WALL,
        &["--slabs", "12", "--about", "0,0,0"],
    ]
    .concat();
    assert!(succeeds(dir.path(), &small).contains("12 light slabs of 3x2 images"));
    let info = json(dir.path(), &["info", "a.lumi", "--json"]);
    let planes = info["slabs"].as_array().unwrap();
    assert_eq!(planes.len(), 12);
    for (plane, turns) in planes.iter().zip(0..) {
        let (sin, cos) = (f64::from(turns) * 30f64.to_radians()).sin_cos();
        let at: Vec<f64> = plane
            .as_array()
            .unwrap()
            .iter()
            .map(|x| x.as_f64().unwrap())
            .collect();
        assert!(
            (at[0] - 3.0 * sin).abs() < 1e-9 && (at[2] - 3.0 * cos).abs() < 1e-9,
            "{plane}"
        );
    }
    let said = succeeds(dir.path(), &["info", "a.lumi", "--check"]);
    assert!(
        said.contains("light slab 12 of 12") && said.contains("ok"),
        "{said}"
    );
    let view = [
        "--look-at",
        "0,0,0",
        "--fov",
        "25",
        "--size",
        "40x30",
        "--json",
        "--eye",
    ];
    let render = |eye| {
        let arguments = [
            ["render", "a.lumi", "-o", "r.png"].as_slice(),
            &view,
            &[eye],
        ]
        .concat();
        json(dir.path(), &arguments)["statistics"]["layers"]
            .as_u64()
            .unwrap()
    };
    // In the middle of the first plane's cameras, and half-way to the second plane.
    let (one, two) = (render("0,0.1,3"), render("0.776,0.1,2.898"));
    assert!(one > 0 && two > one, "{one} and {two} layers");
    fails(
        dir.path(),
        1,
        &["export", "a.lumi", "-o", "a.html"],
        "12 light slabs, and a page shows one",
    );
    fails(
        dir.path(),
        2,
        &[SMALL.as_slice(), &["--about", "0,0,0"]].concat(),
        "--slabs",
    );
    fails(
        dir.path(),
        1,
        &[
            SMALL.as_slice(),
            &["--plane", "0,0,3", "--slabs", "2", "--about", "0,0,4"],
        ]
        .concat(),
        "light slab",
    );
}

#[test]
fn planes_given_one_by_one_are_light_slabs_of_one_file() {
    let dir = tempfile::tempdir().unwrap();
    let planes = [
        "--plane", "0,0,3", "--normal", "0,0,-1", "--plane", "3,0,0", "--normal", "-1,0,0",
        "--extent", "1",
    ];
    assert!(
        succeeds(dir.path(), &[SMALL.as_slice(), &planes].concat())
            .contains("2 light slabs of 3x2 images")
    );
    let info = json(dir.path(), &["info", "a.lumi", "--json"]);
    assert_eq!(
        info["slabs"],
        serde_json::json!([[0.0, 0.0, 3.0], [3.0, 0.0, 0.0]])
    );
    // Each slab is drawn for its own views: equal to a traced frame from the middle of either
    // plane.
    for eye in ["0.1,0.1,3", "3,0.1,0.1"] {
        let view = [
            "--eye",
            eye,
            "--look-at",
            "0,0,0",
            "--fov",
            "40",
            "--size",
            "80x60",
        ];
        succeeds(
            dir.path(),
            &[["render", "a.lumi", "-o", "r.png"].as_slice(), &view].concat(),
        );
        let truth = [
            "truth",
            "builtin:bump",
            "-o",
            "t.png",
            "--samples",
            "16",
            "--unlit",
        ];
        succeeds(dir.path(), &[truth.as_slice(), &view].concat());
        let db = json(dir.path(), &["compare", "r.png", "t.png", "--json"])["psnr_db"]
            .as_f64()
            .unwrap();
        assert!(db > 17.0, "{eye}: {db} dB");
    }
    let planes = ["--plane", "0,0,3", "--plane", "3,0,0", "--plane", "0,3,0"];
    let wrong = |more: &[&str], said| {
        fails(
            dir.path(),
            2,
            &[SMALL.as_slice(), &planes, more].concat(),
            said,
        );
    };
    wrong(
        &["--normal", "0,0,-1", "--normal", "-1,0,0"],
        "2 --normal for 3 --plane",
    );
    wrong(&["--slabs", "3"], "--slabs turns one --plane");
}

#[test]
fn lumigraph_needs_only_a_scene() {
    let dir = tempfile::tempdir().unwrap();
    // As small as can be, for time alone.
    let told = json(
        dir.path(),
        &[SMALL.as_slice(), &["--json", "--layers", "300"]].concat(),
    );
    assert_eq!(
        told["index_bytes"],
        if told["layers"].as_u64() > Some(255) {
            2
        } else {
            1
        }
    );
    assert!(
        told["convergence_per_m"].as_f64() > Some(0.0),
        "the images meet amid the scene"
    );
    let again = [
        SMALL.as_slice(),
        &[
            "--json",
            "--parallel",
            "--placement",
            "uniform",
            "--threads",
            "1",
        ],
    ]
    .concat();
    assert_eq!(
        json(dir.path(), &again)["convergence_per_m"].as_f64(),
        Some(0.0)
    );
    let bytes = std::fs::read(dir.path().join("a.lumi")).unwrap();
    json(dir.path(), &[&again[..again.len() - 1], &["2"]].concat());
    assert!(
        std::fs::read(dir.path().join("a.lumi")).unwrap() == bytes,
        "the same on any number of threads"
    );
}

/// Writes images of a wall 2 m ahead, with stripes every 0.1 m, taken from positions at a height of
/// 1.5 m.
fn wall(folder: &std::path::Path, places: &[f64]) {
    std::fs::create_dir_all(folder).unwrap();
    let frames = places.iter().enumerate().map(|(i, x)| {
        let pixel = |u: u32, _: u32| {
            let at = x + (f64::from(u) + 0.5 - 40.0) / 50.0 * 2.0;
            image::Rgb(if (at * 5.0).rem_euclid(1.0) < 0.5 { [200, 180, 90] } else { [40, 60, 120] })
        };
        image::RgbImage::from_fn(80, 60, pixel).save(folder.join(format!("{i}.png"))).unwrap();
        let depth = image::ImageBuffer::from_pixel(80, 60, image::Luma([2000u16]));
        depth.save(folder.join(format!("{i}_depth.png"))).unwrap();
        serde_json::json!({
            "file_path": format!("{i}.png"), "depth_file_path": format!("{i}_depth.png"), "w": 80, "h": 60, "fl_x": 50.0,
            "transform_matrix": [[1, 0, 0, x], [0, 0, -1, 0], [0, 1, 0, 1.5], [0, 0, 0, 1]],
        })
    });
    let set = serde_json::json!({"frames": frames.collect::<Vec<_>>()});
    std::fs::write(folder.join("transforms.json"), set.to_string()).unwrap();
}

#[test]
fn pictures_from_a_row_of_places_become_a_lumigraph_and_what_says_nothing_of_them_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    wall(&dir.path().join("wall"), &[0.0, 0.1, 0.4]);
    let told = json(
        dir.path(),
        &["lumigraph", "wall", "-o", "wall.lumi", "--json"],
    );
    assert_eq!(
        (&told["cameras"], &told["size"]),
        (&serde_json::json!([3, 1]), &serde_json::json!([80, 60]))
    );
    assert_eq!(
        (told["unknown_pixels"].as_u64(), told["layers"].as_u64()),
        (Some(0), Some(1))
    );
    let columns: Vec<f64> = told["columns"]
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect();
    for (found, expected) in columns.iter().zip([-0.2, -0.1, 0.2]) {
        assert!((found - expected).abs() < 1e-9, "{columns:?}");
    }
    // From a camera's own position the frame is its image.
    let view = [
        "--eye",
        "0.1,0,1.5",
        "--look-at",
        "0.1,1,1.5",
        "--fov",
        "61.927513",
        "--size",
        "80x60",
    ];
    succeeds(
        dir.path(),
        &[["render", "wall.lumi", "-o", "r.png"].as_slice(), &view].concat(),
    );
    let compared = json(dir.path(), &["compare", "r.png", "wall/1.png", "--json"]);
    // Infinite where they are the same.
    assert!(
        compared["psnr_db"].as_f64().is_none_or(|db| db > 50.0),
        "{compared}"
    );

    for (flag, value) in [
        ("--plane", Some("0,0,0")),
        ("--samples", Some("2")),
        ("--unlit", None),
        ("--sun", Some("off")),
    ] {
        let more: Vec<&str> = [flag].into_iter().chain(value).collect();
        let arguments = [["lumigraph", "wall", "-o", "wall.lumi"].as_slice(), &more].concat();
        fails(
            dir.path(),
            2,
            &arguments,
            &format!("{flag} has no meaning for images"),
        );
    }
    wall(&dir.path().join("uneven"), &[0.0, 0.1, 0.1]);
    fails(
        dir.path(),
        1,
        &["lumigraph", "uneven", "-o", "u.lumi"],
        "1.png and 2.png were taken from the same place",
    );
}

#[test]
fn mistakes_give_one_message() {
    let dir = tempfile::tempdir().unwrap();
    let with = |more: &[&'static str]| [SMALL.as_slice(), more].concat();
    fails(
        dir.path(),
        2,
        &with(&["--normal", "0,0,0"]),
        "--normal has no direction",
    );
    fails(
        dir.path(),
        2,
        &[
            "lumigraph",
            "builtin:bump",
            "-o",
            "a.lumi",
            "--cameras",
            "0x4",
        ],
        "COLUMNSxROWS",
    );
    fails(dir.path(), 2, &with(&["--extent", "0"]), "greater than 0");
    fails(dir.path(), 2, &with(&["--layers", "70000"]), "65535");
    fails(
        dir.path(),
        2,
        &with(&["--focus", "2", "--parallel"]),
        "cannot be used with",
    );
    fails(
        dir.path(),
        2,
        &with(&["--plane", "1e9,0,0"]),
        "far from the scene",
    );
    fails(
        dir.path(),
        2,
        &["lumigraph", "builtin:bump", "-o", "a.ldi"],
        ".lumi",
    );
    fails(
        dir.path(),
        2,
        &["lumigraph", "builtin:bump", "-o", "a.lumi", "--size", "1x9"],
        "between 2 and",
    );
    fails(
        dir.path(),
        2,
        &[
            "lumigraph",
            "builtin:bump",
            "-o",
            "a.lumi",
            "--cameras",
            "99x99",
            "--size",
            "999x999",
        ],
        "fewer cameras or smaller images",
    );
    fails(
        dir.path(),
        1,
        &with(&["--plane", "0,0,3", "--normal", "0,0,1"]),
        "see nothing",
    );
    assert!(!dir.path().join("a.lumi").exists());
    succeeds(dir.path(), &[SMALL.as_slice(), &WALL].concat());
    fails(
        dir.path(),
        2,
        &["render", "a.lumi", "-o", "a.png", "--variant", "tent"],
        "shared, whole",
    );
    fails(
        dir.path(),
        2,
        &["render", "a.lumi", "a.lumi", "-o", "a.png"],
        "rendered alone",
    );
    fails(
        dir.path(),
        2,
        &["render", "a.lumi", "-o", "a.png", "--merge", "-1"],
        "a number from 0 to 16",
    );
    fails(
        dir.path(),
        2,
        &["render", "a.lumi", "-o", "a.png", "--depth", "a.exr"],
        "--depth does not apply to this view (lumigraph)",
    );
    let bytes = std::fs::read(dir.path().join("a.lumi")).unwrap();
    std::fs::write(dir.path().join("cut.lumi"), &bytes[..bytes.len() - 9]).unwrap();
    fails(dir.path(), 1, &["info", "cut.lumi"], "truncated");
}
