//! Frames of the geometry: exact on planes and pixels, repeatable, without skins.

use super::{DEFAULT, FOCAL, SIZE, frame, off_the_pattern, opened, settings};
use crate::view_geometry::*;
use fearless_simd::Level;
use glam::DVec3;
use headbox_core::color::srgb8_from_linear;
use headbox_core::simd;
use headbox_fixtures::{frame_at, make_view, plane_view};
use headbox_images::LoadedView;

#[test]
fn plane_is_exact_between_cameras() {
    let eyes = [
        DVec3::ZERO,
        DVec3::new(0.4, 0.1, 0.1),
        DVec3::new(-0.3, -0.2, 0.0),
        DVec3::new(0.1, 0.3, -0.2),
    ];
    let views = eyes.map(|eye| plane_view(eye, eye.z + 3.0, SIZE));
    let (_folder, geometry) = opened(&views, &DEFAULT);
    for eye in [DVec3::new(0.1, 0.05, -0.3), eyes[1]] {
        let camera = frame_at(eye, [111, 70]);
        for texturing in [Texturing::Multi, Texturing::Blended, Texturing::Averaged] {
            let (frame, stats) = frame(&geometry, &camera, &settings(texturing));
            // Rounding to levels in the picture, its bilinear interpolation and in the frame.
            let (worst, holes) = off_the_pattern(&frame, &camera, -3.0);
            // At the frame's rim a pixel, on the mean less than 1.5, lies beyond the sample that
            // the last node holds.
            assert!(
                worst <= 3 && 2 * holes < 3 * (111 + 70),
                "{texturing:?} {eye}: off by {worst}, {holes} holes; {stats:?}"
            );
        }
        let (single, _) = frame(&geometry, &camera, &settings(Texturing::Single));
        let (worst, holes) = off_the_pattern(&single, &camera, -3.0);
        assert!(
            worst <= 3 && holes < 111 * 70 / 4,
            "single: off by {worst}, {holes} holes"
        );
        let (nearest, _) = frame(&geometry, &camera, &settings(Texturing::Nearest));
        let (worst, _) = off_the_pattern(&nearest, &camera, -3.0);
        assert_eq!(
            worst > 20,
            eye != eyes[1],
            "the nearest picture is right from where it was taken only: {worst}"
        );
    }
}

#[test]
fn pixels_match_f64_oracle() {
    // A slanted floor, seen by cameras whose pictures differ in colour, so that who is blended how
    // much shows.
    let eyes = [
        DVec3::ZERO,
        DVec3::new(0.3, 0.1, 0.0),
        DVec3::new(-0.2, 0.2, 0.1),
    ];
    let views: Vec<LoadedView> = eyes
        .iter()
        .enumerate()
        .map(|(number, eye)| {
            let focal = FOCAL * f64::from(SIZE[0]);
            let depth = |x: u32, y: u32| {
                let [u, v] = [(x, SIZE[0]), (y, SIZE[1])]
                    .map(|(at, side)| (f64::from(at) + 0.5 - f64::from(side) / 2.0) / focal);
                // n . p = -2 with p = eye + depth * (u, -v, -1).
                let n = DVec3::new(0.2, 0.5, 1.0);
                ((-2.0 - n.dot(*eye)) / n.dot(DVec3::new(u, -v, -1.0))) as f32
            };
            let color = |x: u32, y: u32| {
                let wave = 20.0 * (f64::from(x) * 0.11 + f64::from(y) * 0.07).sin();
                let mut color = [120.0 + wave; 3];
                color[number] += 80.0;
                color.map(|c| c as u8)
            };
            make_view(*eye, depth, color, SIZE)
        })
        .collect();
    let (_folder, geometry) = opened(&views, &DEFAULT);
    let camera = frame_at(DVec3::new(0.05, 0.1, -0.1), [90, 60]);
    let settings = GeometrySettings {
        margin: 0.0,
        by_sight: false,
        ..settings(Texturing::Blended)
    };
    let mut renderer = GeometryRenderer::new();
    renderer.render(&geometry, &camera, &settings, WaitPolicy::Wait);
    let by_rank: Vec<&LoadedView> = renderer
        .ranked
        .iter()
        .map(|ranked| &views[ranked.camera as usize])
        .collect();
    let (mut compared, mut blended, mut worst) = (0, 0, 0);
    for corners in renderer
        .mesh
        .triangles()
        .iter()
        .filter(|corners| renderer.grid.has_samples(corners))
    {
        let at = corners.map(|node| {
            let node = node as usize;
            [renderer.grid.x[node], renderer.grid.y[node]].map(|part| {
                f64::from(part) / f64::from(headbox_core::image::triangle_scan::SUBPIXELS)
            })
        });
        let corner = |k: usize| {
            let node = corners[k] as usize;
            let depth = 1.0 / f64::from(renderer.grid.inverse_depth[node]);
            let point = camera.eye() + camera.direction(at[k][0], at[k][1]) * depth;
            (point, by_rank[renderer.grid.owner[node] as usize])
        };
        let three = [corner(0), corner(1), corner(2)];
        let owners = corners.map(|node| renderer.grid.owner[node as usize]);
        let range = |axis: usize| {
            let [low, high] =
                [f64::min, f64::max].map(|pick| pick(pick(at[0][axis], at[1][axis]), at[2][axis]));
            low.max(0.0) as u32..high.max(0.0) as u32 + 1
        };
        for (x, y) in range(1).flat_map(|y| range(0).map(move |x| (x, y))) {
            let pixel = [x, y].map(|at| f64::from(at) + 0.5);
            if x >= 90 || y >= 60 || !is_well_inside(at, pixel) {
                continue;
            }
            let Some(expected) = oracle::blended(&camera, three, pixel) else {
                continue;
            };
            let found = renderer.frame.color[(y * 90 + x) as usize];
            for k in 0..3 {
                worst = worst.max(found[k].abs_diff(srgb8_from_linear(expected[k] as f32)));
            }
            compared += 1;
            blended += u32::from(owners[0] != owners[1] || owners[1] != owners[2]);
        }
    }
    // One level: of rounding, where f32 and f64 fall to either side.
    assert!(
        compared > 3000 && blended > 500 && worst <= 1,
        "{compared} pixels, {blended} blended, off by {worst}"
    );
}

/// Returns true if a pixel belongs to a triangle and to no neighbour.
fn is_well_inside([a, b, c]: [[f64; 2]; 3], p: [f64; 2]) -> bool {
    let cross =
        |a: [f64; 2], b: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
    cross(a, b) > 1e-6 && cross(b, c) > 1e-6 && cross(c, a) > 1e-6
}

/// Size of images whose rims are tested.
const LARGE: [u32; 2] = [320, 240];

/// A red square 1.5 m away before a blue wall 3 m away.
fn square_before_wall(eye: DVec3) -> LoadedView {
    let focal = FOCAL * f64::from(LARGE[0]);
    let is_square = move |x: u32, y: u32| {
        let [u, v] = [(x, LARGE[0]), (y, LARGE[1])]
            .map(|(at, side)| (f64::from(at) + 0.5 - f64::from(side) / 2.0) / focal);
        (eye.x + u * 1.5).abs() < 0.3 && (eye.y - v * 1.5).abs() < 0.3
    };
    let depth = move |x, y| if is_square(x, y) { 1.5 } else { 3.0 };
    make_view(
        eye,
        depth,
        move |x, y| {
            if is_square(x, y) {
                [220, 20, 20]
            } else {
                [20, 20, 220]
            }
        },
        LARGE,
    )
}

#[test]
fn no_skin_spans_depth_edge() {
    let eyes = [-0.3, 0.0, 0.3].map(|x| DVec3::new(x, 0.0, 0.0));
    let (_folder, geometry) = opened(&eyes.map(square_before_wall), &DEFAULT);
    let camera = frame_at(DVec3::new(0.12, 0.04, 0.0), LARGE);
    let expected = square_before_wall(camera.eye());
    for texturing in [Texturing::Multi, Texturing::Blended, Texturing::Averaged] {
        let (frame, _) = frame(&geometry, &camera, &settings(texturing));
        let (mut wrong, mut mixed) = (0, 0);
        let shown = frame.color.iter().zip(&frame.coverage).zip(&expected.color);
        for ((found, _), truth) in shown.filter(|((_, coverage), _)| !coverage.is_hole()) {
            mixed += u32::from(found[0] > 60 && found[2] > 60);
            wrong += u32::from(found[0].abs_diff(truth[0]) > 100);
        }
        // The rim is some 410 pixels long: its own pixels are mixed where a texture is looked up
        // across it.
        assert!(
            mixed < 600 && wrong < 200,
            "{texturing:?}: {mixed} mixed, {wrong} wrong"
        );
        // All cameras are lower than the frame's: it looks over the tops of their pictures by 3.4
        // pixels, and the mesh ends at the last row of nodes that hold a sample, less than their
        // distance before that.
        let open_rows = 3.4 + settings(texturing).grid_px;
        assert!(
            frame.hole_count() as f32 <= open_rows * 320.0,
            "{}",
            frame.hole_count()
        );
    }
}

#[test]
fn same_bytes_on_any_threads_and_level() {
    let eyes = [-0.3, 0.0, 0.3].map(|x| DVec3::new(x, 0.0, 0.0));
    let mut views = eyes.map(square_before_wall);
    // Masked out in one of them, so that some texels have no neighbours.
    views[1]
        .color
        .iter_mut()
        .step_by(37)
        .for_each(|color| color[3] = 0);
    let (_folder, geometry) = opened(&views, &DEFAULT);
    // An odd width, so that the last pixels of a row are fewer than the others.
    let camera = frame_at(DVec3::new(0.12, 0.04, 0.0), [317, 203]);
    for texturing in Texturing::ALL {
        let name = texturing.name();
        let on = |threads: usize, level: Level| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("a pool");
            let mut renderer = GeometryRenderer::with(level);
            pool.install(|| {
                renderer
                    .render(&geometry, &camera, &settings(texturing), WaitPolicy::Wait)
                    .0
                    .clone()
            })
        };
        let expected = on(1, simd::level());
        for level in simd::levels() {
            assert!(on(3, level) == expected, "{name}, {level:?}");
        }
    }
}

#[test]
fn reused_buffers_leave_no_trace() {
    let (_folder, geometry) = opened(
        &[DVec3::ZERO, DVec3::X * 0.2].map(|eye| plane_view(eye, 3.0, SIZE)),
        &DEFAULT,
    );
    let mut renderer = GeometryRenderer::new();
    let poses = [
        (DVec3::X * 0.1, [200, 140]),
        (DVec3::new(0.8, 0.0, 1.0), [96, 72]),
        (DVec3::ZERO, [31, 90]),
    ];
    for (eye, size) in poses {
        let camera = frame_at(eye, size);
        for texturing in [Texturing::Blended, Texturing::Nearest, Texturing::Multi] {
            let (expected, _) = frame(&geometry, &camera, &settings(texturing));
            let (found, _) =
                renderer.render(&geometry, &camera, &settings(texturing), WaitPolicy::Wait);
            assert!(*found == expected, "{texturing:?} from {eye}");
        }
    }
}
