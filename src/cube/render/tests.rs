//! Settings against each other, on a small cube of random samples (on analytic scenes:
//! `tests/library/warp_*.rs`).

use super::renderer::default_band_rows;
use super::*;
use crate::pack::tests::scattered;
use crate::pack::{CubeLdi, SplatIndexLayout, Split};
use footprint::splat::SplatKernel;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::random::Rng;

/// Creates cameras with epipoles in the frame, outside it and at infinity, and one at the centre.
pub(crate) fn cameras() -> Vec<Camera> {
    let mut random = Rng::keyed(3);
    let eyes = [
        DVec3::ZERO,
        DVec3::new(0.4, 0.1, 0.3),
        DVec3::new(0.0, -0.3, 0.0),
        DVec3::new(-0.2, 0.45, -1.3),
    ];
    let ahead = |eye: DVec3, i: usize| {
        if i.is_multiple_of(2) {
            eye + DVec3::new(0.1, 0.05, -0.02)
        } else {
            DVec3::X
        }
    };
    let camera = |(i, eye): (usize, DVec3)| {
        let target = eye + ahead(eye, i) + random.in_cube(0.2);
        Camera::look_at(eye, target, DVec3::Y, [100.0, 60.0][i / 2], [52, 37]).expect("valid")
    };
    // Rounded, so that translation loses no bits.
    let eyes = eyes.map(|eye| (eye * 1024.0).round() / 1024.0);
    eyes.into_iter().enumerate().map(camera).collect()
}

pub(super) fn cube() -> CubeLdi {
    CubeLdi::pack(&scattered(), SplatIndexLayout::Normal, Split::AtDepth(1.25)).expect("packs")
}

#[test]
fn bands_and_clipping_change_no_bit() {
    let cube = cube();
    let mut renderer = Renderer::new();
    let depth_pixels = cube.depth_pixel_count() as u64;
    for camera in cameras() {
        for kernel in [SplatKernel::Tent, SplatKernel::Paper, SplatKernel::Square2] {
            let settings = |band_rows| RenderSettings {
                kernel,
                depth: true,
                band_rows,
                ..RenderSettings::default()
            };
            let unclipped = RenderSettings {
                unclipped: true,
                ..settings(37)
            };
            let (expected, warped) = renderer.render_with_stats(&cube, &camera, &unclipped);
            let expected = expected.clone();
            let warped = *warped;
            assert_eq!(warped.depth_pixels_in, depth_pixels);
            assert_eq!(
                warped.behind_or_outside + warped.splatted,
                warped.depth_pixels_in
            );
            assert_eq!(warped.by_footprint.iter().sum::<u64>(), warped.splatted);
            assert!(warped.splatted > 0);
            for band_rows in [37, 1, 8, 0] {
                let (frame, stats) =
                    renderer.render_with_stats(&cube, &camera, &settings(band_rows));
                assert!(*frame == expected, "{kernel:?}, bands of {band_rows} rows");
                let stats = *stats;
                assert_eq!(stats.hole_pixels, warped.hole_pixels);
                assert_eq!(
                    stats.behind_or_outside + stats.splatted,
                    stats.depth_pixels_in
                );
                if band_rows == 37 {
                    let counts = renderer.clip_counts(&cube, &camera, &settings(37));
                    assert_eq!(counts.kept, stats.depth_pixels_in);
                    assert_eq!(stats.splatted, warped.splatted);
                    assert_eq!(counts.culled + counts.clipped + counts.kept, depth_pixels);
                    assert!(counts.culled > 0 && counts.kept < depth_pixels);
                }
            }
        }
    }
}

#[test]
fn stage_times_and_imbalance_are_measured() {
    let mut renderer = Renderer::new();
    let settings = RenderSettings::default();
    let (_, stats) = renderer.render_with_stats(&cube(), &cameras()[1], &settings);
    assert!(stats.clear_ms > 0.0 && stats.warp_ms > 0.0 && stats.finish_ms > 0.0);
    assert!(stats.frame_ms > 0.0);
    let imbalance = stats.imbalance;
    assert!(imbalance > 1.0 - 1e-9, "{imbalance}: slowest over mean");
}

#[test]
fn default_bands_are_several_per_thread() {
    assert_eq!(
        [1, 2, 64].map(|threads| default_band_rows(720, threads)),
        [192, 96, 16]
    );
    assert_eq!(default_band_rows(1, 1), 16);
    assert_eq!(default_band_rows(2160, usize::MAX), 16);
}

#[test]
fn frame_is_independent_of_cube_position() {
    let cube = cube();
    let mut renderer = Renderer::new();
    let offset = DVec3::new(4.0, -2.0, 8.0);
    let mut moved_cube = cube.clone();
    moved_cube.info.centre = offset;
    let settings = RenderSettings::default();
    for camera in cameras() {
        let moved_camera = camera.with_eye(camera.eye() + offset);
        let expected = renderer.render(&cube, &camera, &settings).clone();
        assert!(*renderer.render(&moved_cube, &moved_camera, &settings) == expected);
        assert_eq!(
            renderer.clip_counts(&cube, &camera, &settings),
            renderer.clip_counts(&moved_cube, &moved_camera, &settings)
        );
    }
}

#[test]
fn small_holes_are_filled_unless_kept() {
    let cube = cube();
    let mut renderer = Renderer::new();
    for (kernel, fills) in [
        (SplatKernel::Tent, true),
        (SplatKernel::Ellipse, true),
        (SplatKernel::Opaque, false),
    ] {
        let camera = &cameras()[1];
        let settings = RenderSettings {
            kernel,
            keep_holes: true,
            ..RenderSettings::default()
        };
        let (frame, stats) = renderer.render_with_stats(&cube, camera, &settings);
        let with_holes = frame.clone();
        let holes = stats.hole_pixels;
        assert!(holes > 0 && with_holes.hole_count() == holes);
        let settings = RenderSettings {
            kernel,
            ..RenderSettings::default()
        };
        let (filled, stats) = renderer.render_with_stats(&cube, camera, &settings);
        assert_eq!(stats.hole_pixels, holes, "filled or not");
        assert_eq!(filled.color != with_holes.color, fills, "{kernel:?}");
    }
}
