//! Tests of the layouts of image sets, on folders of tiny images.

use crate::{ImageSet, ImageSetOptions, Lens};
use glam::DVec3;
use image::{Luma, Rgb, RgbImage};
use std::path::Path;
use tempfile::TempDir;

fn folder(files: &[(&str, &str)], images: &[&str], depths: &[&str]) -> TempDir {
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

fn open(folder: &Path) -> ImageSet {
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

#[test]
fn largest_model_read_and_others_named() {
    let cameras = "1 PINHOLE 8 6 5 5 4 3\n";
    let files = [
        ("sparse/0/cameras.txt", cameras),
        ("sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 a.png\n"),
        ("sparse/1/cameras.txt", cameras),
        (
            "sparse/1/images.txt",
            "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 nan 0 0 1 b.png\n3 1 0 0 0 0 0 1 1 c.PNG\n",
        ),
    ];
    let folder = folder(
        &files,
        &["images/a.png", "images/b.png", "images/c.png"],
        &[],
    );
    let set = open(folder.path());
    assert_eq!(set.views.len(), 2);
    let notes = set.notes.join("\n");
    assert!(notes.contains("read sparse/1 with 3 images"), "{notes}");
    assert!(notes.contains("sparse/0 with 1 images"), "{notes}");
    assert!(notes.contains("left out 1 of 3 frames: b.png"), "{notes}");
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
