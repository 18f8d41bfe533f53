//! Readers of image sets: every format reads back as the same cameras and points.

use super::wall::{
    FOCAL, PRINCIPAL, SIZE, colmap_binary, colmap_text, depth, middlebury, open, poses, rgbd,
    seurat, transforms, unreal_seurat, write_json,
};
use headbox_images::{Lens, check};
use image::ImageBuffer;
use serde_json::{Value, json};
use std::path::Path;

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
