//! Fragments between epipolar lines (P5, P6, C16), a baseline of the `lab` crate, against one band
//! on one thread.

use crate::common::bed::{leaves, room};
use crate::common::capture::{one_layer, quick};
use glam::{DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::frame::Frame;
use headbox_core::random::Rng;
use headbox_cube::model::samples::{DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_cube::pack::{CubeLdi, Plane, PlaneSet, PlaneTile, SplatIndexLayout, Split};
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_cube::render::{FrameStats, RenderSettings, Renderer};
use headbox_lab::baselines::fragments::{FragmentRenderer, FragmentStats};
use rayon::{ThreadPool, ThreadPoolBuilder};

const KERNELS: [SplatKernel; 5] = [
    SplatKernel::Tent,
    SplatKernel::Opaque,
    SplatKernel::Paper,
    SplatKernel::Plus,
    SplatKernel::Ellipse,
];

const FACE_PX: u32 = 64;

/// Pixels that may differ from the serial warp. None: the mask contains every pixel that footprints
/// of two fragments touch, and the extended buffer zone everything that touches the mask, in
/// drawing order.
const DIFFERING_PIXELS: usize = 0;

/// Eyes whose epipole on the face -Z is inside a pixel, on a corner of four, on the face's border,
/// far outside, at infinity along an axis and obliquely, almost at infinity on either side,
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
        ("at infinity, oblique", dvec3(-0.3, 0.2, 0.0)),
        ("almost at infinity", dvec3(0.3, -0.2, 1e-18)),
        (
            "negative, inside a pixel",
            dvec3(3.3 * cell, 1.2 * cell, 1.0) * 0.4,
        ),
        ("negative, on a corner", dvec3(cell, -cell, 1.0) * 0.4),
        ("negative, far away", dvec3(-0.4, 0.3, 0.01)),
        ("none: no parallax", DVec3::ZERO),
        ("almost none", DVec3::splat(1e-300)),
        ("behind the first surfaces", dvec3(1.1, 0.4, -2.3)),
    ]
}

/// Packs both scenes as cubes, and with the face -Z alone: the single-camera LDI of the papers.
fn cubes() -> Vec<CubeLdi> {
    let mut cubes = Vec::new();
    for (scene, split) in [(room(6.0), Split::Auto), (leaves(6.0), Split::None)] {
        let mut ldi = quick(&scene, FACE_PX);
        cubes.push(CubeLdi::pack(&ldi, SplatIndexLayout::Normal, split).expect("packs"));
        for face in ldi.faces.iter_mut().filter(|face| face.face != Face::NegZ) {
            *face = LayeredDepthImage::empty(face.face, FACE_PX);
        }
        cubes.push(CubeLdi::pack(&ldi, SplatIndexLayout::Paper, split).expect("packs"));
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

/// Renderers of serial frames and of fragments, used for many frames.
struct Pair {
    serial: Renderer,
    fragments: FragmentRenderer,
    pools: [ThreadPool; 3],
}

impl Pair {
    fn new() -> Self {
        Self {
            serial: Renderer::new(),
            fragments: FragmentRenderer::default(),
            pools: pools(),
        }
    }

    /// Compares frames; returns the statistics of the fragments for each number of fragments.
    fn compare(
        &mut self,
        name: &str,
        cube: &CubeLdi,
        camera: &Camera,
        settings: RenderSettings,
        counts: &[u32],
    ) -> Vec<FragmentStats> {
        let serial = RenderSettings {
            band_rows: camera.height(),
            ..settings
        };
        let (expected, serial_stats) =
            self.pools[0].install(|| self.serial.render_with_stats(cube, camera, &serial));
        let one = |(&count, pool): (&u32, &ThreadPool)| {
            let (frame, stats) =
                pool.install(|| self.fragments.render(cube, camera, &settings, count));
            let title = format!("{name}, {:?}, {count} fragments", settings.kernel);
            assert_eq!(differing(expected, frame), DIFFERING_PIXELS, "{title}");
            assert!(frame == expected, "{title}: depths differ");
            assert_eq!(stats.frame.hole_pixels, serial_stats.hole_pixels, "{title}");
            let first_pass = stats.frame.depth_pixels_in - stats.redone_depth_pixels;
            assert_eq!(
                first_pass, serial_stats.depth_pixels_in,
                "{title}: each depth pixel in one fragment"
            );
            stats
        };
        counts
            .iter()
            .zip(self.pools.iter().cycle())
            .map(one)
            .collect()
    }
}

/// Checks the statistics of a frame in several fragments.
fn check_stats(stats: &FragmentStats, pixels: u64) {
    let FrameStats {
        clear_ms,
        warp_ms,
        finish_ms,
        frame_ms,
        imbalance,
        ..
    } = stats.frame;
    assert!(clear_ms > 0.0 && warp_ms > 0.0 && finish_ms > 0.0 && frame_ms > 0.0);
    assert!(imbalance > 1.0 - 1e-9, "{imbalance}: slowest over mean");
    assert!(stats.redone_pixels <= pixels);
    assert!(stats.redone_depth_pixels <= stats.frame.depth_pixels_in);
    assert!(stats.largest_fragment <= stats.frame.depth_pixels_in);
}

#[test]
fn fragments_give_serial_frame() {
    // Wide enough for most pixels to lie outside of all masks.
    const WIDTH: u32 = 203;
    const HEIGHT: u32 = 121;
    let mut pair = Pair::new();
    let mut random = Rng::keyed(3);
    let mut pixels = 0;
    let mut redone = 0;
    let mut passes = [0; 2];
    for (c, cube) in cubes().iter().enumerate() {
        for (i, (name, eye)) in eyes().into_iter().enumerate() {
            // Every other view has an epipole in the centre of the frame, if there is one.
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
                for stats in pair.compare(name, cube, &camera, settings, &[1, 2, 3, 4, 7]) {
                    check_stats(&stats, u64::from(WIDTH * HEIGHT));
                    pixels += u64::from(WIDTH * HEIGHT);
                    redone += stats.redone_pixels;
                    passes[0] += stats.frame.depth_pixels_in;
                    passes[1] += stats.redone_depth_pixels;
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
fn random_cropped_views_give_serial_frame() {
    let mut pair = Pair::new();
    let mut random = Rng::keyed(21);
    let cubes = cubes();
    for i in 0..60 {
        let eye = random.in_cube([0.5, 0.5, 3.0][i % 3]);
        let fov = [5.0, 60.0, 100.0, 170.0][i % 4];
        let camera = Camera::look_at(eye, eye + random.in_cube(1.0), DVec3::Y, fov, [83, 59])
            .expect("valid");
        // Every fourth view with an off-centre principal point.
        let camera = if i % 4 == 3 {
            camera.cropped(5..70, 20..59).expect("a part")
        } else {
            camera
        };
        let kernel = KERNELS[i % KERNELS.len()];
        let settings = RenderSettings {
            kernel,
            unclipped: i % 7 == 0,
            ..RenderSettings::default()
        };
        let name = format!("{i}: eye {eye}, {fov} degrees");
        pair.compare(&name, &cubes[i / 3 % 4], &camera, settings, &[2, 0, 5]);
    }
}

#[test]
fn odd_sizes_give_serial_frame() {
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
    let empty = CubeLdi {
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

/// Bound of the largest fragment relative to the mean: samples are counted in every fourth row, in
/// runs of 16 columns, which are wide near an epipole.
const UNEVEN: f64 = 1.25;

#[test]
fn fragments_have_similar_sample_counts() {
    let cube = &cubes()[0];
    let mut renderer = FragmentRenderer::default();
    for (name, eye) in eyes().into_iter().take(10) {
        let camera = Camera::look_at(eye, dvec3(eye.x, eye.y, -3.0), DVec3::Y, 90.0, [97, 61])
            .expect("valid");
        let (_, stats) = renderer.render(cube, &camera, &RenderSettings::default(), 4);
        let mean = (stats.frame.depth_pixels_in - stats.redone_depth_pixels) as f64 / 4.0;
        let largest = stats.largest_fragment as f64;
        assert!(largest <= UNEVEN * mean, "{name}: {largest} of {mean}");
    }
}

/// On a face with an odd number of pixels, the middle one lies on the baseline of an eye at the
/// centre, and has no angle.
#[test]
fn pixel_on_baseline_belongs_to_one_fragment() {
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
        let cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs");
        for forward in forwards {
            let camera =
                Camera::look_at(DVec3::ZERO, forward, DVec3::Y, 75.0, [64, 48]).expect("valid");
            for kernel in KERNELS {
                let settings = RenderSettings {
                    kernel,
                    ..RenderSettings::default()
                };
                pair.compare(
                    &format!("{face_px} px"),
                    &cube,
                    &camera,
                    settings,
                    &[2, 3, 7],
                );
            }
        }
    }
}

#[test]
fn cubes_with_plane_textures_are_drawn_in_bands() {
    let ldi = quick(&room(6.0), FACE_PX);
    let mut cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::Auto).expect("packs");
    let tile = PlaneTile {
        plane: 0,
        first_texel: 0,
        x0: 20,
        y0: 20,
        width: 20,
        height: 20,
        face: Face::NegZ.index() as u16,
        opaque: 1,
    };
    cube.planes = PlaneSet {
        error_px: 1.0,
        planes: vec![Plane {
            normal_per_distance: (Face::NegZ.normal() / 1.1).as_vec3(),
        }],
        tiles: vec![tile],
        texels: vec![[0, 255, 0, 255]; 400],
        ..PlaneSet::default()
    };
    let camera =
        Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 90.0, [64, 48]).expect("valid");
    let settings = RenderSettings::default();
    let mut renderer = FragmentRenderer::default();
    let (frame, _) = renderer.render(&cube, &camera, &settings, 3);
    assert!(frame == Renderer::new().render(&cube, &camera, &settings));
    assert!(frame.color.contains(&[0, 255, 0, 255]));
}
