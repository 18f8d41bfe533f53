//! Promises of the command line about exports: every format is read back by an independent reader.

use crate::run::{fails, json, succeeds};
use std::path::Path;

pub(super) const FACE_PX: u32 = 48;

/// A small capture, `a.ldi`.
pub(super) fn capture(folder: &Path) {
    let face = FACE_PX.to_string();
    let size = [
        "--face-size",
        &face,
        "--strata",
        "8",
        "--rays",
        "4",
        "--light-samples",
        "1",
        "--holes",
        "1",
    ];
    succeeds(
        folder,
        &[
            ["capture", "builtin:interior", "-o", "a.ldi"].as_slice(),
            &size,
        ]
        .concat(),
    );
}

#[test]
fn exports_are_whole_and_repeatable() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path());
    for name in ["a.ply", "a.glb", "a.html"] {
        succeeds(dir.path(), &["export", "a.ldi", "-o", name]);
    }
    succeeds(
        dir.path(),
        &["export", "a.ldi", "-o", "points.ply", "--points"],
    );
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    // Vertices of a PLY file, each `bytes` long.
    let vertices = |name: &str, bytes: usize| {
        let file = read(name);
        let end = b"end_header\n";
        let start = file
            .windows(end.len())
            .position(|window| window == end)
            .unwrap()
            + end.len();
        let head = String::from_utf8_lossy(&file[..start]).into_owned();
        let count = head
            .lines()
            .find_map(|line| line.strip_prefix("element vertex "))
            .unwrap();
        assert_eq!(
            file.len(),
            start + count.parse::<usize>().unwrap() * bytes,
            "{name}"
        );
        file[start..].to_vec()
    };
    let (points, splats) = (vertices("points.ply", 40), vertices("a.ply", 68));
    // Splats include the environment.
    assert!(points.len() / 40 < splats.len() / 68);
    let info = json(dir.path(), &["info", "a.ldi", "--json"]);
    for point in points.chunks(40) {
        for (axis, bytes) in point[..24].chunks(8).enumerate() {
            let centre = info["center"][axis].as_f64().unwrap();
            assert!((f64::from_le_bytes(bytes.try_into().unwrap()) - centre).abs() < 100.0);
        }
    }
    assert!(read("a.glb").starts_with(b"glTF") && read("a.html").starts_with(b"<!doctype html>"));
    // A second export has the same bytes.
    succeeds(dir.path(), &["export", "a.ldi", "-o", "b.glb"]);
    assert!(read("a.glb") == read("b.glb"));
    // A new capture has the same headbox, although a box with the sky surrounds the scene.
    succeeds(
        dir.path(),
        &[
            "capture",
            "a.glb",
            "-o",
            "again.ldi",
            "--face-size",
            "32",
            "--strata",
            "4",
            "--holes",
            "1",
        ],
    );
    let again = json(dir.path(), &["info", "again.ldi", "--json"]);
    for field in ["center", "half_size"] {
        assert_eq!(again[field], info[field], "{field}");
    }
}

#[test]
fn exports_meet_their_budgets() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path());
    let export = |output: &str, more: &[&str]| {
        let usual = ["export", "a.ldi", "-o", output, "--json"];
        json(dir.path(), &[usual.as_slice(), more].concat())
    };
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    let all = export("all.ply", &[]);
    let samples = all["samples"].as_u64().unwrap();
    assert_eq!(
        (all["points"].as_u64(), all["error_levels"].as_f64()),
        (Some(samples), Some(0.0))
    );
    export("more.ply", &["--gaussians", "1000000", "--mb", "1000"]);
    assert!(read("all.ply") == read("more.ply"));
    for divisor in [2, 10, 100] {
        let budget = (samples / divisor).to_string();
        let told = export("few.ply", &["--gaussians", &budget]);
        assert!(
            told["points"].as_u64().unwrap() <= samples / divisor,
            "{told}"
        );
        assert!(told["error_levels"].as_f64().unwrap() > 0.0, "{told}");
    }
    export("all.glb", &[]);
    let whole = read("all.glb").len();
    export("more.glb", &["--mb", "1000"]);
    assert!(read("all.glb") == read("more.glb"));
    for (output, share) in [("few.glb", 0.5), ("few.glb", 0.2), ("few.ply", 0.1)] {
        let megabytes = format!("{:.6}", whole as f64 * share / 1e6);
        let told = export(output, &["--mb", &megabytes]);
        let bytes = told["bytes"].as_f64().unwrap();
        assert!(bytes <= whole as f64 * share && bytes > 0.0, "{told}");
    }
    for (output, option, value, message) in [
        (
            "x.ply",
            "--gaussians",
            "0",
            "give a number of Gaussians, at least 1",
        ),
        (
            "x.glb",
            "--triangles",
            "0",
            "give a number of triangles, at least 2",
        ),
        ("x.ply", "--mb", "0", "give MB above 0"),
        (
            "x.exr",
            "--gaussians",
            "9",
            "--gaussians is for .glb and .ply files",
        ),
        (
            "x.html",
            "--mb",
            "9",
            "--mb is for .glb and .ply files; for a smaller page",
        ),
    ] {
        fails(
            dir.path(),
            2,
            &["export", "a.ldi", "-o", output, option, value],
            message,
        );
    }
    for output in ["x.ply", "x.glb"] {
        fails(
            dir.path(),
            1,
            &["export", "a.ldi", "-o", output, "--mb", "0.0001"],
            "the budget is too small: the smallest file has",
        );
        assert!(!dir.path().join(output).exists());
    }
}

#[test]
fn sprites_are_exported() {
    let dir = tempfile::tempdir().unwrap();
    let camera = [
        "--eye",
        "0,0,3",
        "--look-at",
        "0,0,0",
        "--fov",
        "50",
        "--size",
        "96x72",
        "--samples",
        "4",
        "--unlit",
    ];
    succeeds(
        dir.path(),
        &[
            ["sprite", "builtin:bump", "-o", "s.sprite"].as_slice(),
            &camera,
        ]
        .concat(),
    );
    for name in ["s.html", "s.glb", "s.exr"] {
        let told = json(dir.path(), &["export", "s.sprite", "-o", name, "--json"]);
        assert!(
            told["bytes"].as_u64().unwrap() > 1000 && told["sprites"] == 1,
            "{told}"
        );
    }
    // The page draws sprites, not the cube of the other formats.
    let page = std::fs::read_to_string(dir.path().join("s.html")).unwrap();
    assert!(page.contains(r#""kind":"sprite""#) && !page.contains(r#""kind":"samples""#));
}

#[test]
fn unsupported_export_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path());
    let whole = std::fs::read(dir.path().join("a.ldi")).unwrap();
    std::fs::write(dir.path().join("broken.ldi"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(dir.path().join("empty.ldi"), []).unwrap();
    for name in ["html", "glb", "ply", "exr"] {
        let output = format!("x.{name}");
        fails(
            dir.path(),
            1,
            &["export", "broken.ldi", "-o", &output],
            "broken.ldi",
        );
        fails(
            dir.path(),
            1,
            &["export", "empty.ldi", "-o", &output],
            "empty.ldi",
        );
        assert!(!dir.path().join(&output).exists());
    }
    fails(
        dir.path(),
        2,
        &["export", "a.ldi", "-o", "x.glb", "--layers", "2"],
        "--layers is for .exr files",
    );
    fails(
        dir.path(),
        2,
        &["export", "a.ldi", "-o", "x.html", "--face", "+X"],
        "--face is for .exr files",
    );
    fails(
        dir.path(),
        2,
        &["export", "a.ldi", "-o", "x.exr", "--face", "up"],
        "+X, -X, +Y, -Y, +Z or -Z",
    );
    fails(dir.path(), 2, &["export", "a.ldi", "-o", "x.spz"], ".ply");
    #[cfg(target_os = "linux")]
    for name in ["x.html", "x.glb", "x.exr", "x.ply"] {
        std::os::unix::fs::symlink("/dev/full", dir.path().join(name)).unwrap();
        fails(
            dir.path(),
            1,
            &["export", "a.ldi", "-o", name],
            "No space left on device",
        );
    }
}

#[test]
fn stereo_panoramas_cover_all_or_half_directions() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path());
    let size = |flags: &[&str]| {
        succeeds(
            dir.path(),
            &[
                ["render", "a.ldi", "-o", "p.png", "--size", "40x20"].as_slice(),
                flags,
            ]
            .concat(),
        );
        image::image_dimensions(dir.path().join("p.png")).unwrap()
    };
    assert_eq!(size(&["--panorama"]), (40, 20));
    assert_eq!(size(&["--panorama", "--stereo", "0.064"]), (40, 40));
    assert_eq!(size(&["--vr180"]), (40, 20));
    assert_eq!(size(&["--stereo", "0.064"]), (80, 20));
    fails(
        dir.path(),
        2,
        &["render", "a.ldi", "-o", "p.png", "--vr180", "--panorama"],
        "cannot be used with",
    );
    let pose = r#"{"camera_to_world": [1,0,0,0.2, 0,1,0,1.45, 0,0,1,0.9, 0,0,0,1], "fov": 50}"#;
    let path = format!(
        r#"{{"camera_path": [{pose}, {pose}], "render_height": 20, "render_width": 30, "fps": 24}}"#
    );
    std::fs::write(dir.path().join("nerfstudio.json"), path).unwrap();
    succeeds(
        dir.path(),
        &[
            "render",
            "a.ldi",
            "--path",
            "nerfstudio.json",
            "-o",
            "frames",
        ],
    );
    assert_eq!(
        image::image_dimensions(dir.path().join("frames/frame_0000.png")).unwrap(),
        (30, 20)
    );
    // The same view, smaller.
    succeeds(
        dir.path(),
        &[
            "render",
            "a.ldi",
            "--path",
            "nerfstudio.json",
            "-o",
            "small",
            "--size",
            "15x10",
        ],
    );
    let mean = |name: &str| {
        let frame = image::open(dir.path().join(name)).unwrap().to_rgb8();
        let (size, sum) = (
            frame.dimensions(),
            frame.iter().map(|c| f64::from(*c)).sum::<f64>(),
        );
        (size, sum / f64::from(3 * size.0 * size.1))
    };
    let [(_, large), (size, small)] = ["frames/frame_0000.png", "small/frame_0000.png"].map(mean);
    assert!(
        size == (15, 10) && (large - small).abs() < 6.0,
        "{size:?} {large} {small}"
    );
    let refused = "--fov has no meaning with --path, which says it; leave it out";
    fails(
        dir.path(),
        2,
        &[
            "render",
            "a.ldi",
            "--path",
            "nerfstudio.json",
            "-o",
            "x",
            "--fov",
            "50",
        ],
        refused,
    );
    let film = json(
        dir.path(),
        &[
            "render",
            "a.ldi",
            "--path",
            "nerfstudio.json",
            "-o",
            "f.gif",
            "--vr180",
            "--json",
        ],
    );
    assert_eq!(
        (&film["size"], film["fps"].as_u64()),
        (&serde_json::json!([40, 20]), Some(24))
    );
    fails(
        dir.path(),
        1,
        &["render", "a.ldi", "--path", "a.glb", "-o", "none"],
        "a.glb",
    );
}

/// Writes a small unlit house, `a.house`.
fn write_house(folder: &Path) {
    let arguments =
        "house builtin:house --triangles 2000 --rays 0 --unlit --backdrops none -o a.house";
    succeeds(folder, &arguments.split(' ').collect::<Vec<_>>());
}

#[test]
fn films_without_path_move_in_headbox_or_walk_through_house() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path());
    let film = |arguments: &[&str]| {
        let arguments = [&["render"], arguments, &["--size", "40x32", "--json"]].concat();
        json(dir.path(), &arguments)["frames"].as_u64().unwrap()
    };
    assert_eq!(film(&["a.ldi", "-o", "a.gif", "--fps", "2"]), 12);
    let file = std::fs::File::open(dir.path().join("a.gif")).unwrap();
    let decoder = image::codecs::gif::GifDecoder::new(std::io::BufReader::new(file)).unwrap();
    let frames = image::AnimationDecoder::into_frames(decoder);
    let frames: Vec<_> = frames.map(|frame| frame.unwrap().into_buffer()).collect();
    assert_ne!(frames[0], frames[6], "the two ends of the loop");
    let refused = |arguments: &[&str], expected| {
        fails(dir.path(), 2, &[&["render"], arguments].concat(), expected);
    };
    refused(
        &["a.ldi", "-o", "a.gif", "--eye", "99,0,0"],
        "leave out --eye",
    );
    refused(&["a.ldi", "-o", "a.gif", "--repeat", "3"], "not for a film");
    refused(
        &["a.ldi", "-o", "a.png", "--fps", "3"],
        "--fps is for films",
    );
    write_house(dir.path());
    let poses = film(&["a.house", "-o", "walk.gif", "--fps", "1"]);
    assert!((20..200).contains(&poses), "{poses} poses at 1.4 m/s");
    refused(
        &["a.house", "-o", "walk.gif", "--eye", "0,0,0"],
        "--eye has no meaning",
    );
}

/// Homes and lumigraphs can only be exported as pages, which are deterministic.
#[test]
fn homes_and_lumigraphs_export_only_as_pages() {
    let dir = tempfile::tempdir().unwrap();
    write_house(dir.path());
    let lumi = [
        "lumigraph",
        "builtin:bump",
        "--plane",
        "0,0,3",
        "--normal",
        "0,0,-1",
        "--extent",
        "1",
        "--size",
        "32x32",
    ];
    succeeds(
        dir.path(),
        &[
            lumi.as_slice(),
            &["--samples", "1", "--unlit", "-o", "a.lumi"],
        ]
        .concat(),
    );
    for (file, amount) in [("a.house", "triangles"), ("a.lumi", "images")] {
        let told = json(
            dir.path(),
            &["export", file, "-o", "a.html", "--title", "A < B", "--json"],
        );
        assert!(told[amount].as_u64().unwrap() > 0, "{told}");
        let page = std::fs::read_to_string(dir.path().join("a.html")).unwrap();
        assert!(page.starts_with("<!doctype html>") && page.contains("<title>A &lt; B</title>"));
        succeeds(
            dir.path(),
            &["export", file, "-o", "b.html", "--title", "A < B"],
        );
        assert!(
            page == std::fs::read_to_string(dir.path().join("b.html")).unwrap(),
            "{file}"
        );
        fails(
            dir.path(),
            1,
            &["export", file, "-o", "x.glb"],
            "is exported as .html alone",
        );
        assert!(!dir.path().join("x.glb").exists());
    }
}
