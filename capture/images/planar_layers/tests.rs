//! An analytic scene of a panel with a bulge in front of a slanted wall, and invalid input.

use super::frames::Frame;
use super::labels::NONE;
use super::*;
use crate::readers::test_set::photographs;
use crate::{Distortion, Lens, LoadedView, Pinhole, Pose};
use glam::{DMat3, dvec3};
use headbox_core::random::Rng;
use image::Luma;
use std::path::Path;

const SIZE: [u32; 2] = [160, 120];
const FRAMES: usize = 5;
/// Index of the middle frame.
const MIDDLE: usize = 2;

/// Panel: position on Z, half size, height of the bulge, and radius of its sphere.
const PANEL_Z: f64 = -2.0;
const HALF: [f64; 2] = [0.42, 0.34];
const BULGE: f64 = 0.06;
const BALL: f64 = 0.6;

/// Wall: `WALL . p = WALL_OFFSET`.
const WALL: DVec3 = dvec3(0.25, 0.1, 1.0);
const WALL_OFFSET: f64 = -3.4;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Surface {
    Panel,
    Wall,
}

fn pose(i: usize) -> Pose {
    let off = i as f64 - MIDDLE as f64;
    Pose {
        eye: dvec3(0.16 * off, 0.05 * (i % 2) as f64, 0.0),
        world_from_eye: DMat3::from_rotation_y(0.06 * off) * DMat3::from_rotation_z(0.02 * off),
    }
}

fn lens() -> Lens {
    Lens::Pinhole(Pinhole {
        focal_px: [150.0, 150.0],
        principal_px: [80.5, 59.0],
        distortion: Distortion::default(),
    })
}

/// Returns the first surface that a ray hits, and the multiple of the ray.
fn hit(eye: DVec3, ray: DVec3) -> (Surface, f64) {
    let to_panel = (PANEL_Z - eye.z) / ray.z;
    let on_panel = eye + ray * to_panel;
    if on_panel.x.abs() < HALF[0] && on_panel.y.abs() < HALF[1] {
        let centre = dvec3(0.0, 0.0, PANEL_Z + BULGE - BALL);
        let a = ray.length_squared();
        let b = ray.dot(eye - centre);
        let c = (eye - centre).length_squared() - BALL * BALL;
        let discriminant = b * b - a * c;
        let to_ball = if discriminant > 0.0 {
            (-b - discriminant.sqrt()) / a
        } else {
            f64::INFINITY
        };
        return (Surface::Panel, to_panel.min(to_ball));
    }
    (Surface::Wall, (WALL_OFFSET - WALL.dot(eye)) / WALL.dot(ray))
}

/// Returns a solid texture, red on the panel and blue on the wall.
fn color(part: Surface, p: DVec3) -> [f64; 3] {
    let waves = [
        (dvec3(17.0, 5.0, 3.0), 25.0),
        (dvec3(-6.0, 23.0, 11.0), 25.0),
        (dvec3(31.0, -24.0, 9.0), 20.0),
        (dvec3(41.0, 33.0, 2.0), 20.0),
    ];
    let level = 110.0
        + waves
            .iter()
            .map(|(wave, amplitude)| amplitude * wave.dot(p).sin())
            .sum::<f64>();
    match part {
        Surface::Panel => [level + 40.0, level * 0.5, 20.0],
        Surface::Wall => [20.0, level * 0.6, level + 30.0],
    }
}

/// Renders a view with its exact depth; pixels are means of nine rays.
fn view(i: usize) -> LoadedView {
    let pose = pose(i);
    let lens = lens();
    let mut view = LoadedView {
        size_px: SIZE,
        lens,
        pose,
        color: Vec::new(),
        depth: Vec::new(),
    };
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let shade = |u: f64, v: f64| {
                let ray =
                    pose.world_from_eye * lens.ray([f64::from(x) + u, f64::from(y) + v], SIZE);
                let (part, distance) = hit(pose.eye, ray);
                (color(part, pose.eye + ray * distance), distance)
            };
            let mut sum = [0.0; 3];
            for k in 0..9 {
                let (color, _) = shade(
                    (f64::from(k % 3) + 0.5) / 3.0,
                    (f64::from(k / 3) + 0.5) / 3.0,
                );
                (0..3).for_each(|c| sum[c] += color[c] / 9.0);
            }
            let [r, g, b] = sum.map(|level| (level + 0.5) as u8);
            view.color.push([r, g, b, 255]);
            view.depth.push(shade(0.5, 0.5).1 as f32);
        }
    }
    view
}

/// Returns all frames with exact depth.
fn frames() -> Frames {
    let order = [MIDDLE, 0, 1, 3, 4];
    let frame = |i: &usize| Frame {
        view: view(*i),
        gain: [1.0; 3],
    };
    Frames {
        frames: order.iter().map(frame).collect(),
        names: order.iter().map(|i| format!("{i}.png")).collect(),
        baseline_m: 0.24,
        deviation: 0.0,
    }
}

fn job() -> LayerJob {
    LayerJob {
        view: MIDDLE,
        others: 4,
        layers: 6,
        own_depth: false,
        masks: Vec::new(),
        longest_px: 1600,
    }
}

/// Returns the surface and the depth at a pixel's centre from the middle frame's eye.
fn truth(camera: &Camera, pixel: usize) -> (Surface, f64) {
    let x = pixel % camera.width() as usize;
    let y = pixel / camera.width() as usize;
    hit(
        camera.eye(),
        camera.direction(x as f64 + 0.5, y as f64 + 0.5),
    )
}

/// Returns the fraction of the labelled pixels whose relative depth error is below `tolerance`.
fn accurate_share(layers: &PlanarLayers, tolerance: f64) -> f64 {
    let depth = layers.depth();
    let shown: Vec<usize> = (0..depth.len())
        .filter(|i| layers.labels[*i].is_some())
        .collect();
    let error =
        |pixel: &usize| (f64::from(depth[*pixel]) / truth(&layers.camera, *pixel).1 - 1.0).abs();
    let accurate = shown.iter().filter(|pixel| error(pixel) < tolerance);
    accurate.count() as f64 / shown.len() as f64
}

fn layer_surface(layer: &PlanarLayer) -> Surface {
    if layer.normal.z.abs() > 0.99 {
        Surface::Panel
    } else {
        Surface::Wall
    }
}

#[test]
fn planes_labels_and_depth_match_truth() {
    let layers = job().segment(&frames()).expect("layers");
    assert_eq!(layers.layers.len(), 2, "the bulge belongs to the panel");
    let surfaces: Vec<Surface> = layers.layers.iter().map(layer_surface).collect();
    assert_eq!(
        surfaces,
        [Surface::Wall, Surface::Panel],
        "the larger one first"
    );
    let wall = WALL.normalize();
    assert!(
        layers.layers[0].normal.dot(wall).abs() > 1.0 - 1e-6,
        "{}",
        layers.layers[0].normal
    );
    assert!((layers.layers[0].offset.abs() - WALL_OFFSET.abs() / WALL.length()).abs() < 1e-3);
    // The bulge pulls the panel's plane toward the eye by less than its height.
    assert!(
        (layers.layers[1].offset.abs() - PANEL_Z.abs()).abs() < BULGE,
        "{}",
        layers.layers[1].offset
    );
    let depth = layers.depth();
    let mut shown = 0.0;
    let mut right = 0.0;
    let mut near = 0.0;
    let mut flat = 0.0f64;
    for (pixel, label) in layers.labels.iter().enumerate() {
        let Some(label) = label else { continue };
        let (part, distance) = truth(&layers.camera, pixel);
        shown += 1.0;
        right += f64::from(u8::from(surfaces[usize::from(*label)] == part));
        near += f64::from(u8::from(
            (f64::from(depth[pixel]) / distance - 1.0).abs() < 1e-3,
        ));
        if part == Surface::Panel && surfaces[usize::from(*label)] == part {
            flat = flat.max((f64::from(layers.plane_depth[pixel]) / distance - 1.0).abs());
        }
    }
    assert_eq!(
        shown,
        f64::from(SIZE[0] * SIZE[1]),
        "each pixel of the image is a pixel of the canvas"
    );
    assert!(right / shown > 0.995, "{}", right / shown);
    assert!(near / shown > 0.98, "{}", near / shown);
    assert!(flat > 0.008, "planes alone lack the bulge: {flat}");
}

#[test]
fn occluded_and_outside_pixels_filled() {
    let layers = job().segment(&frames()).expect("layers");
    let camera = &layers.camera;
    let wall = &layers.layers[0];
    let mut hidden = 0;
    let mut beyond = 0;
    let mut off = 0.0;
    for (i, pixel) in wall.color.pixels().enumerate() {
        if pixel.0[3] == 0 {
            assert!(wall.depth[i].is_nan());
            continue;
        }
        match layers.labels[i] {
            Some(0) => continue,
            Some(_) => hidden += 1,
            None => beyond += 1,
        }
        let x = i % camera.width() as usize;
        let y = i / camera.width() as usize;
        let ray = camera.direction(x as f64 + 0.5, y as f64 + 0.5);
        let distance = (WALL_OFFSET - WALL.dot(camera.eye())) / WALL.dot(ray);
        assert!(
            (f64::from(wall.depth[i]) / distance - 1.0).abs() < 0.02,
            "{x} {y}: {} {distance}",
            wall.depth[i]
        );
        let truth = color(Surface::Wall, camera.eye() + ray * distance);
        off += (0..3)
            .map(|c| (f64::from(pixel.0[c]) - truth[c]).abs())
            .sum::<f64>()
            / 3.0;
    }
    assert!(hidden > 600 && beyond > 500, "{hidden} {beyond}");
    let off = off / f64::from(hidden + beyond);
    assert!(off < 12.0, "levels off by {off}");
    let unseen = wall
        .color
        .pixels()
        .zip(&layers.labels)
        .filter(|(p, label)| label.is_some() && p.0[3] == 0)
        .count();
    assert!(
        unseen > 100,
        "pixels seen by no frame stay unknown: {unseen}"
    );
}

#[test]
fn composited_layers_match_image() {
    let frames = frames();
    let canvas = Canvas::new(&frames, 1600);
    let planes = planes::find_dominant(&canvas, 6);
    let labels = labels::assign(&canvas, &frames, &planes);
    let layers = build_layers(&canvas, &frames, &planes, labels);
    let mut sum = 0.0;
    let mut worst = 0.0f32;
    let mut soft = 0;
    let mut count = 0.0;
    for (i, _) in layers
        .labels
        .iter()
        .enumerate()
        .filter(|(_, label)| label.is_some())
    {
        let pixel = |layer: &PlanarLayer| {
            layer.color.as_raw()[4 * i..4 * i + 4]
                .iter()
                .map(|v| f32::from(*v))
                .collect::<Vec<_>>()
        };
        let wall = pixel(&layers.layers[0]);
        let panel = pixel(&layers.layers[1]);
        let alpha = panel[3] / 255.0;
        soft += u32::from(panel[3] > 0.0 && panel[3] < 255.0);
        let off = (0..3)
            .map(|c| (panel[c] * alpha + wall[c] * (1.0 - alpha) - canvas.color[i][c]).abs())
            .fold(0.0, f32::max);
        sum += off;
        count += 1.0;
        worst = worst.max(off);
    }
    assert!(soft > 40, "edges within pixels are soft: {soft}");
    assert!(sum / count < 0.3, "mean {}", sum / count);
    assert!(worst < 70.0, "worst {worst}");
}

/// A plane moves from frame to frame by the homography K2 (R + t m) K1^-1, m its normal over its
/// distance.
#[test]
fn plane_is_homography() {
    let frames = frames();
    let canvas = Canvas::new(&frames, 1600);
    let other = &frames.others()[0];
    let plane = Affine {
        coefficients: dvec3(2e-4, -3e-4, 0.41),
    };
    let (normal, offset) = plane.to_world(&canvas);
    let own = canvas.camera;
    let other_pose = other.view.pose;
    let turn = other_pose.world_from_eye.transpose() * own.world_from_eye();
    let shift = other_pose.world_from_eye.transpose() * (own.eye() - other_pose.eye);
    let m = own.world_from_eye().transpose() * normal / -(normal.dot(own.eye()) + offset);
    let pixels = |focal: f64, [cx, cy]: [f64; 2]| {
        DMat3::from_cols(
            dvec3(focal, 0.0, 0.0),
            dvec3(0.0, -focal, 0.0),
            dvec3(-cx, -cy, -1.0),
        )
    };
    let outer = DMat3::from_cols(shift * m.x, shift * m.y, shift * m.z);
    let homography = pixels(150.0, [80.5, 59.0])
        * (turn + outer)
        * pixels(own.focal_px(), own.principal_px()).inverse();
    let mut random = Rng::new(7);
    for _ in 0..200 {
        let pixel = random.below(canvas.shown.len() as u64) as usize;
        let [x, y] = canvas.center(pixel);
        let point = canvas.point(pixel, plane.inverse_depth([x, y]));
        assert!((normal.dot(point) + offset).abs() < 1e-9);
        let moved = homography * dvec3(x, y, 1.0);
        if let Some([px, py, _]) = other.project(point) {
            assert!((moved.x / moved.z - px).abs() < 1e-8 && (moved.y / moved.z - py).abs() < 1e-8);
        }
    }
}

#[test]
fn layers_independent_of_threads() {
    let frames = frames();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| job().segment(&frames).expect("layers"))
    };
    let one = run(1);
    let three = run(3);
    assert_eq!(one.labels, three.labels);
    for (a, b) in one.layers.iter().zip(&three.layers) {
        assert_eq!(
            (a.normal, a.offset, &a.color),
            (b.normal, b.offset, &b.color)
        );
        assert!(
            a.depth
                .iter()
                .zip(&b.depth)
                .all(|(a, b)| a.to_bits() == b.to_bits())
        );
    }
}

fn mask(name: &str, belongs: impl Fn(u32, u32) -> bool) -> Mask {
    let level = |x, y| Luma([if belongs(x, y) { 255 } else { 0 }]);
    Mask {
        path: name.into(),
        picture: GrayImage::from_fn(SIZE[0], SIZE[1], level),
    }
}

#[test]
fn masks_define_layers() {
    let frames = frames();
    let left = mask("a.png", |x, _| x < 40);
    let middle = mask("b.png", |x, y| {
        (60..100).contains(&x) && (40..80).contains(&y)
    });
    let job = LayerJob {
        masks: vec![middle, left],
        ..job()
    };
    let layers = job.segment(&frames).expect("layers");
    let surfaces: Vec<Surface> = layers.layers.iter().map(layer_surface).collect();
    assert_eq!(
        surfaces,
        [Surface::Wall, Surface::Panel],
        "40 x 120 pixels and 40 x 40"
    );
    let count = |label: Option<u8>| layers.labels.iter().filter(|own| **own == label).count();
    assert_eq!((count(Some(0)), count(Some(1))), (40 * 120, 40 * 40));

    let error = |mask: Mask| {
        LayerJob {
            masks: vec![mask],
            ..job.clone()
        }
        .segment(&frames)
        .expect_err("no layers")
        .to_string()
    };
    let small = Mask {
        path: "small.png".into(),
        picture: GrayImage::new(9, 7),
    };
    assert_eq!(
        error(small),
        "small.png: is 9x7 pixels, but 2.png is 160x120: a mask must have the size of the image"
    );
    assert!(
        error(mask("black.png", |_, _| false))
            .starts_with("black.png: only 0 of its white pixels have depth")
    );
}

#[test]
fn masks_beyond_maximum_are_refused() {
    let masks = vec![mask("a.png", |_, _| true); MAX_LAYERS + 1];
    let error = LayerJob { masks, ..job() }.segment(&frames()).err();
    let message = error.map(|error| error.to_string());
    assert_eq!(
        message.as_deref(),
        Some("65 masks; at most 64 are supported")
    );
}

/// Writes a set of photographs.
fn write_photographs(
    folder: &Path,
    pose: impl Fn(usize) -> Pose,
    color: impl Fn(usize) -> Vec<[u8; 4]>,
) -> ImageSet {
    photographs(
        folder,
        (0..FRAMES).map(|i| LoadedView {
            pose: pose(i),
            color: color(i),
            ..view(i)
        }),
    )
}

#[test]
fn photographs_without_depth_give_layers() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = write_photographs(folder.path(), pose, |i| view(i).color);
    let job = LayerJob::suggest(&set);
    assert_eq!(job.view, MIDDLE);
    let frames = job.load(&set, &|_| {}).expect("frames");
    let layers = job.segment(&frames).expect("layers");
    assert!(
        (2..=4).contains(&layers.layers.len()),
        "{}",
        layers.layers.len()
    );
    let accurate = accurate_share(&layers, 0.03);
    assert!(accurate > 0.93, "{accurate}");
}

#[test]
fn sets_without_layers_report_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let even = |_: usize| vec![[90, 90, 90, 255]; (SIZE[0] * SIZE[1]) as usize];
    let set = write_photographs(&folder.path().join("even"), pose, even);
    let error = |set: &ImageSet, job: &LayerJob| {
        job.load(set, &|_| {})
            .and_then(|frames| job.segment(&frames))
            .expect_err("no layers")
            .to_string()
    };
    let suggested = LayerJob::suggest(&set);
    assert!(
        error(&set, &suggested).contains("no texture"),
        "{}",
        error(&set, &suggested)
    );
    let beyond = LayerJob {
        view: FRAMES,
        ..suggested
    };
    assert!(error(&set, &beyond).contains("no perspective view \"6\"; choose one of the 5 views"));
    assert_eq!(LayerJob::find_view(&set, "1").expect("by number"), 0);
    assert_eq!(
        LayerJob::find_view(&set, &set.views[3].name).expect("by name"),
        3
    );
    assert!(LayerJob::find_view(&set, "0").is_err() && LayerJob::find_view(&set, "six").is_err());

    let turning = |i: usize| Pose {
        eye: pose(MIDDLE).eye,
        ..pose(i)
    };
    let set = write_photographs(&folder.path().join("turning"), turning, |i| view(i).color);
    assert!(error(&set, &LayerJob::suggest(&set)).contains("layers need parallax"));
    let mut set = set;
    set.views.truncate(1);
    assert!(error(&set, &LayerJob::suggest(&set)).contains("at least two"));
}

#[test]
fn masked_pixels_belong_to_no_layer() {
    let mut frames = frames();
    for pixel in &mut frames.frames[0].view.color[..SIZE[0] as usize * 20] {
        pixel[3] = 0;
    }
    let canvas = Canvas::new(&frames, 1600);
    let planes = planes::find_dominant(&canvas, 4);
    let labels = labels::assign(&canvas, &frames, &planes);
    for (pixel, label) in labels.iter().enumerate() {
        assert_eq!(*label == NONE, !canvas.shown[pixel]);
    }
    let layers = build_layers(&canvas, &frames, &planes, labels);
    let masked = |i: &usize| canvas.inside[*i] && !canvas.shown[*i];
    assert!((0..layers.labels.len()).filter(masked).count() == SIZE[0] as usize * 20);
    for layer in &layers.layers {
        let alpha = |i: usize| layer.color.as_raw()[4 * i + 3];
        assert!(
            (0..layers.labels.len())
                .filter(masked)
                .all(|i| alpha(i) == 0)
        );
    }
}

#[test]
fn unknown_margins_cropped() {
    let alone = || {
        let mut alone = frames();
        alone.frames.truncate(1);
        alone
    };
    let size = |frames: &Frames| {
        let layers = job().segment(frames).expect("layers");
        assert_eq!(
            layers.labels.iter().filter(|label| label.is_some()).count(),
            (SIZE[0] * SIZE[1]) as usize
        );
        [layers.camera.width(), layers.camera.height()]
    };
    let canvas = Canvas::new(&frames(), 1600);
    let wide = size(&frames());
    let narrow = size(&alone());
    assert_eq!(
        narrow,
        [161, 122],
        "the image centred on its principal point"
    );
    assert!(
        wide[0] > narrow[0] && wide[0] as usize <= canvas.width,
        "{wide:?}"
    );
}

#[test]
fn smaller_canvas_gives_same_layers() {
    let layers = LayerJob {
        longest_px: 100,
        ..job()
    }
    .segment(&frames())
    .expect("layers");
    assert!(layers.camera.width().max(layers.camera.height()) <= 101);
    assert_eq!(layers.layers.len(), 2);
    let accurate = accurate_share(&layers, 0.01);
    assert!(accurate > 0.95, "{accurate}");
}
