//! A room with exact depth whose camera poses are disturbed.

use super::super::{Distortion, Lens, LoadedView, Pinhole};
use super::*;
use glam::{DMat3, DVec3, dvec3};

const SIZE: [u32; 2] = [160, 120];
const VIEWS: usize = 9;

fn lens() -> Lens {
    Lens::Pinhole(Pinhole {
        focal_px: [140.0; 2],
        principal_px: [80.0, 60.0],
        distortion: Distortion::default(),
    })
}

/// Intersects a ray with the room, its post, or the slopes in front of its corners; returns the
/// multiple of its direction.
fn hit(eye: DVec3, ray: DVec3) -> f64 {
    const HALF: DVec3 = dvec3(1.2, 0.8, 2.5);
    let wall = |i: usize| (HALF[i] * ray[i].signum() - eye[i]) / ray[i];
    let room = (0..3)
        .filter(|&i| ray[i] != 0.0)
        .map(wall)
        .fold(f64::INFINITY, f64::min);
    let post = (-1.4 - eye.z) / ray.z;
    let hit = eye + ray * post;
    let near = if post > 0.0 && hit.x.abs() < 0.3 && hit.y < 0.2 {
        post
    } else {
        f64::INFINITY
    };
    let slope = |normal: DVec3, offset: f64| {
        Some((offset - normal.dot(eye)) / normal.dot(ray)).filter(|t| *t > 0.0)
    };
    let slopes = [
        slope(dvec3(0.3, 0.8, 0.5), -0.9),
        slope(dvec3(-0.8, 0.2, 0.5), -1.1),
    ];
    slopes.into_iter().flatten().fold(room.min(near), f64::min)
}

fn view(pose: &Pose) -> LoadedView {
    view_with_pattern(pose, 4.0)
}

/// Renders the room with a pattern of `frequency` radians a metre.
fn view_with_pattern(pose: &Pose, frequency: f64) -> LoadedView {
    let pixels = (0..SIZE[1])
        .flat_map(|y| (0..SIZE[0]).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]));
    let mut depth = Vec::new();
    let mut color = Vec::new();
    for pixel in pixels {
        let ray = pose.world_from_eye * lens().ray(pixel, SIZE);
        let along = hit(pose.eye, ray);
        let level = 128.0
            + 100.0
                * ((pose.eye + ray * along) * frequency)
                    .to_array()
                    .map(f64::sin)
                    .iter()
                    .product::<f64>();
        depth.push(along as f32);
        color.push([level as u8, level as u8, level as u8, 255]);
    }
    LoadedView {
        size_px: SIZE,
        lens: lens(),
        pose: *pose,
        color,
        depth,
    }
}

fn truth() -> Vec<Pose> {
    let pose = |i: usize| {
        let i = i as f64;
        let turn = DMat3::from_rotation_y(0.08 * (i - 4.0))
            * DMat3::from_rotation_x(0.1 * (i * 0.9).sin());
        Pose {
            eye: dvec3(0.08 * i - 0.3, 0.1 * (i * 0.7).sin(), 0.1 * (i * 1.5).cos()),
            world_from_eye: turn,
        }
    };
    (0..VIEWS).map(pose).collect()
}

/// Returns poses turned by half a degree and moved by two centimetres, each differently.
fn disturbed(poses: &[Pose]) -> Vec<Pose> {
    let own = |i: f64| dvec3((i * 1.7).sin(), (i * 2.3).cos(), (i * 0.7).sin()).normalize();
    let disturb = |(i, pose): (usize, &Pose)| {
        let turn = (own(i as f64 + 0.5) * 0.5f64.to_radians()).to_array();
        let step = (own(i as f64) * 0.02).to_array();
        solve::apply_step(
            pose,
            &std::array::from_fn(|k| if k < 3 { turn[k] } else { step[k - 3] }),
        )
    };
    poses.iter().enumerate().map(disturb).collect()
}

/// Returns the mean error of each view's pose relative to its successor, degrees and metres: the
/// position of the whole set is undetermined.
fn relative_errors(poses: &[Pose], truth: &[Pose]) -> [f64; 2] {
    let relative = |pair: &[Pose]| Pose {
        eye: pair[0].to_eye(pair[1].eye),
        world_from_eye: pair[0].world_from_eye.transpose() * pair[1].world_from_eye,
    };
    let pairs: Vec<(Pose, Pose)> = poses
        .windows(2)
        .zip(truth.windows(2))
        .map(|(pair, truth)| (relative(pair), relative(truth)))
        .collect();
    mean_difference(pairs.into_iter())
}

fn grids(truth: &[Pose]) -> Vec<RangeGrid> {
    truth
        .iter()
        .map(|pose| RangeGrid::new(&view(pose)))
        .collect()
}

fn refine_exact(grids: &[RangeGrid], given: &[Pose]) -> (RefinementReport, Vec<Pose>) {
    refine(grids, given, 0.0, &|_| {}).expect("they overlap")
}

#[test]
fn disturbed_poses_restored() {
    let truth = truth();
    let given = disturbed(&truth);
    let (report, refined) = refine_exact(&grids(&truth), &given);
    let [before, after] = [&given, &refined].map(|poses| relative_errors(poses, &truth));
    // Cells at edges contain two surfaces; they leave less than a hundredth of the disturbance.
    assert!(
        report.is_applied && report.surface_distance[1] < report.surface_distance[0] * 0.05,
        "{report:?}"
    );
    assert!(report.levels[1] < report.levels[0] * 0.2, "{report:?}");
    assert!(
        after[0] < before[0] * 0.01 && after[1] < before[1] * 0.01,
        "{before:?} {after:?}"
    );
    // The set as a whole stays at the mean of the given poses.
    let mean = |poses: &[Pose]| poses.iter().map(|pose| pose.eye).sum::<DVec3>() / VIEWS as f64;
    assert!(
        mean(&refined).distance(mean(&given)) < 0.002,
        "{} {}",
        mean(&refined),
        mean(&given)
    );
}

#[test]
fn exact_poses_unchanged() {
    let truth = truth();
    let (report, _) = refine_exact(&grids(&truth), &truth);
    assert!(!report.is_applied, "{report:?}");
    assert!(
        report.movement[0] < 1e-3 && report.movement[1] < 1e-4,
        "{report:?}"
    );
}

#[test]
fn result_independent_of_threads() {
    let truth = truth();
    let given = disturbed(&truth);
    let grids = grids(&truth);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| refine_exact(&grids, &given))
    };
    assert_eq!(run(1), run(3));
}

/// A depth error common to all views pulls poses away: geometry agrees better, colours do not.
#[test]
fn biased_depth_refused_by_colours() {
    let truth = truth();
    let bent = |pose: &Pose| {
        let mut view = view_with_pattern(pose, 30.0);
        for (i, depth) in view.depth.iter_mut().enumerate() {
            let x = (i as u32 % SIZE[0]) as f32 / SIZE[0] as f32 - 0.5;
            *depth *= 1.0 + 0.06 * x;
        }
        RangeGrid::new(&view)
    };
    let grids: Vec<RangeGrid> = truth.iter().map(bent).collect();
    let (report, _) = refine_exact(&grids, &truth);
    assert!(
        !report.is_applied
            && report.surface_distance[1] < report.surface_distance[0] * 0.9
            && report.levels[1] > report.levels[0],
        "{report:?}"
    );
}

/// A flat wall leaves movements along it and turns about its normal undetermined: they stay as
/// given.
#[test]
fn flat_wall_keeps_free_motion() {
    let poses: Vec<Pose> = (0..4)
        .map(|i| Pose {
            eye: dvec3(0.1 * f64::from(i), 0.0, 0.0),
            world_from_eye: DMat3::IDENTITY,
        })
        .collect();
    let count = (SIZE[0] * SIZE[1]) as usize;
    // Uniform colour, so that colours have no effect either.
    let wall = |pose: &Pose| LoadedView {
        depth: vec![2.0; count],
        color: vec![[90, 90, 90, 255]; count],
        ..view(pose)
    };
    let grids: Vec<RangeGrid> = poses
        .iter()
        .map(|pose| RangeGrid::new(&wall(pose)))
        .collect();
    let mut given = poses.clone();
    given[1].eye += dvec3(0.01, 0.005, 0.02);
    let (report, refined) = refine_exact(&grids, &given);
    assert!(report.is_applied, "{report:?}");
    let along = |poses: &[Pose]| {
        poses
            .iter()
            .map(|pose| pose.eye.truncate())
            .collect::<Vec<_>>()
    };
    assert!(
        along(&refined)
            .iter()
            .zip(along(&given))
            .all(|(a, b)| a.distance(b) < 1e-6),
        "{refined:?}"
    );
    assert!(
        (refined[1].eye.z - refined[0].eye.z).abs() < 1e-3,
        "{refined:?}"
    );
}

#[test]
fn views_without_overlap_are_not_refined() {
    let truth = truth();
    let back = Pose {
        world_from_eye: DMat3::from_rotation_y(3.0),
        ..truth[0]
    };
    let poses = [truth[0], back];
    assert!(refine(&grids(&poses), &poses, 0.0, &|_| {}).is_none());
}
