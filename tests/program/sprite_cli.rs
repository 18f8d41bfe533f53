//! Promises of the command line about sprites: capture, import, export, every variant, layers, and
//! one clear message per error.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use super::run::{fails, json, succeeds};
use headbox_sprite::SpriteVariant;
use image::{ImageBuffer, Luma, Rgba, RgbaImage};
use std::path::Path;

fn capture(folder: &Path, scene: &str, more: &[&str]) -> String {
    let arguments = [
        "sprite",
        scene,
        "-o",
        "a.sprite",
        "--size",
        "96x72",
        "--samples",
        "8",
        "--unlit",
    ];
    succeeds(folder, &[arguments.as_slice(), more].concat())
}

fn flip(folder: &Path, a: &str, b: &str) -> f64 {
    json(folder, &["compare", a, b, "--json"])["flip"]
        .as_f64()
        .unwrap()
}

#[test]
fn a_scene_becomes_sprites_that_every_variant_renders() {
    let dir = tempfile::tempdir().unwrap();
    assert!(capture(dir.path(), "builtin:sprites", &[]).contains("4 sprites"));
    let info = json(dir.path(), &["info", "a.sprite", "--json"]);
    assert_eq!(
        (info["kind"].as_str(), info["ok"].as_bool()),
        (Some("sprite"), Some(true))
    );
    assert_eq!(info["sprites"].as_array().unwrap().len(), 4);
    assert_eq!(
        info["bytes"],
        std::fs::metadata(dir.path().join("a.sprite"))
            .unwrap()
            .len()
    );
    assert!(succeeds(dir.path(), &["info", "a.sprite", "--check"]).contains("ok"));

    let view = [
        "--eye",
        "0.25,0.1,-0.1",
        "--look-at",
        "0,0,-5",
        "--size",
        "96x72",
    ];
    let truth = [
        "truth",
        "builtin:sprites",
        "-o",
        "t.png",
        "--samples",
        "16",
        "--unlit",
    ];
    succeeds(dir.path(), &[truth.as_slice(), &view].concat());
    let render = |variant: &str, output: &str, more: &[&str]| {
        let arguments = [
            "render",
            "a.sprite",
            "-o",
            output,
            "--variant",
            variant,
            "--json",
        ];
        json(dir.path(), &[arguments.as_slice(), &view, more].concat())
    };
    for variant in SpriteVariant::ALL {
        for sampling in ["nearest", "bilinear"] {
            let rendered = render(
                variant.name(),
                "r.png",
                &["--sampling", sampling, "--repeat", "2"],
            );
            assert_eq!(rendered["variant"], variant.name());
            assert_eq!(rendered["ms"].as_array().unwrap().len(), 2);
            assert!(rendered["stages"].is_object() && rendered["hole_fraction"].is_number());
        }
    }
    #[cfg(feature = "viewer")]
    super::run::overlays_are_painted(dir.path(), "a.sprite", &["holes"], &view[..4]);
    render("homography", "flat.png", &[]);
    render("two-pass", "deep.png", &[]);
    let (flat, deep) = (
        flip(dir.path(), "t.png", "flat.png"),
        flip(dir.path(), "t.png", "deep.png"),
    );
    assert!(
        deep < flat,
        "parallax inside the sprites brings them closer to truth: {deep} {flat}"
    );
    render("crude", "short_name.png", &[]);
    render("one-pass", "long_name.png", &[]);
    assert_eq!(flip(dir.path(), "short_name.png", "long_name.png"), 0.0);
}

#[test]
fn default_view_of_sprites_is_their_camera() {
    let dir = tempfile::tempdir().unwrap();
    let taken = ["--eye", "0.3,0.2,3.1", "--look-at", "0,0,0", "--fov", "50"];
    capture(dir.path(), "builtin:bump", &taken);
    succeeds(dir.path(), &["render", "a.sprite", "-o", "r.png"]);
    let truth = [
        "truth",
        "builtin:bump",
        "-o",
        "t.png",
        "--samples",
        "8",
        "--unlit",
        "--size",
        "96x72",
    ];
    succeeds(dir.path(), &[truth.as_slice(), &taken].concat());
    let flip = flip(dir.path(), "t.png", "r.png");
    // 0.040: half of the rays differ, which shows at edges. Another view costs ten times as much.
    assert!(flip < 0.05, "{flip}");
}

#[test]
fn exported_sprite_imports_unchanged() {
    let dir = tempfile::tempdir().unwrap();
    succeeds(
        dir.path(),
        &[
            "sprite",
            "builtin:bump",
            "--export",
            "out",
            "--size",
            "64x48",
            "--samples",
            "4",
            "--unlit",
        ],
    );
    let cameras = std::fs::read_to_string(dir.path().join("out/sprites.json")).unwrap();
    let cameras: serde_json::Value = serde_json::from_str(&cameras).unwrap();
    let vector = |key: &str| {
        let numbers: Vec<String> = cameras[0][key]
            .as_array()
            .unwrap()
            .iter()
            .map(ToString::to_string)
            .collect();
        numbers.join(",")
    };
    let (eye, look_at, fov) = (
        vector("eye"),
        vector("look_at"),
        cameras[0]["fov"].to_string(),
    );
    let pictures = [
        "sprite",
        "--color",
        "out/sprite_0.png",
        "--depth",
        "out/sprite_0.exr",
        "--depth-kind",
        "eye",
    ];
    let camera = [
        "--eye",
        &eye,
        "--look-at",
        &look_at,
        "--fov",
        &fov,
        "-o",
        "again.sprite",
    ];
    succeeds(dir.path(), &[pictures.as_slice(), &camera].concat());
    succeeds(
        dir.path(),
        &["sprite", "again.sprite", "--export", "out_again"],
    );
    let read = |name: &str| image::open(dir.path().join(name)).unwrap().to_rgba8();
    assert_eq!(read("out/sprite_0.png"), read("out_again/sprite_0.png"));
    let view = [
        "--eye",
        "0.4,0,3",
        "--look-at",
        "0,0,0",
        "--size",
        "64x48",
        "--fov",
        "40",
    ];
    succeeds(
        dir.path(),
        &[
            "sprite",
            "builtin:bump",
            "-o",
            "b.sprite",
            "--size",
            "64x48",
            "--samples",
            "4",
            "--unlit",
        ],
    );
    for (file, frame) in [("b.sprite", "b.png"), ("again.sprite", "again.png")] {
        succeeds(
            dir.path(),
            &[["render", file, "-o", frame].as_slice(), &view].concat(),
        );
    }
    // The plane is fitted again to depths quantised to 8 bits: the same to a fraction of a pixel.
    let flip = flip(dir.path(), "b.png", "again.png");
    assert!(flip < 0.03, "{flip}");
}

#[test]
fn sprites_and_cubes_lie_over_each_other() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), "builtin:bump", &["--eye", "0,0,3"]);
    let cube = [
        "capture",
        "builtin:bump",
        "-o",
        "a.ldi",
        "--face-size",
        "48",
        "--strata",
        "6",
        "--rays",
        "4",
    ];
    succeeds(dir.path(), &cube);
    let view = ["-o", "r.png", "--size", "48x36", "--eye", "0,0,3", "--json"];
    let both = json(
        dir.path(),
        &[["render", "a.ldi", "a.sprite"].as_slice(), &view].concat(),
    );
    assert_eq!(
        both["statistics"]["order"].as_array().unwrap().len(),
        2,
        "{both}"
    );
    assert!(both["depth_pixels_in"].as_u64().unwrap() > 0);
    let kernel = [
        ["render", "a.sprite", "a.ldi", "--variant", "opaque"].as_slice(),
        &view,
    ]
    .concat();
    succeeds(dir.path(), &kernel);
}

#[test]
fn a_path_gives_a_frame_per_pose() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), "builtin:bump", &[]);
    let poses = r#"[{"eye": [0, 0, 3], "look_at": [0, 0, 0], "size": [20, 10]},
                    {"eye": [0.2, 0, 3], "look_at": [0, 0, 0], "size": [20, 10]}]"#;
    std::fs::write(dir.path().join("path.json"), poses).unwrap();
    succeeds(
        dir.path(),
        &["render", "a.sprite", "--path", "path.json", "-o", "frames"],
    );
    assert_eq!(
        image::image_dimensions(dir.path().join("frames/frame_0001.png")).unwrap(),
        (20, 10)
    );
    assert_eq!(
        std::fs::read_to_string(dir.path().join("frames/times.csv"))
            .unwrap()
            .lines()
            .count(),
        3
    );
}

#[test]
fn range_reports_reach_of_each_variant() {
    let dir = tempfile::tempdir().unwrap();
    let small = [
        "--size",
        "48x48",
        "--samples",
        "2",
        "--unlit",
        "--slabs",
        "1",
    ];
    let said = succeeds(
        dir.path(),
        &[
            ["sprite", "builtin:bump", "--range", "range"].as_slice(),
            &small,
        ]
        .concat(),
    );
    assert!(
        said.lines()
            .any(|line| line.starts_with("two-pass") && line.contains("px of parallax")),
        "{said}"
    );
    let csv = std::fs::read_to_string(dir.path().join("range/range.csv")).unwrap();
    let cell =
        |line: &str, column: usize| line.split(',').nth(column).unwrap().parse::<f64>().unwrap();
    let rows: Vec<&str> = csv.lines().skip(1).collect();
    assert!(
        csv.starts_with("displacement_m,parallax_px,hole_share,homography,one-pass,two-pass,"),
        "{csv}"
    );
    assert!(
        rows.windows(2)
            .all(|pair| cell(pair[0], 1) < cell(pair[1], 1)),
        "parallax grows: {csv}"
    );
    assert!(
        cell(rows[4], 5) < cell(rows[4], 3),
        "two passes beat none: {csv}"
    );
    let chart = std::fs::read_to_string(dir.path().join("range/range.svg")).unwrap();
    assert!(chart.contains(">two-pass</text>"), "{chart}");
    capture(dir.path(), "builtin:bump", &[]);
    fails(
        dir.path(),
        2,
        &["sprite", "a.sprite", "--range", "range"],
        "needs a scene",
    );
}

#[test]
fn mistakes_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let save = |name: &str, picture: RgbaImage| picture.save(dir.path().join(name)).unwrap();
    let grey = |name: &str, width: u32, height: u32, value: u16| {
        let picture = ImageBuffer::<Luma<u16>, _>::from_pixel(width, height, Luma([value]));
        picture.save(dir.path().join(name)).unwrap();
    };
    save(
        "color.png",
        RgbaImage::from_pixel(8, 6, Rgba([200, 100, 50, 255])),
    );
    save("clear.png", RgbaImage::new(8, 6));
    save("one.png", RgbaImage::from_pixel(1, 1, Rgba([9, 9, 9, 255])));
    grey("depth.png", 8, 6, 1500);
    grey("narrow.png", 7, 6, 1500);
    grey("unknown.png", 8, 6, 0);
    grey("one_depth.png", 1, 1, 2000);
    let import = |color: &str, depth: &str| {
        [
            "sprite",
            "--color",
            color,
            "--depth",
            depth,
            "--depth-kind",
            "eye",
            "-o",
            "x.sprite",
        ]
        .map(str::to_owned)
    };
    let refused = |color: &str, depth: &str, expected: &str| {
        let arguments = import(color, depth);
        fails(
            dir.path(),
            1,
            &arguments.each_ref().map(String::as_str),
            expected,
        );
        assert!(!dir.path().join("x.sprite").exists());
    };
    refused("color.png", "narrow.png", "bring both to one size");
    refused(
        "color.png",
        "unknown.png",
        "no visible pixel has a valid depth",
    );
    refused("color.png", "color.png", "8 or 16 bits of grey");
    refused("nowhere.png", "depth.png", "nowhere.png");
    refused("color.png", "nowhere.exr", "nowhere.exr");
    for (color, depth) in [
        ("clear.png", "unknown.png"),
        ("one.png", "one_depth.png"),
        ("color.png", "depth.png"),
    ] {
        let arguments = import(color, depth);
        succeeds(dir.path(), &arguments.each_ref().map(String::as_str));
        succeeds(
            dir.path(),
            &[
                "render", "x.sprite", "-o", "x.png", "--size", "16x12", "--eye", "0.1,0,0",
            ],
        );
        std::fs::remove_file(dir.path().join("x.sprite")).unwrap();
    }
    fails(
        dir.path(),
        2,
        &["sprite", "-o", "x.sprite"],
        "headbox scenes",
    );
    fails(dir.path(), 2, &["sprite", "builtin:bump"], "-o FILE.sprite");
    fails(
        dir.path(),
        2,
        &["sprite", "--color", "color.png", "-o", "x.sprite"],
        "--depth",
    );
    fails(
        dir.path(),
        2,
        &[
            "sprite",
            "builtin:bump",
            "--color",
            "color.png",
            "-o",
            "x.sprite",
        ],
        "cannot be used with",
    );
    let window = [
        "sprite",
        "--color",
        "color.png",
        "--depth",
        "depth.png",
        "--depth-kind",
        "window",
        "-o",
        "x.sprite",
    ];
    fails(dir.path(), 2, &window, "--near");
    let inverted = [window.as_slice(), &["--near", "2", "--far", "1"]].concat();
    fails(dir.path(), 1, &inverted, "0 < near < far");
    let away = [
        "sprite",
        "builtin:bump",
        "-o",
        "x.sprite",
        "--size",
        "8x8",
        "--look-at",
        "0,0,9",
    ];
    fails(dir.path(), 1, &away, "--look-at");

    capture(dir.path(), "builtin:bump", &[]);
    fails(
        dir.path(),
        2,
        &["render", "a.sprite", "-o", "x.png", "--variant", "best"],
        "two-pass",
    );
    fails(
        dir.path(),
        1,
        &["render", "color.png", "-o", "x.png"],
        "not a headbox file",
    );
    let good = std::fs::read(dir.path().join("a.sprite")).unwrap();
    std::fs::write(dir.path().join("half.sprite"), &good[..good.len() / 2]).unwrap();
    fails(
        dir.path(),
        1,
        &["render", "half.sprite", "-o", "x.png"],
        "half.sprite",
    );
    fails(dir.path(), 1, &["info", "half.sprite"], "truncated");
}
