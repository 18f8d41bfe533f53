//! Standard output that cannot be written, limits of file sizes, and what killed runs leave.

#![cfg(unix)]
#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use crate::run::{refused, succeeds};
use std::fs::File;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_headbox"));
    command.args(arguments).current_dir(folder);
    command
}

/// Asserts that a command failed with exit code 1 and without a panic; returns its message.
fn failed(output: Output) -> String {
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(!message.contains("panicked"), "{message}");
    message
}

const WRITERS: [&[&str]; 5] = [
    &["scenes"],
    &["--help"],
    &["--version"],
    &["man"],
    &["completions", "bash"],
];

#[test]
fn closed_pipe_is_a_quiet_failure() {
    let dir = tempfile::tempdir().unwrap();
    for arguments in WRITERS {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = program(dir.path(), arguments).stdout(writer).output();
        let message = failed(output.unwrap());
        assert_eq!(message, "", "{arguments:?}");
    }
}

#[test]
fn closed_output_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let export = ["truth", "builtin:bump", "-o", "-"];
    for arguments in WRITERS.into_iter().chain([&export[..]]) {
        let output = Command::new("sh")
            .args([
                "-c",
                "exec \"$0\" \"$@\" >&-",
                env!("CARGO_BIN_EXE_headbox"),
            ])
            .args(arguments)
            .current_dir(dir.path())
            .output();
        let message = failed(output.unwrap());
        let expected = "standard output cannot be written: it is closed";
        assert!(message.contains(expected), "{arguments:?}: {message}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn full_device_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    for arguments in WRITERS {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = program(dir.path(), arguments).stdout(full).output();
        let message = failed(output.unwrap());
        assert!(
            message.contains("standard output cannot be written"),
            "{message}"
        );
    }
}

#[test]
fn limit_of_file_size_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let limited = "ulimit -f 1; exec \"$0\" truth builtin:bump -o o.bmp --size 64x64 --samples 1";
    let output = Command::new("sh")
        .args(["-c", limited, env!("CARGO_BIN_EXE_headbox")])
        .current_dir(dir.path())
        .stdout(Stdio::null())
        .output();
    let message = failed(output.unwrap());
    assert!(
        message.contains("cannot be written: File too large"),
        "{message}"
    );
    assert_eq!(
        std::fs::read_dir(dir.path()).unwrap().count(),
        0,
        "nothing is left"
    );
}

#[test]
fn files_of_killed_runs_are_removed_and_of_running_ones_kept() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    for name in [".headbox-7-0.part", ".headbox-7-1.part"] {
        std::fs::write(at(name), "x").unwrap();
    }
    let running = File::open(at(".headbox-7-1.part")).unwrap();
    running.lock().unwrap();
    succeeds(dir.path(), &["scenes", "--export", "bump", "bump.obj"]);
    assert!(!at(".headbox-7-0.part").exists() && at(".headbox-7-1.part").exists());
    assert!(at("bump.obj").exists());
}

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
