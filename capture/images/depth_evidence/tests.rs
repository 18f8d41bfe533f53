//! Kinds and units of depth that are found, or left as they are.

use super::*;
use crate::{ImageSetOptions, check};
use glam::{DMat3, DVec3, dvec3};
use image::{ImageBuffer, Luma, RgbImage};
use serde_json::json;
use std::path::Path;

const SIZE: [u32; 2] = [96, 72];
const FOCAL: f64 = 60.0;

/// Half sides of the room, metres.
const HALF: DVec3 = dvec3(2.0, 1.5, 3.0);

/// Returns the ideal position of a distorted one by the keys of `transforms.json`.
fn ideal_position(stored: glam::DVec2, more: &serde_json::Value) -> glam::DVec2 {
    if more["is_fisheye"] == true {
        return stored * (stored.length().tan() / stored.length());
    }
    let mut distortion = crate::Distortion::default();
    distortion.radial[0] = more["k1"].as_f64().unwrap_or(0.0);
    distortion.invert(stored)
}

/// Writes views of a room: `move_m` apart and turned, with depth of `steps` for a metre,
/// measured along the ray if `is_ray`.
fn room(folder: &Path, views: u32, steps: f64, is_ray: bool, more: &serde_json::Value) {
    let mut frames = Vec::new();
    for i in 0..views {
        let turn = DMat3::from_rotation_y(0.15 * f64::from(i));
        let eye = dvec3(0.3 * f64::from(i), 0.1, -0.4 * f64::from(i));
        let cast = |x: u32, y: u32| {
            let [x, y] = [x, y].map(|at| f64::from(at) + 0.5);
            let stored = glam::dvec2((x - 48.0) / FOCAL, (y - 36.0) / FOCAL);
            let ideal = ideal_position(stored, more);
            let ray = turn * dvec3(ideal.x, -ideal.y, -1.0);
            let wall = |k: usize| (HALF[k] * ray[k].signum() - eye[k]) / ray[k];
            let depth = (0..3).map(wall).fold(f64::INFINITY, f64::min);
            (depth, ray.length(), eye + ray * depth)
        };
        let stored = |x, y| {
            let (depth, length, _) = cast(x, y);
            let value = if is_ray { depth * length } else { depth };
            Luma([(value * steps).round() as u16])
        };
        let color = |x, y| {
            let (_, _, p) = cast(x, y);
            let level = |v: f64| (127.0 + 100.0 * v.sin()) as u8;
            image::Rgb([level(5.0 * p.x), level(5.0 * p.y), level(5.0 * p.z)])
        };
        RgbImage::from_fn(SIZE[0], SIZE[1], color)
            .save(folder.join(format!("{i}.png")))
            .expect("written");
        ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(SIZE[0], SIZE[1], stored)
            .save(folder.join(format!("d{i}.png")))
            .expect("written");
        let row = |k: usize| [turn.x_axis[k], turn.y_axis[k], turn.z_axis[k], eye[k]];
        frames.push(json!({
            "file_path": format!("{i}.png"), "depth_path": format!("d{i}.png"),
            "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        }));
    }
    let mut set = json!({"w": SIZE[0], "h": SIZE[1], "fl_x": FOCAL, "frames": frames});
    for (key, value) in more.as_object().into_iter().flatten() {
        set[key] = value.clone();
    }
    std::fs::write(folder.join("transforms.json"), set.to_string()).expect("written");
}

/// Opens a room and returns its notes, its median depth and its warnings.
fn examined(
    views: u32,
    steps: f64,
    is_ray: bool,
    more: &serde_json::Value,
) -> (String, f64, String) {
    let folder = tempfile::tempdir().expect("a folder");
    room(folder.path(), views, steps, is_ray, more);
    let set = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect("opens");
    let report = check(&set, 4, &mut |_| {}).expect("loads");
    (
        set.notes.join("\n"),
        report.median_depth_m,
        report.warnings.join("\n"),
    )
}

#[test]
fn usual_depth_is_left_alone() {
    for views in [1, 2, 5] {
        let (notes, _, warnings) = examined(views, 1000.0, false, &json!({}));
        assert_eq!((notes.as_str(), warnings.as_str()), ("", ""), "{views}");
    }
}

#[test]
fn distance_along_ray_recognised_with_and_without_neighbours() {
    for views in [1, 2, 5] {
        let right = examined(views, 1000.0, false, &json!({})).1;
        let (notes, median, warnings) = examined(views, 1000.0, true, &json!({}));
        assert!(notes.contains("distance along the ray"), "{views}: {notes}");
        assert!(
            (median / right - 1.0).abs() < 1e-3 && warnings.is_empty(),
            "{warnings}"
        );
    }
}

#[test]
fn distance_along_ray_recognised_through_lenses() {
    for more in [json!({"k1": -0.1}), json!({"is_fisheye": true})] {
        let (notes, right, _) = examined(2, 1000.0, false, &more);
        assert!(!notes.contains("along the ray"), "{more}: {notes}");
        let (notes, median, warnings) = examined(2, 1000.0, true, &more);
        assert!(notes.contains("along the ray"), "{more}: {notes}");
        assert!(
            (median / right - 1.0).abs() < 1e-2,
            "{more}: {median} {right}"
        );
        assert_eq!(warnings, "", "{more}");
    }
}

#[test]
fn distance_along_ray_recognised_in_formats_of_depth_along_axis() {
    for is_ray in [false, true] {
        let temporary = tempfile::tempdir().expect("a folder");
        let folder = temporary.path();
        room(folder, 3, 1000.0, is_ray, &json!({}));
        let text = std::fs::read_to_string(folder.join("transforms.json")).expect("read");
        let room: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        std::fs::remove_file(folder.join("transforms.json")).expect("removed");
        // As ScanNet lays out its sequences; its cameras look along +Z.
        for name in ["color", "depth", "pose", "intrinsic"] {
            std::fs::create_dir(folder.join(name)).expect("made");
        }
        for (i, frame) in room["frames"]
            .as_array()
            .expect("a list")
            .iter()
            .enumerate()
        {
            let entry = |row: usize, column: usize| {
                let entry = frame["transform_matrix"][row][column]
                    .as_f64()
                    .expect("a number");
                if row < 3 && (column == 1 || column == 2) {
                    -entry
                } else {
                    entry
                }
            };
            let row = |k: usize| {
                [0, 1, 2, 3]
                    .map(|column| entry(k, column).to_string())
                    .join(" ")
            };
            let pose = [0, 1, 2, 3].map(row).join("\n");
            std::fs::write(folder.join(format!("pose/{i}.txt")), pose).expect("written");
            let color = image::open(folder.join(format!("{i}.png"))).expect("read");
            color
                .save(folder.join(format!("color/{i}.jpg")))
                .expect("written");
            let depth = folder.join(format!("depth/{i}.png"));
            std::fs::rename(folder.join(format!("d{i}.png")), depth).expect("moved");
        }
        let camera = format!("{FOCAL} 0 48 0\n0 {FOCAL} 36 0\n0 0 1 0\n0 0 0 1\n");
        std::fs::write(folder.join("intrinsic/intrinsic_color.txt"), camera).expect("written");
        let set = ImageSet::open(folder, &ImageSetOptions::default()).expect("opens");
        let notes = set.notes.join("\n");
        assert_eq!(notes.contains("distance along the ray"), is_ray, "{notes}");
    }
}

#[test]
fn usual_units_recognised() {
    let right = examined(5, 1000.0, false, &json!({})).1;
    for (steps, is_ray) in [
        (5000.0, false),
        (10_000.0, false),
        (6553.5, false),
        (4000.0, true),
        (100.0, false),
    ] {
        let (notes, median, warnings) = examined(5, steps, is_ray, &json!({}));
        assert!(
            notes.contains("multiplied by the factor"),
            "{steps}: {notes}"
        );
        assert_eq!(notes.contains("along the ray"), is_ray, "{steps}: {notes}");
        assert!(
            (median / right - 1.0).abs() < 1e-2 && warnings.is_empty(),
            "{steps}: {warnings}"
        );
    }
}

#[test]
fn units_in_the_file_are_not_doubted() {
    let right = examined(5, 1000.0, false, &json!({})).1;
    for key in ["integer_depth_scale", "depth_unit_scale_factor"] {
        let (notes, median, _) = examined(5, 5000.0, false, &json!({key: 0.0002}));
        assert!(
            (median / right - 1.0).abs() < 1e-3 && notes.is_empty(),
            "{notes}"
        );
        let (notes, median, warnings) = examined(5, 5000.0, false, &json!({key: 0.001}));
        assert!(
            (median / right - 5.0).abs() < 1e-2 && notes.is_empty(),
            "{notes}"
        );
        assert!(
            warnings.contains("disagree") && warnings.contains("factor 0.2"),
            "{warnings}"
        );
    }
    let (notes, ..) = examined(1, 1000.0, false, &json!({"depth_scale": 5000}));
    assert!(
        notes.contains("\"depth_scale\" is an unknown key"),
        "{notes}"
    );
}
