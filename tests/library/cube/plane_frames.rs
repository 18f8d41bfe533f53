//! Frames with plane textures: they are no worse, and every setting gives the same bits.

use super::primitives::{FACE_PX, draw, pack_with_planes};
use crate::common::bed::{Scene, Shape, leaves, room};
use crate::common::capture::quick;
use crate::common::compare::{psnr_db, truth};
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::metrics::compare;
use headbox_core::random::Rng;
use headbox_core::simd;
use headbox_cube::pack::{CubeLdi, Plane, PlaneSet, PlaneTile, SplatIndexLayout, Split};
use headbox_cube::planes::{DEFAULT_ERROR_PX, pack, pack_keeping_all_textures};
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{RenderSettings, Renderer};

/// A frame with almost no visible texture still needs a canvas for textures; a portal onto the disk
/// shows little else.
#[test]
fn few_textures_skipped_in_wide_frames() {
    let disk = Shape::Disk {
        centre: dvec3(0.0, 0.0, -3.0),
        normal: DVec3::Z,
        radius: 1.0,
    };
    for (scene, has_few) in [
        (
            Scene {
                shapes: vec![disk],
                detail: 6.0,
            },
            true,
        ),
        (room(6.0), false),
    ] {
        let ldi = quick(&scene, FACE_PX);
        let [around, in_parts] = [pack, pack_keeping_all_textures].map(|pack| {
            pack(ldi.clone(), SplatIndexLayout::Normal, Split::Auto, 0.5).expect("packs")
        });
        assert!(!in_parts.planes.tiles.is_empty());
        assert_eq!(around.planes.tiles.is_empty(), has_few);
        assert!(has_few || around == in_parts);
        let samples = |cube: &CubeLdi| cube.depth_pixel_count() as u64 + cube.planes.samples;
        assert_eq!(
            samples(&around),
            samples(&in_parts),
            "what is no picture stays samples"
        );
    }
}

/// Relative increase of FLIP by plane textures over frames of all samples, mean over eyes.
const LOSS_OF_FLIP: f64 = 0.05;

#[test]
fn frames_are_no_worse_and_have_no_cracks() {
    for (name, scene, least_share) in [("room", room(6.0), 0.7), ("leaves", leaves(6.0), 0.0)] {
        let ldi = quick(&scene, FACE_PX);
        let all = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs");
        let some = pack_with_planes(&ldi, DEFAULT_ERROR_PX);
        let share = some.planes.samples as f64 / all.depth_pixel_count() as f64;
        assert!(
            share > least_share,
            "{name}: {share} of the samples are on planes"
        );
        let mut random = Rng::new(3);
        let (mut sums, mut flips, mut holes) = ([0.0; 2], [0.0; 2], [0; 2]);
        for _ in 0..6 {
            let (eye, to) = (random.in_cube(0.45), random.in_cube(1.0));
            let camera = Camera::look_at(eye, eye + to, DVec3::Y, 60.0, [192, 144]).expect("valid");
            let truth = truth(&scene, &camera, 4);
            for (k, cube) in [&all, &some].into_iter().enumerate() {
                let frame = draw(cube, &camera);
                sums[k] += psnr_db(&frame, &truth) / 6.0;
                let pictures = [&truth, &frame].map(|frame| frame.to_rgb().expect("a picture"));
                flips[k] += compare(&pictures[0], &pictures[1])
                    .expect("equal sizes")
                    .flip
                    / 6.0;
                holes[k] += frame.hole_count();
            }
        }
        println!("{name}: {share:.3} on planes, {sums:.2?} dB, FLIP {flips:.4?}, holes {holes:?}");
        assert!(sums[1] >= sums[0], "{name}: {sums:?} dB");
        assert!(
            flips[1] < flips[0] * (1.0 + LOSS_OF_FLIP),
            "{name}: FLIP {flips:?}"
        );
        assert!(holes[1] <= holes[0] + 6, "{name}: {holes:?}");
    }
}

#[test]
fn threads_bands_and_levels_change_no_bit() {
    let cube = pack_with_planes(&quick(&room(6.0), FACE_PX), 0.5);
    assert_eq!(
        cube,
        pack_with_planes(&quick(&room(6.0), FACE_PX), 0.5),
        "the same choice again"
    );
    let camera = Camera::look_at(
        dvec3(0.2, 0.1, -0.3),
        dvec3(1.0, -0.4, -3.0),
        DVec3::Y,
        60.0,
        [203, 151],
    )
    .expect("valid");
    let settings = RenderSettings {
        depth: true,
        ..RenderSettings::default()
    };
    let reference = Renderer::new().render(&cube, &camera, &settings).clone();
    for band_rows in [1, 7, 64, 1000] {
        let settings = RenderSettings {
            band_rows,
            ..settings
        };
        assert_eq!(
            *Renderer::new().render(&cube, &camera, &settings),
            reference,
            "bands of {band_rows}"
        );
    }
    for level in simd::levels() {
        assert_eq!(
            *Renderer::with_level(level).render(&cube, &camera, &settings),
            reference,
            "{level:?}"
        );
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .expect("a thread");
    assert_eq!(
        *pool
            .install(|| Renderer::new().render(&cube, &camera, &settings).clone())
            .color,
        *reference.color
    );
}

#[test]
fn textures_occlude_in_every_band() {
    // A green texture 1.1 m ahead, in front of everything else.
    const SIDE: u16 = 150;
    let mut cube = CubeLdi::pack(
        &quick(&room(6.0), FACE_PX),
        SplatIndexLayout::Normal,
        Split::Auto,
    )
    .expect("packs");
    let plane = Plane {
        normal_per_distance: (Face::NegZ.normal() / 1.1).as_vec3(),
    };
    let (x0, index) = (
        (FACE_PX as i16 - SIDE as i16) / 2,
        Face::NegZ.index() as u16,
    );
    let tile = PlaneTile {
        plane: 0,
        first_texel: 0,
        x0,
        y0: x0,
        width: SIDE,
        height: SIDE,
        face: index,
        opaque: 1,
    };
    let texels = vec![[0, 255, 0, 255]; usize::from(SIDE) * usize::from(SIDE)];
    cube.planes = PlaneSet {
        error_px: 1.0,
        planes: vec![plane],
        tiles: vec![tile],
        texels,
        ..PlaneSet::default()
    };
    assert_eq!(cube.validate(), Ok(()));
    // Samples a few pixels wide, more than the adjacent rows that a band reads, all around the
    // texture.
    for (fov_deg, all_green) in [(20.0, true), (4.0, true), (90.0, false)] {
        let camera = Camera::look_at(
            dvec3(0.1, 0.05, 0.1),
            dvec3(0.1, 0.05, -3.0),
            DVec3::Y,
            fov_deg,
            [101, 75],
        );
        let camera = camera.expect("valid");
        for kernel in SplatKernel::ALL {
            let name = kernel.name();
            let settings = RenderSettings {
                kernel,
                depth: true,
                ..RenderSettings::default()
            };
            let reference = Renderer::new().render(&cube, &camera, &settings).clone();
            for band_rows in [1, 7, 40] {
                let settings = RenderSettings {
                    band_rows,
                    ..settings
                };
                let frame = Renderer::new().render(&cube, &camera, &settings).clone();
                assert!(
                    frame == reference,
                    "{name}, {fov_deg} degrees, bands of {band_rows}"
                );
            }
            if all_green {
                assert!(
                    reference
                        .color
                        .iter()
                        .all(|pixel| *pixel == [0, 255, 0, 255]),
                    "{name}, {fov_deg} degrees"
                );
                assert!(
                    reference
                        .depth_m
                        .iter()
                        .all(|depth| (depth - 1.2).abs() < 1e-4),
                    "{name}, {fov_deg} degrees"
                );
            }
        }
    }
}

/// Number of frames within which mip levels are built, and the time in which even a busy machine
/// draws them.
const FRESH_FRAMES: usize = 600;
const FRESH_SECONDS: u64 = 240;

#[test]
fn mip_requests_do_not_block() {
    let cube = pack_with_planes(&quick(&room(6.0), FACE_PX), 0.5);
    let camera = |size| {
        Camera::look_at(
            dvec3(0.2, 0.1, -0.3),
            dvec3(1.0, -0.4, -3.0),
            DVec3::Y,
            75.0,
            size,
        )
    };
    let camera = camera([48, 36]).expect("valid");
    let settings = RenderSettings {
        band_rows: 1,
        ..RenderSettings::default()
    };
    let (done, all_done) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(8)
            .build()
            .expect("threads");
        let frames = || {
            Renderer::new()
                .render(&cube.clone(), &camera, &settings)
                .color
                .clone()
        };
        let reference = pool.install(frames);
        done.send((0..FRESH_FRAMES).all(|_| pool.install(frames) == reference))
    });
    let same = all_done.recv_timeout(std::time::Duration::from_secs(FRESH_SECONDS));
    assert_eq!(same, Ok(true), "each frame is drawn, and is the same");
}

#[test]
fn depths_equal_scene() {
    let scene = room(6.0);
    let cube = pack_with_planes(&quick(&scene, FACE_PX), 0.5);
    let camera = Camera::look_at(
        dvec3(0.1, 0.2, -0.2),
        dvec3(0.5, -0.6, -3.0),
        DVec3::Y,
        60.0,
        [192, 144],
    )
    .expect("valid");
    let settings = RenderSettings {
        depth: true,
        ..RenderSettings::default()
    };
    let frame = Renderer::new().render(&cube, &camera, &settings).clone();
    let close = frame.depth_m.iter().enumerate().filter(|(i, depth)| {
        let d = camera.direction((i % 192) as f64 + 0.5, (i / 192) as f64 + 0.5);
        scene
            .hit(camera.eye(), d)
            .is_some_and(|hit| (hit.t / f64::from(**depth) - 1.0).abs() < 0.02)
    });
    // The rest are rims, where the depth of a pixel is that of one of its surfaces.
    let share = close.count() as f64 / frame.depth_m.len() as f64;
    assert!(share > 0.95, "{share}");
}

#[test]
fn edge_on_and_back_facing_planes() {
    let cube = pack_with_planes(&quick(&room(6.0), 96), 0.5);
    // In the plane of the floor, below it, and behind a wall.
    for eye in [
        dvec3(0.0, -1.5, 0.0),
        dvec3(0.0, -1.5 - 1e-12, 0.3),
        dvec3(0.2, -4.0, 0.1),
        dvec3(9.0, 0.0, -9.0),
    ] {
        for forward in [DVec3::X, DVec3::NEG_Y, dvec3(-1.0, 0.3, 0.2)] {
            let camera =
                Camera::look_at(eye, eye + forward, DVec3::Y, 75.0, [61, 47]).expect("valid");
            let frame = draw(&cube, &camera);
            assert_eq!(frame.color.len(), 61 * 47);
        }
    }
}
