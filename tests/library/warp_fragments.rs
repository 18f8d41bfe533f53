//! Fragments between epipolar lines (P5, P6, C16) against the serial warp: one band on one thread.

use crate::common::bed::{leaves, room};
use crate::common::capture::{one_layer, quick};
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::frame::Frame;
use headbox_core::random::Rng;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_cube::pack::{PackedCube, SplatIndexLayout, Split};
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{FrameStats, Parallel, RenderSettings, Renderer};
use rayon::{ThreadPool, ThreadPoolBuilder};

const KERNELS: [SplatKernel; 4] = [
    SplatKernel::Tent,
    SplatKernel::Opaque,
    SplatKernel::Paper,
    SplatKernel::Plus,
];

const FACE_PX: u32 = 64;

/// Pixels that may differ from the serial warp. None: the mask holds every pixel that footprints of
/// two fragments touch, and the extended buffer zone everything that touches the mask, in drawing
/// order.
const DIFFERING_PIXELS: usize = 0;

/// Epipoles in the image plane of the face -Z: inside a pixel, on a corner of four, on the face's
/// border, far outside, at infinity along an axis and slanting, nearly there on either side,
/// negative (behind), and none.
fn eyes() -> Vec<(&'static str, DVec3)> {
    let cell = 2.0 / f64::from(FACE_PX);
    vec![
        ("inside a pixel", dvec3(2.3 * cell, -1.7 * cell, -1.0) * 0.4),
        ("on a corner", dvec3(cell, cell, -1.0) * 0.4),
        ("on the axis", dvec3(0.0, 0.0, -0.4)),
        ("on the border", dvec3(1.0, 0.2, -1.0) * 0.3),
        ("far away", dvec3(0.4, 0.3, -0.01)),
        ("at infinity, to the right", dvec3(0.4, 0.0, 0.0)),
        ("at infinity, slanting", dvec3(-0.3, 0.2, 0.0)),
        ("nearly at infinity", dvec3(0.3, -0.2, 1e-18)),
        (
            "negative, inside a pixel",
            dvec3(3.3 * cell, 1.2 * cell, 1.0) * 0.4,
        ),
        ("negative, on a corner", dvec3(cell, -cell, 1.0) * 0.4),
        ("negative, far away", dvec3(-0.4, 0.3, 0.01)),
        ("nowhere: no parallax", DVec3::ZERO),
        ("nowhere, nearly", DVec3::splat(1e-300)),
        ("behind the first surfaces", dvec3(1.1, 0.4, -2.3)),
    ]
}

/// Both scenes as cubes, and with the face -Z alone: the single-camera LDI of the papers.
fn cubes() -> Vec<PackedCube> {
    let mut cubes = Vec::new();
    for (scene, split) in [(room(6.0), Split::Auto), (leaves(6.0), Split::None)] {
        let mut ldi = quick(&scene, FACE_PX);
        cubes.push(PackedCube::pack(&ldi, SplatIndexLayout::Normal, split).expect("packs"));
        for face in ldi.faces.iter_mut().filter(|face| face.face != Face::NegZ) {
            *face = LayeredDepthImage::empty(face.face, FACE_PX);
        }
        cubes.push(PackedCube::pack(&ldi, SplatIndexLayout::Paper, split).expect("packs"));
    }
    cubes
}

fn pools() -> [ThreadPool; 3] {
    [1, 2, 3].map(|threads| {
        ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads")
    })
}

fn differing(a: &Frame, b: &Frame) -> usize {
    let (a, b) = (
        a.color.iter().zip(&a.coverage),
        b.color.iter().zip(&b.coverage),
    );
    a.zip(b).filter(|(a, b)| a != b).count()
}

/// Draws frames serially and in fragments, with renderers that remember all earlier ones.
struct Pair {
    serial: Renderer,
    fragments: Renderer,
    pools: [ThreadPool; 3],
}

impl Pair {
    fn new() -> Self {
        Self {
            serial: Renderer::new(),
            fragments: Renderer::new(),
            pools: pools(),
        }
    }

    /// The statistics of both, for a number of fragments.
    fn compare(
        &mut self,
        name: &str,
        cube: &PackedCube,
        camera: &Camera,
        settings: RenderSettings,
        counts: &[u32],
    ) -> Vec<[FrameStats; 2]> {
        let serial = RenderSettings {
            band_rows: camera.height(),
            ..settings
        };
        let (expected, of_serial) =
            self.pools[0].install(|| self.serial.render_with_stats(cube, camera, &serial));
        let one = |(&count, pool): (&u32, &ThreadPool)| {
            let settings = RenderSettings {
                parallel: Parallel::Fragments(count),
                ..settings
            };
            let (found, stats) =
                pool.install(|| self.fragments.render_with_stats(cube, camera, &settings));
            let differing = differing(expected, found);
            let title = format!("{name}, {:?}, {count} fragments", settings.kernel);
            assert!(
                differing == DIFFERING_PIXELS,
                "{title}: {differing} pixels differ"
            );
            assert_eq!(stats.hole_pixels, of_serial.hole_pixels, "{title}");
            let first_pass = stats.depth_pixels_in - stats.redone_depth_pixels;
            assert_eq!(
                first_pass, of_serial.depth_pixels_in,
                "{title}: each depth pixel in one fragment"
            );
            [*of_serial, *stats]
        };
        counts
            .iter()
            .zip(self.pools.iter().cycle())
            .map(one)
            .collect()
    }
}

#[test]
fn fragments_give_the_serial_frame() {
    // Wide enough for most pixels to lie outside of all masks.
    const WIDTH: u32 = 203;
    const HEIGHT: u32 = 121;
    let mut pair = Pair::new();
    let mut random = Rng::keyed(3);
    let (mut pixels, mut redone, mut passes) = (0, 0, [0; 2]);
    for (c, cube) in cubes().iter().enumerate() {
        for (i, (name, eye)) in eyes().into_iter().enumerate() {
            // Every other time with an epipole in the middle of the frame, if there is one.
            let ahead = if i % 2 == 0 {
                dvec3(eye.x, eye.y, -3.0)
            } else {
                eye - DVec3::Z + random.in_cube(0.7)
            };
            let fov = [90.0, 40.0, 130.0][(i + c) % 3];
            let camera =
                Camera::look_at(eye, ahead, DVec3::Y, fov, [WIDTH, HEIGHT]).expect("valid");
            for kernel in KERNELS {
                let settings = RenderSettings {
                    kernel,
                    depth: true,
                    ..RenderSettings::default()
                };
                for [_, stats] in pair.compare(name, cube, &camera, settings, &[1, 2, 3, 4, 7]) {
                    pixels += u64::from(WIDTH * HEIGHT);
                    redone += stats.redone_pixels;
                    passes = [
                        passes[0] + stats.depth_pixels_in,
                        passes[1] + stats.redone_depth_pixels,
                    ];
                }
            }
        }
    }
    println!(
        "in masks: {:.1} % of the pixels; of the depth pixels {:.1} % in the second pass",
        redone as f64 / pixels as f64 * 100.0,
        passes[1] as f64 / passes[0] as f64 * 100.0
    );
    assert!(
        redone > 0 && redone * 2 < pixels,
        "{redone} of {pixels} pixels"
    );
}

#[test]
fn eyes_and_views_at_random_and_every_depth_pixel_warped() {
    let mut pair = Pair::new();
    let mut random = Rng::keyed(21);
    let cubes = cubes();
    for i in 0..60 {
        let eye = random.in_cube([0.5, 0.5, 3.0][i % 3]);
        let fov = [5.0, 60.0, 100.0, 170.0][i % 4];
        let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, fov, [83, 59])
            .expect("valid");
        let settings = RenderSettings {
            kernel: KERNELS[i % KERNELS.len()],
            unclipped: i % 5 == 0,
            ..RenderSettings::default()
        };
        let name = format!("{i}: eye {eye}, {fov} degrees");
        pair.compare(&name, &cubes[i / 3 % 4], &camera, settings, &[2, 0, 5]);
    }
}

#[test]
fn frames_of_every_size_and_more_fragments_than_there_can_be() {
    let mut pair = Pair::new();
    let cubes = cubes();
    for [width, height] in [
        [1, 1],
        [1, 97],
        [97, 1],
        [2048, 3],
        [3, 2048],
        [47, 49],
        [48, 47],
    ] {
        let camera = Camera::look_at(
            dvec3(0.1, 0.2, -0.3),
            DVec3::NEG_Z,
            DVec3::Y,
            60.0,
            [width, height],
        )
        .expect("valid");
        for kernel in KERNELS {
            let settings = RenderSettings {
                kernel,
                depth: true,
                ..RenderSettings::default()
            };
            pair.compare(
                &format!("{width}x{height}"),
                &cubes[0],
                &camera,
                settings,
                &[2, 16, u32::MAX],
            );
        }
    }
    let empty = PackedCube {
        segments: Vec::new(),
        ..cubes[0].clone()
    };
    let camera =
        Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [40, 30]).expect("valid");
    pair.compare(
        "no segments",
        &empty,
        &camera,
        RenderSettings::default(),
        &[1, 4],
    );
}

/// The largest fragment's share of the depth pixels may exceed the mean by this factor: weights are
/// counted in every fourth row, in pieces of 16 columns, which near an epipole are wide. A bound,
/// not a measurement.
const UNEVEN: f64 = 1.25;

#[test]
fn fragments_have_about_equally_many_depth_pixels() {
    let cube = &cubes()[0];
    let mut renderer = Renderer::new();
    for (name, eye) in eyes().into_iter().take(10) {
        let camera = Camera::look_at(eye, dvec3(eye.x, eye.y, -3.0), DVec3::Y, 90.0, [97, 61])
            .expect("valid");
        let settings = RenderSettings {
            parallel: Parallel::Fragments(4),
            ..RenderSettings::default()
        };
        let (_, stats) = renderer.render_with_stats(cube, &camera, &settings);
        let mean = (stats.depth_pixels_in - stats.redone_depth_pixels) as f64 / 4.0;
        let largest = stats.largest_fragment as f64;
        assert!(largest <= UNEVEN * mean, "{name}: {largest} of {mean}");
    }
}

/// On a face of an odd number of pixels, the middle one lies on the baseline of an eye at the
/// centre, and has no angle.
#[test]
fn a_pixel_on_the_baseline_takes_no_neighbours_along() {
    let mut pair = Pair::new();
    let forwards = [
        dvec3(-0.113_878_676_628, -0.057_211_210_838, 0.991_846_018_475),
        DVec3::X,
        dvec3(-1.0, 0.0, 0.7),
    ];
    for face_px in [1, 3, 5] {
        let ldi = one_layer(DVec3::ZERO, face_px, &Face::ALL, |face, x, y| {
            let color = [x as u8 * 40, y as u8 * 40, 90, 255];
            let normal = EncodedNormal::new(-face.normal().as_vec3());
            Some(DepthPixel {
                inverse_depth: 0.5,
                normal,
                color_srgb: color,
            })
        });
        let cube = PackedCube::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs");
        for forward in forwards {
            let camera =
                Camera::look_at(DVec3::ZERO, forward, DVec3::Y, 75.0, [64, 48]).expect("valid");
            for kernel in KERNELS {
                let settings = RenderSettings {
                    kernel,
                    ..RenderSettings::default()
                };
                let expected = pair.serial.render(&cube, &camera, &settings);
                for count in [2, 3, 7] {
                    let settings = RenderSettings {
                        parallel: Parallel::Fragments(count),
                        ..settings
                    };
                    let found = pair.fragments.render(&cube, &camera, &settings);
                    assert_eq!(
                        differing(expected, found),
                        DIFFERING_PIXELS,
                        "{face_px} px, {kernel:?}, {count}"
                    );
                }
            }
        }
    }
}
