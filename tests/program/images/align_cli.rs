//! `headbox images --align`, with a stand-in for COLMAP that finds three cameras, or none, or
//! fails.

#![cfg(unix)]
#![expect(
    clippy::unwrap_used,
    reason = "in a test a panic is the failure report"
)]

use image::{Rgb, RgbImage};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// Installs a stand-in for COLMAP with a last step, where `$out` is the folder for models.
fn with_colmap(folder: &Path, last_step: &str) {
    let asked = folder.join("asked");
    let asked = asked.display();
    let script = format!(
        "#!/bin/sh\n\
         case \"$*\" in *--Sift*) echo \"unrecognised option '--SiftExtraction.use_gpu'\"; exit 1;; esac\n\
         case $1 in\n\
         feature_extractor) echo \"$*\" > {asked}; echo 'Processed file [1/3]'; echo 'Processed file [3/3]';;\n\
         exhaustive_matcher) echo 'Matching block [1/1, 1/1]' >&2;;\n\
         mapper) while [ $# -gt 0 ]; do [ \"$1\" = --output_path ] && out=$2; shift; done; {last_step};;\n\
         esac\n"
    );
    fs::create_dir(folder.join("bin")).unwrap();
    let program = folder.join("bin/colmap");
    fs::write(&program, script).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
}

/// Options with which the stand-in for COLMAP was called.
fn requested_options(folder: &Path) -> String {
    fs::read_to_string(folder.join("asked")).unwrap()
}

/// Writes three photographs, and the model that the stand-in will find.
fn photographs(folder: &Path) {
    fs::create_dir_all(folder.join("photos")).unwrap();
    fs::create_dir_all(folder.join("found/0")).unwrap();
    let mut cameras = 1_u64.to_le_bytes().to_vec();
    cameras.extend(1_u32.to_le_bytes());
    cameras.extend(0_u32.to_le_bytes()); // SIMPLE_PINHOLE
    cameras.extend([16_u64, 12].map(u64::to_le_bytes).as_flattened());
    cameras.extend([20.0_f64, 8.0, 6.0].map(f64::to_le_bytes).as_flattened());
    fs::write(folder.join("found/0/cameras.bin"), cameras).unwrap();
    let mut images = 3_u64.to_le_bytes().to_vec();
    for id in 0..3_u32 {
        let name = format!("{id}.png");
        RgbImage::from_pixel(16, 12, Rgb([200, 90, id as u8]))
            .save(folder.join("photos").join(&name))
            .unwrap();
        images.extend(id.to_le_bytes());
        images.extend(
            [1.0_f64, 0.0, 0.0, 0.0, f64::from(id), 0.0, 0.0]
                .map(f64::to_le_bytes)
                .as_flattened(),
        );
        images.extend(1_u32.to_le_bytes());
        images.extend(name.as_bytes());
        images.extend([0_u8; 9]); // the name's end, and no points
    }
    fs::write(folder.join("found/0/images.bin"), images).unwrap();
}

fn align(folder: &Path, path: &str) -> (Output, String) {
    let mut program = Command::new(env!("CARGO_BIN_EXE_headbox"));
    let output = program
        .args(["images", "photos", "--align"])
        .current_dir(folder)
        .env("PATH", path)
        .output()
        .unwrap();
    let words = String::from_utf8(output.stderr.clone()).unwrap();
    (output, words)
}

fn with_bin(folder: &Path) -> String {
    format!(
        "{}:{}",
        folder.join("bin").display(),
        std::env::var("PATH").unwrap_or_default()
    )
}

/// Lists other files among the photographs.
fn other_files(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder.join("photos"))
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap());
    names.filter(|name| !name.ends_with(".png")).collect()
}

#[test]
fn model_is_written_beside_photographs_and_read() {
    let dir = tempfile::tempdir().unwrap();
    photographs(dir.path());
    with_colmap(
        dir.path(),
        &format!("cp -r {} \"$out/0\"", dir.path().join("found/0").display()),
    );
    let (output, words) = align(dir.path(), &with_bin(dir.path()));
    assert!(output.status.success(), "{words}");
    assert!(words.contains("3 of 3 photographs"), "{words}");
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(
        told.contains("COLMAP model (binary), 3 views") && told.contains("16x12"),
        "{told}"
    );
    assert!(
        !words.contains("images are missing"),
        "the photographs themselves are its pictures: {words}"
    );
    assert_eq!(other_files(dir.path()), ["sparse"]);
    let (again, words) = align(dir.path(), &with_bin(dir.path()));
    assert_eq!(again.status.code(), Some(1));
    assert!(words.contains("a model exists"), "{words}");
}

#[test]
fn failed_alignment_is_reported_and_leaves_folder_unchanged() {
    for (last_step, expected) in [
        (
            "echo 'No good initial image pair found.'",
            "no two photographs overlap",
        ),
        (
            "echo 'ERROR: failed to create sparse model'; exit 1",
            "no two photographs overlap",
        ),
        (
            "echo 'out of memory'; exit 1",
            "colmap mapper failed: out of memory",
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        photographs(dir.path());
        with_colmap(dir.path(), last_step);
        let (output, words) = align(dir.path(), &with_bin(dir.path()));
        assert_eq!(output.status.code(), Some(1), "{words}");
        assert!(words.contains(expected), "{words}");
        assert!(other_files(dir.path()).is_empty());
    }
    let dir = tempfile::tempdir().unwrap();
    photographs(dir.path());
    let (_, words) = align(dir.path(), "/nonexistent");
    assert!(
        words.contains("COLMAP, which estimates the camera poses, is not installed")
            && words.contains("apt install colmap"),
        "{words}"
    );
    assert!(other_files(dir.path()).is_empty());
}

/// COLMAP skips photographs whose size differs from that of its only camera: with upright ones
/// among others it found nothing.
#[test]
fn photographs_of_several_sizes_get_separate_cameras() {
    for (size, expected) in [([16, 12], "single_camera 1"), ([12, 16], "single_camera 0")] {
        let dir = tempfile::tempdir().unwrap();
        photographs(dir.path());
        RgbImage::new(size[0], size[1])
            .save(dir.path().join("photos/3.png"))
            .unwrap();
        with_colmap(dir.path(), "exit 0");
        align(dir.path(), &with_bin(dir.path()));
        assert!(
            requested_options(dir.path()).contains(expected),
            "{size:?}: {}",
            requested_options(dir.path())
        );
    }
}

/// Installs a stand-in for `python3` with pycolmap, which checks the script and the steps.
fn with_pycolmap(folder: &Path) {
    let script = format!(
        "#!/bin/sh\n\
         [ \"$1\" = -c ] || exit 9\n\
         [ \"$2\" = 'import pycolmap' ] && exit 0\n\
         case $2 in *pycolmap.incremental_mapping*) ;; *) exit 9;; esac\n\
         shift 2\n\
         echo \"$*\" >> {asked}\n\
         case $1 in mapper) while [ $# -gt 0 ]; do [ \"$1\" = --output_path ] && out=$2; shift; done; cp -r {found} \"$out/0\";; esac\n",
        asked = folder.join("asked").display(),
        found = folder.join("found/0").display(),
    );
    fs::create_dir(folder.join("bin")).unwrap();
    let program = folder.join("bin/python3");
    fs::write(&program, script).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn pycolmap_is_used_without_the_program() {
    let dir = tempfile::tempdir().unwrap();
    photographs(dir.path());
    with_pycolmap(dir.path());
    for tool in ["sh", "cp"] {
        let found = ["/bin", "/usr/bin"].map(|folder| Path::new(folder).join(tool));
        let found = found.iter().find(|path| path.is_file()).unwrap();
        std::os::unix::fs::symlink(found, dir.path().join("bin").join(tool)).unwrap();
    }
    // Nothing else is on the path, so that an installed COLMAP is not found.
    let (output, words) = align(dir.path(), &dir.path().join("bin").display().to_string());
    assert!(output.status.success(), "{words}");
    assert!(words.contains("3 of 3 photographs"), "{words}");
    let asked = requested_options(dir.path());
    let steps: Vec<&str> = asked
        .lines()
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    assert_eq!(steps, ["feature_extractor", "exhaustive_matcher", "mapper"]);
    assert!(
        asked.contains("--ImageReader.single_camera 1") && !asked.contains("use_gpu"),
        "{asked}"
    );
}
