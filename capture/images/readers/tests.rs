//! Tests of the layouts of image sets, on folders of tiny images.

use crate::{DepthPicture, ImageSet, ImageSetOptions, Lens, write_depth_exr};
use glam::DVec3;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, Luma, Rgb, RgbImage};
use std::path::Path;
use tempfile::TempDir;

pub(crate) fn folder(files: &[(&str, &str)], images: &[&str], depths: &[&str]) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let create = |name: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        path
    };
    for (name, text) in files {
        std::fs::write(create(name), text).expect("written");
    }
    for name in images {
        let picture = RgbImage::from_pixel(8, 6, Rgb([9, 8, 7]));
        picture.save(create(name)).expect("written");
    }
    for name in depths {
        let picture = image::ImageBuffer::from_pixel(8, 6, Luma([5000u16]));
        picture.save(create(name)).expect("written");
    }
    folder
}

pub(crate) fn open(folder: &Path) -> ImageSet {
    ImageSet::open(folder, &ImageSetOptions::default()).expect("opens")
}

/// Checks the camera of the first view: eye, focal length, principal point, and the world's
/// direction of the image's right and down.
fn check(set: &ImageSet, eye: [f64; 3], focal: f64, principal: [f64; 2], axes: [DVec3; 2]) {
    let view = &set.views[0];
    let Lens::Pinhole(lens) = view.lens else {
        panic!("not a pinhole")
    };
    assert_eq!((lens.focal_px, lens.principal_px), ([focal; 2], principal));
    assert!(
        view.pose.eye.distance(DVec3::from(eye)) < 1e-12,
        "{:?}",
        view.pose
    );
    let turn = view.pose.world_from_eye;
    assert!(turn.x_axis.distance(axes[0]) < 1e-12 && (-turn.y_axis).distance(axes[1]) < 1e-12);
}

const POSE: &str = "1 0 0 0.5\n0 1 0 0\n0 0 1 2\n0 0 0 1\n";
const LOST: &str = "-inf -inf -inf -inf\nNaN 1 0 0\n0 0 1 2\n0 0 0 1\n";
const OPENCV: [DVec3; 2] = [DVec3::X, DVec3::Y];

#[test]
fn scannet_opens_without_lost_frame() {
    let files = [
        (
            "intrinsic/intrinsic_color.txt",
            "5 0 3.5 0\n0 5 2.5 0\n0 0 1 0\n0 0 0 1\n",
        ),
        ("pose/2.txt", POSE),
        ("pose/10.txt", POSE),
        ("pose/3.txt", LOST),
    ];
    let images = ["color/2.jpg", "color/3.jpg", "color/10.jpg"];
    let folder = folder(&files, &images, &["depth/2.png", "depth/3.png"]);
    let set = open(folder.path());
    let names: Vec<&str> = set.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["2.jpg", "10.jpg"], "in the order of numbers");
    check(&set, [0.5, 0.0, 2.0], 5.0, [4.0, 3.0], OPENCV);
    assert!((set.views[0].load().expect("loads").depth[0] - 5.0).abs() < 1e-6);
    let notes = set.notes.join("\n");
    assert!(notes.contains("left out 1 of 3 frames: 3.jpg"), "{notes}");
    assert!(notes.contains("without depth: 10.jpg"), "{notes}");
}

#[test]
fn tum_matches_times_and_unit() {
    let files = [
        ("rgb.txt", "# color\n1.00 rgb/a.png\n2.00 rgb/b.png\n"),
        ("depth.txt", "1.01 depth/a.png\n"),
        (
            "groundtruth.txt",
            "0.5 9 9 9 0 0 0 1\n0.995 0.5 0 2 0 0 0 1\n",
        ),
        ("camera-intrinsics.txt", "5 0 3.5 0 5 2.5 0 0 1"),
    ];
    let folder = folder(&files, &["rgb/a.png", "rgb/b.png"], &["depth/a.png"]);
    let set = open(folder.path());
    assert_eq!(set.views.len(), 1);
    check(&set, [0.5, 0.0, 2.0], 5.0, [4.0, 3.0], OPENCV);
    assert!((set.views[0].load().expect("loads").depth[0] - 1.0).abs() < 1e-6);
    assert!(set.notes.join("\n").contains("b.png"), "{:?}", set.notes);
    std::fs::remove_file(folder.path().join("camera-intrinsics.txt")).expect("removed");
    let error = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect_err("unknown");
    assert!(error.to_string().contains("TUM"), "{error}");
}

#[test]
fn replica_reads_trajectory_and_scale() {
    let files = [
        ("traj.txt", "1 0 0 0.5 0 1 0 0 0 0 1 2 0 0 0 1\n"),
        (
            "cam_params.json",
            r#"{"camera": {"w": 8, "h": 6, "fx": 5, "fy": 5, "cx": 3.5, "cy": 2.5, "scale": 2500}}"#,
        ),
    ];
    let images = ["results/frame000000.jpg"];
    let folder = folder(&files, &images, &["results/depth000000.png"]);
    let set = open(folder.path());
    check(&set, [0.5, 0.0, 2.0], 5.0, [4.0, 3.0], OPENCV);
    assert!((set.views[0].load().expect("loads").depth[0] - 2.0).abs() < 1e-6);
}

#[test]
fn polycam_has_axes_of_opengl() {
    let camera = r#"{"fx": 10, "fy": 10, "cx": 8, "cy": 6, "width": 16, "height": 12,
        "t_00": 1, "t_01": 0, "t_02": 0, "t_03": 0.5, "t_10": 0, "t_11": 1, "t_12": 0, "t_13": 0,
        "t_20": 0, "t_21": 0, "t_22": 1, "t_23": 2}"#;
    let files = [("keyframes/corrected_cameras/7.json", camera)];
    let images = ["keyframes/corrected_images/7.jpg"];
    let folder = folder(&files, &images, &["keyframes/depth/7.png"]);
    let set = open(folder.path());
    check(
        &set,
        [0.5, 0.0, 2.0],
        5.0,
        [4.0, 3.0],
        [DVec3::X, -DVec3::Y],
    );
    assert!(set.views[0].depth.is_some());
}

#[test]
fn record3d_opens() {
    let metadata = r#"{"w": 8, "h": 6, "K": [5, 0, 0, 0, 5, 0, 4, 3, 1],
        "poses": [[0, 0, 0, 1, 0.5, 0, 2]]}"#;
    let folder = folder(&[("metadata.json", metadata)], &["rgbd/0.jpg"], &[]);
    std::fs::write(folder.path().join("rgbd/0.depth"), b"").expect("written");
    let set = open(folder.path());
    check(
        &set,
        [0.5, 0.0, 2.0],
        5.0,
        [4.0, 3.0],
        [DVec3::X, -DVec3::Y],
    );
    assert!(
        set.notes.join("\n").contains("1 compressed"),
        "{:?}",
        set.notes
    );
}

#[test]
fn splat_cameras_scaled_to_image() {
    let cameras = r#"[{"id": 0, "img_name": "a", "width": 16, "height": 12, "fx": 10, "fy": 10,
        "position": [0.5, 0, 2], "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]},
        {"id": 1, "img_name": "missing", "width": 8, "height": 6, "fx": 5, "fy": 5,
        "position": [0, 0, 0], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}]"#;
    let folder = folder(&[("cameras.json", cameras)], &["images/a.png"], &[]);
    let set = open(folder.path());
    check(
        &set,
        [0.5, 0.0, 2.0],
        5.0,
        [4.0, 3.0],
        [DVec3::Y, -DVec3::X],
    );
    let notes = set.notes.join("\n");
    assert!(
        notes.contains("missing") && notes.contains("scaled"),
        "{notes}"
    );
}

#[test]
fn metashape_scales_and_centres() {
    let xml = r#"<?xml version="1.0"?><document version="1.5.0"><chunk><sensors>
        <sensor id="0" type="frame"><resolution width="8" height="6"/>
        <calibration class="initial"><f>99</f></calibration>
        <calibration class="adjusted"><f>5</f><cx>1</cx><cy>-1</cy></calibration></sensor></sensors>
        <cameras><camera id="0" sensor_id="0" label="a">
        <transform>1 0 0 0.25 0 1 0 0 0 0 1 1 0 0 0 1</transform></camera>
        <camera id="1" sensor_id="0" label="b"/></cameras>
        <transform><rotation>0 1 0 1 0 0 0 0 -1</rotation><translation>6e6 0 0</translation>
        <scale>2</scale></transform></chunk></document>"#;
    let folder = folder(
        &[("cameras.xml", xml)],
        &["images/a.jpg", "images/b.jpg"],
        &[],
    );
    let set = open(folder.path());
    check(&set, [0.5, 0.0, 2.0], 5.0, [5.0, 2.0], OPENCV);
    assert!(
        set.notes.join("\n").contains("not aligned"),
        "{:?}",
        set.notes
    );
}

/// Opens a `transforms.json` with the pose of two frames, and keys.
fn transforms(keys: &str, second: &str) -> ImageSet {
    let pose = "[[1,0,0,0.5],[0,1,0,0],[0,0,1,2],[0,0,0,1]]";
    let json = format!(
        r#"{{{keys} "frames": [{{"file_path": "a.png", "transform_matrix": {pose}}},
        {{"file_path": "b.png", "transform_matrix": {second}}}]}}"#
    );
    let folder = folder(&[("transforms.json", &json)], &["a.png", "b.png"], &[]);
    open(folder.path())
}

const IDENTITY: &str = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";

#[test]
fn unusable_frame_left_out() {
    let scaled = "[[1.01,0,0,0],[0,1.01,0,0],[0,0,1.01,0],[0,0,0,1]]";
    let bare = "[[NaN,0,0,0],[0,1,0,-Infinity],[0,0,1,0],[0,0,0,1]]";
    for second in [scaled, bare, "[[1,0,0,0]]", "null"] {
        let set = transforms(r#""fl_x": 5,"#, second);
        assert_eq!(set.views.len(), 1, "{second}");
        assert!(
            set.notes
                .join("\n")
                .contains("left out 1 of 2 frames: b.png"),
            "{:?}",
            set.notes
        );
    }
}

#[test]
fn lens_keys_read_or_reported() {
    let source = |keys: &str| transforms(keys, IDENTITY).views[0].source;
    assert_eq!(source(r#""fl_x": 5, "k1": 0.1,"#), None);
    assert!(source(r#""fl_x": 5, "is_fisheye": true,"#).is_some());
    assert_eq!(source(r#""fl_x": 5, "is_fisheye": false,"#), None);
    assert!(source(r#""fl_x": 5, "camera_model": "OPENCV", "k4": 0.3,"#).is_some());
    assert!(source(r#""x_fov": 50, "camera_model": "OPENCV_FISHEYE","#).is_some());
    let set = transforms(r#""x_fov": 90, "aabb_scale": 4, "barrel": 1,"#, IDENTITY);
    let focal = set.views[0].pinhole().expect("a pinhole").focal_px[0];
    assert!((focal - 4.0).abs() < 1e-12, "{focal}");
    let notes = set.notes.join("\n");
    assert!(
        notes.contains("1 unknown keys") && notes.contains("barrel"),
        "{notes}"
    );
    assert!(!notes.contains("aabb_scale"), "{notes}");
}

/// Saves an image of 6x8 pixels that is stored on its side, with EXIF orientation 6.
fn save_on_side(path: &Path) {
    let exif = *b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    let mut file = Vec::new();
    let mut encoder = PngEncoder::new(&mut file);
    encoder.set_exif_metadata(exif.to_vec()).expect("supported");
    let pixels = [9; 8 * 6 * 3];
    encoder
        .write_image(&pixels, 8, 6, ExtendedColorType::Rgb8)
        .expect("fits");
    std::fs::write(path, file).expect("written");
}

#[test]
fn image_on_its_side_read_upright() {
    const POLYCAM: &str = r#"{"fx": 5, "fy": 5, "cx": 3, "cy": 4, "width": 6, "height": 8,
        "t_00": 1, "t_01": 0, "t_02": 0, "t_03": 0, "t_10": 0, "t_11": 1, "t_12": 0, "t_13": 0,
        "t_20": 0, "t_21": 0, "t_22": 1, "t_23": 0}"#;
    const RECORD3D: &str = r#"{"w": 6, "h": 8, "K": [5, 0, 0, 0, 5, 0, 3, 4, 1],
        "poses": [[0, 0, 0, 1, 0, 0, 0]]}"#;
    const SPLATS: &str = r#"[{"id": 0, "img_name": "0", "width": 6, "height": 8, "fx": 5, "fy": 5,
        "position": [0, 0, 0], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}]"#;
    let sets = [
        (
            vec![("keyframes/cameras/0.json", POLYCAM)],
            "keyframes/images/0.jpg",
        ),
        (vec![("metadata.json", RECORD3D)], "rgb/0.jpg"),
        (vec![("cameras.json", SPLATS)], "images/0.png"),
        (
            vec![
                ("intrinsic/intrinsic_color.txt", "5 5 2.5 3.5"),
                ("pose/0.txt", POSE),
            ],
            "color/0.jpg",
        ),
        (
            vec![
                ("rgb.txt", "1 rgb/0.png"),
                ("groundtruth.txt", "1 0 0 0 0 0 0 1"),
                ("intrinsics.txt", "5 5 2.5 3.5"),
            ],
            "rgb/0.png",
        ),
    ];
    for (files, image) in sets {
        let folder = folder(&files, &[image], &[]);
        save_on_side(&folder.path().join(image));
        let set = open(folder.path());
        assert_eq!(set.views[0].size_px, [6, 8], "{}", set.format);
        let notes = set.notes.join("\n");
        assert!(notes.contains("turned upright"), "{notes}");
        assert!(!notes.contains("sizes of images differ"), "{notes}");
        let lens = set.views[0].pinhole().expect("a pinhole");
        assert_eq!((lens.focal_px, lens.principal_px), ([5.0; 2], [3.0, 4.0]));
    }
}

/// Opens a ScanNet sequence of one frame with these intrinsics of colour and depth.
fn scannet_notes(color: &str, depth: &str) -> String {
    let files = [
        ("intrinsic/intrinsic_color.txt", color),
        ("intrinsic/intrinsic_depth.txt", depth),
        ("pose/0.txt", POSE),
    ];
    let folder = folder(&files, &["color/0.jpg"], &["depth/0.png"]);
    open(folder.path()).notes.join("\n")
}

#[test]
fn intrinsics_that_do_not_fit_noted() {
    assert_eq!(scannet_notes("5 5 3.5 2.5", "5 5 3.5 2.5"), "");
    let notes = scannet_notes("5 5 3.5 2.5", "4 4 3.5 2.5");
    assert!(notes.contains("another field of view"), "{notes}");
    let notes = scannet_notes("10 10 7.5 5.5", "10 10 7.5 5.5");
    assert!(notes.contains("images of another size"), "{notes}");
}

#[test]
fn replica_scales_intrinsics_and_pairs_by_number() {
    let line = "1 0 0 0.5 0 1 0 0 0 0 1 2 0 0 0 1\n";
    let camera = r#"{"camera": {"w": 16, "h": 12, "fx": 10, "fy": 10, "cx": 7.5, "cy": 5.5, "scale": 2500}}"#;
    let trajectory = line.repeat(3);
    let files = [
        ("traj.txt", trajectory.as_str()),
        ("cam_params.json", camera),
    ];
    let images = [
        "results/frame0.jpg",
        "results/frame1.jpg",
        "results/frame2.jpg",
    ];
    let depths = ["results/depth0.png", "results/depth2.png"];
    let folder = folder(&files, &images, &depths);
    let set = open(folder.path());
    check(&set, [0.5, 0.0, 2.0], 5.0, [4.0, 3.0], OPENCV);
    let has_depth: Vec<bool> = set.views.iter().map(|view| view.depth.is_some()).collect();
    assert_eq!(has_depth, [true, false, true]);
    let last = set.views[2].depth.as_ref().expect("depth");
    assert!(last.path.ends_with("depth2.png"), "{last:?}");
}

#[test]
fn float_depth_of_tum_is_metres() {
    let files = [
        ("rgb.txt", "1 rgb/0.png"),
        ("depth.txt", "1 depth/0.exr"),
        ("groundtruth.txt", "1 0 0 0 0 0 0 1"),
        ("intrinsics.txt", "5 5 3.5 2.5"),
        ("depth/note.txt", ""),
    ];
    let folder = folder(&files, &["rgb/0.png"], &[]);
    let depth = DepthPicture {
        width: 8,
        height: 6,
        values: vec![2.0; 48],
    };
    write_depth_exr(&depth, &folder.path().join("depth/0.exr")).expect("written");
    let view = open(folder.path()).views[0].load().expect("loads");
    assert_eq!(view.depth[0], 2.0);
}

#[test]
fn mask_of_levels_0_and_1_keeps_1() {
    let json = format!(
        r#"{{"fl_x": 5, "frames": [{{"file_path": "a.png", "mask_path": "m.png", "transform_matrix": {IDENTITY}}}]}}"#
    );
    let folder = folder(&[("transforms.json", &json)], &["a.png"], &[]);
    let mask = image::GrayImage::from_fn(8, 6, |x, _| Luma([u8::from(x < 4)]));
    mask.save(folder.path().join("m.png")).expect("written");
    let view = open(folder.path()).views[0].load().expect("loads");
    assert_eq!([view.color[0][3], view.color[7][3]], [255, 0]);
}

#[test]
fn largest_sequence_read_and_others_named() {
    let files = [
        ("camera-intrinsics.txt", "5 5 3.5 2.5"),
        ("seq-01/frame-0.pose.txt", POSE),
        ("seq-02/frame-0.pose.txt", POSE),
        ("seq-02/frame-1.pose.txt", POSE),
    ];
    let images = ["seq-01/frame-0.color.png", "seq-02/frame-0.color.png"];
    let folder = folder(&files, &images, &[]);
    let set = open(folder.path());
    let notes = set.notes.join("\n");
    assert_eq!(set.views.len(), 1, "{notes}");
    assert!(
        notes.contains("read the sequence seq-02 with 2 frames"),
        "{notes}"
    );
    assert!(notes.contains("seq-01 with 1 frames"), "{notes}");
    assert!(
        notes.contains("left out 1 of 2 frames: frame-1.pose.txt"),
        "{notes}"
    );
}

#[test]
fn metashape_applies_transform_of_largest_chunk() {
    let sensors = r#"<sensors><sensor id="0" type="frame"><resolution width="8" height="6"/>
        <calibration class="adjusted"><f>5</f></calibration></sensor></sensors>"#;
    let camera = |label: &str, x: f64| {
        format!(
            r#"<camera sensor_id="0" component_id="3" label="{label}"><transform>1 0 0 {x} 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>"#
        )
    };
    let small = camera("c", 0.0);
    let cameras = camera("a", -0.25) + &camera("b", 0.25);
    let transform = "<transform><rotation>0 -1 0 1 0 0 0 0 1</rotation>\
        <translation>0 0 1</translation><scale>2</scale></transform>";
    let component = format!("<components><component id=\"3\">{transform}</component></components>");
    for (component, transform) in [("", transform), (component.as_str(), "")] {
        let xml = format!(
            "<document><chunk label=\"first\">{sensors}<cameras>{small}</cameras></chunk>\
             <chunk>{sensors}<cameras>{cameras}</cameras>{component}{transform}</chunk></document>"
        );
        let images = ["a.jpg", "b.jpg", "c.jpg"];
        let folder = folder(&[("cameras.xml", &xml)], &images, &[]);
        let set = open(folder.path());
        check(
            &set,
            [0.0, -0.5, 1.0],
            5.0,
            [4.0, 3.0],
            [DVec3::Y, -DVec3::X],
        );
        assert_eq!(set.views.len(), 2);
        let notes = set.notes.join("\n");
        assert!(notes.contains("first with 1 cameras"), "{notes}");
        assert!(notes.contains("scales by 2"), "{notes}");
    }
}

#[test]
fn tum_reads_associations_in_either_order() {
    let line = [
        "1 rgb/a.png 1.01 depth/a.png\n",
        "7 depth/a.png 1 rgb/a.png\n",
    ];
    for line in line {
        let files = [
            ("associations.txt", line),
            ("groundtruth.txt", "1 0.5 0 2 0 0 0 1\n"),
            ("camera-intrinsics.txt", "5 0 3.5 0 5 2.5 0 0 1"),
        ];
        let set = open(folder(&files, &["rgb/a.png"], &["depth/a.png"]).path());
        check(&set, [0.5, 0.0, 2.0], 5.0, [4.0, 3.0], OPENCV);
        assert!(set.views[0].depth.is_some(), "{line}");
    }
    let files = [
        ("associations.txt", "7 depth/a.png one rgb/a.png\n"),
        ("groundtruth.txt", "1 0.5 0 2 0 0 0 1\n"),
    ];
    let folder = folder(&files, &["rgb/a.png"], &["depth/a.png"]);
    let error = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect_err("no time");
    assert!(error.to_string().contains("expected a time"), "{error}");
}

#[test]
fn transforms_of_any_name_open() {
    let json = format!(
        r#"{{"fl_x": 5, "w": 8, "h": 6, "frames": [{{"file_path": "a.png", "transform_matrix": {IDENTITY}}}]}}"#
    );
    let folder = folder(&[("transforms_undistorted.json", &json)], &["a.png"], &[]);
    assert_eq!(
        open(&folder.path().join("transforms_undistorted.json"))
            .views
            .len(),
        1
    );
}

#[test]
fn unusable_depth_of_some_frames_left_out() {
    let frame = |depth: &str| {
        format!(
            r#"{{"file_path": "a.png", "depth_file_path": "{depth}", "transform_matrix": {IDENTITY}}}"#
        )
    };
    let json = |depths: [&str; 3]| {
        let frames = depths.map(frame).join(",");
        format!(r#"{{"fl_x": 5, "w": 8, "h": 6, "frames": [{frames}]}}"#)
    };
    let opened = |depths: [&str; 3]| {
        let files = [("transforms.json", &*json(depths)), ("bad.png", "no image")];
        open(folder(&files, &["a.png"], &["d.png"]).path())
    };
    let set = opened(["d.png", "none.png", "bad.png"]);
    assert_eq!(set.views_with_depth().count(), 1);
    let notes = set.notes.join("\n");
    assert!(notes.contains("2 of 3 depth files"), "{notes}");
    // Without any, loading reports the problem.
    assert_eq!(opened(["bad.png"; 3]).views_with_depth().count(), 3);
}

#[test]
fn broken_image_with_depth_left_out() {
    let frame = |name: &str| {
        format!(
            r#"{{"file_path": "{name}", "depth_file_path": "d.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}}"#
        )
    };
    let frames = ["a.png", "empty.png", "text.png", "missing.png"].map(frame);
    let json = format!(
        r#"{{"fl_x": 5, "w": 8, "h": 6, "frames": [{}]}}"#,
        frames.join(",")
    );
    let files = [
        ("transforms.json", json.as_str()),
        ("empty.png", ""),
        ("text.png", "an error of the server"),
    ];
    let folder = folder(&files, &["a.png"], &["d.png"]);
    let set = open(folder.path());
    let notes = set.notes.join("\n");
    assert_eq!(set.views.len(), 1, "{notes}");
    assert!(notes.contains("1 of 4 images are missing"), "{notes}");
    assert!(notes.contains("2 of 4 images cannot be read"), "{notes}");
    std::fs::write(folder.path().join("a.png"), "").expect("written");
    let error = ImageSet::open(folder.path(), &ImageSetOptions::default()).expect_err("no image");
    assert!(error.to_string().contains("a.png"), "{error}");
}
