//! Rooms of which depth and colours are known, taken by cameras that are known.

use super::Kept;
use super::estimate::{is_better, of_views};
use super::evidence::{COLUMNS, Evidence};
use super::photometric::Problem;
use super::{Lens, LoadedView, Pinhole, Pose};
use crate::Distortion;
use crate::register::exposure;
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

/// Where a ray leaves the room, as a multiple of its direction.
fn wall(eye: DVec3, ray: DVec3) -> f64 {
    let along = |i: usize| (HALF[i] * ray[i].signum() - eye[i]) / ray[i];
    (0..3)
        .filter(|&i| ray[i] != 0.0)
        .map(along)
        .fold(f64::INFINITY, f64::min)
}

/// Light and dark with some ten pixels' period, different in each channel.
fn texture(p: DVec3) -> [f64; 3] {
    let wave = |k: DVec3, phase: f64| (p.dot(k) + phase).sin() * 24.0;
    [0.0, 1.0, 2.0].map(|c| {
        128.0
            + wave(dvec3(9.0, 5.0, 7.0), c)
            + wave(dvec3(-4.0, 11.0, 3.0), 2.0 * c)
            + wave(dvec3(2.0, -3.0, 5.0), 0.5 * c)
    })
}

/// A view whose depth is seen by one camera and whose colours by another.
fn view(depth: (Lens, Pose), color: (Lens, Pose), gain: f64) -> Evidence {
    let pixels = || {
        (0..SIZE[1])
            .flat_map(|y| (0..SIZE[0]).map(move |x| [f64::from(x) + 0.5, f64::from(y) + 0.5]))
    };
    let ray = |(lens, pose): (Lens, Pose), at: [f64; 2]| pose.world_from_eye * lens.ray(at, SIZE);
    let color_at = |at: [f64; 2]| {
        let ray = ray(color, at);
        let levels = texture(color.1.eye + ray * wall(color.1.eye, ray))
            .map(|level| (level * gain + 0.5) as u8);
        [levels[0], levels[1], levels[2], 255]
    };
    let depths = pixels()
        .map(|at| wall(depth.1.eye, ray(depth, at)) as f32)
        .collect();
    let color = pixels().map(color_at).collect();
    Evidence::of(
        &LoadedView {
            size_px: SIZE,
            lens: depth.0,
            pose: depth.1,
            color,
            depth: depths,
        },
        COLUMNS,
    )
}

/// Turned about all axes, and moved far enough: what all views share would else be free along the way that they turn.
fn pose(i: usize) -> Pose {
    let i = i as f64;
    let turn = DMat3::from_rotation_y(0.06 * i) * DMat3::from_rotation_x(0.2 * (i * 0.9).sin());
    let eye = dvec3(0.06 * i, 0.3 * (i * 0.7).sin(), 0.3 * (i * 0.5).cos());
    Pose {
        eye,
        world_from_eye: turn * DMat3::from_rotation_z(0.3 * (i * 1.3).sin()),
    }
}

/// What `pose` becomes by a turn and a step of the camera.
fn beside(pose: Pose, turn: DVec3, step: DVec3) -> Pose {
    let turned = DMat3::from_axis_angle(turn.normalize(), turn.length());
    Pose {
        eye: pose.to_world(step),
        world_from_eye: pose.world_from_eye * turned,
    }
}

#[test]
fn another_lens_another_moment_and_another_exposure_are_found() {
    let own = |i: usize| {
        dvec3(
            (i as f64 * 1.7).sin(),
            (i as f64 * 2.3).cos(),
            (i as f64 * 0.7).sin(),
        ) * 0.004
    };
    let gains: Vec<f64> = (0..14).map(|i| 1.0 + 0.01 * (f64::from(i) - 6.5)).collect();
    let truth: Vec<Pose> = (0..14)
        .map(|i| {
            beside(
                pose(i),
                dvec3(0.003, -0.004, 0.002) + own(i),
                dvec3(0.025, 0.0, 0.0),
            )
        })
        .collect();
    let views = (0..14)
        .map(|i| view((lens(146.0), pose(i)), (lens(130.0), truth[i]), gains[i]))
        .collect();
    let problem = Problem::new(views, pinhole(146.0));
    let given = problem.as_given();
    let one = problem.one_for_all(&given);
    let each = problem.each_view(&one);
    let levels = [&given, &one, &each].map(|state| problem.unseen_levels(state));
    assert!(
        levels[1] < levels[0] * 0.6 && levels[2] < levels[1] * 0.6,
        "{levels:?}"
    );
    let found_gains = exposure::estimate(&problem, &each);
    let found = each.registrations(&found_gains);
    assert!(
        (found[0].lens.focal_px[0] / 130.0 - 1.0).abs() < 0.01,
        "{:?}",
        found[0].lens
    );
    // Turns, steps and the lens's centre make up for one another: what counts is where points are seen. That all colours lie a
    // little aside on the walls hardly shows in their differences; that each does otherwise would.
    let mut off = Vec::new();
    for (found, truth) in found.iter().zip(&truth) {
        for at in [[20.0, 20.0], [80.0, 60.0], [140.0, 30.0], [60.0, 100.0]] {
            let ray = truth.world_from_eye * lens(130.0).ray(at, SIZE);
            let eye = found.pose.to_eye(truth.eye + ray * wall(truth.eye, ray));
            let seen = found
                .lens
                .distortion
                .apply(DVec2::new(eye.x / -eye.z, eye.y / eye.z))
                * found.lens.focal_px[0];
            off.push(DVec2::from_array(found.lens.principal_px) + seen - DVec2::from_array(at));
        }
    }
    let common = off.iter().sum::<DVec2>() / off.len() as f64;
    let own = off.iter().map(|off| off.distance(common)).sum::<f64>() / off.len() as f64;
    assert!(common.length() < 1.5 && own < 0.5, "{common} px, {own} px");
    for (found, gain) in found_gains.iter().zip(&gains) {
        for found in found {
            assert!(
                (f64::from(*found) / gain - 1.0).abs() < 0.015,
                "{found_gains:?}"
            );
        }
    }
}

#[test]
fn what_is_registered_stays_as_it_is() {
    let views = (0..10)
        .map(|i| view((lens(146.0), pose(i)), (lens(146.0), pose(i)), 1.0))
        .collect();
    let problem = Problem::new(views, pinhole(146.0));
    let given = problem.as_given();
    let one = problem.one_for_all(&given);
    let each = problem.each_view(&one);
    let levels = [&given, &one, &each].map(|state| problem.unseen_levels(state));
    assert!(
        !is_better(levels[1], levels[0]) && !is_better(levels[2], levels[0]),
        "{levels:?}"
    );
    assert!(
        each.moved_from(problem.poses())[0] < 0.1,
        "{:?}",
        each.moved_from(problem.poses())
    );
    assert!(
        exposure::estimate(&problem, &given)
            .iter()
            .flatten()
            .all(|&gain| gain == 1.0)
    );
}

#[test]
fn views_without_overlap_prove_nothing() {
    let back = Pose {
        world_from_eye: DMat3::from_rotation_y(3.0),
        ..pose(0)
    };
    let views = [pose(0), back].map(|pose| view((lens(146.0), pose), (lens(146.0), pose), 1.0));
    let problem = Problem::new(views.into(), pinhole(146.0));
    assert!(problem.pairs().is_empty());
}

/// What is judged by a part says the same of all views as if all had been asked.
#[test]
fn a_part_speaks_for_all() {
    const VIEWS: usize = 40;
    let beside_all =
        |i: usize| beside(pose(i), dvec3(0.003, -0.004, 0.002), dvec3(0.025, 0.0, 0.0));
    let own = |i: usize| {
        dvec3(
            (i as f64 * 1.7).sin(),
            (i as f64 * 2.3).cos(),
            (i as f64 * 0.7).sin(),
        ) * 0.004
    };
    let each = |i: usize| beside(beside_all(i), own(i), DVec3::ZERO);
    let poses: Vec<Pose> = (0..VIEWS).map(pose).collect();
    let gain = |i: usize| 1.0 + 0.08 * (i as f64 * 0.4).sin();
    // The lens of the colours, where they were taken, how exposed, what is to be kept, and how often views are loaded.
    type Case<'a> = (
        f64,
        &'a dyn Fn(usize) -> Pose,
        &'a dyn Fn(usize) -> f64,
        Kept,
        usize,
    );
    let cases: [Case; 4] = [
        (146.0, &pose, &|_| 1.0, Kept::AsGiven, 16),
        (130.0, &beside_all, &|_| 1.0, Kept::OneForAll, 16),
        (146.0, &pose, &gain, Kept::AsGiven, 16 + VIEWS),
        (130.0, &each, &gain, Kept::EachView, 16 + VIEWS),
    ];
    for (focal, truth, gain, kept, loads) in cases {
        let loaded = std::cell::Cell::new(0);
        let load = |numbers: &[usize], _: u32| {
            loaded.set(loaded.get() + numbers.len());
            let view = |&i: &usize| view((lens(146.0), pose(i)), (lens(focal), truth(i)), gain(i));
            Ok(numbers.iter().map(view).collect())
        };
        let (report, found) = of_views(&poses, pinhole(146.0), 4, &load)
            .expect("loads")
            .expect("pairs");
        assert_eq!(
            (report.kept, report.judged, loaded.get()),
            (kept, 16, loads),
            "{report:?}"
        );
        let mean = (0..VIEWS).map(|i| gain(i).ln()).sum::<f64>() / VIEWS as f64;
        let mut off = DVec2::ZERO;
        for (i, found) in found.iter().enumerate() {
            let gain = gain(i) / mean.exp();
            assert!(
                found
                    .gain
                    .iter()
                    .all(|found| (f64::from(*found) / gain - 1.0).abs() < 0.03),
                "{i}: {found:?} {gain}"
            );
            let ray = truth(i).world_from_eye * lens(focal).ray([80.0, 60.0], SIZE);
            let eye = found
                .pose
                .to_eye(truth(i).eye + ray * wall(truth(i).eye, ray));
            let seen = DVec2::new(eye.x / -eye.z, eye.y / eye.z) * found.lens.focal_px[0];
            off += (DVec2::from_array(found.lens.principal_px) + seen - dvec2(80.0, 60.0)).abs()
                / VIEWS as f64;
        }
        assert!(off.length() < 1.6, "{kept:?}: {off} px");
    }
}

/// A post before a wall, seen from places far apart: behind the post other parts of the wall are hidden from each.
#[test]
fn what_is_hidden_from_a_view_does_not_speak_for_another_camera() {
    let lens = lens(146.0);
    let seen = |eye: DVec3, ray: DVec3| {
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
                texture(pose.eye + ray * seen(pose.eye, ray)).map(|level| (level + 0.5) as u8);
            [levels[0], levels[1], levels[2], 255]
        };
        let depth = rays().map(|ray| seen(pose.eye, ray) as f32).collect();
        Evidence::of(
            &LoadedView {
                size_px: SIZE,
                lens,
                pose,
                color: rays().map(color).collect(),
                depth,
            },
            COLUMNS,
        )
    };
    let problem = Problem::new((0..14).map(view).collect(), pinhole(146.0));
    let given = problem.as_given();
    let one = problem.one_for_all(&given);
    let each = problem.each_view(&one);
    let levels = [&given, &one, &each].map(|state| problem.unseen_levels(state));
    assert!(levels[0] < 1.5, "nothing hidden is compared: {levels:?}");
    assert!(
        !is_better(levels[1], levels[0]) && !is_better(levels[2], levels[0]),
        "{levels:?}"
    );
}
