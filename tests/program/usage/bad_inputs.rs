//! Bad inputs are refused: with the right exit code, one error message, nothing on standard output
//! and no file left behind.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use std::path::Path;
use std::process::Command;

/// Commands that must fail, one per line, after their exit codes; arguments are separated by
/// spaces, `''` is an empty one.
const BAD_INPUTS: &str = include_str!("bad_inputs.txt");

/// Files that the commands refer to.
fn prepare(folder: &Path) {
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).unwrap();
    write("empty.obj", b"");
    write("points.obj", b"v 0 0 0\nv 1 0 0\n");
    write("words.obj", b"v 0 0 0\nv a b c\nf 1 2 3\n");
    write("one.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    write("text.glb", b"this is no GLB");
    write("short.glb", b"glTF\x02\0\0\0\xff\xff\0\0");
    write("half.gltf", b"{\"asset\": {\"version\": ");
    write("bare.gltf", b"{\"asset\": {\"version\": \"2.0\"}}");
    write("text.ldi", b"this is no LDI");
    write("empty.ldi", b"");
    write("magic.ldi", b"HEADBOX\0cldi");
    write(
        "alien.ldi",
        &[b"HEADBOX\0alie\x01".as_slice(), &[0; 11]].concat(),
    );
    write(
        "future.ldi",
        &[b"HEADBOX\0cldi\x63".as_slice(), &[0; 11]].concat(),
    );
    write(
        "house.ldi",
        &[b"HEADBOX\0hous\x01".as_slice(), &[0; 11]].concat(),
    );
    write("text.toml", b"rooms, and doors");
    write("bare.toml", b"unit = 1.0\n");
    write("text.xml", b"not XML");
    write("bare.xml", b"<home/>");
    write("text.sh3d", b"not a ZIP archive");
    write("zip.sh3d", b"PK\x03\x04 and no more");
    write("text.png", b"this is no PNG");
    write("text.exr", b"this is no EXR");
    write(
        "square.hdr",
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n\x80\0\0\x81\x80\0\0\x81\x80\0\0\x81\x80\0\0\x81",
    );
    write("text.json", b"this is no JSON");
    write(
        "pose.json",
        b"[{\"eye\": [0, 0, 0], \"look_at\": [0, 0, -1]}]",
    );
    write("cut.json", b"[");
    write("nan.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n");
    write("list.json", b"{\"poses\": 5}");
    image::RgbImage::new(4, 3)
        .save(folder.join("small.png"))
        .unwrap();
    image::RgbImage::new(5, 3)
        .save(folder.join("wide.png"))
        .unwrap();
    std::fs::create_dir(folder.join("folder")).unwrap();
    let capture =
        "capture builtin:bump -o good.ldi --face-size 8 --strata 2 --rays 2 --light-samples 0";
    let made = Command::new(env!("CARGO_BIN_EXE_headbox"))
        .args(capture.split(' '))
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(
        made.status.success(),
        "{}",
        String::from_utf8_lossy(&made.stderr)
    );
    let good = std::fs::read(folder.join("good.ldi")).unwrap();
    write("cut.ldi", &good[..good.len() / 2]);
    write("long.ldi", &[good.as_slice(), b"junk"].concat());
    let mut flipped = good;
    let last = flipped.len() - 1;
    flipped[last] ^= 1;
    write("flipped.ldi", &flipped);
}

#[test]
fn bad_inputs_fail_cleanly() {
    let dir = tempfile::tempdir().unwrap();
    let cache = tempfile::tempdir().unwrap();
    prepare(dir.path());
    let file_count = || std::fs::read_dir(dir.path()).unwrap().count();
    let prepared = file_count();
    for (code, line) in BAD_INPUTS.lines().map(|line| line.split_once(' ').unwrap()) {
        let arguments = line
            .split(' ')
            .map(|word| if word == "''" { "" } else { word });
        let mut command = Command::new(env!("CARGO_BIN_EXE_headbox"));
        command
            .env_remove("DISPLAY")
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("WAYLAND_SOCKET");
        command.env("XDG_CACHE_HOME", cache.path());
        let output = command
            .args(arguments)
            .current_dir(dir.path())
            .output()
            .unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), code.parse().ok(), "{line}: {stderr}");
        assert!(
            output.stdout.is_empty(),
            "{line}: writes to standard output"
        );
        assert_eq!(stderr.matches("error: ").count(), 1, "{line}: {stderr}");
        // Temporary names stay private.
        assert!(!stderr.contains(".part"), "{line}: {stderr}");
        assert_eq!(file_count(), prepared, "{line}: leaves a file");
    }
}
