//! Mutated image sets of all layouts: descriptions, poses, photographs and depth files.

use crate::mutations::{Alone, Files, written_bytes};
use headbox_images::depth::DepthPicture;
use headbox_images::{ImageSet, ImageSetOptions, write_depth_exr};
use image::{ImageFormat, Luma, Rgb, RgbImage};
use std::path::Path;

/// Pose of a camera at (0.5, 0, 2), as a matrix of four rows.
const POSE: &str = "1 0 0 0.5\n0 1 0 0\n0 0 1 2\n0 0 0 1\n";

fn photograph(name: &str) -> (String, Vec<u8>) {
    let format = ImageFormat::from_path(name).expect("known");
    let picture = RgbImage::from_fn(8, 6, |x, y| Rgb([x as u8 * 30, y as u8 * 40, 7]));
    let bytes = written_bytes(|path| picture.save_with_format(path, format).expect("written"));
    (name.into(), bytes)
}

fn depth(name: &str) -> (String, Vec<u8>) {
    let picture = image::ImageBuffer::from_fn(8, 6, |x, y| Luma([(4000 + 50 * x + 9 * y) as u16]));
    let save = |path: &Path| picture.save_with_format(path, ImageFormat::Png);
    (
        name.into(),
        written_bytes(|path| save(path).expect("written")),
    )
}

fn depth_exr(name: &str) -> (String, Vec<u8>) {
    let depth = DepthPicture {
        width: 8,
        height: 6,
        values: (0..48).map(|i| 1.0 + 0.1 * i as f32).collect(),
    };
    let bytes = written_bytes(|path| write_depth_exr(&depth, path).expect("written"));
    (name.into(), bytes)
}

fn text(name: &str, text: &str) -> (String, Vec<u8>) {
    (name.into(), text.into())
}

/// Opens a set and loads its views.
fn open(folder: &Path) -> bool {
    let options = ImageSetOptions::default();
    let Ok(set) = ImageSet::open(folder, &options) else {
        return false;
    };
    let pixels = |view: &headbox_images::LoadedView| view.size_px[0] * view.size_px[1];
    for view in set.views.iter().take(4) {
        if let Ok(loaded) = view.load() {
            assert_eq!(loaded.color.len(), pixels(&loaded) as usize);
        }
    }
    true
}

fn scannet() -> Files {
    let k = "5 0 3.5 0\n0 5 2.5 0\n0 0 1 0\n0 0 0 1\n";
    vec![
        text("intrinsic/intrinsic_color.txt", k),
        text("pose/2.txt", POSE),
        text("pose/10.txt", POSE),
        photograph("color/2.jpg"),
        photograph("color/10.jpg"),
        depth("depth/2.png"),
        depth("depth/10.png"),
    ]
}

fn tum() -> Files {
    let truth = "0.5 9 9 9 0 0 0 1\n0.995 0.5 0 2 0 0 0 1\n2 0.6 0 2 0 0 0 1\n";
    vec![
        text("rgb.txt", "# color\n1.00 rgb/a.png\n2.00 rgb/b.png\n"),
        text("depth.txt", "1.01 depth/a.png\n2.01 depth/b.png\n"),
        text("groundtruth.txt", truth),
        text("camera-intrinsics.txt", "5 0 3.5 0 5 2.5 0 0 1"),
        photograph("rgb/a.png"),
        photograph("rgb/b.png"),
        depth("depth/a.png"),
        depth("depth/b.png"),
    ]
}

fn replica() -> Files {
    let parameters =
        r#"{"camera": {"w": 8, "h": 6, "fx": 5, "fy": 5, "cx": 3.5, "cy": 2.5, "scale": 2500}}"#;
    vec![
        text("traj.txt", "1 0 0 0.5 0 1 0 0 0 0 1 2 0 0 0 1\n"),
        text("cam_params.json", parameters),
        photograph("results/frame000000.jpg"),
        depth("results/depth000000.png"),
    ]
}

fn polycam() -> Files {
    let camera = r#"{"fx": 10, "fy": 10, "cx": 8, "cy": 6, "width": 16, "height": 12,
        "t_00": 1, "t_01": 0, "t_02": 0, "t_03": 0.5, "t_10": 0, "t_11": 1, "t_12": 0, "t_13": 0,
        "t_20": 0, "t_21": 0, "t_22": 1, "t_23": 2}"#;
    vec![
        text("keyframes/corrected_cameras/7.json", camera),
        photograph("keyframes/corrected_images/7.jpg"),
        depth("keyframes/depth/7.png"),
    ]
}

fn record3d() -> Files {
    let metadata = r#"{"w": 8, "h": 6, "K": [5, 0, 0, 0, 5, 0, 4, 3, 1],
        "poses": [[0, 0, 0, 1, 0.5, 0, 2]]}"#;
    vec![
        text("metadata.json", metadata),
        photograph("rgbd/0.jpg"),
        text("rgbd/0.depth", "compressed"),
    ]
}

fn gaussians() -> Files {
    let cameras = r#"[{"id": 0, "img_name": "a", "width": 16, "height": 12, "fx": 10, "fy": 10,
        "position": [0.5, 0, 2], "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}]"#;
    vec![text("cameras.json", cameras), photograph("images/a.png")]
}

fn metashape() -> Files {
    let xml = r#"<?xml version="1.0"?><document version="1.5.0"><chunk><sensors>
        <sensor id="0" type="frame"><resolution width="8" height="6"/>
        <calibration class="adjusted"><f>5</f><cx>1</cx><cy>-1</cy><k1>0.01</k1></calibration></sensor></sensors>
        <cameras><camera id="0" sensor_id="0" label="a">
        <transform>1 0 0 0.25 0 1 0 0 0 0 1 1 0 0 0 1</transform></camera></cameras>
        <transform><rotation>0 1 0 1 0 0 0 0 -1</rotation><translation>6e6 0 0</translation>
        <scale>2</scale></transform></chunk></document>"#;
    vec![text("cameras.xml", xml), photograph("images/a.jpg")]
}

fn middlebury() -> Files {
    let line = "v0.png 5 0 4 0 5 3 0 0 1 1 0 0 0 1 0 0 0 1 0.5 0 2\n";
    let lines = format!("1\n{line}");
    vec![text("wall_par.txt", &lines), photograph("v0.png")]
}

fn seurat() -> Files {
    let manifest = r#"{"view_groups": [{"views": [{"projective_camera": {"image_width": 8, "image_height": 6,
        "clip_from_eye_matrix": [1.25,0,0,0, 0,1.67,0,0, 0,0,-1.002,-0.2002, 0,0,-1,0],
        "world_from_eye_matrix": [1,0,0,0.5, 0,1,0,0, 0,0,1,2, 0,0,0,1], "depth_type": "WINDOW_Z"},
        "depth_image_file": {"color": {"path": "c.png", "channel_0": "R", "channel_1": "G", "channel_2": "B",
        "channel_alpha": "CONSTANT_ONE"}, "depth": {"path": "d.png", "channel_0": "R"}}}]}]}"#;
    vec![
        text("manifest.json", manifest),
        photograph("c.png"),
        depth("d.png"),
    ]
}

fn panorama() -> Files {
    let picture = RgbImage::from_fn(16, 8, |x, y| Rgb([x as u8 * 15, y as u8 * 30, 7]));
    let bytes = written_bytes(|path| {
        picture
            .save_with_format(path, ImageFormat::Png)
            .expect("written");
    });
    let depth = DepthPicture {
        width: 16,
        height: 8,
        values: (0..128).map(|i| 1.0 + 0.1 * i as f32).collect(),
    };
    let exr = written_bytes(|path| write_depth_exr(&depth, path).expect("written"));
    vec![("p.png".into(), bytes), ("p_depth.exr".into(), exr)]
}

/// `transforms.json` with depth files and a lens.
fn nerfstudio(depth: (String, Vec<u8>), keys: &str) -> Files {
    let frame = |name: &str, x: f64| {
        format!(
            r#"{{"file_path": "{name}", "depth_file_path": "{}", "transform_matrix": [[1,0,0,{x}],[0,1,0,0],[0,0,1,2],[0,0,0,1]]}}"#,
            depth.0
        )
    };
    let json = format!(
        r#"{{"fl_x": 5, "fl_y": 5, "cx": 4, "cy": 3, "w": 8, "h": 6, {keys} "frames": [{}, {}]}}"#,
        frame("a.png", 0.0),
        frame("b.jpg", 0.4)
    );
    vec![
        text("transforms.json", &json),
        photograph("a.png"),
        photograph("b.jpg"),
        depth,
    ]
}

fn npy(name: &str) -> (String, Vec<u8>) {
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (6, 8), }\n";
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    (0..48).for_each(|i| bytes.extend((1.0 + i as f32).to_le_bytes()));
    (name.into(), bytes)
}

fn tiff(name: &str) -> (String, Vec<u8>) {
    let picture = image::ImageBuffer::from_fn(8, 6, |x, y| Luma([(4000 + 50 * x + 9 * y) as u16]));
    let save = |path: &Path| picture.save_with_format(path, ImageFormat::Tiff);
    (
        name.into(),
        written_bytes(|path| save(path).expect("written")),
    )
}

/// COLMAP map of depth.
fn map(name: &str) -> (String, Vec<u8>) {
    let mut bytes = b"8&6&1&".to_vec();
    (0..48).for_each(|i| bytes.extend((1.0 + i as f32).to_le_bytes()));
    (name.into(), bytes)
}

fn colmap_text() -> Files {
    vec![
        text(
            "sparse/0/cameras.txt",
            "# c\n1 OPENCV 8 6 5 5 4 3 0.1 0 0 0\n",
        ),
        text(
            "sparse/0/images.txt",
            "# i\n1 1 0 0 0 0 0 0 1 a.png\n1.5 2 1 3 4 -1\n2 1 0 0 0 0.3 0 0 1 b.png\n\n",
        ),
        text("sparse/0/points3D.txt", "1 1 2 -3.5 1 2 3 0.5 1 0 2 0\n"),
        photograph("images/a.png"),
        photograph("images/b.png"),
        map("stereo/depth_maps/a.png.geometric.bin"),
    ]
}

fn colmap_binary() -> Files {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend(7u32.to_le_bytes());
    cameras.extend(1i32.to_le_bytes());
    [8u64, 6]
        .iter()
        .for_each(|n| cameras.extend(n.to_le_bytes()));
    [5.0f64, 5.0, 4.0, 3.0]
        .iter()
        .for_each(|n| cameras.extend(n.to_le_bytes()));
    let mut images = 2u64.to_le_bytes().to_vec();
    for i in 0..2u32 {
        images.extend(i.to_le_bytes());
        [1.0, 0.0, 0.0, 0.0, f64::from(i), 0.0, 0.0]
            .iter()
            .for_each(|n| images.extend(n.to_le_bytes()));
        images.extend(7u32.to_le_bytes());
        images.extend(format!("{i}.png\0").bytes());
        images.extend(1u64.to_le_bytes().into_iter().chain([0; 24]));
    }
    let mut points = 1u64.to_le_bytes().to_vec();
    points.extend(7u64.to_le_bytes());
    [1.0f64, 2.0, -3.5]
        .iter()
        .for_each(|n| points.extend(n.to_le_bytes()));
    points.extend([1, 2, 3]);
    points.extend(0.5f64.to_le_bytes());
    points.extend(1u64.to_le_bytes().into_iter().chain([0; 8]));
    vec![
        ("sparse/0/cameras.bin".into(), cameras),
        ("sparse/0/images.bin".into(), images),
        ("sparse/0/points3D.bin".into(), points),
        photograph("images/0.png"),
        photograph("images/1.png"),
    ]
}

fn projections() -> Files {
    let p = "5 0 4 0\n0 5 3 0\n0 0 1 2\n";
    vec![text("v.000.P", p), photograph("v.000.png")]
}

#[test]
fn colmap_models() {
    let alone = Alone::lock();
    let open_with_points = |folder: &Path| {
        let points = headbox_images::read_sparse_points(folder);
        open(folder) && points.is_ok()
    };
    alone.try_folders(
        "COLMAP",
        &[colmap_text(), colmap_binary()],
        open_with_points,
    );
}

#[test]
fn nerfstudio_sets() {
    let alone = Alone::lock();
    let lens = r#""camera_model": "OPENCV", "k1": 0.1, "p1": 0.01,"#;
    let unit = r#""integer_depth_scale": 0.001,"#;
    let sets = [
        nerfstudio(depth("d.png"), unit),
        nerfstudio(depth_exr("d.exr"), lens),
        nerfstudio(npy("d.npy"), lens),
        nerfstudio(tiff("d.tif"), ""),
    ];
    alone.try_folders("transforms.json", &sets, open);
}

#[test]
fn rgbd_folders() {
    let alone = Alone::lock();
    alone.try_folders("RGB-D folders", &[scannet(), tum(), replica()], open);
}

#[test]
fn phone_exports() {
    let alone = Alone::lock();
    let sets = [polycam(), record3d(), gaussians(), metashape()];
    alone.try_folders("phone exports", &sets, open);
}

#[test]
fn other_sets() {
    let alone = Alone::lock();
    let sets = [middlebury(), seurat(), panorama(), projections()];
    alone.try_folders("other sets", &sets, open);
}
