//! The rasteriser against the tracer, against arithmetic, and against itself in other divisions.

use fearless_simd::Level;
use glam::{DVec3, Vec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::color::tone::ToneMap;
use headbox_core::environment::Environment;
use headbox_core::random::Rng;
use headbox_core::simd;
use headbox_raster::{
    GroupWindow, Marker, PixelContent, RasterMesh, RasterOutput, RasterStats, RasterView,
    Rasterizer,
};
use headbox_scene::material::{Cutout, Material, Texture};
use headbox_scene::scene::Scene;
use headbox_scene::scene::Triangle;
use headbox_trace::bvh::{Hit, Ray, Tracer};
use std::ops::Range;
use std::sync::Arc;

const HOLE: [u8; 3] = [1, 2, 3];

pub(super) fn view<'a>(groups: &'a [GroupWindow], markers: &'a [Marker]) -> RasterView<'a> {
    RasterView {
        groups,
        markers,
        exposure: 1.0,
        tone: ToneMap::SrgbClipped,
        hole_color_srgb: HOLE,
    }
}

pub(super) fn full_windows(groups: u32) -> Vec<GroupWindow> {
    (0..groups)
        .map(|group| GroupWindow {
            group,
            window: None,
        })
        .collect()
}

pub(super) fn draw(scene: &Arc<Scene>, camera: &Camera) -> (RasterOutput, RasterStats) {
    let mesh = RasterMesh::new(
        Arc::clone(scene),
        std::slice::from_ref(&(0..scene.triangles.len() as u32)),
        camera.eye(),
    );
    let mut rasterizer = Rasterizer::new();
    let (frame, stats) = rasterizer.draw(
        &mesh,
        camera,
        &view(&full_windows(1), &[]),
        &Environment::default(),
    );
    (frame.clone(), *stats)
}

/// A scene of triangles with a colour at each corner.
pub(super) fn scene_from_triangles(triangles: &[[DVec3; 3]]) -> Scene {
    let mut random = Rng::keyed(7);
    let positions: Vec<DVec3> = triangles.iter().flatten().copied().collect();
    let mut channel = || random.between(0.1, 0.9) as f32;
    Scene {
        colors: positions
            .iter()
            .map(|_| Vec3::new(channel(), channel(), channel()))
            .collect(),
        triangles: (0..triangles.len() as u32)
            .map(|i| Triangle {
                vertices: [3 * i, 3 * i + 1, 3 * i + 2],
                material: 0,
            })
            .collect(),
        materials: vec![Material {
            albedo: [1.0; 3],
            ..Material::default()
        }],
        positions,
        ..Scene::default()
    }
}

/// Triangles of all sizes on all sides of the origin, some through it, some slivers.
pub(super) fn soup(count: usize) -> Scene {
    let mut random = Rng::keyed(3);
    let triangle = |i: usize| {
        let size = [0.05, 0.4, 3.0, 40.0][i % 4];
        let centre = random.in_cube(6.0);
        let a = centre + random.in_cube(size);
        let b = centre + random.in_cube(size);
        let c = if i.is_multiple_of(5) {
            a + (b - a) * random.unit() + random.in_cube(1e-4)
        } else {
            centre + random.in_cube(size)
        };
        [a, b, c]
    };
    scene_from_triangles(&(0..count).map(triangle).collect::<Vec<_>>())
}

/// Adds a texture to every other triangle, with `repetitions` per metre.
pub(super) fn with_textures(mut scene: Scene, repetitions: f64) -> Scene {
    let texture = Texture::from_fn(4, 4, |x, y| [(60 * x) as u8, (60 * y) as u8, 128, 255]);
    scene.textures.push(texture);
    scene.texcoords = scene
        .positions
        .iter()
        .map(|p| (p.truncate() * repetitions).as_vec2())
        .collect();
    scene.materials.push(Material {
        albedo_texture: Some(0),
        emission: [0.1, 0.0, 0.2],
        ..Material::default()
    });
    scene
        .triangles
        .iter_mut()
        .enumerate()
        .for_each(|(i, t)| t.material = (i % 2) as u32);
    scene
}

pub(super) fn camera(eye: DVec3, at: DVec3, width: u32, height: u32) -> Camera {
    Camera::look_at(eye, at, DVec3::Y, 70.0, [width, height]).expect("valid")
}

pub(super) fn hit(tracer: &Tracer, camera: &Camera, x: f64, y: f64) -> Option<Hit> {
    let origin = (camera.eye() - tracer.origin()).as_vec3();
    let direction = camera.direction(x, y).as_vec3();
    // The rasteriser's near plane.
    tracer.closest(&Ray {
        origin,
        direction,
        t_min: 1e-5,
        t_max: f32::INFINITY,
    })
}

/// A pixel may show another surface than the tracer's ray only if a ray this far away meets that
/// surface: corners are snapped to 1/256 px, which moves an edge by up to 0.0028 px; the rest is
/// the rounding of f32 positions.
const EDGE_PX: f64 = 0.004;
/// Relative difference of inverse depth on one surface: snapping moves corners by 0.0028 px, on a
/// slope of at most about ten times the depth per frame here.
const DEPTH: f32 = 2e-3;

/// Compares every pixel with the tracer; returns the number of pixels that differ but have an edge
/// within [`EDGE_PX`].
fn compare_with_tracer(scene: Scene, camera: &Camera) -> usize {
    let scene = Arc::new(scene);
    let (frame, _) = draw(&scene, camera);
    let tracer = Tracer::new(Arc::clone(&scene), camera.eye());
    let mut at_edges = 0;
    for pixel in 0..frame.inverse_depth.len() {
        let (x, y) = (pixel as u32 % camera.width(), pixel as u32 / camera.width());
        let (px, py) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        let seen_at = |dx: f64, dy: f64| match hit(&tracer, camera, px + dx, py + dy) {
            Some(hit) => PixelContent::Triangle(hit.primitive),
            None => PixelContent::Nothing,
        };
        let seen = frame.seen(pixel);
        if seen == seen_at(0.0, 0.0) {
            let Some(hit) = hit(&tracer, camera, px, py) else {
                continue;
            };
            let found = 1.0 / frame.inverse_depth[pixel];
            let slope = 1.0 + edge_on(&tracer, camera, &hit, px, py);
            assert!(
                (found - hit.t).abs() <= DEPTH * slope * hit.t,
                "({x}, {y}): {found} and {}",
                hit.t
            );
            continue;
        }
        // Even slivers a thousandth of a pixel wide are hit by one of this many rays.
        let around = (0..1024).map(|k| f64::from(k) * std::f64::consts::TAU / 64.0);
        let within = around
            .enumerate()
            .map(|(k, a)| (a, EDGE_PX * (1 + k / 64) as f64 / 16.0));
        let near_edge = within
            .map(|(a, r)| seen_at(r * a.cos(), r * a.sin()))
            .any(|near| near == seen);
        // Where two surfaces cross, either may be in front.
        let crossing = hit(&tracer, camera, px, py)
            .is_some_and(|hit| (hit.t * frame.inverse_depth[pixel] - 1.0).abs() < 1e-4);
        assert!(
            near_edge || crossing,
            "({x}, {y}): {seen:?}, the tracer sees {:?}",
            seen_at(0.0, 0.0)
        );
        at_edges += 1;
    }
    at_edges
}

/// Tangent of the angle between a surface's normal and the ray, which stretches depth errors.
fn edge_on(tracer: &Tracer, camera: &Camera, hit: &Hit, x: f64, y: f64) -> f32 {
    let normal = tracer.scene().geometric_normal(hit.primitive);
    let cosine = normal
        .dot(camera.direction(x, y).normalize().as_vec3())
        .abs()
        .max(1e-3);
    1.0 / cosine
}

#[test]
fn surfaces_equal_tracer() {
    let eye = dvec3(0.3, -0.2, 0.4);
    for (at, width, height) in [
        (dvec3(1.0, 0.2, -3.0), 97, 61),
        (dvec3(-4.0, -3.0, 1.0), 64, 64),
        (dvec3(0.3, 7.0, 0.4), 33, 80),
    ] {
        let at_edges = compare_with_tracer(soup(600), &camera(eye, at, width, height));
        assert!(
            at_edges < (width * height / 50) as usize,
            "{at_edges} pixels within {EDGE_PX} px of an edge"
        );
    }
}

/// A floor and walls of two triangles each that pass under, beside and behind the eye, at heights
/// down to a millimetre.
#[test]
fn triangles_that_reach_behind_the_eye() {
    for height in [1.5, 0.05, 0.001] {
        let quad = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| [[a, b, c], [a, c, d]];
        // Farther away the tracer's own f32 error exceeds the height: its positions are relative to
        // the eye, too.
        let far = 20_000.0 * f64::min(height, 0.1);
        let floor = quad(
            dvec3(-far, 0.0, -far),
            dvec3(far, 0.0, -far),
            dvec3(far, 0.0, far),
            dvec3(-far, 0.0, far),
        );
        let wall = quad(
            dvec3(0.4, -1.0, -30.0),
            dvec3(0.4, -1.0, 30.0),
            dvec3(0.4, 9.0, 30.0),
            dvec3(0.4, 9.0, -30.0),
        );
        let scene = scene_from_triangles(&[floor, wall].concat());
        compare_with_tracer(
            scene,
            &camera(
                dvec3(0.0, height, 0.0),
                dvec3(1.0, height - 0.2, -3.0),
                75,
                51,
            ),
        );
    }
}

#[test]
fn same_bytes_for_bands_threads_levels() {
    // Textures with mip levels, and triangles with holes.
    let mut scene = with_textures(soup(900), 0.7);
    scene.materials.push(Material {
        cutout: Some(Cutout {
            texture: Some(0),
            threshold: 0.3,
        }),
        ..scene.materials[1].clone()
    });
    scene.textures[0] = Texture::from_fn(64, 32, |x, y| {
        [(4 * x) as u8, (8 * y) as u8, 99, (x ^ y) as u8 * 4]
    });
    scene
        .triangles
        .iter_mut()
        .step_by(3)
        .for_each(|triangle| triangle.material = 2);
    let scene = Arc::new(scene);
    let camera = camera(dvec3(0.1, 0.0, 0.2), dvec3(1.0, 0.3, -2.0), 131, 67);
    let half = scene.triangles.len() as u32 / 2;
    let mesh = RasterMesh::new(Arc::clone(&scene), &[0..half, half..2 * half], DVec3::ZERO);
    let groups = full_windows(2);
    let render = |threads: usize, level: Level, rows: u32| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        let mut rasterizer = Rasterizer::with(level, rows);
        pool.install(|| {
            rasterizer
                .draw(&mesh, &camera, &view(&groups, &[]), &Environment::default())
                .0
                .clone()
        })
    };
    let levels = simd::levels();
    let reference = render(1, levels[0], 0);
    let ways = levels
        .into_iter()
        .flat_map(|level| [(2, level, 7), (3, level, 1), (1, level, 500), (1, level, 0)]);
    for (threads, level, rows) in ways {
        let other = render(threads, level, rows);
        assert_eq!(other.frame, reference.frame);
        let bits = |frame: &RasterOutput| {
            frame
                .inverse_depth
                .iter()
                .map(|q| q.to_bits())
                .collect::<Vec<_>>()
        };
        assert_eq!(bits(&other), bits(&reference));
    }
}

#[test]
fn markers_are_depth_tested() {
    let wall = |z: f64, from: f64| {
        [
            [
                dvec3(from, -9.0, z),
                dvec3(9.0, -9.0, z),
                dvec3(9.0, 9.0, z),
            ],
            [
                dvec3(from, -9.0, z),
                dvec3(9.0, 9.0, z),
                dvec3(from, 9.0, z),
            ],
        ]
    };
    let scene = scene_from_triangles(&[wall(-1.0, 0.0), wall(-3.0, -9.0)].concat());
    let marker = Marker {
        polygon: [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]]
            .map(|[x, y]| dvec3(x, y, -2.0))
            .to_vec(),
        number: 5,
    };
    let camera = camera(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), 10, 6);
    let mesh = RasterMesh::new(Arc::new(scene), std::slice::from_ref(&(0..4)), DVec3::ZERO);
    let mut rasterizer = Rasterizer::new();
    let (frame, stats) = rasterizer.draw(
        &mesh,
        &camera,
        &view(&full_windows(1), &[marker]),
        &Environment::default(),
    );
    assert_eq!(stats.marker_pixels, 30);
    for pixel in 0..60 {
        let right = pixel % 10 >= 5;
        assert_eq!(frame.seen(pixel) == PixelContent::Marker(5), !right);
        assert_eq!(frame.frame.coverage[pixel].is_hole(), !right);
    }
}

#[test]
fn tiny_frames_and_degenerate_triangles_are_drawn() {
    let mut triangles = vec![[DVec3::ZERO; 3], [dvec3(0.0, 0.0, -1.0); 3]];
    triangles.push([
        dvec3(-1.0, 0.0, -1.0),
        dvec3(0.0, 0.0, -1.0),
        dvec3(1.0, 0.0, -1.0),
    ]);
    triangles.push([
        dvec3(1e300, 0.0, -1.0),
        dvec3(-1e300, 1.0, -1.0),
        dvec3(0.0, 1e300, 5.0),
    ]);
    triangles.push([
        dvec3(-1e9, -1e9, -2.0),
        dvec3(1e9, -1e9, -2.0),
        dvec3(0.0, 1e9, -2.0),
    ]);
    let scene = Arc::new(scene_from_triangles(&triangles));
    for (width, height) in [(1, 1), (1, 7), (13, 1), (3, 5), (17, 31)] {
        let (frame, _) = draw(
            &scene,
            &camera(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), width, height),
        );
        let all = (0..(width * height) as usize)
            .all(|pixel| frame.seen(pixel) == PixelContent::Triangle(4));
        assert!(all, "{width}x{height}");
    }
    let mesh = RasterMesh::new(
        Arc::clone(&scene),
        &[9..50, Range { start: 3, end: 2 }],
        DVec3::ZERO,
    );
    let mut rasterizer = Rasterizer::new();
    let camera = camera(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), 3, 3);
    let (frame, stats) = rasterizer.draw(
        &mesh,
        &camera,
        &view(&full_windows(9), &[]),
        &Environment::default(),
    );
    assert_eq!((frame.frame.hole_count(), stats.triangles_in), (9, 0));
    assert_eq!(frame.frame.color[0], [HOLE[0], HOLE[1], HOLE[2], 255]);
}
