//! Bands, threads and clipping change no bit of a frame: every setting against one band with
//! nothing clipped.

use crate::common::bed::{leaves, room};
use crate::common::capture::quick;
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::random::Rng;
use headbox_core::simd;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{RenderSettings, Renderer};

/// One for each way to draw a splat.
const KERNELS: [SplatKernel; 6] = [
    SplatKernel::Tent,
    SplatKernel::Opaque,
    SplatKernel::Paper,
    SplatKernel::Plus,
    SplatKernel::Ellipse,
    SplatKernel::Point,
];

/// Eyes at the centre, on lines that put an epipole into a pixel, on a corner, far away and at
/// infinity (hard cases 1 and 3), on a face and a corner of the headbox, and anywhere inside and
/// around it.
fn eyes() -> Vec<DVec3> {
    let mut random = Rng::keyed(11);
    let cell = 2.0 / 48.0;
    let mut eyes = vec![
        DVec3::ZERO,
        dvec3(0.4, 0.0, 0.0),
        dvec3(0.3, 0.3, 0.0),
        dvec3(0.3, -0.2, 1e-18),
        dvec3(2.3 * cell, -1.7 * cell, 1.0) * 0.4,
        dvec3(cell, cell, -1.0) * 0.4,
        dvec3(0.5, 0.1, -0.2),
        DVec3::splat(-0.5),
    ];
    eyes.extend((0..8).map(|_| random.in_cube(0.5)));
    eyes.extend((0..8).map(|_| random.in_cube(3.0)));
    eyes
}

fn draw(cube: &CubeLdi, camera: &Camera, settings: RenderSettings, threads: usize) -> (Frame, u64) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("threads");
    let mut renderer = Renderer::new();
    let (frame, stats) = pool.install(|| renderer.render_with_stats(cube, camera, &settings));
    (frame.clone(), stats.depth_pixels_in)
}

/// Minimum saving by clipping relative to culling of whole segments, mean over views inside the
/// headbox.
const CLIPPING_SAVES: f64 = 1.5;

#[test]
fn clipping_counts_are_what_is_drawn() {
    for scene in [room(6.0), leaves(6.0)] {
        let cube = CubeLdi::pack(&quick(&scene, 160), SplatIndexLayout::Normal, Split::Auto)
            .expect("packs");
        let (mut random, mut renderer) = (Rng::keyed(9), Renderer::new());
        let mut savings = Vec::new();
        for _ in 0..40 {
            let eye = random.in_cube(0.5);
            let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, 60.0, [64, 48])
                .expect("valid");
            let settings = RenderSettings {
                band_rows: camera.height(),
                ..RenderSettings::default()
            };
            let counts = renderer.clip_counts(&cube, &camera, &settings);
            let drawn = *renderer.render_with_stats(&cube, &camera, &settings).1;
            assert_eq!(
                counts.culled + counts.clipped + counts.kept,
                cube.depth_pixel_count() as u64
            );
            assert_eq!(counts.kept, drawn.depth_pixels_in);
            let unclipped = RenderSettings {
                unclipped: true,
                ..settings
            };
            assert_eq!(
                renderer
                    .render_with_stats(&cube, &camera, &unclipped)
                    .1
                    .splatted,
                drawn.splatted,
                "nothing that shows is lost"
            );
            savings.push((counts.clipped + counts.kept) as f64 / counts.kept.max(1) as f64);
        }
        let mean = savings.iter().sum::<f64>() / savings.len() as f64;
        assert!(mean > CLIPPING_SAVES, "{mean}");
        // From the centre, the face behind is invisible, and all others except the front one are at
        // most clipped.
        let ahead =
            Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [64, 48]).expect("valid");
        let counts = renderer.clip_counts(&cube, &ahead, &RenderSettings::default());
        let of = |face| {
            cube.segments
                .iter()
                .filter(move |s| s.face == face)
                .map(|s| s.depth_pixels.len() as u64)
                .sum()
        };
        let (behind, in_front): (u64, u64) = (of(Face::PosZ), of(Face::NegZ));
        assert!(
            behind > 0 && in_front > 0 && counts.culled >= behind,
            "{counts:?}, {behind} behind"
        );
        assert!(
            counts.clipped + counts.kept >= in_front,
            "{counts:?}, {in_front} in front"
        );
    }
}

#[test]
fn no_setting_changes_a_bit() {
    let (mut all, mut clipped) = (0, 0);
    for scene in [room(6.0), leaves(6.0)] {
        let ldi = quick(&scene, 80);
        let mut random = Rng::keyed(5);
        for (i, eye) in eyes().into_iter().enumerate() {
            let layout = [SplatIndexLayout::Normal, SplatIndexLayout::Paper][i % 2];
            let cube =
                CubeLdi::pack(&ldi, layout, [Split::Auto, Split::None][i / 2 % 2]).expect("packs");
            let fov = [1.0, 40.0, 90.0, 170.0][i % 4];
            let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, fov, [97, 61])
                .expect("valid");
            for kernel in [0, 3].map(|k| KERNELS[(i + i / 6 + k) % 6]) {
                let settings = |unclipped, band_rows| RenderSettings {
                    kernel,
                    unclipped,
                    band_rows,
                    depth: true,
                    ..Default::default()
                };
                let (expected, warped) = draw(&cube, &camera, settings(true, 61), 1);
                all += warped;
                let has_depth = |(coverage, depth_m): (&Coverage, &f32)| {
                    depth_m.is_finite() == (coverage.splat_share() > 0)
                };
                let pixels = expected.coverage.iter().zip(&expected.depth_m);
                assert_eq!(
                    pixels.clone().filter(|&pixel| !has_depth(pixel)).count(),
                    0,
                    "{kernel:?}: covered and no depth"
                );
                assert!(pixels.len() == 97 * 61, "as many depths as pixels");
                for (unclipped, band_rows, threads) in
                    [(false, 61, 1), (true, 7, 3), (false, 1, 2), (false, 20, 2)]
                {
                    let (found, warped) =
                        draw(&cube, &camera, settings(unclipped, band_rows), threads);
                    assert!(
                        found == expected,
                        "eye {eye}, {kernel:?}, {unclipped}, {band_rows} rows, {threads} threads"
                    );
                    if band_rows == 61 {
                        clipped += warped;
                    }
                }
            }
        }
    }
    assert!(clipped * 2 < all, "clipping left {clipped} of {all}");
}

#[test]
fn no_simd_level_changes_a_bit() {
    let levels = simd::levels();
    let cube = CubeLdi::pack(
        &quick(&leaves(6.0), 80),
        SplatIndexLayout::Normal,
        Split::Auto,
    )
    .expect("packs");
    let mut random = Rng::keyed(6);
    for eye in eyes() {
        let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, 75.0, [97, 61])
            .expect("valid");
        for kernel in KERNELS {
            let settings = RenderSettings {
                kernel,
                ..RenderSettings::default()
            };
            let expected = Renderer::with_level(levels[0])
                .render(&cube, &camera, &settings)
                .clone();
            for level in &levels[1..] {
                let found = Renderer::with_level(*level)
                    .render(&cube, &camera, &settings)
                    .clone();
                assert!(found == expected, "eye {eye}, {kernel:?}, {level:?}");
            }
        }
    }
}

#[test]
fn frames_of_every_size_are_drawn() {
    let cube = CubeLdi::pack(
        &quick(&room(6.0), 32),
        SplatIndexLayout::Normal,
        Split::Auto,
    )
    .expect("packs");
    let mut renderer = Renderer::new();
    for [width, height] in [
        [1, 1],
        [1, 97],
        [97, 1],
        [8192, 3],
        [3, 8192],
        [47, 49],
        [640, 48],
    ] {
        let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [width, height])
            .expect("valid");
        let (frame, stats) = renderer.render_with_stats(&cube, &camera, &RenderSettings::default());
        assert_eq!(
            (frame.width, frame.height, frame.color.len()),
            (width, height, (width * height) as usize)
        );
        assert_eq!(stats.hole_pixels, frame.hole_count());
    }
}

/// Tolerances: positions in a part of a frame are rounded relative to its own principal point, so
/// some borders fall on the other side of a pixel's centre, and blends differ in their last bits.
const ROUNDED_LEVELS: u8 = 3;
const ROUNDED_SHARE: f64 = 0.003;

#[test]
fn a_part_of_a_frame_is_drawn_as_in_the_whole() {
    let cube = CubeLdi::pack(
        &quick(&room(6.0), 80),
        SplatIndexLayout::Normal,
        Split::Auto,
    )
    .expect("packs");
    let mut random = Rng::keyed(7);
    for kernel in SplatKernel::ALL {
        let settings = RenderSettings {
            kernel,
            ..RenderSettings::default()
        };
        let (mut off, mut all, mut warped) = (0, 0, [0, 0]);
        for eye in eyes() {
            let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, 75.0, [97, 61])
                .expect("valid");
            let (whole, of_whole) = draw(&cube, &camera, settings, 1);
            for (columns, rows) in [
                (0..97, 0..61),
                (3..20, 40..61),
                (60..97, 7..9),
                (50..51, 0..61),
            ] {
                let part = camera
                    .cropped(columns.clone(), rows.clone())
                    .expect("a part");
                let (found, of_part) = draw(&cube, &part, settings, 1);
                let whole_rows =
                    rows.flat_map(|y| columns.clone().map(move |x| (y * 97 + x) as usize));
                for (at, color) in whole_rows.zip(&found.color) {
                    let expected = whole.color[at];
                    off +=
                        u32::from((0..3).any(|c| expected[c].abs_diff(color[c]) > ROUNDED_LEVELS));
                    all += 1;
                }
                warped = [warped[0] + of_part, warped[1] + of_whole];
            }
        }
        assert!(
            f64::from(off) < ROUNDED_SHARE * f64::from(all),
            "{kernel:?}: {off} of {all}"
        );
        assert!(
            warped[0] * 10 < warped[1] * 7,
            "{kernel:?}: clipping to the part left {warped:?}"
        );
    }
}
