//! Tests of coverage.

use crate::capture::SceneCapture;
use crate::scene_source::SceneSource;
use crate::spec::{CaptureSpec, RunOptions};
use glam::{DVec3, Vec3, dvec3};
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::model::samples::{CubeSamples, DepthPixel};
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_trace::bvh::{Ray, Tracer};
use headbox_trace::light::Lighting;
use std::ops::Range;
use std::sync::Arc;

/// Size of a face, px. A pixel is 25 mm wide at a distance of 6 m.
const SIZE: u32 = 480;
/// Pixels of the square that is filled with triangles and measured, along each axis.
const MIDDLE: Range<u32> = 224..256;
/// Eye depth between triangles and wall, metres.
const BEHIND_CLOUD_M: f32 = 10.0;

/// Triangles of about `size_m` at random places of a square at 6 m, up to `depth_m` behind it;
/// a wall at 30 m.
fn cloud(count: u32, size_m: f64, depth_m: f64) -> Scene {
    let mut scene = Scene::default();
    scene.materials.push(Material::default());
    let mut random = Rng::new(3);
    let mut from = |low: f64, high: f64| low + (high - low) * random.unit();
    for i in 0..count {
        let middle = dvec3(from(-0.4, 0.4), from(-0.4, 0.4), -6.0 - from(0.0, depth_m));
        for _ in 0..3 {
            let mut offset = || from(-size_m, size_m) / 2.0;
            let corner = dvec3(offset(), offset(), offset() * (10.0 * depth_m).min(1.0));
            scene.positions.push(middle + corner);
        }
        scene.triangles.push(Triangle {
            vertices: [0, 1, 2].map(|corner| 3 * i + corner),
            material: 0,
        });
    }
    let first = scene.positions.len() as u32;
    let wall = [dvec3(-50.0, -50.0, -30.0), dvec3(150.0, -50.0, -30.0)];
    scene.positions.extend(wall);
    scene.positions.push(dvec3(-50.0, 150.0, -30.0));
    scene.triangles.push(Triangle {
        vertices: [first, first + 1, first + 2],
        material: 0,
    });
    scene
}

/// A capture about the origin, with its tracer.
fn capture(scene: Scene) -> (CubeSamples, Tracer) {
    let spec = CaptureSpec {
        face_size_px: SIZE,
        parameters: CaptureParameters::unlit(16, 16),
        ..CaptureSpec::new(SceneSource::new("test"), DVec3::ZERO, 0.3)
    };
    let tracer = Tracer::new(Arc::new(scene), spec.centre);
    let lighting = Lighting::unmetered(&tracer, 1);
    let options = RunOptions::default();
    let (cube, _) = SceneCapture::new(&spec, &tracer, &lighting, &options)
        .run()
        .expect("no file");
    (cube, tracer)
}

/// Share of the middle that is covered in front of the wall: by the alphas of a capture, and by
/// rays.
fn covered_shares(scene: Scene) -> [f64; 2] {
    let (cube, tracer) = capture(scene);
    let face = &cube.faces[Face::NegZ.index()];
    let mut random = Rng::new(4);
    let (mut captured, mut met) = (0.0, 0.0);
    for [x, y] in MIDDLE.flat_map(|y| MIDDLE.map(move |x| [x, y])) {
        let in_front = |it: &&DepthPixel| it.inverse_depth > 1.0 / BEHIND_CLOUD_M;
        let samples = face.pixel(x, y).iter().filter(in_front);
        let alphas = samples.map(|it| it.color_srgb[3]);
        captured += 1.0
            - alphas
                .map(|it| 1.0 - f64::from(it) / 255.0)
                .product::<f64>();
        for _ in 0..64 {
            let [column, row] = [x, y].map(|pixel| f64::from(pixel) + random.unit());
            let ray = Ray {
                origin: Vec3::ZERO,
                direction: Face::NegZ.direction(column, row, SIZE).as_vec3(),
                t_min: 0.0,
                t_max: BEHIND_CLOUD_M,
            };
            met += f64::from(u8::from(tracer.occluded(&ray))) / 64.0;
        }
    }
    [captured, met].map(|sum| sum / (MIDDLE.len() as f64).powi(2))
}

/// Few rays of the capture meet the cloud, so that many of its pixels have only the wall's
/// sample.
#[test]
fn triangles_smaller_than_a_pixel_cover_what_rays_meet() {
    const TOLERANCE: f64 = 0.03;
    let clouds = [
        (4000, 0.03, 0.4),
        (40_000, 0.01, 0.0),
        (2000, 0.06, 0.0),
        (1000, 0.03, 0.4),
        (16_000, 0.03, 0.4),
    ];
    for (count, size_m, depth_m) in clouds {
        let [captured, met] = covered_shares(cloud(count, size_m, depth_m));
        assert!(
            (captured / met - 1.0).abs() < TOLERANCE,
            "{count} of {size_m} m, {depth_m} m deep: {captured:.4} instead of {met:.4}"
        );
    }
}

/// A box whose faces are visible from outside. The centre sees its front; its sides, which only
/// eyes beside the centre see, turn their backs to the centre.
fn solid_box(single_sided: bool) -> Scene {
    let mut scene = Scene::default();
    scene.materials.push(Material {
        single_sided,
        ..Material::default()
    });
    let corner = |i: u32| {
        let [x, y, z] = [0, 1, 2].map(|axis| f64::from(i >> axis & 1));
        dvec3(0.2 * x - 0.1, 0.2 * y - 0.1, z - 3.0)
    };
    scene.positions.extend((0..8).map(corner));
    let sides = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    for [a, b, c, d] in sides {
        for vertices in [[a, b, c], [a, c, d]] {
            scene.triangles.push(Triangle {
                vertices,
                material: 0,
            });
        }
    }
    scene
}

#[test]
fn single_sided_surfaces_cover_as_much_as_others() {
    let [single, double] = [true, false].map(|single| capture(solid_box(single)).0);
    let hidden = |cube: &CubeSamples| {
        let face = &cube.faces[Face::NegZ.index()];
        let samples = face.samples.iter();
        samples
            .filter(|it| it.inverse_depth < 1.0 / 2.05)
            .map(|it| it.color_srgb[3])
            .collect::<Vec<u8>>()
    };
    let alphas = hidden(&single);
    assert!(alphas.len() > 500, "{}", alphas.len());
    assert_eq!(alphas, hidden(&double));
}
