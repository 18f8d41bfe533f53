//! Files that inputs name: where they are searched, and which are refused.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use crate::run::{fails, headbox, json, succeeds};
use std::fs::{create_dir_all, write};
use std::path::Path;

/// Writes a scene with a texture `texture`, and a red picture at `at`.
fn scene(folder: &Path, texture: &str, at: &str) {
    let path = |name: &str| {
        let path = folder.join(name);
        create_dir_all(path.parent().expect("a folder")).unwrap();
        path
    };
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n";
    write(path("project/scene/a.obj"), obj).unwrap();
    let mtl = format!("newmtl a\nmap_Kd {texture}\n");
    write(path("project/scene/a.mtl"), mtl).unwrap();
    let red = image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0]));
    red.save(path(at)).unwrap();
}

/// Messages of a small truth of the scene with more arguments.
fn messages(folder: &Path, more: &[&str]) -> String {
    let small = ["truth", "project/scene/a.obj", "-o", "o.png"];
    let size = ["--size", "8x8", "--samples", "1"];
    let output = headbox(folder, &[&small, &size[..], more].concat());
    let messages = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{messages}");
    messages
}

#[test]
fn texture_outside_is_read_if_allowed_or_searched() {
    let dir = tempfile::tempdir().unwrap();
    scene(dir.path(), "../../far/x.png", "far/x.png");
    let strict = messages(dir.path(), &[]);
    assert!(strict.contains("1 texture could not be read"), "{strict}");
    assert!(strict.contains("far/x.png"), "{strict}");
    assert!(strict.contains("--allow-outside"), "{strict}");
    for more in [&["--allow-outside"][..], &["--search", "far"]] {
        let allowed = messages(dir.path(), more);
        assert!(
            !allowed.contains("could not be read"),
            "{more:?}: {allowed}"
        );
    }
    fails(
        dir.path(),
        2,
        &["info", "project/scene/a.obj", "--search", "nowhere"],
        "--search nowhere: there is no such folder",
    );
}

#[test]
fn texture_of_exporter_or_folder_above_is_read() {
    let dir = tempfile::tempdir().unwrap();
    scene(dir.path(), "../tex/x.png", "project/tex/x.png");
    let beside = messages(dir.path(), &[]);
    assert!(!beside.contains("could not be read"), "{beside}");
    // The exporter's own file exists here, too: that beside the scene is used.
    let own = dir.path().join("work/tex/x.png");
    scene(dir.path(), own.to_str().unwrap(), "work/tex/x.png");
    scene(dir.path(), own.to_str().unwrap(), "project/scene/tex/x.png");
    let moved = messages(dir.path(), &[]);
    assert!(!moved.contains("could not be read"), "{moved}");
    assert!(moved.contains("found in another folder"), "{moved}");
    let exact = messages(dir.path(), &["--allow-outside"]);
    assert!(!exact.contains("found in another folder"), "{exact}");
}

#[test]
fn home_of_scene_outside_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    scene(dir.path(), "x.png", "project/scene/x.png");
    let home = dir.path().join("homes/mine/a.toml");
    create_dir_all(home.parent().unwrap()).unwrap();
    write(&home, "scene = \"../../project/scene/a.obj\"\n").unwrap();
    let message = "scene = \"../../project/scene/a.obj\" leads out of the folder";
    fails(dir.path(), 1, &["house", "homes/mine/a.toml"], message);
}

/// Writes a set of two views whose first image is `path`.
fn set(folder: &Path, path: &str) {
    create_dir_all(folder.join("set")).unwrap();
    let frame = |path: &str, x: f64| {
        let pose = serde_json::json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        serde_json::json!({"file_path": path, "transform_matrix": pose})
    };
    let frames = [frame(path, 0.0), frame("b.png", 0.1)];
    let set = serde_json::json!({"fl_x": 8, "w": 8, "h": 8, "frames": frames});
    write(folder.join("set/transforms.json"), set.to_string()).unwrap();
    let grey = image::RgbImage::from_pixel(8, 8, image::Rgb([90, 90, 90]));
    grey.save(folder.join("set/b.png")).unwrap();
}

const DESCRIBE: [&str; 4] = ["images", "set", "--pairs", "0"];

#[test]
fn images_outside_are_read_if_allowed() {
    let dir = tempfile::tempdir().unwrap();
    create_dir_all(dir.path().join("above")).unwrap();
    set(dir.path(), "../above/a.png");
    let a = dir.path().join("above/a.png");
    std::fs::copy(dir.path().join("set/b.png"), &a).unwrap();
    let views = |more: &[&str]| {
        let set = json(dir.path(), &[&DESCRIBE, &["--json"][..], more].concat());
        set["views"].as_array().unwrap().len()
    };
    assert_eq!(views(&[]), 2, "one folder above");
    let outside = tempfile::tempdir().unwrap();
    let far = outside.path().join("far.png");
    std::fs::copy(&a, &far).unwrap();
    set(dir.path(), far.to_str().unwrap());
    fails(dir.path(), 1, &DESCRIBE, "pass --allow-outside");
    assert_eq!(views(&["--allow-outside"]), 2);
    std::fs::copy(&a, dir.path().join("set/far.png")).unwrap();
    assert_eq!(views(&[]), 2, "the name is beside the set");
}

#[cfg(unix)]
#[test]
fn links_out_of_set_and_special_files_are_refused() {
    use std::os::unix::fs::symlink;
    let dir = tempfile::tempdir().unwrap();
    set(dir.path(), "a.png");
    let outside = tempfile::tempdir().unwrap();
    let far = outside.path().join("far.png");
    let b = dir.path().join("set/b.png");
    std::fs::copy(&b, &far).unwrap();
    let a = dir.path().join("set/a.png");
    symlink(&far, &a).unwrap();
    fails(dir.path(), 1, &DESCRIBE, "pass --allow-outside");
    fails(dir.path(), 1, &DESCRIBE, "file_path: \"a.png\" leads out");
    succeeds(dir.path(), &[&DESCRIBE, &["--allow-outside"][..]].concat());
    std::fs::remove_file(&a).unwrap();
    symlink("b.png", &a).unwrap();
    succeeds(dir.path(), &DESCRIBE);
    // A FIFO without a writer would wait for ever.
    let fifo = |name: &str| {
        let file = dir.path().join("set").join(name);
        std::fs::remove_file(&file).unwrap();
        let made = std::process::Command::new("mkfifo").arg(file).status();
        assert!(made.unwrap().success());
        let output = headbox(dir.path(), &[&DESCRIBE, &["--allow-outside"][..]].concat());
        (
            output.status.success(),
            String::from_utf8(output.stderr).unwrap(),
        )
    };
    let (is_read, messages) = fifo("a.png");
    assert!(is_read, "{messages}");
    assert!(
        messages.contains("left out 1 of 2 frames: a.png"),
        "{messages}"
    );
    assert!(
        messages.contains("is a FIFO, not a regular file"),
        "{messages}"
    );
    let (is_read, messages) = fifo("transforms.json");
    assert!(
        !is_read && messages.contains("not an image set"),
        "{messages}"
    );
}

/// Runs `headbox images set --depth` on five views of a built-in scene, and returns its messages.
fn estimate(folder: &Path, more: &[&str]) -> (bool, String) {
    let depth = [
        "images",
        "set",
        "--depth",
        "--depth-size",
        "96",
        "--pairs",
        "0",
    ];
    let output = headbox(folder, &[&depth, more].concat());
    let messages = String::from_utf8(output.stderr).unwrap();
    (output.status.success(), messages)
}

#[cfg(unix)]
#[test]
fn depth_is_estimated_again_but_not_through_links() {
    use std::os::unix::fs::symlink;
    let dir = tempfile::tempdir().unwrap();
    let truth = [
        "truth",
        "builtin:interior",
        "--images",
        "5x1",
        "-o",
        "traced",
    ];
    let small = ["--size", "96x72", "--samples", "4", "--unlit"];
    succeeds(dir.path(), &[&truth, &small[..]].concat());
    // Without the traced depth.
    let traced = dir.path().join("traced/transforms.json");
    let text = std::fs::read_to_string(&traced).unwrap();
    let mut set: serde_json::Value = serde_json::from_str(&text).unwrap();
    for frame in set["frames"].as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("depth_file_path");
    }
    write(&traced, set.to_string()).unwrap();
    std::fs::rename(dir.path().join("traced"), dir.path().join("set")).unwrap();
    for _ in 0..2 {
        let (is_done, messages) = estimate(dir.path(), &[]);
        assert!(is_done, "{messages}");
    }
    let (is_done, messages) = estimate(dir.path(), &["-o", "copy"]);
    assert!(is_done, "{messages}");
    let (is_done, messages) = estimate(dir.path(), &["-o", "copy"]);
    assert!(!is_done, "{messages}");
    assert!(messages.contains("already holds a set"), "{messages}");

    let depth = dir.path().join("set/headbox-depth");
    std::fs::rename(&depth, dir.path().join("elsewhere")).unwrap();
    write(&depth, "a file").unwrap();
    let (is_done, messages) = estimate(dir.path(), &[]);
    assert!(!is_done, "{messages}");
    assert!(
        messages.contains("headbox-depth: cannot be written"),
        "{messages}"
    );
    std::fs::remove_file(&depth).unwrap();
    symlink("../elsewhere", &depth).unwrap();
    let described = headbox(dir.path(), &DESCRIBE);
    let messages = String::from_utf8(described.stderr).unwrap();
    assert!(described.status.success(), "{messages}");
    assert!(
        messages.contains("estimated depth is not used"),
        "{messages}"
    );
    let (is_done, messages) = estimate(dir.path(), &[]);
    assert!(!is_done, "{messages}");
    assert!(messages.contains("is a symbolic link"), "{messages}");
}
