//! Cases of the ranking of photographs and the mesh of view-dependent geometry (hard case 11; S24,
//! E6, E8, C26).

use super::Case;
use super::fixtures::{case_rng, largest, look_along, random_direction};
use glam::{DVec3, dvec3};
use headbox_core::depth_kind::DepthKind;
use headbox_core::file_frame::FileFrame;
use headbox_core::progress::Silent;
use headbox_cube::model::parameters::MergeRule;
use headbox_images::{
    DepthPicture, DepthSource, Distortion, ImageSet, Lens, Pinhole, Pose, View, write_depth_exr,
};
use headbox_ldi::from_images::{ImageSetCapture, NearestImages};
use headbox_photos::view_geometry::{
    GeometryRenderer, GeometryResources, GeometrySettings, NodeMesh, RankWeights, SampleGrid,
    ViewGeometry, WaitPolicy,
};
use image::RgbaImage;
use std::collections::BTreeMap;
use std::path::Path;

pub(super) fn cases() -> Vec<Case> {
    vec![
        Case {
            name: "nearest images at equal distances",
            what: "Images from the corners of a regular polygon, from one place, mirrored, and 1e7 m from the origin, frames from the polygon's middle and anywhere: pairs of images that are ranked against their angles and distances in f64, or, of equals, against their order in the set.",
            unit: "pairs",
            bound: 0.0,
            reason: "The order is total: of equals the first of the set comes first. Angles closer than rounding, 1e-7 rad at 1e7 m, count as equal in any order, unless pose and direction are the same.",
            measure: |seed| near_images(seed, 2.0),
        },
        Case {
            name: "nearest images without depth",
            what: "The same of depth images without a single depth, so that no distance is known.",
            unit: "pairs",
            bound: 0.0,
            reason: "Without a median depth, 1 m takes its place.",
            measure: |seed| near_images(seed, f32::NAN),
        },
        Case {
            name: "ranking of cameras",
            what: "Cameras of view-dependent geometry in one place, on the line of sight, mirrored and anywhere, all of which see the whole of what the frame sees: pairs that are ranked against the penalties in f64, or, of equals, against their order.",
            unit: "pairs",
            bound: 0.0,
            reason: "The same; 0 / 0, where all cameras are on the line of sight, is 0 (C26).",
            measure: camera_ranking,
        },
        Case {
            name: "ranking cameras none of which is valid",
            what: "Frames that look away from all that cameras have seen, or from behind it, and cameras without a depth: cameras that are used, and pixels that are not holes.",
            unit: "",
            bound: 0.0,
            reason: "Nothing is known there: nothing is drawn, and nothing fails.",
            measure: no_valid_camera,
        },
        Case {
            name: "mesh of nodes on common circles",
            what: "Nodes of a frame's grid on a regular lattice, and off it by one part of 256 of a pixel at random: edges whose opposite corner lies inside the circle of the triangle, edges of more or fewer than two triangles, triangles without area, and differences of area from the grid's, in exact arithmetic.",
            unit: "",
            bound: 0.0,
            reason: "Positions are integers and predicates exact (E8): a fourth node on the circle is not inside, and no edge is flipped for ever.",
            measure: |seed| {
                let mut rng = case_rng(seed, 114);
                largest([0, 1].map(|off| {
                    mesh_defects(|_, _| [0, 1].map(|_| rng.below(2 * off as u64 + 1) as i32 - off))
                }))
            },
        },
        Case {
            name: "mesh of nodes nearly in a line",
            what: "The same of nodes that lie a 256th of a pixel on either side of every second border of rows, of columns, or of both, anywhere along it: rows of triangles 1 to 1,280 times as long as high.",
            unit: "",
            bound: 0.0,
            reason: "The same; slivers have an area of their own, which f64 products of pixels would lose.",
            measure: |seed| {
                let mut rng = case_rng(seed, 115);
                largest([[false, true], [true, false], [true, true]].map(|pressed| {
                    mesh_defects(|node, side| {
                        [0, 1].map(|axis| {
                            let anywhere = rng.below(side as u64) as i32 - side / 2;
                            match (pressed[axis], node[axis] % 2) {
                                (false, _) => anywhere,
                                (true, 0) => side,
                                (true, _) => -side,
                            }
                        })
                    })
                }))
            },
        },
    ]
}

/// Size of the images, px.
const IMAGE_PX: [u32; 2] = [16, 12];

/// Focal length of the images, px.
const FOCAL_PX: f64 = 12.0;

/// Writes a set of images of a plane at a constant depth, metres, from the given poses.
fn image_set(folder: &Path, poses: &[Pose], depth_m: f32) -> Option<ImageSet> {
    let [width, height] = IMAGE_PX;
    let (color, depth) = (folder.join("color.png"), folder.join("depth.exr"));
    let picture = RgbaImage::from_pixel(width, height, image::Rgba([90, 120, 150, 255]));
    picture.save(&color).ok()?;
    let picture = DepthPicture {
        width,
        height,
        values: vec![depth_m; (width * height) as usize],
    };
    write_depth_exr(&picture, &depth).ok()?;
    let lens = Lens::Pinhole(Pinhole {
        focal_px: [FOCAL_PX; 2],
        principal_px: IMAGE_PX.map(|side| f64::from(side) / 2.0),
        distortion: Distortion::default(),
    });
    let views = poses.iter().enumerate().map(|(i, pose)| {
        let depth = DepthSource::metres(depth.clone(), DepthKind::EyeDepth, 1.0);
        View::new(
            i.to_string(),
            IMAGE_PX,
            lens,
            *pose,
            color.clone(),
            Some(depth),
        )
    });
    Some(ImageSet {
        folder: folder.into(),
        format: "of a case",
        frame: FileFrame::default(),
        views: views.collect(),
        headbox_centre: None,
        notes: Vec::new(),
    })
}

/// Returns a pose that looks along a direction.
fn pose(eye: DVec3, forward: DVec3) -> Option<Pose> {
    let camera = look_along(DVec3::ZERO, forward, 60.0, IMAGE_PX).ok()?;
    Some(Pose {
        eye,
        world_from_eye: camera.world_from_eye(),
    })
}

/// Counts the pairs of neighbours in `order` whose keys descend by more than `rounding`, or that
/// have equal poses and are not in the set's order.
fn pairs_out_of_order(order: &[usize], keys: &[f64], poses: &[Pose], rounding: f64) -> f64 {
    let is_wrong = |pair: &&[usize]| {
        let (a, b) = (pair[0], pair[1]);
        keys[a] > keys[b] + rounding || (poses[a] == poses[b] && a > b)
    };
    order.windows(2).filter(is_wrong).count() as f64
}

/// Counts the pairs that [`NearestImages`] ranks in the wrong order.
fn near_images(seed: u64, depth_m: f32) -> Option<f64> {
    const CORNERS: usize = 8;
    let mut rng = case_rng(seed, 111);
    largest([DVec3::ZERO, dvec3(1e7, 0.0, -1e7)].map(|middle| {
        let direction = random_direction(&mut rng);
        let mut poses = Vec::new();
        for corner in 0..CORNERS {
            let turn = std::f64::consts::TAU * corner as f64 / CORNERS as f64;
            let arm = dvec3(turn.cos(), turn.sin(), 0.0);
            // Around a middle, with parallel and with inward directions, and in the middle itself.
            poses.push(pose(middle + arm, DVec3::NEG_Z)?);
            poses.push(pose(middle + arm, -arm)?);
            poses.push(pose(middle, direction)?);
        }
        let folder = tempfile::tempdir().ok()?;
        let set = image_set(folder.path(), &poses, depth_m)?;
        let job = ImageSetCapture {
            centre: middle,
            half_size_m: 0.1,
            face_size_px: 8,
            merge_rule: MergeRule::Average,
            depth_noise: 0.0,
        };
        let near = NearestImages::new(set, job, 1 << 20).ok()?;
        let median_depth_m = if depth_m.is_nan() {
            1.0
        } else {
            f64::from(depth_m)
        };
        let frames = [
            (middle, DVec3::NEG_Z),
            (middle, direction),
            (middle + rng.in_cube(1.0), random_direction(&mut rng)),
        ];
        largest(frames.map(|(eye, forward)| {
            let camera = look_along(eye, forward, 60.0, [32, 24]).ok()?;
            // The arc tangent is accurate at 0 and at a half turn.
            let key = |pose: &Pose| {
                let (a, b) = (-pose.world_from_eye.z_axis, camera.forward());
                a.cross(b).length().atan2(a.dot(b))
                    + pose.eye.distance(camera.eye()) / median_depth_m
            };
            let keys: Vec<f64> = poses.iter().map(key).collect();
            let order = near.nearest(&camera, poses.len());
            let missing = (poses.len() - order.len()) as f64;
            Some(missing + pairs_out_of_order(&order, &keys, &poses, 1e-7))
        }))
    }))
}

/// Opens view-dependent geometry of a set of images.
fn open_geometry(folder: &Path, poses: &[Pose], depth_m: f32) -> Option<ViewGeometry> {
    let set = image_set(folder, poses, depth_m)?;
    let resources = GeometryResources {
        grid: SampleGrid::default(),
        budget: 1 << 20,
        cache: None,
    };
    let views: Vec<&View> = set.views.iter().collect();
    ViewGeometry::open(&set, &views, &resources, &Silent).ok()
}

/// Counts the pairs of cameras that view-dependent geometry ranks in the wrong order.
fn camera_ranking(seed: u64) -> Option<f64> {
    let mut rng = case_rng(seed, 112);
    let on_axis = |i: usize| dvec3(0.0, 0.0, -0.1 * i as f64);
    let mut sets = [Vec::new(), Vec::new(), Vec::new()];
    for i in 0..4 {
        let arm = dvec3(rng.between(-0.4, 0.4), rng.between(-0.4, 0.4), 0.0);
        let forward = (DVec3::NEG_Z + rng.in_cube(0.2)).normalize();
        sets[0].push(pose(DVec3::ZERO, DVec3::NEG_Z)?);
        sets[1].push(pose(on_axis(i), DVec3::NEG_Z)?);
        for eye in [arm, -arm, arm] {
            sets[2].push(pose(eye, forward)?);
        }
    }
    largest(sets.map(|poses| {
        let folder = tempfile::tempdir().ok()?;
        let geometry = open_geometry(folder.path(), &poses, 2.0)?;
        // From this distance and at this angle, everything that the cameras see is in the frame.
        let camera = look_along(dvec3(0.0, 0.0, 4.0), DVec3::NEG_Z, 90.0, [64, 48]).ok()?;
        let distance = |pose: &Pose| (pose.eye - camera.eye()).cross(camera.forward()).length();
        let farthest = poses.iter().map(distance).fold(0.0, f64::max);
        let field = 2.0 * (64f64.hypot(48.0) / 2.0 / camera.focal_px()).atan();
        let key = |pose: &Pose| {
            let (a, b) = (-pose.world_from_eye.z_axis, camera.forward());
            let angle = a.cross(b).length().atan2(a.dot(b));
            let share = if farthest > 0.0 {
                distance(pose) / farthest
            } else {
                0.0
            };
            share + angle / field.max(60f64.to_radians())
        };
        let keys: Vec<f64> = poses.iter().map(key).collect();
        let settings = GeometrySettings {
            cameras: poses.len(),
            weights: RankWeights::default(),
            ..GeometrySettings::default()
        };
        let mut renderer = GeometryRenderer::new();
        renderer.render(&geometry, &camera, &settings, WaitPolicy::Wait);
        let order: Vec<usize> = renderer.used().iter().map(|&i| i as usize).collect();
        let missing = (poses.len() - order.len()) as f64;
        // Tolerance: the arc cosine near 1 keeps half of the digits.
        Some(missing + pairs_out_of_order(&order, &keys, &poses, 1e-7))
    }))
}

/// Counts the cameras and pixels that frames without a valid camera use.
fn no_valid_camera(seed: u64) -> Option<f64> {
    let mut rng = case_rng(seed, 113);
    let poses = (0..4).map(|_| pose(rng.in_cube(0.5), DVec3::NEG_Z));
    let poses: Vec<Pose> = poses.collect::<Option<_>>()?;
    let frames = [
        (2.0, DVec3::ZERO, DVec3::Z),
        (2.0, dvec3(0.0, 0.0, -9.0), DVec3::NEG_Z),
        (2.0, dvec3(1e6, 0.0, 0.0), DVec3::NEG_Z),
        (f32::NAN, DVec3::ZERO, DVec3::NEG_Z),
    ];
    largest(frames.map(|(depth_m, eye, forward)| {
        let folder = tempfile::tempdir().ok()?;
        let geometry = open_geometry(folder.path(), &poses, depth_m)?;
        let camera = look_along(eye, forward, 60.0, [32, 24]).ok()?;
        let mut renderer = GeometryRenderer::new();
        let settings = GeometrySettings::default();
        let (frame, stats) = renderer.render(&geometry, &camera, &settings, WaitPolicy::Wait);
        let drawn = frame.color.len() as u64 - frame.hole_count();
        Some((stats.cameras_used + drawn) as f64)
    }))
}

/// Counts the defects of the mesh of displaced nodes, see the case "mesh of nodes on common
/// circles".
fn mesh_defects(offset: impl FnMut([usize; 2], i32) -> [i32; 2]) -> Option<f64> {
    let NodeMesh {
        size: [columns, rows],
        positions,
        triangles,
    } = NodeMesh::new([120, 100], 5.0, offset);
    let at = |node: u32| positions[node as usize].map(i128::from);
    let minus = |p: [i128; 2], q: [i128; 2]| [p[0] - q[0], p[1] - q[1]];
    let cross = |p: [i128; 2], q: [i128; 2]| p[0] * q[1] - p[1] * q[0];
    let area = |[a, b, c]: [u32; 3]| cross(minus(at(b), at(a)), minus(at(c), at(a)));
    let mut defects = triangles
        .iter()
        .filter(|corners| area(**corners) <= 0)
        .count();

    // Area within the rim, by the shoelace formula.
    let node = |column: usize, row: usize| (row * columns + column) as u32;
    let (right, below) = (columns - 1, rows - 1);
    let mut rim: Vec<u32> = (0..right).map(|column| node(column, 0)).collect();
    rim.extend((0..below).map(|row| node(right, row)));
    rim.extend((1..=right).rev().map(|column| node(column, below)));
    rim.extend((1..=below).rev().map(|row| node(0, row)));
    let next = rim.iter().cycle().skip(1);
    let within: i128 = rim
        .iter()
        .zip(next)
        .map(|(a, b)| cross(at(*a), at(*b)))
        .sum();
    defects += usize::from(triangles.iter().map(|corners| area(*corners)).sum::<i128>() != within);

    // Corners opposite to each edge.
    let mut apexes: BTreeMap<[u32; 2], Vec<([u32; 3], u32)>> = BTreeMap::new();
    for &corners in &triangles {
        for k in 0..3 {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            let edge = [a.min(b), a.max(b)];
            apexes
                .entry(edge)
                .or_default()
                .push((corners, corners[(k + 2) % 3]));
        }
    }
    let is_inside = |corners: [u32; 3], node: u32| {
        let [a, b, c] = corners.map(|corner| minus(at(corner), at(node)));
        let square = |p: [i128; 2]| p[0] * p[0] + p[1] * p[1];
        square(a) * cross(b, c) + square(b) * cross(c, a) + square(c) * cross(a, b) > 0
    };
    let mut on_rim = 0;
    for sides in apexes.values() {
        match sides[..] {
            [_] => on_rim += 1,
            [(one, _), (_, apex)] => defects += usize::from(is_inside(one, apex)),
            _ => defects += 1,
        }
    }
    defects += usize::from(on_rim != rim.len());
    (positions.len() > 100).then_some(defects as f64)
}
