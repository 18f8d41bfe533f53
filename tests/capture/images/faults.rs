//! Faults of image sets: errors name file and field, and checks warn of doubtful views.

use super::wall::{
    SIZE, colmap_binary, colmap_text, depth, join_numbers, matrix, open, poses, rgbd, rows4,
    seurat, transforms, write_json,
};
use glam::{DMat4, DVec3, dvec3};
use headbox_images::{DepthPicture, check, write_depth_exr};
use image::{ImageBuffer, Luma, RgbImage};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

#[test]
fn errors_name_file_and_field() {
    let manifest = |change: &dyn Fn(&mut Value)| {
        let folder = tempfile::tempdir().expect("a folder");
        let mut value = seurat(folder.path());
        change(&mut value);
        write_json(folder.path(), "manifest.json", &value);
        (open(folder.path()), folder)
    };
    let camera = |value: &mut Value, key: &str, to: Value| {
        value["view_groups"][0]["views"][1]["projective_camera"][key] = to;
    };
    let file = |value: &mut Value, key: &str, to: Value| {
        value["view_groups"][0]["views"][1]["depth_image_file"][key] = to;
    };
    type Change = Box<dyn Fn(&mut Value)>;
    let cases: [(&str, Change); 10] = [
        (
            "views[1].projective_camera.depth_type",
            Box::new(move |v| camera(v, "depth_type", json!("Z"))),
        ),
        (
            "views[1].projective_camera.image_width",
            Box::new(move |v| camera(v, "image_width", json!(0))),
        ),
        (
            "image_width",
            Box::new(move |v| camera(v, "image_width", json!(1e9))),
        ),
        (
            "world_from_eye_matrix",
            Box::new(move |v| camera(v, "world_from_eye_matrix", json!([1, 2, 3]))),
        ),
        (
            "mirrors",
            Box::new(move |v| {
                let left_handed = rows4(DMat4::from_scale(dvec3(1.0, 1.0, -1.0)));
                camera(v, "world_from_eye_matrix", json!(left_handed));
            }),
        ),
        (
            "scale of 1000",
            Box::new(move |v| {
                camera(
                    v,
                    "world_from_eye_matrix",
                    json!(rows4(DMat4::from_scale(DVec3::splat(1000.0)))),
                );
            }),
        ),
        (
            "looks down -Z",
            Box::new(move |v| camera(v, "clip_from_eye_matrix", json!(rows4(DMat4::IDENTITY)))),
        ),
        (
            "leads out of the folder",
            Box::new(move |v| file(v, "depth", json!({"path": "../../etc/passwd"}))),
        ),
        (
            "leads out of the folder",
            Box::new(move |v| file(v, "color", json!({"path": "/etc/passwd"}))),
        ),
        ("view_groups", Box::new(|v| *v = json!({}))),
    ];
    for (expected, change) in &cases {
        match manifest(change).0 {
            Ok(set) => {
                let notes = set.notes.join("\n");
                assert_eq!(set.views.len(), 1, "the other view is left out");
                assert!(notes.contains(expected), "{expected}: {notes}");
            }
            Err(error) => {
                let error = error.to_string();
                assert!(
                    error.contains("manifest.json") && error.contains(expected),
                    "{expected}: {error}"
                );
                assert_eq!(error.lines().count(), 1, "{error}");
            }
        }
    }
    let load = |change: &dyn Fn(&Path)| {
        let folder = tempfile::tempdir().expect("a folder");
        rgbd(folder.path());
        change(folder.path());
        open(folder.path())
            .and_then(|set| {
                set.views
                    .iter()
                    .try_for_each(|view| view.load().map(|_| ()))
            })
            .expect_err("refused")
            .to_string()
    };
    let depth = "frame-000001.depth.png";
    let truncated = load(&|folder| {
        let bytes = fs::read(folder.join(depth)).expect("there");
        fs::write(folder.join(depth), &bytes[..bytes.len() / 2]).expect("written");
    });
    assert!(truncated.contains(depth), "{truncated}");
    let other_size = load(&|folder| {
        ImageBuffer::<Luma<u16>, _>::new(8, 8)
            .save(folder.join(depth))
            .expect("written");
    });
    assert!(
        other_size.contains("8x8") && other_size.contains("32x24"),
        "{other_size}"
    );
    let eight_bits = load(&|folder| {
        image::GrayImage::new(32, 24)
            .save(folder.join(depth))
            .expect("written");
    });
    assert!(eight_bits.contains("8 bits"), "{eight_bits}");
    let folder = tempfile::tempdir().expect("a folder");
    rgbd(folder.path());
    let has_left_out = || {
        let notes = open(folder.path()).expect("opens").notes.join("\n");
        assert!(
            notes.contains("left out 1 of ") && notes.contains("frame-000001.pose.txt"),
            "{notes}"
        );
    };
    fs::remove_file(folder.path().join("frame-000001.color.png")).expect("removed");
    has_left_out();
    fs::write(folder.path().join("frame-000001.pose.txt"), "1 2 3").expect("written");
    has_left_out();
    let nothing = open(tempfile::tempdir().expect("a folder").path())
        .expect_err("nothing there")
        .to_string();
    assert!(
        nothing.contains("manifest.json") && nothing.contains("COLMAP"),
        "{nothing}"
    );
}

#[test]
fn missing_photographs_skipped_and_named() {
    let folder = tempfile::tempdir().expect("a folder");
    colmap_text(folder.path());
    fs::remove_file(folder.path().join("images/0.png")).expect("removed");
    let set = open(folder.path()).expect("a set");
    assert!(
        set.views
            .iter()
            .map(|view| view.name.as_str())
            .eq(["1.png"])
    );
    let [note] = &set.notes[..] else {
        panic!("{:?}", set.notes)
    };
    assert!(
        note.starts_with("1 of 2 images are missing") && note.ends_with("0.png"),
        "{note}"
    );
    fs::remove_file(folder.path().join("images/1.png")).expect("removed");
    let error = open(folder.path()).expect_err("no picture").to_string();
    assert!(
        error.contains("0.png: file not found, nor any other of the 2 images"),
        "{error}"
    );
}

#[test]
fn truncated_colmap_models_refused() {
    for name in ["cameras.bin", "images.bin"] {
        let folder = tempfile::tempdir().expect("a folder");
        colmap_binary(folder.path());
        let path = folder.path().join("sparse").join(name);
        let bytes = fs::read(&path).expect("there");
        for length in 0..bytes.len() {
            fs::write(&path, &bytes[..length]).expect("written");
            let error = open(folder.path()).expect_err("truncated").to_string();
            assert!(error.contains(name), "{length}: {error}");
        }
    }
}

#[test]
fn check_warns_of_disagreement_and_equal_poses() {
    let folder = tempfile::tempdir().expect("a folder");
    rgbd(folder.path());
    let pose = folder.path().join("frame-000001.pose.txt");
    let moved = matrix((poses()[1].0, poses()[1].1 + dvec3(0.0, 0.0, 0.8)));
    let opencv = moved * DMat4::from_diagonal(glam::dvec4(1.0, -1.0, -1.0, 1.0));
    fs::write(&pose, join_numbers(rows4(opencv))).expect("written");
    let set = open(folder.path()).expect("opens");
    let report = check(&set, 4, &mut |_| {}).expect("loads");
    assert!(
        report
            .warnings
            .iter()
            .any(|warning| warning.contains("disagree")),
        "{report:?}"
    );
    fs::copy(folder.path().join("frame-000000.pose.txt"), &pose).expect("copied");
    let report = check(&open(folder.path()).expect("opens"), 4, &mut |_| {}).expect("loads");
    assert!(
        report
            .warnings
            .iter()
            .any(|warning| warning.contains("same pose")),
        "{report:?}"
    );
}

/// Poses in millimetres with depth in metres give a warning; background depth does not.
#[test]
fn check_warns_of_different_units() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut value = transforms(folder.path());
    let warnings = |value: &Value| {
        write_json(folder.path(), "transforms.json", value);
        let report = check(&open(folder.path()).expect("opens"), 4, &mut |_| {}).expect("loads");
        (report.warnings, report.median_depth_m)
    };
    let values = |x: usize, y: usize| {
        if y < 14 {
            f32::INFINITY
        } else {
            depth(poses()[0], x as u32, y as u32) as f32
        }
    };
    let [width, height] = SIZE.map(|side| side as usize);
    let values = (0..width * height)
        .map(|i| values(i % width, i / width))
        .collect();
    let sky = DepthPicture {
        width: SIZE[0],
        height: SIZE[1],
        values,
    };
    write_depth_exr(&sky, &folder.path().join("sky.exr")).expect("written");
    let mut outside = value.clone();
    outside["frames"] = json!([outside["frames"][0]]);
    outside["frames"][0]["depth_file_path"] = json!("sky.exr");
    let (messages, median) = warnings(&outside);
    assert!(
        messages.is_empty() && median > 1.5 && median < 3.0,
        "{messages:?} {median}"
    );
    for frame in value["frames"].as_array_mut().expect("a list") {
        for row in 0..3 {
            let of = &mut frame["transform_matrix"][row][3];
            *of = json!(of.as_f64().expect("a number") * 1000.0);
        }
    }
    let (messages, _) = warnings(&value);
    let [warning] = &messages[..] else {
        panic!("one: {messages:?}")
    };
    assert!(warning.contains("millimetres and metres"), "{warning}");
    value["depth_unit_scale_factor"] = json!(0);
    write_json(folder.path(), "transforms.json", &value);
    let error = open(folder.path()).expect_err("no unit").to_string();
    assert!(
        error.contains("transforms.json: depth_unit_scale_factor: must be above 0"),
        "{error}"
    );
}

/// Files of views that are in no compared pair are checked as well.
#[test]
fn every_file_checked() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut value = transforms(folder.path());
    let frames = value["frames"].as_array_mut().expect("a list");
    for i in 2..9 {
        let names = ["", "_depth16"].map(|ending| format!("{i}{ending}.png"));
        for (name, of) in names.iter().zip(["0.png", "0_depth16.png"]) {
            fs::copy(folder.path().join(of), folder.path().join(name)).expect("copied");
        }
        let mut frame = frames[0].clone();
        frame["file_path"] = json!(names[0]);
        frame["depth_file_path"] = json!(names[1]);
        frames.push(frame);
    }
    write_json(folder.path(), "transforms.json", &value);
    let checked = || check(&open(folder.path()).expect("opens"), 1, &mut |_| {});
    checked().expect("all is there");
    RgbImage::new(8, 8)
        .save(folder.path().join("8.png"))
        .expect("written");
    let error = checked().expect_err("another size").to_string();
    assert!(
        error.contains("8.png: is 8x8 pixels, but the set specifies 32x24"),
        "{error}"
    );
    // A photograph whose depth is missing is of use without.
    fs::remove_file(folder.path().join("7_depth16.png")).expect("removed");
    let set = open(folder.path()).expect("opens");
    assert_eq!(set.views_with_depth().count(), 8);
    let notes = set.notes.join("\n");
    assert!(
        notes.contains("1 of 9 depth files") && notes.contains("7_depth16.png"),
        "{notes}"
    );
}
