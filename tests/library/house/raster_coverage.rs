//! Coverage of the rasteriser: adjacent triangles leave no crack and share no pixel but on edges.

use super::raster::{camera, full_windows, scene_from_triangles, view};
use glam::{DVec3, dvec3};
use headbox_core::environment::Environment;
use headbox_core::random::Rng;
use headbox_raster::{GroupWindow, PixelContent, RasterMesh, Rasterizer};
use headbox_scene::material::Material;
use headbox_scene::scene::Scene;
use headbox_scene::scene::Triangle;
use std::sync::Arc;

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
