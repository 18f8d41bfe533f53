//! Frames that are known exactly: ray by ray, at the cameras, and in every way to run.

use crate::tests::{Bed, render, unmerged};
use crate::*;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::random::Rng;
use headbox_core::simd;

/// Share of pixels where a position of 24 bits may find the texel beside that of 53 bits.
const OTHER_TEXELS: f64 = 0.001;
/// Rounding to 12 bits of linear light, levels.
const ROUNDING: u8 = 1;

#[test]
fn frames_are_those_of_rays_one_by_one() {
    let bed = Bed::usual();
    let mut lumigraph = bed.lumigraph();
    let mut random = Rng::keyed(7);
    let texels = (0..6 * 16)
        .map(|_| [random.below(256) as u8, random.below(256) as u8, 90, 255])
        .collect();
    lumigraph.environment = Environment { size_px: 4, texels };
    let settings = LumigraphSettings::default();
    let variants = [
        settings,
        LumigraphSettings {
            blend: Blend::Whole,
            ..settings
        },
        LumigraphSettings {
            merge: false,
            levels: false,
            ..settings
        },
        LumigraphSettings {
            tolerance_px: 20.0,
            ..settings
        },
    ];
    let (mut off, mut pixels, mut drawn) = (0, 0, 0);
    for camera in bed.cameras() {
        for settings in &variants {
            let (fast, slow) = (
                render(&lumigraph, &camera, settings),
                render_by_rays(&lumigraph, &camera, settings),
            );
            let differs =
                |(a, b): &(&[u8; 4], &[u8; 4])| (0..3).any(|c| a[c].abs_diff(b[c]) > ROUNDING);
            off += fast.color.iter().zip(&slow.color).filter(differs).count();
            pixels += fast.color.len();
            drawn += fast
                .coverage
                .iter()
                .filter(|coverage| coverage.splat_share() > 0)
                .count();
        }
    }
    assert!(
        off as f64 <= OTHER_TEXELS * pixels as f64,
        "{off} of {pixels} pixels"
    );
    assert!(
        drawn * 2 > pixels,
        "there was something to see in {drawn} of {pixels}"
    );
}

#[test]
fn levels_threads_and_skipping_change_no_bit() {
    let bed = Bed::usual();
    let lumigraph = bed.lumigraph();
    for blend in [Blend::Shared, Blend::Whole] {
        let settings = LumigraphSettings {
            blend,
            ..LumigraphSettings::default()
        };
        for camera in bed.cameras() {
            let expected = render(&lumigraph, &camera, &settings);
            for level in simd::levels() {
                let mut renderer = LumigraphRenderer::with_level(level);
                assert_eq!(
                    renderer.render(&lumigraph, &camera, &settings).0,
                    &expected,
                    "{}",
                    simd::name(level)
                );
            }
            let all = LumigraphSettings {
                skip: false,
                ..settings
            };
            assert_eq!(render(&lumigraph, &camera, &all), expected, "rectangles");
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .expect("a pool");
                assert_eq!(
                    pool.install(|| render(&lumigraph, &camera, &settings)),
                    expected,
                    "{threads} threads"
                );
            }
        }
    }
}

#[test]
fn rectangles_leave_most_layers_out() {
    let bed = Bed::usual();
    let lumigraph = bed.lumigraph();
    let camera = bed.camera(DVec3::new(0.1, 0.1, 0.5), DVec3::NEG_Z, [200, 150]);
    let asked = |skip| {
        let settings = LumigraphSettings { skip, ..unmerged() };
        LumigraphRenderer::new()
            .render(&lumigraph, &camera, &settings)
            .1
            .layer_pixels
    };
    assert!(
        asked(true) * 4 < asked(false) * 3,
        "{} of {}",
        asked(true),
        asked(false)
    );
}

#[test]
fn the_first_view_shows_what_the_images_show() {
    let bed = Bed::usual();
    let lumigraph = bed.lumigraph();
    let holes = |fov_y_deg: f64, size_px: [u32; 2]| {
        let eye = bed.grid.origin();
        let camera =
            Camera::look_at(eye, eye + DVec3::NEG_Z, DVec3::Y, fov_y_deg, size_px).expect("valid");
        render(&lumigraph, &camera, &LumigraphSettings::default()).hole_count()
    };
    for size_px in [[96, 64], [64, 96], [97, 97]] {
        let fov_y_deg = lumigraph.clear_fov_deg(size_px);
        assert_eq!(
            holes(fov_y_deg, size_px),
            0,
            "{size_px:?}, {fov_y_deg} degrees"
        );
        assert!(
            holes(fov_y_deg * 1.7, size_px) > 50,
            "{size_px:?}: a wider view looks past the images"
        );
    }
}

#[test]
fn frame_at_camera_equals_its_image() {
    let bed = Bed::usual();
    let lumigraph = bed.lumigraph();
    for (column, row) in [(0, 0), (1, 1), (3, 2), (2, 0)] {
        let frame = render(&lumigraph, &bed.grid.camera(column, row), &unmerged());
        let picture = &lumigraph.pictures()[row * 4 + column];
        let off = frame
            .color
            .iter()
            .zip(&picture.color)
            .filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > ROUNDING));
        // Positions of 24 bits are not quite the middles of texels.
        assert!(off.count() * 200 < picture.color.len());
    }
}
