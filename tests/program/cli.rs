//! Promises of the command line: exit codes, one clear message per error, JSON keys, complete files
//! or none.

use super::run::{fails, headbox, json, refused, succeeds};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A small capture of the bump scene.
const CAPTURE: [&str; 10] = [
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

fn capture(folder: &Path, more: &[&str]) -> String {
    succeeds(folder, &[CAPTURE.as_slice(), more].concat())
}

#[test]
fn wrong_usage_exits_2_and_names_allowed_values() {
    let dir = tempfile::tempdir().unwrap();
    let usage = |more: &[&str], expected: &str| {
        let message = refused(
            dir.path(),
            2,
            &[CAPTURE.as_slice(), &["-o", "x.ldi"], more].concat(),
        );
        assert!(message.contains(expected), "{more:?}: {message}");
    };
    usage(&["--center", "nan,0,0"], "three finite numbers");
    usage(&["--center", "1,2"], "three finite numbers");
    usage(&["--half-size", "0"], "greater than 0");
    usage(&["--half-size", "-1"], "greater than 0");
    usage(&["--novelty", "2"], "from 0 to 1");
    usage(&["--shard", "5/4"], "I/N");
    usage(&["--split", "-3"], "auto, none");
    for error in ["-1", "nan", "inf", "1e9"] {
        usage(
            &["--error-px", error],
            "a number of frame pixels from 0 to 1000000",
        );
    }
    let range = |name: &str, value: &str, expected: &str| {
        let message = refused(
            dir.path(),
            2,
            &["capture", "builtin:bump", "-o", "x.ldi", name, value],
        );
        assert!(message.contains(expected), "{name} {value}: {message}");
    };
    range("--face-size", "0", "from 1 to 8192");
    range("--face-size", "100000", "from 1 to 8192");
    range("--strata", "0", "1..=128");
    range("--rays", "0", "1..=1048576");
    range("--memory", "1", "64..=");
    assert_eq!(
        std::fs::read_dir(dir.path()).unwrap().count(),
        0,
        "nothing was written"
    );
    let message = refused(
        dir.path(),
        2,
        &["truth", "builtin:bump", "-o", "t.png", "--fov", "180"],
    );
    assert!(message.contains("between 0.1 and 179"), "{message}");
    refused(dir.path(), 2, &["no-such-command"]);
}

#[test]
fn bad_outputs_are_refused_before_any_work() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), &["-o", "a.ldi"]);
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write(
        "one.obj",
        "mtllib one.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n",
    );
    write("one.mtl", "newmtl a\nmap_Kd one.png\n");
    let picture = image::RgbImage::from_pixel(2, 2, image::Rgb([9, 8, 7]));
    picture.save(dir.path().join("one.png")).unwrap();
    let before = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    let all = || ["a.ldi", "one.obj", "one.mtl", "one.png"].map(before);
    let untouched = all();
    let refused = |code: i32, arguments: &[&str], expected: &str| {
        let message = refused(dir.path(), code, arguments);
        assert!(message.contains(expected), "{arguments:?}: {message}");
        assert!(all() == untouched, "{arguments:?} harmed a file");
    };
    refused(
        2,
        &["render", "a.ldi", "-o", "a.ldi"],
        "input of this command",
    );
    refused(2, &["render", "a.ldi", "-o", "x.gif"], ".png, .jpg");
    refused(
        2,
        &["render", "a.ldi", "-o", "-", "--json"],
        "leave one out",
    );
    refused(
        2,
        &["render", "a.ldi", "-o", "x.png", "--coverage", "x.png"],
        "two outputs",
    );
    refused(
        2,
        &["capture", "one.obj", "-o", "one.obj"],
        "input of this command",
    );
    refused(2, &["capture", "one.obj", "-o", "x.shard"], "--shard");
    refused(
        2,
        &["truth", "one.obj", "-o", "one.png", "--samples", "1"],
        "input of this command",
    );
    refused(
        2,
        &["compare", "one.png", "one.png", "--map", "one.png"],
        "input of this command",
    );
    refused(
        2,
        &["sprite", "one.obj", "-o", "one.obj"],
        "input of this command",
    );
    refused(
        1,
        &["render", "a.ldi", "-o", "one.obj/x.png"],
        "one.obj/x.png",
    );
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 4);
    for name in ["new/x.jpg", "x.webp", "x.TIF"] {
        succeeds(
            dir.path(),
            &["render", "a.ldi", "-o", name, "--size", "16x12"],
        );
        let found = image::ImageReader::open(dir.path().join(name))
            .unwrap()
            .with_guessed_format()
            .unwrap();
        assert_eq!(
            found.format(),
            image::ImageFormat::from_path(name).ok(),
            "{name}"
        );
    }
    let output = headbox(
        dir.path(),
        &["render", "a.ldi", "-o", "-", "--size", "16x12"],
    );
    assert!(
        output.stdout.starts_with(b"\x89PNG") && image::load_from_memory(&output.stdout).is_ok()
    );
    assert!(
        String::from_utf8(output.stderr).unwrap().contains(" ms"),
        "the words go to standard error"
    );
}

#[test]
fn nonsense_gives_error_or_warning() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), &["-o", "a.ldi"]);
    let warns = |more: &[&str], expected: &str| {
        let output = headbox(
            dir.path(),
            &[
                ["render", "a.ldi", "-o", "x.png", "--size", "16x12"].as_slice(),
                more,
            ]
            .concat(),
        );
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(
            output.status.success() && said.contains(expected),
            "{more:?}: {said}"
        );
    };
    warns(&["--eye", "0,0,90"], "outside the headbox");
    warns(
        &["--eye", "0,0,0", "--look-at", "0,-1,0"],
        "along the up vector",
    );
    warns(
        &["--eye", "0,0,0", "--up-vector", "0,0,1"],
        "along the up vector",
    );
    let message = refused(
        dir.path(),
        2,
        &[CAPTURE.as_slice(), &["-o", "x.ldi", "--center", "1e30,0,0"]].concat(),
    );
    assert!(message.contains("so far from the scene"), "{message}");
    let mut longer = std::fs::read(dir.path().join("a.ldi")).unwrap();
    longer.extend(b"junk");
    std::fs::write(dir.path().join("long.ldi"), longer).unwrap();
    let message = refused(dir.path(), 1, &["info", "long.ldi"]);
    assert!(message.contains("found 4 more bytes"), "{message}");
}

#[test]
fn missing_and_wrong_files_exit_1_and_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    let message = refused(dir.path(), 1, &["capture", "nowhere.obj", "-o", "x.ldi"]);
    assert!(message.contains("nowhere.obj"), "{message}");
    let message = refused(
        dir.path(),
        1,
        &["capture", "builtin:nothing", "-o", "x.ldi"],
    );
    assert!(
        message.contains("nothing") && message.contains("tree"),
        "{message}"
    );
    write("empty.obj", b"# no faces\n");
    let message = refused(dir.path(), 1, &["capture", "empty.obj", "-o", "x.ldi"]);
    assert!(message.contains("empty.obj"), "{message}");
    write("text.ldi", b"this is not an LDI");
    for command in [
        ["info", "text.ldi"].as_slice(),
        &["render", "text.ldi", "-o", "x.png"],
    ] {
        let message = refused(dir.path(), 1, command);
        assert!(
            message.contains("text.ldi") && message.contains("not a headbox file"),
            "{message}"
        );
    }
    let message = refused(dir.path(), 1, &["compare", "a.png", "b.png"]);
    assert!(message.contains("a.png"), "{message}");
    let message = refused(dir.path(), 1, &["merge", "text.ldi", "-o", "x.ldi"]);
    assert!(message.contains("text.ldi"), "{message}");
    assert!(!dir.path().join("x.ldi").exists());
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
        noisy.contains("dB (PSNR); comparisons cannot exceed it"),
        "{noisy}"
    );
    // An image of only the sky has no noise.
    let clean = truth(&["--samples", "4", "--eye", "0,50,0", "--look-at", "0,100,1"]);
    assert!(
        clean.contains("(PSNR)") && !clean.contains("comparisons"),
        "{clean}"
    );
}

#[cfg(unix)]
#[test]
fn waiting_for_pipe_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let pipe = dir.path().join("pipe.obj");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let writer = std::thread::spawn(move || std::fs::write(pipe, "v 0 0 0\n"));
    let message = refused(dir.path(), 1, &["capture", "pipe.obj", "-o", "x.ldi"]);
    assert!(
        message.starts_with("note: pipe.obj is a pipe; waiting for what is written to it"),
        "{message}"
    );
    writer.join().unwrap().unwrap();
}

#[test]
fn a_damaged_capture_is_refused_and_named() {
    let dir = tempfile::tempdir().unwrap();
    capture(dir.path(), &["-o", "a.ldi"]);
    let good = std::fs::read(dir.path().join("a.ldi")).unwrap();
    let refused = |bytes: &[u8], expected: &str| {
        std::fs::write(dir.path().join("b.ldi"), bytes).unwrap();
        let message = refused(dir.path(), 1, &["info", "b.ldi", "--check"]);
        assert!(
            message.contains("b.ldi") && message.contains(expected),
            "{message}"
        );
    };
    refused(&good[..good.len() / 2], "truncated");
    refused(&good[..20], "header");
    let flipped = |at: usize| {
        let mut bytes = good.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    refused(&flipped(13), "version");
    refused(&flipped(good.len() - 40), "checksum");
    refused(&flipped(16), "section table");
    assert!(succeeds(dir.path(), &["info", "a.ldi", "--check"]).contains("ok"));
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
fn every_command_prints_json() {
    let dir = tempfile::tempdir().unwrap();
    let captured: serde_json::Value =
        serde_json::from_str(&capture(dir.path(), &["-o", "a.ldi", "--json"])).unwrap();
    for key in [
        "rays",
        "rays_per_s",
        "trace_s",
        "total_s",
        "peak_rss_mb",
        "depth_pixels",
        "missing_estimate",
    ] {
        assert!(captured[key].is_number(), "capture: {key}");
    }
    let info = json(dir.path(), &["info", "a.ldi", "--json"]);
    assert_eq!(info["ok"], true);
    assert_eq!(info["depth_pixels"], captured["depth_pixels"]);
    assert_eq!(
        info["bytes"],
        std::fs::metadata(dir.path().join("a.ldi")).unwrap().len()
    );
    assert!(info["faces"].is_array() && info["kind"] == "cube LDI");
    let size = ["--size", "64x48"];
    let rendered = json(
        dir.path(),
        &[
            ["render", "a.ldi", "-o", "r.png", "--repeat", "3", "--json"].as_slice(),
            &size,
        ]
        .concat(),
    );
    for key in [
        "ms_median",
        "depth_pixels_in",
        "splatted",
        "hole_fraction",
        "threads",
    ] {
        assert!(rendered[key].is_number(), "render: {key}");
    }
    assert!(rendered["ms"].as_array().unwrap().len() == 3 && rendered["stages"].is_object());
    json(
        dir.path(),
        &[
            [
                "truth",
                "builtin:bump",
                "-o",
                "t.png",
                "--samples",
                "8",
                "--json",
            ]
            .as_slice(),
            &size,
        ]
        .concat(),
    );
    let compared = json(
        dir.path(),
        &["compare", "t.png", "r.png", "--map", "m.png", "--json"],
    );
    for key in ["flip", "psnr_db", "ssim", "differing_fraction"] {
        assert!(compared[key].is_number(), "compare: {key}");
    }
    assert!(
        compared["psnr_db"].as_f64().unwrap() > 18.0,
        "a coarse capture still looks like its scene: {compared}"
    );
    let same = json(dir.path(), &["compare", "t.png", "t.png", "--json"]);
    assert!(same["psnr_db"].is_null() && same["flip"] == 0.0 && same["differing_fraction"] == 0.0);
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

/// Linux only: elsewhere a display needs no environment variables, and a window would open.
#[cfg(all(feature = "viewer", target_os = "linux"))]
#[test]
fn window_without_display_exits_1_with_one_message() {
    let dir = tempfile::tempdir().unwrap();
    let view = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_headbox"));
        command
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET");
        let output = command
            .arg("view")
            .args(arguments)
            .current_dir(dir.path())
            .output()
            .unwrap();
        (
            output.status.code(),
            String::from_utf8(output.stderr).unwrap(),
        )
    };
    let (code, message) = view(&[]);
    assert!(
        code == Some(1) && message.lines().count() == 1 && message.contains("no display"),
        "{code:?}: {message}"
    );
    assert!(message.contains("headbox render"), "{message}");
    let capture =
        "capture builtin:bump -o a.ldi --face-size 8 --strata 2 --rays 2 --light-samples 0";
    let captured = Command::new(env!("CARGO_BIN_EXE_headbox"))
        .args(capture.split(' '))
        .current_dir(dir.path())
        .status();
    assert!(captured.unwrap().success());
    let (code, message) = view(&["a.ldi"]);
    let page = "headbox export a.ldi -o a.html";
    assert!(
        code == Some(1) && message.lines().count() == 1 && message.contains(page),
        "{code:?}: {message}"
    );
    // Opened completely before the window is.
    let (code, message) = view(&["a.ldi", "a.ldi", "builtin:bump@at=0,0,-3"]);
    assert!(
        code == Some(1) && message.contains("no display"),
        "{code:?}: {message}"
    );
    let (code, message) = view(&["nothing.ldi"]);
    assert!(
        code == Some(1) && message.contains("nothing.ldi"),
        "{code:?}: {message}"
    );
    assert_eq!(
        view(&["--frames", "3"]).0,
        Some(2),
        "a script needs something to show"
    );
}

#[test]
fn closed_pipe_ends_program_quietly() {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let output = Command::new(env!("CARGO_BIN_EXE_headbox"))
        .arg("scenes")
        .stdout(writer)
        .stderr(Stdio::piped())
        .spawn()
        .and_then(Child::wait_with_output)
        .expect("the program runs");
    assert_eq!(
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stderr).as_ref()
        ),
        (Some(1), "")
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

#[test]
fn memory_limit_refuses_files_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("a.mtl", "newmtl m\nmap_Kd large.png\n");
    write(
        "a.obj",
        "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n",
    );
    // 16 MiB of pixels, and four times as many as a texture.
    let image = image::GrayImage::new(4096, 4096);
    image.save(dir.path().join("large.png")).unwrap();
    let command = "truth a.obj -o o.png --size 8x8 --samples 1 --memory";
    let arguments = |limit| command.split(' ').chain([limit]).collect::<Vec<_>>();
    fails(
        dir.path(),
        1,
        &arguments("64"),
        "a.obj: large.png needs at least 80 MiB of memory",
    );
    assert!(!dir.path().join("o.png").exists());
    succeeds(dir.path(), &arguments("4096"));

    // As large as a texture, but a sprite has more for each pixel.
    let sprite = "sprite --color large.png --depth large.png --depth-kind eye -o o.sprite --memory";
    fails(
        dir.path(),
        1,
        &sprite.split(' ').chain(["512"]).collect::<Vec<_>>(),
        "large.png and large.png: making a sprite needs at least 768 MiB of memory",
    );
}

/// Files whose headers state sizes that they do not have: a frame of a GIF that is larger than the
/// image, and a sky.
#[test]
fn decoders_allocate_no_more_than_the_limit() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    write("a.mtl", b"newmtl m\nmap_Kd large.gif\n");
    write(
        "a.obj",
        b"mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n",
    );
    let size = 30_000u16.to_le_bytes();
    let mut gif = b"GIF89a\x01\0\x01\0\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0".to_vec();
    gif.extend([size, size].concat());
    gif.extend(b"\0\x02\x02D\x01\0;");
    write("large.gif", &gif);
    let command = "-o o.png --size 8x8 --samples 1 --memory 256";
    let refuses = |scene: &[&str], message: &str| {
        let arguments = [&["truth"], scene, &command.split(' ').collect::<Vec<_>>()].concat();
        fails(dir.path(), 1, &arguments, message);
    };
    refuses(&["a.obj"], "a.obj: large.gif needs at least");

    let sky = "truth builtin:bump -o sky.exr --size 16x8 --samples 1";
    succeeds(dir.path(), &sky.split(' ').collect::<Vec<_>>());
    let mut exr = std::fs::read(dir.path().join("sky.exr")).unwrap();
    let corners = [0i32, 0, 16_383, 16_383].map(i32::to_le_bytes);
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let found = exr.windows(name.len()).position(|bytes| bytes == name);
        let window = found.unwrap() + name.len() + 4;
        exr[window..window + 16].copy_from_slice(&corners.concat());
    }
    write("large.exr", &exr);
    refuses(
        &["builtin:bump", "--sky", "large.exr"],
        "large.exr: needs at least 3072 MiB of memory",
    );
}

/// 300,000 triangles without common corners: each kind of file is refused by the first part of it
/// that does not fit.
#[test]
fn meshes_are_within_the_memory_limit() {
    const TRIANGLES: u32 = 300_000;
    let dir = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    // Each triangle has three vertices of its own: their positions are shared, not their normals.
    let mut flat = "v 0 0 0\nv 1 0 0\nv 0 0 1\n".to_owned();
    let mut stl = vec![0; 80];
    stl.extend(TRIANGLES.to_le_bytes());
    for i in 0..TRIANGLES {
        obj += &format!("v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nf -1 -2 -3\n");
        flat += &format!("vn 0 1 {i}\nf 1//-1 2//-1 3//-1\n");
        let x = i as f32;
        let record = [0.0, 0.0, 0.0, x, 0.0, 0.0, x, 1.0, 0.0, x, 0.0, 1.0];
        stl.extend(record.iter().flat_map(|value: &f32| value.to_le_bytes()));
        stl.extend([0, 0]);
    }
    std::fs::write(dir.path().join("a.obj"), obj).unwrap();
    std::fs::write(dir.path().join("flat.obj"), flat).unwrap();
    std::fs::write(dir.path().join("a.stl"), stl).unwrap();
    let truth = |file: &'static str, limit: &'static str| {
        let command = "-o o.png --size 8x8 --samples 1 --bounces 0 --memory";
        let words = command.split(' ').chain([limit]);
        ["truth", file].into_iter().chain(words).collect::<Vec<_>>()
    };
    for (file, limit, message) in [
        ("a.obj", "64", "a.obj: its mesh needs at least 56 MiB"),
        ("a.obj", "128", "a.obj: its mesh needs at least 110 MiB"),
        (
            "flat.obj",
            "128",
            "flat.obj: its mesh needs at least 114 MiB",
        ),
        ("a.stl", "64", "a.stl: its mesh needs at least"),
        ("a.stl", "128", "a.stl: tracing it needs at least 58 MiB"),
    ] {
        fails(dir.path(), 1, &truth(file, limit), message);
    }
    succeeds(dir.path(), &truth("a.stl", "256"));
}

/// Takes 54 MiB; 69 if the allocator keeps freed memory.
#[test]
fn captures_keep_the_memory_limit_or_are_refused() {
    const LIMIT_MIB: &str = "64";
    let dir = tempfile::tempdir().unwrap();
    let command = "capture builtin:interior --strata 6 --rays 4 --light-samples 1";
    let arguments =
        |more: [&'static str; 4]| [command.split(' ').collect(), more.to_vec()].concat();
    let kept = arguments(["-o", "kept.ldi", "--face-size", "176"]);
    let limit = ["--memory", LIMIT_MIB, "--threads", "8"];
    let printed = json(dir.path(), &[&kept[..], &limit, &["--json"]].concat());
    let peak = printed["peak_rss_mb"].as_f64().unwrap();
    assert!(peak < LIMIT_MIB.parse().unwrap(), "{peak} MiB");
    succeeds(
        dir.path(),
        &arguments(["-o", "free.ldi", "--face-size", "176"]),
    );
    let bytes = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    assert!(bytes("kept.ldi") == bytes("free.ldi"));

    let refused = arguments(["-o", "refused.ldi", "--face-size", "256"]);
    let message = "--memory 64: loading the scene and capturing it take about";
    fails(dir.path(), 2, &[&refused[..], &limit].concat(), message);
    assert!(!dir.path().join("refused.ldi").exists());

    let shard =
        "capture builtin:interior --face-size 400 --strata 1 --rays 1 --shard 1/1 -o a.shard";
    succeeds(dir.path(), &shard.split(' ').collect::<Vec<_>>());
    let merge = ["merge", "a.shard", "-o", "refused.ldi"];
    fails(dir.path(), 2, &[&merge[..], &limit].concat(), message);
    assert!(!dir.path().join("refused.ldi").exists());
}
