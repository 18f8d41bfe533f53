//! Visibility first, each pixel looked up once: what is known of its frames in closed form, and that nothing but the view
//! decides them.

use crate::common::bed::{leaves, room};
use crate::common::capture::{one_layer, quick};
use crate::common::compare::assert_close;
use glam::{DVec3, dvec3};
use headbox::capture::random::Rng;
use headbox::capture::rig::Face;
use headbox::capture::{Camera, simd};
use headbox::frame::Frame;
use headbox::ldi::{DepthPixel, EncodedNormal};
use headbox::packed::{PackedCube, SplatIndexLayout, Split};
use headbox::render::splat::SplatKernel;
use headbox::render::{RenderSettings, Renderer};

fn settings() -> RenderSettings {
    RenderSettings { kernel: SplatKernel::Surface, depth: true, ..RenderSettings::default() }
}

fn pack(ldi: &headbox::ldi::CubeLdi) -> PackedCube {
    PackedCube::pack(ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs")
}

/// At the centre, on a line that puts the epipole into a pixel, on faces and a corner, anywhere in the headbox and outside.
fn eyes() -> Vec<DVec3> {
    let mut random = Rng::keyed(11);
    let cell = 2.0 / 48.0;
    let mut eyes = vec![
        DVec3::ZERO,
        dvec3(0.4, 0.0, 0.0),
        dvec3(0.3, -0.2, 1e-18),
        dvec3(2.3 * cell, -1.7 * cell, 1.0) * 0.4,
        dvec3(0.5, 0.1, -0.2),
        DVec3::splat(-0.5),
    ];
    eyes.extend((0..6).map(|_| random.in_cube(0.5)));
    eyes.extend((0..6).map(|_| random.in_cube(3.0)));
    eyes
}

#[test]
fn bands_threads_and_left_out_sheets_change_no_bit() {
    let (mut all, mut drawn) = (0, 0);
    for scene in [room(6.0), leaves(6.0)] {
        let cube = pack(&quick(&scene, 80));
        let mut random = Rng::keyed(5);
        for (i, eye) in eyes().into_iter().enumerate() {
            let fov = [1.0, 40.0, 90.0, 170.0][i % 4];
            let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, fov, [97, 61]).expect("valid");
            let draw = |unclipped, band_rows, threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                let mut renderer = Renderer::new();
                let settings = RenderSettings { unclipped, band_rows, ..settings() };
                let (frame, stats) = pool.install(|| renderer.render_with_stats(&cube, &camera, &settings));
                (frame.clone(), stats.depth_pixels_in)
            };
            let (expected, warped) = draw(true, 61, 1);
            all += warped;
            for (coverage, depth_m) in expected.coverage.iter().zip(&expected.depth_m) {
                assert_eq!(coverage.splat_share() > 0, depth_m.is_finite(), "depth where something is, and only there");
            }
            for (unclipped, rows, threads) in [(false, 61, 1), (true, 7, 3), (false, 1, 2), (false, 20, 2)] {
                let (found, warped) = draw(unclipped, rows, threads);
                assert!(found == expected, "eye {eye}, {unclipped}, {rows} rows, {threads} threads");
                drawn += if rows == 61 { warped } else { 0 };
            }
        }
    }
    // Sheets are large on faces of 80 px.
    assert!(drawn * 10 < all * 7, "{drawn} of {all}");
}

#[test]
fn no_simd_level_changes_a_bit() {
    let levels = simd::levels();
    let cube = pack(&quick(&leaves(6.0), 80));
    let mut random = Rng::keyed(6);
    for eye in eyes() {
        let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, 75.0, [97, 61]).expect("valid");
        let expected = Renderer::with_level(levels[0]).render(&cube, &camera, &settings()).clone();
        for level in &levels[1..] {
            let found = Renderer::with_level(*level).render(&cube, &camera, &settings()).clone();
            assert!(found == expected, "eye {eye}, {level:?}");
        }
    }
}

/// Levels by which a linear ramp of at most 4 levels a pixel, sampled in 8 bits and interpolated with 8-bit weights, may
/// differ from the ramp at the pixel: 1/2 for the samples, 1/2 for each of the two steps of interpolation, and weights.
const RAMP_LEVELS: u8 = 2;

#[test]
fn a_slanted_plane_warps_to_its_homography() {
    let normal = dvec3(0.4, 0.25, 0.8).normalize();
    let through = dvec3(0.0, 0.0, -2.5);
    let ramp = |p: DVec3| {
        let level = |v: f64| (128.0 + 20.0 * v).clamp(0.0, 255.0);
        [level(p.x), level(p.y), level(p.x - p.y)].map(|v| (v + 0.5) as u8)
    };
    let meet = |o: DVec3, d: DVec3| o + d * ((through - o).dot(normal) / d.dot(normal));
    let ldi = one_layer(DVec3::ZERO, 128, &[Face::NegZ], |face, x, y| {
        let p = meet(DVec3::ZERO, face.direction(x, y, 128));
        let [r, g, b] = ramp(p);
        let normal = EncodedNormal::new(normal.as_vec3());
        Some(DepthPixel { inverse_depth: (1.0 / -p.z) as f32, normal, color_srgb: [r, g, b, 255] })
    });
    let cube = pack(&ldi);
    for (i, eye) in
        [DVec3::ZERO, dvec3(0.3, -0.2, 0.1), dvec3(-0.4, 0.3, -0.5), dvec3(0.2, 0.2, 0.9)].into_iter().enumerate()
    {
        let camera = Camera::look_at(eye, through + eye * 0.5, dvec3(0.1, 1.0, 0.0), 35.0, [101, 83]).expect("valid");
        let color = (0..101 * 83).map(|i| {
            let direction = camera.direction(f64::from(i % 101) + 0.5, f64::from(i / 101) + 0.5);
            let [r, g, b] = ramp(meet(eye, direction));
            [r, g, b, 255]
        });
        let expected = Frame { width: 101, height: 83, color: color.collect(), ..Frame::default() };
        let mut renderer = Renderer::new();
        let (frame, stats) = renderer.render_with_stats(&cube, &camera, &settings());
        assert_eq!(stats.hole_pixels, 0, "no cracks");
        assert_close(&format!("surface_homography_{i}"), &expected, frame, RAMP_LEVELS, 0.0);
    }
}

#[test]
fn the_identity_warp_is_the_identity() {
    let centre = dvec3(1e5, -3.0, 2e4);
    for face in Face::ALL {
        let random = std::cell::RefCell::new(Rng::keyed(face.index() as u64));
        let ldi = one_layer(centre, 37, &[face], |_, _, _| {
            let mut r = random.borrow_mut();
            let mut byte = || (r.unit() * 256.0) as u8;
            let color_srgb = [byte(), byte(), byte(), 255];
            let normal = EncodedNormal::new((-face.normal() + r.in_cube(0.3)).as_vec3());
            Some(DepthPixel { inverse_depth: r.between(0.1, 2.0) as f32, normal, color_srgb })
        });
        let expected: Vec<_> = ldi.faces[face.index()].samples.iter().map(|s| s.color_srgb).collect();
        let camera = Camera::from_parts(centre, face.world_from_eye(), 37.0 / 2.0, 37, 37).expect("valid");
        let mut renderer = Renderer::new();
        let (frame, stats) = renderer.render_with_stats(&pack(&ldi), &camera, &settings());
        assert_eq!(stats.hole_pixels, 0);
        assert!(frame.color == expected, "{face:?}");
    }
}

#[test]
fn frames_of_odd_sizes_are_drawn() {
    let cube = pack(&quick(&room(20.0), 33));
    for size in [[1, 1], [7, 1], [1, 9], [8, 8], [17, 3], [131, 67]] {
        let camera = Camera::look_at(dvec3(0.2, 0.1, 0.0), DVec3::X, DVec3::Y, 60.0, size).expect("valid");
        let frame = Renderer::new().render(&cube, &camera, &settings()).clone();
        assert_eq!(frame.color.len(), (size[0] * size[1]) as usize);
        assert!(frame.color.iter().all(|c| c[3] == 255));
    }
}
