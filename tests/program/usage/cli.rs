//! Promises of the command line: exit codes, one clear message per error, JSON keys, complete files
//! or none.

use crate::capture::capture_cli::{CAPTURE, capture};
use crate::run::{headbox, json, outputs, refused, succeeds};
use std::process::{Child, Command, Stdio};

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
    refused(2, &["render", "a.ldi", "-o", "x.svg"], ".png, .jpg");
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
    write("page.html", b"<!doctype html>");
    let message = refused(dir.path(), 1, &["info", "page.html"]);
    assert!(message.contains("open it in a browser"), "{message}");
    let message = refused(dir.path(), 1, &["compare", "a.png", "b.png"]);
    assert!(message.contains("a.png"), "{message}");
    let message = refused(dir.path(), 1, &["merge", "text.ldi", "-o", "x.ldi"]);
    assert!(message.contains("text.ldi"), "{message}");
    assert!(!dir.path().join("x.ldi").exists());
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
    for key in ["depth_pixels", "center", "half_size"] {
        assert!(!captured[key].is_null(), "capture: {key}");
        assert_eq!(info[key], captured[key], "{key}");
    }
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
    for key in [
        "flip",
        "psnr_db",
        "ssim",
        "differing_fraction",
        "reference_standard_error_psnr_db",
    ] {
        assert!(compared[key].is_number(), "compare: {key}");
    }
    assert!(
        compared["psnr_db"].as_f64().unwrap() > 18.0,
        "a coarse capture still looks like its scene: {compared}"
    );
    let (_, noted) = outputs(dir.path(), &["compare", "t.png", "r.png"]);
    assert!(
        noted.contains("the reference has noise of its own"),
        "{noted}"
    );
    let (_, noted) = outputs(dir.path(), &["compare", "r.png", "t.png"]);
    assert_eq!(noted, "", "a frame does not store its noise");
    let same = json(dir.path(), &["compare", "t.png", "t.png", "--json"]);
    assert!(same["psnr_db"].is_null() && same["flip"] == 0.0 && same["differing_fraction"] == 0.0);
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
    let home = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus/Home.xml");
    for (input, command) in [
        ("builtin:bump", "headbox capture builtin:bump -o bump.ldi"),
        (
            "builtin:house",
            "headbox house builtin:house -o house.house",
        ),
        (home, "-o Home.house"),
    ] {
        let (code, message) = view(&[input]);
        assert!(
            code == Some(1) && message.lines().count() == 1 && message.contains(command),
            "{input}: {code:?}: {message}"
        );
    }
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
