//! Cameras around an object.

use super::*;
use glam::DMat3;
use headbox_images::{Distortion, Lens, Pinhole, Pose};

/// Views of a patterned ball from a ring, through lenses whose fields of view are narrower than the
/// steps between cameras.
fn narrow_ring(step_deg: f64, count: u32) -> Vec<LoadedView> {
    const RADIUS: f64 = 0.5;
    let size = [96, 96];
    // 13 degrees, corner to corner.
    let focal = 600.0;
    let lens = Lens::Pinhole(Pinhole {
        focal_px: [focal; 2],
        principal_px: [48.0; 2],
        distortion: Distortion::default(),
    });
    let view = |i: u32| {
        let turn = DMat3::from_rotation_y((f64::from(i) * step_deg).to_radians());
        let eye = turn * DVec3::Z * 10.0;
        let met = |x: u32, y: u32| {
            let ray = turn * lens.ray([f64::from(x) + 0.5, f64::from(y) + 0.5], size);
            let along = -eye.dot(ray) / ray.length_squared();
            let aside = (eye + ray * along).length_squared();
            (aside < RADIUS * RADIUS)
                .then(|| along - ((RADIUS * RADIUS - aside) / ray.length_squared()).sqrt())
        };
        let pixels = || (0..size[0] * size[1]).map(|i| (i % size[0], i / size[0]));
        let color = |(x, y)| {
            let ray = turn * lens.ray([f64::from(x) + 0.5, f64::from(y) + 0.5], size);
            let [r, g, b] = met(x, y).map_or([0; 3], |depth| {
                let p = (eye + ray * depth) * 4.0;
                pattern(p.x + p.z, p.y)
            });
            [r, g, b, 255]
        };
        LoadedView {
            size_px: size,
            lens,
            pose: Pose {
                eye,
                world_from_eye: turn,
            },
            color: pixels().map(color).collect(),
            depth: pixels()
                .map(|(x, y)| met(x, y).map_or(f32::NAN, |depth| depth as f32))
                .collect(),
        }
    };
    (0..count).map(view).collect()
}

#[test]
fn surrounding_cameras_serve_each_other() {
    let views = narrow_ring(22.5, 16);
    let (_folder, mut geometry) = opened(&views, &grid(2, 2));
    geometry.leave_out(&[0]);
    let camera = Camera::from_parts(
        views[0].pose.eye,
        views[0].pose.world_from_eye,
        600.0,
        96,
        96,
    )
    .expect("a camera");
    let (shown, stats) = frame(&geometry, &camera, &settings(Texturing::Averaged));
    // Two on each side look from within 60 degrees; those farther round see the other side.
    assert_eq!(stats.cameras_valid, 4);
    let (mut on_ball, mut covered, mut off) = (0, 0, 0.0);
    for (i, depth) in views[0]
        .depth
        .iter()
        .enumerate()
        .filter(|(_, depth)| depth.is_finite())
    {
        on_ball += 1;
        if shown.coverage[i].is_hole() {
            continue;
        }
        covered += 1;
        off += (0..3)
            .map(|c| f64::from(shown.color[i][c].abs_diff(views[0].color[i][c])))
            .sum::<f64>()
            / 3.0;
        assert!(*depth < 10.0);
    }
    assert!(
        on_ball > 2500 && covered * 10 > on_ball * 9,
        "{covered} of {on_ball}"
    );
    assert!(
        off / f64::from(covered) < 6.0,
        "{} levels",
        off / f64::from(covered)
    );
}
