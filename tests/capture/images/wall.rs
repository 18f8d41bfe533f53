//! Image sets of one scene, a wall and two cameras, in every format.

use glam::{DMat3, DMat4, DVec3, dvec3};
use headbox_core::file_frame::FileFrame;
use headbox_images::{ImageSet, ImageSetOptions, ImagesError};
use image::{ImageBuffer, Luma, Rgb, RgbImage};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

pub(super) const SIZE: [u32; 2] = [32, 24];
pub(super) const FOCAL: [f64; 2] = [40.0, 42.0];
pub(super) const PRINCIPAL: [f64; 2] = [16.3, 11.7];

/// Two camera poses in front of a wall at z = -2: rotation (columns right, up, back) and position.
pub(super) fn poses() -> [(DMat3, DVec3); 2] {
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
pub(super) fn depth(pose: (DMat3, DVec3), x: u32, y: u32) -> f64 {
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
pub(super) fn matrix((rotation, eye): (DMat3, DVec3)) -> DMat4 {
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

pub(super) fn rows4(matrix: DMat4) -> Vec<f64> {
    matrix.transpose().to_cols_array().to_vec()
}

pub(super) fn join_numbers(numbers: impl IntoIterator<Item = f64>) -> String {
    numbers
        .into_iter()
        .map(|number| format!("{number:.12e}"))
        .collect::<Vec<_>>()
        .join(" ")
}

pub(super) fn rgbd(folder: &Path) {
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

pub(super) fn transforms(folder: &Path) -> Value {
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

pub(super) fn write_json(folder: &Path, name: &str, value: &Value) {
    fs::write(folder.join(name), value.to_string()).expect("written");
}

pub(super) fn colmap_text(folder: &Path) {
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

pub(super) fn colmap_binary(folder: &Path) {
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

pub(super) fn middlebury(folder: &Path) {
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
pub(super) fn seurat(folder: &Path) -> Value {
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
pub(super) fn unreal_seurat(folder: &Path) -> Value {
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

pub(super) fn open(folder: &Path) -> Result<ImageSet, ImagesError> {
    ImageSet::open(folder, &ImageSetOptions::default())
}
