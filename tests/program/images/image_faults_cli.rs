//! Promises of the command line about faults of image sets.

use super::images_cli::{DEPTH_FOCAL, SIZE, room};
use crate::run::{fails, headbox, outputs};
use image::{ImageBuffer, Luma, Rgb, RgbImage};
use std::path::Path;

/// A view without depth is not captured, and its image is not read; `images` checks every file.
#[test]
fn unused_pictures_are_not_read() {
    let dir = tempfile::tempdir().unwrap();
    let images = [
        "truth",
        "builtin:castle",
        "--images",
        "2x2",
        "-o",
        "castle",
        "--size",
        "80x60",
        "--samples",
        "1",
        "--unlit",
    ];
    outputs(dir.path(), &images);
    let file = dir.path().join("castle/transforms.json");
    let mut set: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    let frame = set["frames"][3].as_object_mut().unwrap();
    frame.remove("depth_file_path");
    let picture = dir
        .path()
        .join("castle")
        .join(frame["file_path"].as_str().unwrap());
    std::fs::write(&file, set.to_string()).unwrap();
    RgbImage::new(40, 40).save(&picture).unwrap();
    let (captured, _) = outputs(
        dir.path(),
        &[
            "capture",
            "castle",
            "-o",
            "castle.ldi",
            "--no-registration",
            "--json",
        ],
    );
    assert!(
        captured.contains("\"images\":3") || captured.contains("\"images\": 3"),
        "{captured}"
    );
    let refused = headbox(dir.path(), &["images", "castle", "--no-registration"]);
    let why = String::from_utf8(refused.stderr).unwrap();
    assert!(
        refused.status.code() == Some(1) && why.contains("00003.png: is 40x40 pixels"),
        "{why}"
    );
}

/// Problems of a set's images are reported in a sentence that names the file, and nothing is
/// written.
#[test]
fn picture_defects_are_reported() {
    let depths = |folder: &Path| -> Vec<_> {
        (0..8)
            .map(|i| folder.join(format!("room/frame-{i:06}.depth.png")))
            .collect()
    };
    let black = |height: u32| ImageBuffer::<Luma<u16>, Vec<u16>>::new(SIZE[0], height);
    type Case<'a> = (&'a str, &'a dyn Fn(&Path));
    let cases: [Case; 4] = [
        (
            "frame-000001.depth.png: is 96x36 pixels, but its image is 96x72",
            &|dir| {
                black(SIZE[1] / 2).save(&depths(dir)[1]).unwrap();
            },
        ),
        ("frame-000001.depth.png: has depth in 8 bits", &|dir| {
            image::GrayImage::new(SIZE[0], SIZE[1])
                .save(&depths(dir)[1])
                .unwrap();
        }),
        ("frame-000001.depth.png: ", &|dir| {
            std::fs::write(
                &depths(dir)[1],
                &std::fs::read(&depths(dir)[1]).unwrap()[..200],
            )
            .unwrap();
        }),
        ("room: no image has depth", &|dir| {
            depths(dir)
                .iter()
                .for_each(|file| black(SIZE[1]).save(file).unwrap());
        }),
    ];
    for (expected, damage) in cases {
        let dir = tempfile::tempdir().unwrap();
        room(dir.path(), DEPTH_FOCAL);
        damage(dir.path());
        fails(
            dir.path(),
            1,
            &["capture", "room", "-o", "room.ldi", "--no-registration"],
            expected,
        );
        assert!(!dir.path().join("room.ldi").exists(), "{expected}");
    }
    let dir = tempfile::tempdir().unwrap();
    room(dir.path(), DEPTH_FOCAL);
    black(SIZE[1]).save(&depths(dir.path())[1]).unwrap();
    std::fs::remove_file(&depths(dir.path())[7]).unwrap();
    for ending in ["color.png", "depth.png", "pose.txt"] {
        let [from, to] = [0, 9].map(|i| dir.path().join(format!("room/frame-{i:06}.{ending}")));
        std::fs::copy(from, to).unwrap();
    }
    std::fs::remove_file(dir.path().join("room/frame-000003.color.png")).unwrap();
    let (_, said) = outputs(
        dir.path(),
        &["capture", "room", "-o", "room.ldi", "--no-registration"],
    );
    assert!(
        said.contains("warning: views with the same pose: frame-000000.color.png"),
        "{said}"
    );
    let (_, said) = outputs(dir.path(), &["images", "room"]);
    for expected in [
        "left out 1 of 9 frames: frame-000003.pose.txt (room/frame-000003.color.png: cannot be read",
        "no pixel has a valid depth (all are zero or not numbers): frame-000001.color.png",
        "without depth: frame-000007.color.png",
        "views with the same pose: frame-000000.color.png and frame-000009.color.png",
    ] {
        assert!(said.contains(expected), "{said}");
    }
}

/// Cameras that move sideways along a wall two metres away, whose depth is eight times too large:
/// depths agree, colours do not. Every command says so, and no camera is estimated from it.
#[test]
fn doubtful_unit_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join("wall").join(name);
    std::fs::create_dir(at("")).unwrap();
    let save_depth = |millimetres: u16| {
        let depth = ImageBuffer::from_pixel(96, 96, Luma([millimetres]));
        depth.save(at("depth.png")).unwrap();
    };
    let frames: Vec<serde_json::Value> = (0..5)
        .map(|i| {
            let eye = 0.2 * f64::from(i);
            let color = |x: u32, y: u32| {
                let [x, y] = [x, y].map(|at| (f64::from(at) - 47.5) / 60.0 * 2.0);
                let level = |v: f64| (127.0 + 100.0 * v.sin()) as u8;
                Rgb([
                    level(8.0 * (x + eye)),
                    level(9.0 * y),
                    level(5.0 * (x + eye)),
                ])
            };
            let name = format!("{i}.png");
            RgbImage::from_fn(96, 96, color).save(at(&name)).unwrap();
            let pose = [
                [1.0, 0.0, 0.0, eye],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
            ];
            serde_json::json!({
                "file_path": name, "depth_file_path": "depth.png", "transform_matrix": pose,
            })
        })
        .collect();
    let set = serde_json::json!({"w": 96, "h": 96, "fl_x": 60, "frames": frames});
    std::fs::write(at("transforms.json"), set.to_string()).unwrap();
    let render = ["render", "wall", "-o", "a.png", "--size", "64x48"];
    let geometry = ["--variant", "geometry-single"];
    for (depth, is_wrong) in [(2000, false), (16_000, true)] {
        save_depth(depth);
        for more in [geometry.as_slice(), &[]] {
            let (_, said) = outputs(dir.path(), &[render.as_slice(), more].concat());
            let is_told = said.contains("the factor 0.125: the unit of depth")
                && said.contains("colours are not registered");
            assert!(is_told == is_wrong, "{depth} mm: {said}");
        }
    }
}
