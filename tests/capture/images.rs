//! Readers of image sets: one scene of a wall and two cameras in every format reads back as the
//! same cameras and points, and errors name file and field.

use glam::{DMat3, DMat4, DVec3, dvec3};
use headbox_core::file_frame::FileFrame;
use headbox_images::{
    DepthPicture, ImageSet, ImageSetOptions, ImagesError, Lens, check, write_depth_exr,
};
use image::{ImageBuffer, Luma, Rgb, RgbImage};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const SIZE: [u32; 2] = [32, 24];
const FOCAL: [f64; 2] = [40.0, 42.0];
const PRINCIPAL: [f64; 2] = [16.3, 11.7];

/// Two camera poses in front of a wall at z = -2: rotation (columns right, up, back) and position.
fn poses() -> [(DMat3, DVec3); 2] {
    [
        (
            DMat3::from_rotation_y(0.1) * DMat3::from_rotation_x(-0.05),
            dvec3(0.1, 0.2, 0.3),
        ),
        (
            DMat3::from_rotation_y(-0.15) * DMat3::from_rotation_z(0.02),
            dvec3(-0.2, 0.1, 0.25),
        ),
    ]
}

fn ray(x: u32, y: u32) -> DVec3 {
    let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
    dvec3(
        (x - PRINCIPAL[0]) / FOCAL[0],
        (PRINCIPAL[1] - y) / FOCAL[1],
        -1.0,
    )
}

/// Returns the eye depth of the wall at a pixel.
fn depth(pose: (DMat3, DVec3), x: u32, y: u32) -> f64 {
    (-2.0 - pose.1.z) / (pose.0 * ray(x, y)).z
}

fn write_pictures(
    folder: &Path,
    i: usize,
    color: &str,
    depth_name: Option<&str>,
    steps_per_metre: f64,
) {
    let pose = poses()[i];
    // A texture of the wall, so that both cameras see the same colour at a point.
    let texture = |x: u32, y: u32| {
        let p = pose.0 * ray(x, y) * depth(pose, x, y) + pose.1;
        let level = |v: f64| (127.0 + 100.0 * v.sin()) as u8;
        Rgb([level(3.0 * p.x), level(4.0 * p.y), 90])
    };
    RgbImage::from_fn(SIZE[0], SIZE[1], texture)
        .save(folder.join(color))
        .expect("written");
    if let Some(name) = depth_name {
        let steps = |x: u32, y: u32| Luma([(depth(pose, x, y) * steps_per_metre).round() as u16]);
        ImageBuffer::<Luma<u16>, _>::from_fn(SIZE[0], SIZE[1], steps)
            .save(folder.join(name))
            .expect("written");
    }
}

/// Converts a pose to a camera-to-world matrix with this crate's eye space.
fn matrix((rotation, eye): (DMat3, DVec3)) -> DMat4 {
    let mut matrix = DMat4::from_mat3(rotation);
    matrix.w_axis = eye.extend(1.0);
    matrix
}

/// Converts a pose to world-to-camera extrinsics with X right, Y down, Z forward: rotation and
/// translation.
fn extrinsics((rotation, eye): (DMat3, DVec3)) -> (DMat3, DVec3) {
    let world_from_camera = rotation * DMat3::from_diagonal(dvec3(1.0, -1.0, -1.0));
    (
        world_from_camera.transpose(),
        -(world_from_camera.transpose() * eye),
    )
}

fn rows4(matrix: DMat4) -> Vec<f64> {
    matrix.transpose().to_cols_array().to_vec()
}

fn join_numbers(numbers: impl IntoIterator<Item = f64>) -> String {
    numbers
        .into_iter()
        .map(|number| format!("{number:.12e}"))
        .collect::<Vec<_>>()
        .join(" ")
}

fn rgbd(folder: &Path) {
    for (i, pose) in poses().into_iter().enumerate() {
        write_pictures(
            folder,
            i,
            &format!("frame-{i:06}.color.png"),
            Some(&format!("frame-{i:06}.depth.png")),
            1000.0,
        );
        let opencv = matrix(pose) * DMat4::from_diagonal(glam::dvec4(1.0, -1.0, -1.0, 1.0));
        fs::write(
            folder.join(format!("frame-{i:06}.pose.txt")),
            join_numbers(rows4(opencv)),
        )
        .expect("written");
    }
    let k = [
        FOCAL[0],
        0.0,
        PRINCIPAL[0] - 0.5,
        0.0,
        FOCAL[1],
        PRINCIPAL[1] - 0.5,
        0.0,
        0.0,
        1.0,
    ];
    fs::write(folder.join("camera-intrinsics.txt"), join_numbers(k)).expect("written");
}

/// Converts a pose to nerfstudio's world with Z up: (x, y, z) there is (x, z, -y) here.
fn z_up(pose: (DMat3, DVec3)) -> (DMat3, DVec3) {
    let file = |p: DVec3| {
        FileFrame {
            up: headbox_core::file_frame::UpAxis::Z,
            unit_m: 1.0,
        }
        .file_from_world(p)
    };
    let rotation = DMat3::from_cols(
        file(pose.0.x_axis),
        file(pose.0.y_axis),
        file(pose.0.z_axis),
    );
    (rotation, file(pose.1))
}

fn transforms(folder: &Path) -> Value {
    let frames: Vec<Value> = (0..2)
        .map(|i| {
            write_pictures(folder, i, &format!("{i}.png"), Some(&format!("{i}_depth16.png")), 1000.0);
            let rows: Vec<Vec<f64>> = rows4(matrix(z_up(poses()[i]))).chunks(4).map(<[f64]>::to_vec).collect();
            json!({"file_path": format!("{i}.png"), "depth_file_path": format!("{i}_depth16.png"), "transform_matrix": rows})
        })
        .collect();
    json!({
        "fl_x": FOCAL[0], "fl_y": FOCAL[1], "cx": PRINCIPAL[0], "cy": PRINCIPAL[1], "w": SIZE[0], "h": SIZE[1],
        "frames": frames,
    })
}

fn write_json(folder: &Path, name: &str, value: &Value) {
    fs::write(folder.join(name), value.to_string()).expect("written");
}

fn colmap_text(folder: &Path) {
    fs::create_dir_all(folder.join("sparse")).expect("made");
    fs::create_dir_all(folder.join("images")).expect("made");
    let [fx, fy] = FOCAL;
    let [cx, cy] = PRINCIPAL;
    let camera = format!(
        "# comment\n7 PINHOLE {} {} {fx} {fy} {cx} {cy}\n",
        SIZE[0], SIZE[1]
    );
    fs::write(folder.join("sparse/cameras.txt"), camera).expect("written");
    let mut images = String::from("# comment\n");
    for (i, pose) in poses().into_iter().enumerate() {
        write_pictures(&folder.join("images"), i, &format!("{i}.png"), None, 0.0);
        let (rotation, t) = extrinsics(pose);
        let q = glam::DQuat::from_mat3(&rotation);
        images += &format!(
            "{} {} 7 {i}.png\n\n",
            i + 1,
            join_numbers([q.w, q.x, q.y, q.z, t.x, t.y, t.z])
        );
    }
    fs::write(folder.join("sparse/images.txt"), images).expect("written");
}

fn colmap_binary(folder: &Path) {
    colmap_text(folder);
    fs::remove_file(folder.join("sparse/cameras.txt")).expect("removed");
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend(7u32.to_le_bytes().into_iter().chain(1u32.to_le_bytes()));
    SIZE.iter()
        .for_each(|&side| cameras.extend(u64::from(side).to_le_bytes()));
    FOCAL
        .iter()
        .chain(&PRINCIPAL)
        .for_each(|number| cameras.extend(number.to_le_bytes()));
    fs::write(folder.join("sparse/cameras.bin"), cameras).expect("written");
    let mut images = 2u64.to_le_bytes().to_vec();
    for (i, pose) in poses().into_iter().enumerate() {
        let (rotation, t) = extrinsics(pose);
        let q = glam::DQuat::from_mat3(&rotation);
        images.extend((i as u32).to_le_bytes());
        [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
            .iter()
            .for_each(|number| images.extend(number.to_le_bytes()));
        images.extend(7u32.to_le_bytes());
        images.extend(format!("{i}.png\0").bytes());
        images.extend(1u64.to_le_bytes().into_iter().chain([0; 24])); // one point
    }
    fs::write(folder.join("sparse/images.bin"), images).expect("written");
}

fn middlebury(folder: &Path) {
    let mut lines = String::from("2\n");
    for (i, pose) in poses().into_iter().enumerate() {
        write_pictures(folder, i, &format!("v{i}.png"), None, 0.0);
        let (rotation, t) = extrinsics(pose);
        let k = [
            FOCAL[0],
            0.0,
            PRINCIPAL[0] - 0.5,
            0.0,
            FOCAL[1],
            PRINCIPAL[1] - 0.5,
            0.0,
            0.0,
            1.0,
        ];
        let r = rotation.transpose().to_cols_array();
        lines += &format!(
            "v{i}.png {}\n",
            join_numbers(k.into_iter().chain(r).chain([t.x, t.y, t.z]))
        );
    }
    fs::write(folder.join("wall_par.txt"), lines).expect("written");
}

/// Writes a Seurat set with window depth in 16 bits.
fn seurat(folder: &Path) -> Value {
    let (near, far) = (0.1, 100.0);
    let views: Vec<Value> = (0..2)
        .map(|i| {
            let name = format!("c{i}.png");
            let pose = poses()[i];
            write_pictures(folder, i, &name, None, 0.0);
            let window = |x: u32, y: u32| {
                let d = far / (far - near) * (1.0 - near / depth(pose, x, y));
                Luma([(d * 65_535.0).round() as u16])
            };
            let picture = ImageBuffer::<Luma<u16>, _>::from_fn(SIZE[0], SIZE[1], window);
            picture.save(folder.join(format!("d{i}.png"))).expect("written");
            let [w, h] = SIZE.map(f64::from);
            let clip = [
                [2.0 * FOCAL[0] / w, 0.0, 1.0 - 2.0 * PRINCIPAL[0] / w, 0.0],
                [0.0, 2.0 * FOCAL[1] / h, 2.0 * PRINCIPAL[1] / h - 1.0, 0.0],
                [0.0, 0.0, -(far + near) / (far - near), -2.0 * far * near / (far - near)],
                [0.0, 0.0, -1.0, 0.0],
            ];
            json!({
                "projective_camera": {
                    "image_width": SIZE[0], "image_height": SIZE[1], "clip_from_eye_matrix": clip.concat(),
                    "world_from_eye_matrix": rows4(matrix(pose)), "depth_type": "WINDOW_Z",
                },
                "depth_image_file": {
                    "color": {"path": name, "channel_0": "R", "channel_1": "G", "channel_2": "B", "channel_alpha": "CONSTANT_ONE"},
                    "depth": {"path": format!("d{i}.png"), "channel_0": "R"},
                },
            })
        })
        .collect();
    json!({"view_groups": [{"views": views}]})
}

/// Writes a set like Seurat's plugin for Unreal Engine: colour and depth in one EXR, depth in
/// alpha, and every pixel opaque.
fn unreal_seurat(folder: &Path) -> Value {
    let mut value = seurat(folder);
    for i in 0..2 {
        let colors = image::open(folder.join(format!("c{i}.png")))
            .expect("a picture")
            .into_rgb8();
        let linear = |level: u8| headbox_core::color::linear_from_srgb8(level);
        let channels = exr::prelude::SpecificChannels::rgba(|at: exr::math::Vec2<usize>| {
            let (x, y) = (at.x() as u32, at.y() as u32);
            let [r, g, b] = colors.get_pixel(x, y).0.map(linear);
            (r, g, b, depth(poses()[i], x, y) as f32)
        });
        let image =
            exr::prelude::Image::from_channels((SIZE[0] as usize, SIZE[1] as usize), channels);
        let name = format!("{i}_ColorDepth.exr");
        exr::prelude::WritableImage::write(&image)
            .to_file(folder.join(&name))
            .expect("written");
        let view = &mut value["view_groups"][0]["views"][i];
        view["projective_camera"]["depth_type"] = json!("EYE_Z");
        view["depth_image_file"]["color"]["path"] = json!(name);
        view["depth_image_file"]["depth"] = json!({"path": name, "channel_0": "A"});
    }
    value
}

fn open(folder: &Path) -> Result<ImageSet, ImagesError> {
    ImageSet::open(folder, &ImageSetOptions::default())
}

#[test]
fn formats_read_same_cameras_and_points() {
    type Write = fn(&Path);
    let formats: [(&str, Write); 8] = [
        ("RGB-D frames", rgbd),
        ("nerfstudio transforms", |folder| {
            write_json(folder, "transforms.json", &transforms(folder));
        }),
        ("nerfstudio transforms", |folder| {
            write_json(folder, "transforms_train.json", &transforms(folder));
        }),
        ("COLMAP model (text)", colmap_text),
        ("COLMAP model (binary)", colmap_binary),
        ("Middlebury multi-view", middlebury),
        ("Seurat manifest", |folder| {
            write_json(folder, "manifest.json", &seurat(folder));
        }),
        ("Seurat manifest", |folder| {
            write_json(folder, "manifest.json", &unreal_seurat(folder));
        }),
    ];
    for (name, write) in formats {
        let folder = tempfile::tempdir().expect("a folder");
        write(folder.path());
        let set = open(folder.path()).expect(name);
        assert_eq!((set.format, set.views.len()), (name, 2));
        for (view, pose) in set.views.iter().zip(poses()) {
            assert_eq!(view.size_px, SIZE, "{name}");
            let Lens::Pinhole(pinhole) = view.lens else {
                panic!("{name}: a pinhole")
            };
            let close =
                |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs().max((a[1] - b[1]).abs()) < 1e-9;
            assert!(
                close(pinhole.focal_px, FOCAL) && close(pinhole.principal_px, PRINCIPAL),
                "{name}: {pinhole:?}"
            );
            assert!(
                (view.pose.eye - pose.1).length() < 1e-9,
                "{name}: {}",
                view.pose.eye
            );
            assert!(
                (view.pose.world_from_eye.x_axis - pose.0.x_axis).length() < 1e-9,
                "{name}"
            );
            assert!(
                (view.pose.world_from_eye.z_axis - pose.0.z_axis).length() < 1e-9,
                "{name}"
            );
            let loaded = view.load().expect(name);
            if let Some(point) = loaded.point_at(20, 5) {
                // Half a millimetre of rounding; of window depth half a step times Z^2 / near (C1):
                // 0.4 mm.
                assert!(
                    (point.z + 2.0).abs() < 1e-3,
                    "{name}: the wall is at -2, found {point}"
                );
            } else {
                assert!(view.depth.is_none(), "{name}");
            }
        }
        let report = check(&set, 4, &mut |_| {}).expect(name);
        assert_eq!(report.warnings, Vec::<String>::new(), "{name}");
        if set.views_with_depth().count() == 2 {
            let residual = &report.residuals[0];
            assert!(
                residual.overlap > 0.5 && residual.relative_depth < 1e-3,
                "{name}: {residual:?}"
            );
            // Bilinear lookups in a texture of a twentieth of a period a pixel.
            assert!(residual.color_levels < 6.0, "{name}: {residual:?}");
        }
    }
}

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

/// Red and green are swapped by name, and nothing is masked out although the file's alpha is zero.
#[test]
fn manifest_selects_channels() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut value = seurat(folder.path());
    let pixel = |x, y| image::Rgba([x as u8, y as u8, 7, 0]);
    image::RgbaImage::from_fn(SIZE[0], SIZE[1], pixel)
        .save(folder.path().join("c0.png"))
        .expect("written");
    // The largest value below 1 in one corner.
    let step = |x, y| {
        if [x, y] == [0, 0] {
            u16::MAX
        } else {
            (depth(poses()[0], x, y) * 16_000.0) as u16
        }
    };
    let rgba = |x, y| image::Rgba([9, 8, 7, step(x, y)]);
    let with_depth = ImageBuffer::<image::Rgba<u16>, Vec<u16>>::from_fn(SIZE[0], SIZE[1], rgba);
    with_depth
        .save(folder.path().join("d0.png"))
        .expect("written");
    let view = &mut value["view_groups"][0]["views"][0];
    view["projective_camera"]["depth_type"] = json!("EYE_Z");
    view["depth_image_file"]["color"]["channel_0"] = json!("G");
    view["depth_image_file"]["color"]["channel_1"] = json!("R");
    view["depth_image_file"]["color"]["channel_2"] = json!("CONSTANT_ZERO");
    view["depth_image_file"]["depth"]["channel_0"] = json!("A");
    let load = |value: &Value| {
        write_json(folder.path(), "manifest.json", value);
        open(folder.path()).expect("opens").views[0].load()
    };
    let loaded = load(&value).expect("loads");
    assert_eq!(loaded.color[(5 * SIZE[0] + 20) as usize], [5, 20, 0, 255]);
    let expected = depth(poses()[0], 20, 5) * 16_000.0 / 65_535.0;
    assert!((f64::from(loaded.depth_at(20, 5).expect("known")) - expected).abs() < 1e-4);
    assert_eq!(
        loaded.depth_at(0, 0),
        Some(1.0),
        "a sensor's \"none\" is a share like any other"
    );
    for (of, key) in [("color", "channel_alpha"), ("depth", "channel_0")] {
        let mut wrong = value.clone();
        wrong["view_groups"][0]["views"][0]["depth_image_file"][of][key] = json!("W");
        let error = load(&wrong).expect_err("no such channel").to_string();
        assert!(error.contains("0.png: has no channel W"), "{error}");
    }
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
