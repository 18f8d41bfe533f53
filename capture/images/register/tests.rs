//! A room with known depth and colours, seen by known cameras.

use super::calibration::Calibration;
use super::estimate::{estimate_views, is_better, is_plausible};
use super::photometric::PhotometricProblem;
use super::view_samples::{MAX_COLUMNS, ViewSamples};
use super::{Exposure, Lens, LoadedView, Pinhole, Pose, RegistrationModel, exposure};
use crate::Distortion;
use glam::{DMat3, DVec2, DVec3, dvec2, dvec3};

const SIZE: [u32; 2] = [160, 120];
const HALF: DVec3 = dvec3(2.0, 1.4, 2.5);

fn pinhole(focal: f64) -> Pinhole {
    Pinhole {
        focal_px: [focal; 2],
        principal_px: [80.0, 60.0],
        distortion: Distortion::default(),
    }
}

fn lens(focal: f64) -> Lens {
    Lens::Pinhole(pinhole(focal))
}

/// Returns the intersection of a ray with the room's walls, as a multiple of its direction.
fn wall(eye: DVec3, ray: DVec3) -> f64 {
    let along = |i: usize| (HALF[i] * ray[i].signum() - eye[i]) / ray[i];
    (0..3)
        .filter(|&i| ray[i] != 0.0)
        .map(along)
        .fold(f64::INFINITY, f64::min)
}

/// Returns the levels of the walls: waves with a period of about ten pixels, different in each
/// channel.
fn texture(p: DVec3) -> [f64; 3] {
    let wave = |k: DVec3, phase: f64| (p.dot(k) + phase).sin() * 24.0;
    [0.0, 1.0, 2.0].map(|c| {
        128.0
            + wave(dvec3(9.0, 5.0, 7.0), c)
            + wave(dvec3(-4.0, 11.0, 3.0), 2.0 * c)
            + wave(dvec3(2.0, -3.0, 5.0), 0.5 * c)
    })
}

/// Samples a view with depth from one camera and colours from another.
fn view(depth: (Lens, Pose), color: (Lens, Pose), gain: f64) -> ViewSamples {
    ViewSamples::new(&rendered(depth, color, gain), MAX_COLUMNS)
}

/// Renders a view with depth from one camera and colours from another.
fn rendered(depth: (Lens, Pose), color: (Lens, Pose), gain: f64) -> LoadedView {
    let pixels = || {
        (0..SIZE[1])
            .flat_map(|y| (0..SIZE[0]).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]))
    };
    let ray =
        |(lens, pose): (Lens, Pose), pixel: [f64; 2]| pose.world_from_eye * lens.ray(pixel, SIZE);
    let color_at = |pixel: [f64; 2]| {
        let ray = ray(color, pixel);
        let levels = texture(color.1.eye + ray * wall(color.1.eye, ray))
            .map(|level| (level * gain + 0.5) as u8);
        [levels[0], levels[1], levels[2], 255]
    };
    let depths = pixels()
        .map(|pixel| wall(depth.1.eye, ray(depth, pixel)) as f32)
        .collect();
    let color = pixels().map(color_at).collect();
    LoadedView {
        size_px: SIZE,
        lens: depth.0,
        pose: depth.1,
        color,
        depth: depths,
    }
}

/// Returns a pose turned about all axes and moved far enough to determine the shared offset along
/// the rotation axis.
fn pose(i: usize) -> Pose {
    let i = i as f64;
    let turn = DMat3::from_rotation_y(0.06 * i) * DMat3::from_rotation_x(0.2 * (i * 0.9).sin());
    let eye = dvec3(0.06 * i, 0.3 * (i * 0.7).sin(), 0.3 * (i * 0.5).cos());
    Pose {
        eye,
        world_from_eye: turn * DMat3::from_rotation_z(0.3 * (i * 1.3).sin()),
    }
}

/// Turns and moves a pose in its own axes.
fn offset_pose(pose: Pose, turn: DVec3, step: DVec3) -> Pose {
    let turned = DMat3::from_axis_angle(turn.normalize(), turn.length());
    Pose {
        eye: pose.to_world(step),
        world_from_eye: pose.world_from_eye * turned,
    }
}

/// Returns the turn of a view's own colour camera.
fn own_turn(i: usize) -> DVec3 {
    let i = i as f64;
    dvec3((i * 1.7).sin(), (i * 2.3).cos(), (i * 0.7).sin()) * 0.004
}

/// Returns the given calibration and the estimates with a shared offset and per view, and their
/// differences of levels at validation points.
fn estimate_all(problem: &PhotometricProblem) -> ([Calibration; 3], [f64; 3]) {
    let given = problem.initial_calibration();
    let shared = problem.estimate_shared_offset(&given);
    let per_view = problem.estimate_per_view(&shared);
    let estimates = [given, shared, per_view];
    let levels = estimates
        .each_ref()
        .map(|estimate| problem.validate(estimate));
    (estimates, levels)
}

#[test]
fn lens_poses_and_exposure_estimated() {
    let gains: Vec<f64> = (0..14).map(|i| 1.0 + 0.01 * (f64::from(i) - 6.5)).collect();
    let truth: Vec<Pose> = (0..14)
        .map(|i| {
            offset_pose(
                pose(i),
                dvec3(0.003, -0.004, 0.002) + own_turn(i),
                dvec3(0.025, 0.0, 0.0),
            )
        })
        .collect();
    let views = (0..14)
        .map(|i| view((lens(146.0), pose(i)), (lens(130.0), truth[i]), gains[i]))
        .collect();
    let problem = PhotometricProblem::new(views, pinhole(146.0));
    let ([_, _, per_view], levels) = estimate_all(&problem);
    assert!(
        levels[1] < levels[0] * 0.6 && levels[2] < levels[1] * 0.6,
        "{levels:?}"
    );
    let exposures = exposure::estimate(&problem, &per_view);
    let registrations = per_view.to_registrations(&exposures);
    assert!(
        (registrations[0].lens.focal_px[0] / 130.0 - 1.0).abs() < 0.01,
        "{:?}",
        registrations[0].lens
    );
    // Turns, steps and the lens's centre are interchangeable, so errors are measured where points
    // project to. A common shift on the walls is nearly unobservable; individual ones are not.
    let mut errors = Vec::new();
    for (registration, truth) in registrations.iter().zip(&truth) {
        for pixel in [[20.0, 20.0], [80.0, 60.0], [140.0, 30.0], [60.0, 100.0]] {
            let ray = truth.world_from_eye * lens(130.0).ray(pixel, SIZE);
            let eye = registration
                .pose
                .to_eye(truth.eye + ray * wall(truth.eye, ray));
            let lens = &registration.lens;
            let normalized = DVec2::new(eye.x / -eye.z, eye.y / eye.z);
            let projected = DVec2::from_array(lens.principal_px)
                + lens.distortion.apply(normalized) * lens.focal_px[0];
            errors.push(projected - DVec2::from_array(pixel));
        }
    }
    let common = errors.iter().sum::<DVec2>() / errors.len() as f64;
    let distances = errors.iter().map(|error| error.distance(common));
    let own = distances.sum::<f64>() / errors.len() as f64;
    assert!(common.length() < 1.5 && own < 0.5, "{common} px, {own} px");
    for (estimated, gain) in exposures.iter().zip(&gains) {
        assert_eq!(estimated.offset, [0.0; 3], "gains explain the levels");
        for channel in estimated.gain {
            assert!(
                (f64::from(channel) / gain - 1.0).abs() < 0.015,
                "{exposures:?}"
            );
        }
    }
}

/// Stray light raises the levels of some views, whose gain differs, too.
#[test]
fn offsets_of_levels_estimated() {
    let truth = |i: usize| {
        let offset = 8.0 * (i as f32 * 0.9).sin();
        Exposure {
            gain: [1.0 + 0.06 * (i as f32 * 0.5).cos(), 1.0, 0.97],
            offset: [offset, -offset, 0.5 * offset],
        }
    };
    let camera = |i| (lens(146.0), pose(i));
    let views = (0..10)
        .map(|i| {
            let mut view = rendered(camera(i), camera(i), 1.0);
            for pixel in &mut view.color {
                for (c, level) in pixel[..3].iter_mut().enumerate() {
                    *level = truth(i).expose(c, f32::from(*level));
                }
            }
            ViewSamples::new(&view, MAX_COLUMNS)
        })
        .collect();
    let problem = PhotometricProblem::new(views, pinhole(146.0));
    let exposures = exposure::estimate(&problem, &problem.initial_calibration());
    // Only differences between views are determined: the levels that one level of the first view
    // has in the others.
    for (i, estimated) in exposures.iter().enumerate() {
        for c in 0..3 {
            for level in [60.0, 128.0, 200.0] {
                let [expected, found] = [(truth(0), truth(i)), (exposures[0], *estimated)]
                    .map(|(first, own)| own.expose(c, f32::from(first.even_out(c, level))));
                assert!(
                    expected.abs_diff(found) <= 3,
                    "view {i}, channel {c}: {expected} {found}"
                );
            }
        }
    }
}

#[test]
fn registered_views_unchanged() {
    let views = (0..10)
        .map(|i| view((lens(146.0), pose(i)), (lens(146.0), pose(i)), 1.0))
        .collect();
    let problem = PhotometricProblem::new(views, pinhole(146.0));
    let ([given, _, per_view], levels) = estimate_all(&problem);
    assert!(
        !is_better(levels[1], levels[0]) && !is_better(levels[2], levels[0]),
        "{levels:?}"
    );
    assert!(
        per_view.mean_offset(problem.poses())[0] < 0.1,
        "{:?}",
        per_view.mean_offset(problem.poses())
    );
    assert!(
        exposure::estimate(&problem, &given)
            .iter()
            .all(|exposure| *exposure == Exposure::EVEN)
    );
}

/// Pixels outside of an oval are black and transparent, as beside the image of a distorted lens.
#[test]
fn transparent_pixels_take_no_part() {
    let masked = |i: usize| {
        let camera = (lens(146.0), pose(i));
        let mut view = rendered(camera, camera, 1.0);
        for (k, pixel) in (0..).zip(&mut view.color) {
            let [x, y] = [k % SIZE[0], k / SIZE[0]].map(f64::from);
            if dvec2((x - 79.5) / 70.0, (y - 59.5) / 50.0).length() > 1.0 {
                *pixel = [0; 4];
            }
        }
        ViewSamples::new(&view, MAX_COLUMNS)
    };
    let problem = PhotometricProblem::new((0..10).map(masked).collect(), pinhole(146.0));
    let (_, levels) = estimate_all(&problem);
    // As without a mask, where only the interpolation of levels differs.
    assert!(levels[0] < 1.5, "{levels:?}");
    assert!(
        !is_better(levels[1], levels[0]) && !is_better(levels[2], levels[0]),
        "{levels:?}"
    );
}

/// Points of an image that an estimate shrinks to a point have no differences.
#[test]
fn cameras_of_no_sensor_are_implausible() {
    let given = Calibration::as_given(&pinhole(146.0), (0..3).map(pose));
    for (ratio, expected) in [
        (0.0, false),
        (0.6, false),
        (0.7, true),
        (1.4, true),
        (1.6, false),
    ] {
        let estimate = Calibration {
            focal_px: 146.0 * ratio,
            ..given.clone()
        };
        assert_eq!(
            is_plausible(&estimate, &pinhole(146.0)),
            expected,
            "{ratio}"
        );
    }
}

#[test]
fn views_without_overlap_have_no_pairs() {
    let back = Pose {
        world_from_eye: DMat3::from_rotation_y(3.0),
        ..pose(0)
    };
    let views = [pose(0), back].map(|pose| view((lens(146.0), pose), (lens(146.0), pose), 1.0));
    let problem = PhotometricProblem::new(views.into(), pinhole(146.0));
    assert!(problem.pairs.is_empty());
}

/// The model chosen on a subset is that of all views.
#[test]
fn subset_represents_all_views() {
    const VIEWS: usize = 40;
    let shared_pose =
        |i: usize| offset_pose(pose(i), dvec3(0.003, -0.004, 0.002), dvec3(0.025, 0.0, 0.0));
    let own_pose = |i: usize| offset_pose(shared_pose(i), own_turn(i), DVec3::ZERO);
    let poses: Vec<Pose> = (0..VIEWS).map(pose).collect();
    let gain = |i: usize| 1.0 + 0.08 * (i as f64 * 0.4).sin();
    // Focal length, pose and exposure of the colours, the expected model, and the number of loaded
    // views.
    type Case<'a> = (
        f64,
        &'a dyn Fn(usize) -> Pose,
        &'a dyn Fn(usize) -> f64,
        RegistrationModel,
        usize,
    );
    let cases: [Case; 4] = [
        (146.0, &pose, &|_| 1.0, RegistrationModel::AsGiven, 16),
        (
            130.0,
            &shared_pose,
            &|_| 1.0,
            RegistrationModel::SharedOffset,
            16,
        ),
        (146.0, &pose, &gain, RegistrationModel::AsGiven, 16 + VIEWS),
        (
            130.0,
            &own_pose,
            &gain,
            RegistrationModel::PerView,
            16 + VIEWS,
        ),
    ];
    for (focal, truth, gain, model, loads) in cases {
        let loaded = std::cell::Cell::new(0);
        let load = |numbers: &[usize], _: u32| {
            loaded.set(loaded.get() + numbers.len());
            let view = |&i: &usize| view((lens(146.0), pose(i)), (lens(focal), truth(i)), gain(i));
            Ok(numbers.iter().map(view).collect())
        };
        let (report, registrations) = estimate_views(&poses, pinhole(146.0), 4, &load)
            .expect("loads")
            .expect("pairs");
        assert_eq!(
            (report.applied, report.sampled_views, loaded.get()),
            (model, 16, loads),
            "{report:?}"
        );
        let mean = (0..VIEWS).map(|i| gain(i).ln()).sum::<f64>() / VIEWS as f64;
        let mut mean_error = DVec2::ZERO;
        for (i, registration) in registrations.iter().enumerate() {
            let gain = gain(i) / mean.exp();
            assert!(
                registration
                    .exposure
                    .gain
                    .iter()
                    .all(|channel| (f64::from(*channel) / gain - 1.0).abs() < 0.03),
                "{i}: {registration:?} {gain}"
            );
            let ray = truth(i).world_from_eye * lens(focal).ray([80.0, 60.0], SIZE);
            let eye = registration
                .pose
                .to_eye(truth(i).eye + ray * wall(truth(i).eye, ray));
            let lens = &registration.lens;
            let normalized = DVec2::new(eye.x / -eye.z, eye.y / eye.z);
            let projected = DVec2::from_array(lens.principal_px) + normalized * lens.focal_px[0];
            mean_error += (projected - dvec2(80.0, 60.0)).abs() / VIEWS as f64;
        }
        assert!(mean_error.length() < 1.6, "{model:?}: {mean_error} px");
    }
}

/// A post in front of a wall, seen with a wide baseline: each view sees other parts of the wall
/// behind the post.
#[test]
fn occluded_points_not_compared() {
    let lens = lens(146.0);
    let hit = |eye: DVec3, ray: DVec3| {
        let post = (-1.0 - eye.z) / ray.z;
        let x = eye.x + ray.x * post;
        if x.abs() < 0.25 {
            post
        } else {
            (-3.0 - eye.z) / ray.z
        }
    };
    let view = |i: usize| {
        let pose = Pose {
            eye: dvec3(0.12 * i as f64 - 0.8, 0.1 * (i % 3) as f64, 0.0),
            world_from_eye: DMat3::IDENTITY,
        };
        let rays = || {
            (0..SIZE[1]).flat_map(|y| {
                (0..SIZE[0]).map(move |x| lens.ray([f64::from(x) + 0.5, f64::from(y) + 0.5], SIZE))
            })
        };
        let color = |ray: DVec3| {
            let levels =
                texture(pose.eye + ray * hit(pose.eye, ray)).map(|level| (level + 0.5) as u8);
            [levels[0], levels[1], levels[2], 255]
        };
        let depth = rays().map(|ray| hit(pose.eye, ray) as f32).collect();
        ViewSamples::new(
            &LoadedView {
                size_px: SIZE,
                lens,
                pose,
                color: rays().map(color).collect(),
                depth,
            },
            MAX_COLUMNS,
        )
    };
    let problem = PhotometricProblem::new((0..14).map(view).collect(), pinhole(146.0));
    let (_, levels) = estimate_all(&problem);
    assert!(levels[0] < 1.5, "nothing hidden is compared: {levels:?}");
    assert!(
        !is_better(levels[1], levels[0]) && !is_better(levels[2], levels[0]),
        "{levels:?}"
    );
}
