//! Ways to draw a frame against each other, on a small cube of samples at random (the same on analytic scenes: `tests/library/warp_*.rs`).

use super::*;
use crate::pack::tests::scattered;
use crate::pack::{SplatIndexLayout, Split};
use glam::DVec3;
use headbox_core::random::Rng;

/// Eyes with epipoles in a frame, beside it and at infinity, and at the centre.
pub(super) fn cameras() -> Vec<Camera> {
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
        let at = eye + ahead(eye, i) + random.in_cube(0.2);
        Camera::look_at(eye, at, DVec3::Y, [100.0, 60.0][i / 2], [52, 37]).expect("valid")
    };
    // So that no bit is lost where a cube stands elsewhere.
    let eyes = eyes.map(|eye| (eye * 1024.0).round() / 1024.0);
    eyes.into_iter().enumerate().map(camera).collect()
}

pub(super) fn cube() -> PackedCube {
    PackedCube::pack(&scattered(), SplatIndexLayout::Normal, Split::AtDepth(1.25)).expect("packs")
}

fn depth_pixels(cube: &PackedCube) -> u64 {
    cube.depth_pixel_count() as u64
}

#[test]
fn fragments_give_the_frame_of_bands() {
    let cube = cube();
    let (mut bands, mut fragments) = (Renderer::new(), Renderer::new());
    for (i, camera) in cameras().iter().enumerate() {
        for (kernel, count) in [
            (SplatKernel::Tent, 5),
            (SplatKernel::Opaque, 2),
            (SplatKernel::Ellipse, 3),
        ] {
            let settings = RenderSettings {
                kernel,
                depth: true,
                ..RenderSettings::default()
            };
            let (expected, of_bands) = bands.render_with_stats(&cube, camera, &settings);
            let settings = RenderSettings {
                parallel: Parallel::Fragments(count),
                ..settings
            };
            let (found, stats) = fragments.render_with_stats(&cube, camera, &settings);
            assert!(found == expected, "{kernel:?}, eye {i}");
            assert_eq!(stats.hole_pixels, of_bands.hole_pixels);
            for stats in [stats, of_bands] {
                assert!(
                    stats.clear_ms >= 0.0
                        && stats.warp_ms > 0.0
                        && stats.finish_ms > 0.0
                        && stats.frame_ms > 0.0
                );
                assert!(
                    stats.imbalance > 1.0 - 1e-9,
                    "{}: the slowest over the mean",
                    stats.imbalance
                );
            }
            assert!(
                stats.redone_pixels <= 52 * 37
                    && stats.redone_depth_pixels <= stats.depth_pixels_in
            );
            if i > 0 {
                assert!(
                    stats.largest_fragment > 0 && stats.largest_fragment <= depth_pixels(&cube)
                );
                assert!(
                    stats.redone_pixels > 0 && stats.redone_depth_pixels > 0,
                    "{kernel:?}, eye {i}"
                );
            }
        }
    }
}

#[test]
fn bands_and_clipping_change_no_bit_and_counts_add_up() {
    let (cube, mut renderer) = (cube(), Renderer::new());
    for camera in cameras() {
        for kernel in [SplatKernel::Tent, SplatKernel::Paper, SplatKernel::Square2] {
            let of_rows = |band_rows| RenderSettings {
                kernel,
                depth: true,
                band_rows,
                ..RenderSettings::default()
            };
            let all = RenderSettings {
                unclipped: true,
                ..of_rows(37)
            };
            let (expected, warped) = renderer.render_with_stats(&cube, &camera, &all);
            let (expected, warped) = (expected.clone(), *warped);
            assert_eq!(warped.depth_pixels_in, depth_pixels(&cube));
            assert_eq!(
                warped.behind_or_outside + warped.splatted,
                warped.depth_pixels_in
            );
            assert_eq!(warped.by_footprint.iter().sum::<u64>(), warped.splatted);
            assert!(warped.splatted > 0);
            for band_rows in [37, 1, 8, 0] {
                let (found, stats) =
                    renderer.render_with_stats(&cube, &camera, &of_rows(band_rows));
                assert!(*found == expected, "{kernel:?}, bands of {band_rows} rows");
                assert_eq!(stats.hole_pixels, warped.hole_pixels);
                let (found, stats) = (stats.depth_pixels_in, *stats);
                assert_eq!(stats.behind_or_outside + stats.splatted, found);
                if band_rows == 37 {
                    let counts = renderer.clip_counts(&cube, &camera, &of_rows(37));
                    assert_eq!((counts.kept, stats.splatted), (found, warped.splatted));
                    assert_eq!(
                        counts.culled + counts.clipped + counts.kept,
                        depth_pixels(&cube)
                    );
                    assert!(counts.culled > 0 && counts.kept < depth_pixels(&cube));
                }
            }
        }
    }
}

#[test]
fn bands_are_so_many_that_threads_even_out() {
    assert_eq!(
        [1, 2, 64].map(|threads| default_band_rows(720, threads)),
        [192, 96, 16]
    );
    assert_eq!(
        (default_band_rows(1, 1), default_band_rows(2160, usize::MAX)),
        (16, 16)
    );
}

#[test]
fn a_frame_is_the_same_wherever_its_cube_stands() {
    let (here, mut renderer) = (cube(), Renderer::new());
    let (mut there, moved) = (here.clone(), DVec3::new(4.0, -2.0, 8.0));
    there.info.centre = moved;
    for camera in cameras() {
        let moved = camera.with_eye(camera.eye() + moved);
        for parallel in [Parallel::Bands, Parallel::Fragments(3)] {
            let settings = RenderSettings {
                parallel,
                ..RenderSettings::default()
            };
            let expected = renderer.render(&here, &camera, &settings).clone();
            assert!(
                *renderer.render(&there, &moved, &settings) == expected,
                "{parallel:?}"
            );
        }
        let settings = RenderSettings::default();
        assert_eq!(
            renderer.clip_counts(&here, &camera, &settings),
            renderer.clip_counts(&there, &moved, &settings)
        );
    }
}

#[test]
fn small_holes_are_filled_unless_they_are_to_be_kept() {
    let (cube, mut renderer) = (cube(), Renderer::new());
    for (kernel, fills) in [
        (SplatKernel::Tent, true),
        (SplatKernel::Ellipse, true),
        (SplatKernel::Opaque, false),
    ] {
        let camera = &cameras()[1];
        let kept = RenderSettings {
            kernel,
            keep_holes: true,
            ..RenderSettings::default()
        };
        let (kept, of_kept) = renderer.render_with_stats(&cube, camera, &kept);
        let (kept, holes) = (kept.clone(), of_kept.hole_pixels);
        assert!(holes > 0 && kept.hole_count() == holes);
        let settings = RenderSettings {
            kernel,
            ..RenderSettings::default()
        };
        let (filled, stats) = renderer.render_with_stats(&cube, camera, &settings);
        assert_eq!(stats.hole_pixels, holes, "filled or not");
        assert_eq!(filled.color != kept.color, fills, "{kernel:?}");
    }
}
