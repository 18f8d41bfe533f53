//! Every error is one sentence of what, where and what to do: 150 bad inputs and what is said to each, in
//! `snapshots/`. After a change of words: `INSTA_UPDATE=always cargo test --test program words`, and read what changed.

#![expect(clippy::unwrap_used, reason = "in a test a panic is the failure report")]

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// Commands that must fail, one a line; words are separated by spaces, `''` is an empty word.
const BAD: &str = include_str!("words.txt");

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
    write("alien.ldi", &[b"HEADBOX\0alie\x01".as_slice(), &[0; 11]].concat());
    write("future.ldi", &[b"HEADBOX\0cldi\x63".as_slice(), &[0; 11]].concat());
    write("house.ldi", &[b"HEADBOX\0hous\x01".as_slice(), &[0; 11]].concat());
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
    write("pose.json", b"[{\"eye\": [0, 0, 0], \"look_at\": [0, 0, -1]}]");
    write("cut.json", b"[");
    write("nan.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n");
    write("list.json", b"{\"poses\": 5}");
    image::RgbImage::new(4, 3).save(folder.join("small.png")).unwrap();
    image::RgbImage::new(5, 3).save(folder.join("wide.png")).unwrap();
    std::fs::create_dir(folder.join("folder")).unwrap();
    let capture = "capture builtin:bump -o good.ldi --face-size 8 --strata 2 --rays 2 --light-samples 0";
    let made =
        Command::new(env!("CARGO_BIN_EXE_headbox")).args(capture.split(' ')).current_dir(folder).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let good = std::fs::read(folder.join("good.ldi")).unwrap();
    write("cut.ldi", &good[..good.len() / 2]);
    write("long.ldi", &[good.as_slice(), b"junk"].concat());
    let mut flipped = good;
    let last = flipped.len() - 1;
    flipped[last] ^= 1;
    write("flipped.ldi", &flipped);
}

/// Lengths and checksums belong to the files at hand, and not to the words.
fn without_figures(sentence: &str) -> String {
    let is_figure = |word: &&str| {
        let word = word.trim_end_matches([',', ':', ';']);
        word.len() > 2 && word.contains(|c: char| c.is_ascii_digit()) && word.chars().all(|c| c.is_ascii_hexdigit())
    };
    sentence.split(' ').map(|word| if is_figure(&word) { "N" } else { word }).collect::<Vec<_>>().join(" ")
}

#[test]
fn what_is_said_to_150_bad_inputs() {
    let dir = tempfile::tempdir().unwrap();
    let cache = tempfile::tempdir().unwrap();
    prepare(dir.path());
    let before = std::fs::read_dir(dir.path()).unwrap().count();
    let lines: Vec<&str> = BAD.lines().filter(|line| !line.is_empty()).collect();
    assert!(lines.len() >= 150, "{} bad inputs", lines.len());
    let mut page = String::new();
    for line in lines {
        let arguments = line.split(' ').map(|word| if word == "''" { "" } else { word });
        let mut command = Command::new(env!("CARGO_BIN_EXE_headbox"));
        command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        command.env("XDG_CACHE_HOME", cache.path());
        let output = command.args(arguments).current_dir(dir.path()).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap().replace(dir.path().to_str().unwrap(), "DIR");
        let code = output.status.code().unwrap();
        assert!(code == 1 || code == 2, "{line}: exit code {code}: {said}");
        assert!(output.stdout.is_empty(), "{line}: writes to standard output");
        assert_eq!(said.matches("error: ").count(), 1, "{line}: {said}");
        for foul in ["os error", ".part", "panicked", "expected value at line 1 column 1", "use '-- ", "kind \"cldi\""]
        {
            assert!(!said.contains(foul), "{line}: {said}");
        }
        // Usage and where to find help follow each mistake of usage, the same each time.
        let sentence: Vec<&str> =
            said.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more")).collect();
        let sentence = sentence.join("\n");
        let sentence = if sentence.contains("is damaged: ") { without_figures(&sentence) } else { sentence };
        writeln!(page, "$ headbox {line}\n[{code}] {}\n", sentence.trim_end()).unwrap();
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), before, "nothing was written");
    insta::assert_snapshot!(page);
}
