//! Captures of scenes on the command line: shards, paths, truth, and what `info` says of them.

use crate::run::{headbox, json, refused, succeeds};
use std::path::Path;

/// A small capture of the bump scene.
pub(crate) const CAPTURE: [&str; 10] = [
    "capture",
    "builtin:bump",
    "--face-size",
    "48",
    "--strata",
    "6",
    "--rays",
    "4",
    "--light-samples",
    "1",
];

pub(crate) fn capture(folder: &Path, more: &[&str]) -> String {
    succeeds(folder, &[CAPTURE.as_slice(), more].concat())
}

#[test]
fn truth_reports_its_noise() {
    let dir = tempfile::tempdir().unwrap();
    let truth = |more: &[&str]| {
        let usual = [
            "truth",
            "builtin:miniature",
            "-o",
            "t.png",
            "--size",
            "32x24",
        ];
        succeeds(dir.path(), &[usual.as_slice(), more].concat())
    };
    let noisy = truth(&["--samples", "1"]);
    assert!(
        noisy.contains("dB (PSNR); smaller errors cannot be measured against it"),
        "{noisy}"
    );
    // An image of only the sky has no noise.
    let clean = truth(&["--samples", "4", "--eye", "0,50,0", "--look-at", "0,100,1"]);
    assert!(
        clean.contains("(PSNR)") && !clean.contains("comparisons"),
        "{clean}"
    );
}

#[test]
fn info_says_why_rooms_are_not_split() {
    let dir = tempfile::tempdir().unwrap();
    let info = |split: &str| {
        let command = "capture builtin:interior -o room.ldi --face-size 64 --strata 4 --rays 4 --light-samples 0";
        let arguments: Vec<&str> = command.split(' ').chain(["--split", split]).collect();
        succeeds(dir.path(), &arguments);
        succeeds(dir.path(), &["info", "room.ldi"])
    };
    let why = "not split near and far";
    let told = info("auto");
    assert!(told.contains("  planes ") && told.contains(why), "{told}");
    assert!(!info("1.5").contains(why));
}

#[test]
fn a_path_gives_a_frame_per_pose_and_their_times() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), &["-o", "a.ldi"]);
    let poses = r#"[{"eye": [0, 0, 0], "look_at": [0, 0, -1], "size": [20, 10]},
                    {"eye": [0.01, 0, 0], "look_at": [0, 0, -1], "size": [20, 10]}]"#;
    std::fs::write(dir.path().join("path.json"), poses).unwrap();
    succeeds(
        dir.path(),
        &["render", "a.ldi", "--path", "path.json", "-o", "frames"],
    );
    for name in ["frame_0000.png", "frame_0001.png"] {
        assert_eq!(
            image::image_dimensions(dir.path().join("frames").join(name)).unwrap(),
            (20, 10)
        );
    }
    let csv = std::fs::read_to_string(dir.path().join("frames/times.csv")).unwrap();
    assert_eq!(csv.lines().count(), 3);
}

#[test]
fn truth_faces_direction_with_most_to_see() {
    let dir = tempfile::tempdir().unwrap();
    let wall = "# Y up, metres\nv 5 -3 -3\nv 5 3 -3\nv 5 3 3\nv 5 -3 3\nf 1 2 3 4\n";
    std::fs::write(dir.path().join("wall.obj"), wall).unwrap();
    // No single direction shows the wall to both eyes.
    for eye in ["1,0,0", "9,0,0"] {
        let arguments = [
            "truth",
            "wall.obj",
            "--unlit",
            "--exposure",
            "0",
            "--eye",
            eye,
            "--size",
            "8x8",
            "--samples",
            "2",
            "-o",
            "a.png",
        ];
        succeeds(dir.path(), &arguments);
        let picture = image::open(dir.path().join("a.png")).unwrap().to_rgb8();
        let [r, g, b] = picture.get_pixel(4, 4).0;
        assert!(
            r == g && g == b,
            "grey as the wall, not blue as the sky: {r} {g} {b}"
        );
    }
}

#[test]
fn shards_merge_to_the_same_file() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), &["-o", "whole.ldi"]);
    for part in ["1/3", "2/3", "3/3"] {
        capture(
            dir.path(),
            &["--shard", part, "-o", &format!("{}.shard", &part[..1])],
        );
    }
    let message = refused(
        dir.path(),
        1,
        &["merge", "1.shard", "3.shard", "-o", "merged.ldi"],
    );
    assert!(message.contains("missing: 2/3"), "{message}");
    succeeds(
        dir.path(),
        &["merge", "3.shard", "1.shard", "2.shard", "-o", "merged.ldi"],
    );
    let read = |name| std::fs::read(dir.path().join(name)).unwrap();
    assert!(read("whole.ldi") == read("merged.ldi"));
    assert_eq!(
        json(dir.path(), &["info", "1.shard", "--check", "--json"])["ok"],
        true
    );
}

#[test]
fn blocked_headbox_is_captured_with_warning() {
    let dir = tempfile::tempdir().unwrap();
    let size = [
        "--face-size",
        "32",
        "--strata",
        "4",
        "--rays",
        "4",
        "--light-samples",
        "1",
    ];
    let arguments = [
        [
            "capture",
            "builtin:interior",
            "--half-size",
            "2.5",
            "-o",
            "a.ldi",
        ]
        .as_slice(),
        &size,
    ]
    .concat();
    let output = headbox(dir.path(), &arguments);
    assert!(output.status.success());
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(
        warning.contains("warning: geometry inside the headbox hides"),
        "{warning}"
    );
}

/// The library, the command and the window's last round (tested there) give the same capture.
#[test]
fn command_and_library_capture_the_same_bytes() {
    /// A floor and a box in the open, without a suggested headbox.
    const OPEN_SCENE: &str = "v -9 0 -9\nv 9 0 -9\nv 9 0 9\nv -9 0 9\n\
        v -3 0 -4\nv 3 0 -4\nv 3 4 -4\nv -3 4 -4\n\
        f 1 4 3\nf 1 3 2\nf 5 6 7\nf 5 7 8\n";
    let dir = tempfile::tempdir().unwrap();
    let open_scene = dir.path().join("open.obj");
    std::fs::write(&open_scene, OPEN_SCENE).unwrap();
    for name in ["builtin:miniature", open_scene.to_str().unwrap()] {
        let arguments = [
            "capture",
            name,
            "-o",
            "command.ldi",
            "--face-size",
            "64",
            "--strata",
            "5",
            "--rays",
            "4",
            "--light-samples",
            "1",
            "--holes",
            "1e-3",
        ];
        succeeds(dir.path(), &arguments);
        let scene = headbox::Scene::open(name).unwrap();
        let capture = headbox::Capture::new(&scene)
            .face_size(64)
            .strata(5)
            .rays(4);
        let cube = capture.light_samples(1).holes(1e-3).run().unwrap();
        let by_library = dir.path().join("library.ldi");
        cube.write(&by_library).unwrap();
        let bytes = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
        assert!(bytes("command.ldi") == bytes("library.ldi"), "{name}");
    }
}
