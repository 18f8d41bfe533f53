//! The rasteriser against the tracer, against arithmetic, and against itself in other divisions.

use fearless_simd::Level;
use glam::{DVec3, Vec2, Vec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::color::srgb8_from_linear;
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

fn view<'a>(groups: &'a [GroupWindow], markers: &'a [Marker]) -> RasterView<'a> {
    RasterView {
        groups,
        markers,
        exposure: 1.0,
        hole_color_srgb: HOLE,
    }
}

fn full_windows(groups: u32) -> Vec<GroupWindow> {
    (0..groups)
        .map(|group| GroupWindow {
            group,
            window: None,
        })
        .collect()
}

fn draw(scene: &Arc<Scene>, camera: &Camera) -> (RasterOutput, RasterStats) {
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
fn scene_from_triangles(triangles: &[[DVec3; 3]]) -> Scene {
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
fn soup(count: usize) -> Scene {
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
fn with_textures(mut scene: Scene, repetitions: f64) -> Scene {
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

fn camera(eye: DVec3, at: DVec3, width: u32, height: u32) -> Camera {
    Camera::look_at(eye, at, DVec3::Y, 70.0, [width, height]).expect("valid")
}

fn hit(tracer: &Tracer, camera: &Camera, x: f64, y: f64) -> Option<Hit> {
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

/// A jittered grid of triangles that covers the frame, flat and tilted, fine and coarse, partly
/// behind the eye: every pixel is covered by one of them, and by a second one only on its edge.
#[test]
fn adjacent_triangles_cover_every_pixel_and_share_few() {
    let mut random = Rng::keyed(11);
    for (side, reach, tilt) in [
        (3, 4.0, 0.0),
        (9, 4.0, 0.4),
        (40, 3.0, 0.1),
        (4, 4000.0, 0.9),
    ] {
        let mut corner = |i: usize, j: usize| {
            let inside = i > 0 && j > 0 && i < side && j < side;
            let mut jitter = || {
                if inside {
                    random.between(-0.3, 0.3)
                } else {
                    0.0
                }
            };
            let at =
                |k: usize, jitter: f64| ((k as f64 + jitter) / side as f64 * 2.0 - 1.0) * reach;
            let (x, y) = (at(i, jitter()), at(j, jitter()));
            dvec3(x, y, -1.0 + tilt * x / reach)
        };
        let grid: Vec<DVec3> = (0..(side + 1) * (side + 1))
            .map(|k| corner(k % (side + 1), k / (side + 1)))
            .collect();
        let mut scene = Scene {
            positions: grid,
            materials: vec![Material::default()],
            ..Scene::default()
        };
        for j in 0..side {
            for i in 0..side {
                let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)]
                    .map(|(di, dj)| ((j + dj) * (side + 1) + i + di) as u32);
                let pair = if (i + j) % 2 == 0 {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, b, d], [d, b, c]]
                };
                scene.triangles.extend(pair.map(|vertices| Triangle {
                    vertices,
                    material: 0,
                }));
            }
        }
        let count = scene.triangles.len() as u32;
        let camera = camera(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), 61, 47);
        let groups: Vec<_> = (0..count).map(|i| i..i + 1).collect();
        let mesh = RasterMesh::new(Arc::new(scene), &groups, DVec3::ZERO);
        let (mut rasterizer, mut times) = (Rasterizer::new(), vec![0u32; 61 * 47]);
        for group in 0..count {
            let one = [GroupWindow {
                group,
                window: None,
            }];
            let (frame, _) =
                rasterizer.draw(&mesh, &camera, &view(&one, &[]), &Environment::default());
            times
                .iter_mut()
                .enumerate()
                .for_each(|(i, n)| *n += u32::from(frame.seen(i) != PixelContent::Nothing));
        }
        assert!(times.iter().all(|&n| n >= 1), "side {side}, reach {reach}");
        // One pixel centre in 256 lies on an edge that crosses the pixel.
        let shared = times.iter().filter(|&&n| n > 1).count();
        assert!(
            shared * 100 < times.len(),
            "side {side}, reach {reach}: {shared}"
        );
    }
}

/// Walls whose panels were cut into pieces on one side only, as around a door: after stitching, no
/// light leaks through T-junctions in views from a thousand positions.
#[test]
fn t_junctions_leave_no_cracks() {
    let mut random = Rng::keyed(5);
    let whole_panel = [
        dvec3(-1.0, -40.0, 0.0),
        dvec3(-1.0, 40.0, 0.0),
        dvec3(-40.0, 40.0, 0.0),
        dvec3(-40.0, -40.0, 0.0),
    ];
    let mut triangles = vec![
        [whole_panel[0], whole_panel[1], whole_panel[2]],
        [whole_panel[0], whole_panel[2], whole_panel[3]],
    ];
    let mut cuts: Vec<f64> = (0..40)
        .map(|_| random.between(-3.0, 3.0))
        .chain([-40.0, 40.0])
        .collect();
    cuts.sort_by(f64::total_cmp);
    for pair in cuts.windows(2) {
        let [low, high] = [pair[0], pair[1]];
        let corner = |x: f64, y: f64| dvec3(x, y, 0.0);
        triangles.push([corner(-1.0, low), corner(40.0, low), corner(40.0, high)]);
        triangles.push([corner(-1.0, low), corner(40.0, high), corner(-1.0, high)]);
    }
    // Rotated like a house in a plan: its walls are not parallel to the axes.
    let turn = glam::DMat3::from_rotation_y(0.4) * glam::DMat3::from_rotation_x(0.3);
    triangles
        .iter_mut()
        .flatten()
        .for_each(|corner| *corner = turn * *corner);
    let mut scene = scene_from_triangles(&triangles);
    scene.stitch();
    let scene = Arc::new(scene);
    let mesh = RasterMesh::new(
        Arc::clone(&scene),
        std::slice::from_ref(&(0..scene.triangles.len() as u32)),
        DVec3::ZERO,
    );
    let mut rasterizer = Rasterizer::new();
    for place in 0..1000 {
        let eye = turn * (dvec3(-1.0, 0.0, 2.0) + random.in_cube(0.7));
        let at = turn * (dvec3(-1.0, 0.0, 0.0) + random.in_cube(0.2));
        let camera = camera(eye, at, 48, 48);
        let (frame, _) = rasterizer.draw(
            &mesh,
            &camera,
            &view(&full_windows(1), &[]),
            &Environment::default(),
        );
        assert_eq!(frame.frame.hole_count(), 0, "place {place}");
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

/// Tolerance, sRGB levels: a pixel's weights may be those of a point 0.003 px away, and colours of
/// these triangles change by at most 255 levels over some pixels.
const COLOR_LEVELS: i32 = 3;

#[test]
fn colours_equal_traced_surface() {
    // Magnified: a texel is larger than a pixel, so no mip level is used.
    let scene = Arc::new(with_textures(soup(300), 0.02));
    let camera = camera(dvec3(0.3, -0.2, 0.4), dvec3(1.0, 0.2, -3.0), 97, 61);
    let (frame, _) = draw(&scene, &camera);
    let tracer = Tracer::new(Arc::clone(&scene), camera.eye());
    let (mut compared, mut far_off) = (0, 0);
    for pixel in 0..frame.inverse_depth.len() {
        let (x, y) = (
            f64::from(pixel as u32 % 97) + 0.5,
            f64::from(pixel as u32 / 97) + 0.5,
        );
        let Some(hit) = hit(&tracer, &camera, x, y)
            .filter(|hit| frame.seen(pixel) == PixelContent::Triangle(hit.primitive))
        else {
            continue;
        };
        let surface = scene.surface(hit.primitive, hit.u, hit.v);
        let expected =
            [0, 1, 2].map(|c| srgb8_from_linear(surface.albedo[c] + surface.emission[c]));
        let apart = (0..3)
            .map(|c| (i32::from(expected[c]) - i32::from(frame.frame.color[pixel][c])).abs())
            .max();
        compared += 1;
        far_off += u32::from(apart > Some(COLOR_LEVELS));
    }
    // Slivers and triangles of the size of a pixel have all their colours within 0.003 px.
    assert!(
        compared > 3000 && far_off * 50 < compared,
        "{far_off} of {compared}"
    );
}

/// On a floor 0.1 mm below the eye, depths within a frame differ by 10^5. The colours of its
/// corners change linearly over its 100 m, so a pixel's colour gives the position of its weights on
/// the floor.
#[test]
fn floor_just_below_eye_has_correct_colours() {
    let corners = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]]
        .map(|[x, z]| dvec3(x, -1e-4, z));
    let even = |p: DVec3| Vec3::new(0.5 + p.x as f32 / 101.0, 0.5 + p.z as f32 / 101.0, 0.5);
    let scene = Scene {
        positions: corners.to_vec(),
        colors: corners.iter().map(|p| even(*p)).collect(),
        triangles: [[0, 1, 2], [0, 2, 3]]
            .map(|vertices| Triangle {
                vertices,
                material: 0,
            })
            .to_vec(),
        materials: vec![Material {
            albedo: [1.0; 3],
            ..Material::default()
        }],
        ..Scene::default()
    };
    // Upside down: the first row is directly below the eye, and the middle one 25 m away, 4e-6 rad
    // below the horizon.
    let camera = |up| {
        Camera::look_at(DVec3::ZERO, dvec3(0.3, -4e-6, -1.0), up, 100.0, [61, 97]).expect("valid")
    };
    let scene = Arc::new(scene);
    for camera in [camera(DVec3::Y), camera(-DVec3::Y)] {
        let frame = draw(&scene, &camera).0;
        let mut compared = 0;
        for pixel in (0..frame.inverse_depth.len())
            .filter(|pixel| frame.seen(*pixel) != PixelContent::Nothing)
        {
            let d = camera.direction(
                f64::from(pixel as u32 % 61) + 0.5,
                f64::from(pixel as u32 / 61) + 0.5,
            );
            let expected = even(d * (-1e-4 / d.y)).to_array().map(srgb8_from_linear);
            let found = frame.frame.color[pixel];
            assert!(
                (0..3).all(|c| expected[c].abs_diff(found[c]) <= 1),
                "{pixel}: {found:?} for {expected:?}"
            );
            compared += 1;
        }
        assert!(compared > 1000, "{compared}");
    }
}

#[test]
fn minified_textures_average_and_cutouts_have_holes() {
    let checks = Texture::from_fn(64, 64, |x, y| {
        if (x + y) % 2 == 0 {
            [255; 4]
        } else {
            [0, 0, 0, 0]
        }
    });
    let quad = [
        dvec3(-1.0, -1.0, -1.0),
        dvec3(1.0, -1.0, -1.0),
        dvec3(1.0, 1.0, -1.0),
        dvec3(-1.0, 1.0, -1.0),
    ];
    let mut scene = Scene {
        positions: quad.to_vec(),
        texcoords: quad
            .iter()
            .map(|p| Vec2::new(p.x as f32, p.y as f32) * 0.5 + 0.5)
            .collect(),
        triangles: [[0, 1, 2], [0, 2, 3]]
            .map(|vertices| Triangle {
                vertices,
                material: 0,
            })
            .to_vec(),
        materials: vec![Material {
            albedo: [1.0; 3],
            albedo_texture: Some(0),
            ..Material::default()
        }],
        textures: vec![checks],
        ..Scene::default()
    };
    let camera =
        Camera::look_at(DVec3::ZERO, dvec3(0.0, 0.0, -1.0), DVec3::Y, 90.0, [8, 8]).expect("valid");
    let (frame, _) = draw(&Arc::new(scene.clone()), &camera);
    let grey = srgb8_from_linear(0.5);
    assert!(
        frame.frame.color.iter().all(|c| c[0].abs_diff(grey) <= 2),
        "{:?}",
        frame.frame.color
    );

    scene.materials[0].cutout = Some(Cutout {
        texture: Some(0),
        threshold: 0.5,
    });
    scene.textures[0] =
        Texture::from_fn(2, 1, |x, _| [255, 255, 255, if x == 0 { 255 } else { 0 }]);
    let (frame, _) = draw(&Arc::new(scene), &camera);
    for pixel in 0..64 {
        let left = pixel % 8 < 4;
        assert_eq!(
            frame.seen(pixel) != PixelContent::Nothing,
            left,
            "pixel {pixel}"
        );
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
