//! The built program, run as users run it.

#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use std::path::Path;
use std::process::{Command, Output};

/// Runs a command in a folder.
pub(crate) fn headbox(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_headbox"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Runs a command that must fail with `code`, write nothing to standard output and not panic;
/// returns its message.
pub(crate) fn refused(folder: &Path, code: i32, arguments: &[&str]) -> String {
    let output = headbox(folder, arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    assert!(
        output.stdout.is_empty(),
        "{arguments:?} wrote to standard output"
    );
    assert!(!message.contains("panicked"), "{arguments:?}: {message}");
    message
}

/// Runs a command that must fail with `code` and a message that contains `expected`.
pub(crate) fn fails(folder: &Path, code: i32, arguments: &[&str], expected: &str) {
    let message = refused(folder, code, arguments);
    assert!(message.contains(expected), "{arguments:?}: {message}");
}

/// Runs a command that must succeed, and returns its standard output.
pub(crate) fn succeeds(folder: &Path, arguments: &[&str]) -> String {
    outputs(folder, arguments).0
}

/// Runs a command that must succeed, and returns its standard output and error.
pub(crate) fn outputs(folder: &Path, arguments: &[&str]) -> (String, String) {
    let output = headbox(folder, arguments);
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert!(output.status.success(), "{arguments:?}: {err}");
    (out, err)
}

/// Parses the JSON output of a command that must succeed.
pub(crate) fn json(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    serde_json::from_str(&succeeds(folder, arguments)).unwrap()
}

/// Paints overlays of a file by `render`: each must differ from the plain frame and from the
/// others. An unknown overlay must be refused with the names of the known ones.
#[cfg(feature = "viewer")]
pub(crate) fn overlays_are_painted(folder: &Path, file: &str, overlays: &[&str], more: &[&str]) {
    let base = ["render", file, "-o", "overlay.png", "--size", "96x72"];
    let painted = |overlay: &str| {
        let said = json(
            folder,
            &[base.as_slice(), more, &["--overlay", overlay, "--json"]].concat(),
        );
        assert_eq!(
            (said["overlay"].as_str(), &said["size"]),
            (Some(overlay), &serde_json::json!([96, 72]))
        );
        std::fs::read(folder.join("overlay.png")).unwrap()
    };
    let mut pictures = vec![painted("none")];
    for overlay in overlays {
        let picture = painted(overlay);
        assert!(!pictures.contains(&picture), "{file}: {overlay}");
        pictures.push(picture);
    }
    let known = ["none"]
        .iter()
        .chain(overlays)
        .copied()
        .collect::<Vec<_>>()
        .join(", ");
    fails(
        folder,
        2,
        &[base.as_slice(), more, &["--overlay", "rainbow"]].concat(),
        &known,
    );
}
