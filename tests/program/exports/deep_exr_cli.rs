//! Deep EXR files: their pixels make the frame, and they are captured again.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use super::export_cli::{FACE_PX, capture};
use crate::run::{fails, json, succeeds};
use headbox_core::color::linear_from_srgb8;
use headbox_images::deep_exr::{DeepCompression, DeepImage, DeepView};
use std::path::Path;

/// Renders the frame of the face -Z: linear red, green, blue of each pixel.
fn face_frame(folder: &Path) -> Vec<[f32; 3]> {
    let info = json(folder, &["info", "a.ldi", "--json"]);
    let centre: Vec<f64> = info["center"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c.as_f64().unwrap())
        .collect();
    let text = |p: [f64; 3]| p.map(|c| c.to_string()).join(",");
    let (eye, at) = (
        text([centre[0], centre[1], centre[2]]),
        text([centre[0], centre[1], centre[2] - 1.0]),
    );
    let size = format!("{FACE_PX}x{FACE_PX}");
    succeeds(
        folder,
        &[
            "render",
            "a.ldi",
            "-o",
            "z.png",
            "--eye",
            &eye,
            "--look-at",
            &at,
            "--fov",
            "90",
            "--size",
            &size,
        ],
    );
    let frame = image::open(folder.join("z.png")).unwrap().to_rgb8();
    frame
        .pixels()
        .map(|pixel| pixel.0.map(linear_from_srgb8))
        .collect()
}

/// Share of pixels that differ from the frame by more than 0.08: rims, where the renderer
/// distributes samples over neighbours.
fn share_off(found: impl Iterator<Item = [f32; 4]>, frame: &[[f32; 3]]) -> f64 {
    let off = found
        .zip(frame)
        .filter(|(found, frame)| (0..3).any(|i| (found[i] - frame[i]).abs() > 0.08))
        .count();
    off as f64 / frame.len() as f64
}

#[test]
fn deep_pixels_and_flat_layers_make_the_frame() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path());
    let frame = face_frame(dir.path());
    let told = json(dir.path(), &["export", "a.ldi", "-o", "deep.exr", "--json"]);
    assert_eq!(told["size"], serde_json::json!([FACE_PX, 6 * FACE_PX]));
    let all = DeepImage::read(&dir.path().join("deep.exr")).unwrap();
    assert!(
        all.view.cube && told["samples"].as_u64() == Some(u64::from(*all.offsets.last().unwrap()))
    );
    let depths = all.channel("Z").unwrap();
    for pixel in all
        .offsets
        .windows(2)
        .map(|ends| &depths[ends[0] as usize..ends[1] as usize])
    {
        assert!(
            pixel.windows(2).all(|pair| pair[0] < pair[1]),
            "tidy: {pixel:?}"
        );
    }
    let pixels = || (0..FACE_PX).flat_map(|y| (0..FACE_PX).map(move |x| (x, y)));
    let below = pixels().map(|(x, y)| DeepImage::composite(&[&all], x, y + 5 * FACE_PX));
    let off = share_off(below, &frame);
    assert!(off < 0.07, "{off}");
    for (flag, value) in [("--quality", "good"), ("--rays", "3"), ("--exposure", "1")] {
        let said = format!("{flag} has no meaning for a deep picture; leave it out");
        fails(
            dir.path(),
            2,
            &["capture", "deep.exr", "-o", "x.ldi", flag, value],
            &said,
        );
    }

    succeeds(
        dir.path(),
        &["export", "a.ldi", "-o", "face.exr", "--face", "-Z"],
    );
    let face = DeepImage::read(&dir.path().join("face.exr")).unwrap();
    assert_eq!(face.size_px, [FACE_PX, FACE_PX]);
    assert!(
        !face.view.cube && face.view.world_to_camera.is_some() && face.view.world_to_ndc.is_some()
    );
    for (x, y) in pixels() {
        assert_eq!(
            DeepImage::composite(&[&face], x, y),
            DeepImage::composite(&[&all], x, y + 5 * FACE_PX)
        );
    }

    succeeds(
        dir.path(),
        &[
            "export", "a.ldi", "-o", "flat.exr", "--face", "-z", "--layers", "3",
        ],
    );
    let flat = exr::prelude::read_all_flat_layers_from_file(dir.path().join("flat.exr")).unwrap();
    assert_eq!(flat.layer_data.len(), 3);
    let channel = |layer: usize, name: &str| {
        let list = &flat.layer_data[layer].channel_data.list;
        let found = list.iter().find(|channel| channel.name.eq(name)).unwrap();
        found.sample_data.values_as_f32().collect::<Vec<f32>>()
    };
    let layers: Vec<[Vec<f32>; 4]> = (0..3)
        .map(|layer| ["R", "G", "B", "A"].map(|name| channel(layer, name)))
        .collect();
    for (at, (x, y)) in pixels().enumerate() {
        let over = layers.iter().fold([0.0f32; 4], |over, layer| {
            std::array::from_fn(|i| over[i] + (1.0 - over[3]) * layer[i][at])
        });
        let expected = DeepImage::composite(&[&face], x, y);
        // Half-precision floats, at most five layered.
        assert!(
            (0..4).all(|i| (over[i] - expected[i]).abs() < 5e-3),
            "{x} {y}: {over:?} {expected:?}"
        );
    }
}

/// Deep EXR files are captured again with the same appearance.
#[test]
fn deep_pictures_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path());
    let info = json(dir.path(), &["info", "a.ldi", "--json"]);
    let centre: Vec<f64> = info["center"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c.as_f64().unwrap())
        .collect();
    let text = |p: [f64; 3]| p.map(|c| c.to_string()).join(",");
    let [x, y, z] = [centre[0], centre[1], centre[2]];
    succeeds(dir.path(), &["export", "a.ldi", "-o", "all.exr"]);
    succeeds(
        dir.path(),
        &["export", "a.ldi", "-o", "face.exr", "--face", "-Z"],
    );
    let half = info["half_size"].as_f64().unwrap().to_string();
    // An environment map has no position.
    let place = ["--center", &text([x, y, z]), "--half-size", &half];
    succeeds(
        dir.path(),
        &[["capture", "all.exr", "-o", "all.ldi"].as_slice(), &place].concat(),
    );
    succeeds(
        dir.path(),
        &[
            "capture",
            "face.exr",
            "-o",
            "face.ldi",
            "--half-size",
            &half,
        ],
    );
    // The same without a camera in the header, as many renderers write it.
    let bare = DeepImage {
        view: DeepView::default(),
        ..DeepImage::read(&dir.path().join("face.exr")).unwrap()
    };
    bare.write(&dir.path().join("bare.exr"), DeepCompression::Rle)
        .unwrap();
    fails(
        dir.path(),
        1,
        &["capture", "bare.exr", "-o", "x.ldi"],
        "give --fov, and --center and --look-at",
    );
    for (file, knows_camera) in [("all.exr", true), ("face.exr", true), ("bare.exr", false)] {
        let told = json(dir.path(), &["images", file, "--json"]);
        assert_eq!(told, json(dir.path(), &["info", file, "--json"]));
        assert_eq!(
            (&told["kind"], &told["knows_camera"]),
            (&"deep EXR".into(), &knows_camera.into()),
            "{told}"
        );
        assert!(
            told["depth"][0].as_f64() > Some(0.0) && told["samples"].as_u64() > Some(0),
            "{told}"
        );
    }
    succeeds(
        dir.path(),
        &[
            "export", "a.ldi", "-o", "flat.exr", "--face", "-Z", "--layers", "1",
        ],
    );
    fails(
        dir.path(),
        1,
        &["images", "flat.exr"],
        "flat.exr: the version: is that of a flat image",
    );
    succeeds(
        dir.path(),
        &[
            ["capture", "bare.exr", "-o", "bare.ldi", "--fov", "90"].as_slice(),
            &place,
        ]
        .concat(),
    );
    let twice = "--fov does not apply, because the header specifies the camera's field of view; leave it out";
    fails(
        dir.path(),
        1,
        &["capture", "face.exr", "-o", "x.ldi", "--fov", "90"],
        twice,
    );
    fails(
        dir.path(),
        1,
        &["capture", "bare.exr", "-o", "x.ldi", "--fov", "180"],
        "a vertical field of view of 180",
    );
    for (input, flag, value, kind) in [
        ("builtin:bump", "--fov", "90", "deep EXRs without a camera"),
        ("builtin:bump", "--agreement", "9", "folders of photographs"),
        (
            "builtin:bump",
            "--backdrop",
            "none",
            "folders of photographs",
        ),
        (
            "builtin:bump",
            "--depth-noise",
            "0.1",
            "folders of images with",
        ),
        ("face.exr", "--agreement", "9", "folders of photographs"),
    ] {
        fails(
            dir.path(),
            2,
            &["capture", input, "-o", "x.ldi", flag, value],
            &format!("{flag} is for {kind}"),
        );
    }
    let frame = |file: &str, eye: [f64; 3]| {
        let at = text([eye[0], eye[1], eye[2] - 1.0]);
        let camera = [
            "--eye",
            &text(eye),
            "--look-at",
            &at,
            "--fov",
            "60",
            "--size",
            "64x48",
        ];
        succeeds(
            dir.path(),
            &[["render", file, "-o", "frame.png"].as_slice(), &camera].concat(),
        );
        std::fs::rename(
            dir.path().join("frame.png"),
            dir.path().join(format!("{file}.png")),
        )
        .unwrap();
        format!("{file}.png")
    };
    for eye in [[x, y, z], [x + 0.05, y, z - 0.05]] {
        let expected = frame("a.ldi", eye);
        for file in ["all.ldi", "face.ldi", "bare.ldi"] {
            let found = json(
                dir.path(),
                &["compare", &expected, &frame(file, eye), "--json"],
            );
            let flip = found["flip"].as_f64().unwrap();
            assert!(flip < 0.05, "{file} from {eye:?}: FLIP {flip}");
        }
    }
    let told = json(dir.path(), &["info", "face.ldi", "--json"]);
    let found: Vec<f64> = told["center"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c.as_f64().unwrap())
        .collect();
    assert!(
        found.iter().zip(&centre).all(|(a, b)| (a - b).abs() < 1e-5),
        "{found:?} {centre:?}"
    );
    fails(
        dir.path(),
        1,
        &["capture", "face.ldi.exr", "-o", "b.ldi"],
        "face.ldi.exr",
    );
}

/// Deep images of other programs, without a camera in the header, reproduce their image from the
/// camera's position.
#[test]
fn deep_pictures_of_a_film_studio_are_captured() {
    let folder =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/openexr_deep/LowResLeftView");
    if !folder.exists() {
        return println!("skipped: there is no {}", folder.display());
    }
    let dir = tempfile::tempdir().unwrap();
    for name in ["Balls.exr", "Leaves.exr", "Trunks.exr"] {
        let deep = DeepImage::read(&folder.join(name)).unwrap();
        let [width, height] = deep.size_px;
        let file = folder.join(name).display().to_string();
        succeeds(
            dir.path(),
            &[
                "capture",
                &file,
                "-o",
                "a.ldi",
                "--fov",
                "40",
                "--error-px",
                "0",
            ],
        );
        let size = format!("{width}x{height}");
        let camera = [
            "--eye",
            "0,0,0",
            "--look-at",
            "0,0,-1",
            "--fov",
            "40",
            "--size",
            &size,
        ];
        succeeds(
            dir.path(),
            &[["render", "a.ldi", "-o", "a.png"].as_slice(), &camera].concat(),
        );
        let frame = image::open(dir.path().join("a.png")).unwrap().to_rgb8();
        // Only opaque pixels: the renderer fills a rim with the surface behind it.
        let (mut count, mut sum) = (0, 0.0);
        for (x, y, found) in frame.enumerate_pixels() {
            let expected = DeepImage::composite(&[&deep], x, y);
            if expected[3] > 0.98 {
                count += 1;
                sum += (0..3)
                    .map(|i| (linear_from_srgb8(found[i]) - expected[i].min(1.0)).abs())
                    .sum::<f32>()
                    / 3.0;
            }
        }
        let mean = sum / count as f32;
        assert!(
            count > 1000 && mean < 0.02,
            "{name}: {mean} over {count} pixels"
        );
    }
}
