//! Frames of pictures on planes, pixel by pixel: rays, and texels between texels.

use super::plan::tests::{FACE_PX, one_picture, traced};
use super::*;
use crate::pack::{Plane, PlaneTile};
use crate::render::canvas::depth::DepthCanvas;
use crate::render::canvas::linear::LinearLight;
use crate::render::canvas::over::OverCanvas;
use crate::render::canvas::surface::SurfaceCanvas;
use crate::render::footprint::ellipse::EllipseCanvas;
use crate::render::footprint::splat::{Canvas, SplatKernel, Splats};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_core::simd;

const SIZE_PX: [u32; 2] = [60, 44];

/// Levels by which bilinear means in integers, of distances in 1/256 of a texel, may err, where texels differ by at most 40.
const LEVELS: f64 = 1.5;

/// A camera before the texels of a picture, which are larger than pixels.
fn camera(random: &mut Rng) -> Camera {
    let eye = random.in_cube(0.2);
    let look = Face::NegZ.normal() + random.in_cube(0.2);
    Camera::look_at(eye, eye + look, DVec3::Y, 50.0, SIZE_PX).expect("valid")
}

/// A picture on a leaning plane whose texels vary by less than 40 from one to the next; one corner fades out.
fn picture(fades: bool) -> PlaneSet {
    let mut set = one_picture(DVec3::new(0.1, -0.08, -0.5), Face::NegZ, [20, 22], [23, 19]);
    let texel = |i: u32| {
        let (x, y) = (i % 23, i / 23);
        let alpha = if fades {
            (x * 40).min(y * 40).min(255)
        } else {
            255
        };
        PlaneSet::covered([(x * 10) as u8, (y * 13) as u8, 80, alpha as u8])
    };
    set.texels = (0..23 * 19).map(texel).collect();
    set.tiles[0].opaque = u16::from(!fades);
    set
}

/// Bilinear, colour times alpha, and alpha.
fn between(set: &PlaneSet, u: f64, v: f64) -> [f64; 4] {
    let (x, y) = ((u as usize).min(21), (v as usize).min(17));
    let (u, v) = (u - x as f64, v - y as f64);
    std::array::from_fn(|c| {
        let at = |x: usize, y: usize| f64::from(set.texels[y * 23 + x][c]);
        (at(x, y) * (1.0 - u) + at(x + 1, y) * u) * (1.0 - v)
            + (at(x, y + 1) * (1.0 - u) + at(x + 1, y + 1) * u) * v
    })
}

fn drawn(
    set: &PlaneSet,
    camera: &Camera,
    standing: Option<&Standing>,
    rows: Range<u32>,
    level: Level,
) -> PlaneCanvas {
    let (mut view, mut canvas) = (PlanesInView::default(), PlaneCanvas::default());
    view.prepare(set, camera, camera.eye(), FACE_PX);
    canvas.draw(set, &view, standing, (rows, 0), 0.01, level);
    canvas
}

#[test]
fn pictures_are_bilinear_means_where_rays_meet_them() {
    let (mut random, mut counts) = (Rng::keyed(5), [0; 3]);
    for i in 0..8 {
        let (set, camera, rows) = (picture(i % 2 == 1), camera(&mut random), 9..37);
        for level in simd::levels() {
            let canvas = drawn(&set, &camera, None, rows.clone(), level);
            for (y, x) in rows
                .clone()
                .flat_map(|y| (0..SIZE_PX[0]).map(move |x| (y, x)))
            {
                let Some([u, v, _, q]) = traced(&set, &camera, [x, y]) else {
                    panic!("before the camera")
                };
                let inside = u.min(22.0 - u).min(v).min(18.0 - v);
                let row = (y - rows.start) as usize;
                let (colors, depths) = canvas.row(row);
                let (color, depth) = (colors[x as usize], depths[x as usize]);
                let rim = canvas
                    .rims()
                    .iter()
                    .find(|rim| rim.pixel == [x, row as u32]);
                let at = [x, y].map(|c| c as f32 + 0.5);
                assert_eq!(
                    canvas.hides(at, depth / 1.02),
                    depth > 0.0,
                    "a hundredth is tolerated"
                );
                if inside < -0.01 {
                    assert!(
                        color == [0; 4] && depth == NOWHERE && rim.is_none(),
                        "{x}, {y}: nothing is there"
                    );
                    counts[0] += 1;
                    continue;
                }
                if inside < 0.01 {
                    continue;
                }
                let expected = between(&set, u, v);
                let near = |found: u8, expected: f64| (f64::from(found) - expected).abs() <= LEVELS;
                let near_q = |found: f32| (f64::from(found) / q - 1.0).abs() < 1e-4;
                match (color[3], rim) {
                    (255, None) => {
                        assert!(
                            expected[3] > 254.0 - LEVELS && near_q(depth),
                            "{expected:?} {depth} {q}"
                        );
                        assert!(
                            (0..3).all(|c| near(color[c], expected[c])),
                            "{x}, {y}: {color:?} {expected:?}"
                        );
                        counts[1] += 1;
                    }
                    (0, Some(rim)) => {
                        assert!(
                            near(rim.color[3], expected[3])
                                && rim.color[3] >= 8
                                && near_q(rim.inverse_depth)
                        );
                        // Straight: rounding weighs the more the less of it there is.
                        let straight = |c: usize| {
                            (
                                expected[c] * 255.0 / expected[3],
                                LEVELS * 2.0 * 255.0 / expected[3],
                            )
                        };
                        let is_near = |c: usize| {
                            (f64::from(rim.color[c]) - straight(c).0).abs() <= straight(c).1
                        };
                        assert!((0..3).all(is_near), "{x}, {y}: {rim:?} {expected:?}");
                        counts[2] += 1;
                    }
                    _ => assert!(
                        color == [0; 4] && rim.is_none() && expected[3] < 8.0 + LEVELS,
                        "{x}, {y}: {expected:?}"
                    ),
                }
            }
        }
    }
    assert!(counts.iter().all(|count| *count > 300), "{counts:?}");
}

#[test]
fn of_two_pictures_the_nearer_hides_the_other_and_its_rims() {
    let mut set = picture(false);
    let behind = picture(true);
    set.planes.push(Plane {
        normal_per_distance: set.planes[0].normal_per_distance * 0.5,
    });
    set.tiles.push(PlaneTile {
        plane: 1,
        first_texel: 23 * 19,
        ..behind.tiles[0]
    });
    set.texels.extend(behind.texels);
    let camera = camera(&mut Rng::keyed(9));
    let [both, alone] =
        [&set, &picture(false)].map(|set| drawn(set, &camera, None, 0..44, Level::new()));
    for (row, (of_both, of_one)) in both.rows().zip(alone.rows()).enumerate() {
        for (x, ((both_color, color), depth)) in
            of_both.0.iter().zip(of_one.0).zip(of_one.1).enumerate()
        {
            assert!(color[3] == 0 || both_color == color);
            let mut here = both
                .rims()
                .iter()
                .filter(|rim| rim.pixel == [x as u32, row as u32]);
            assert!(here.all(|rim| rim.inverse_depth > *depth));
        }
    }
    assert!(
        both.rims().iter().any(|rim| rim.pixel[0] > 0),
        "some of it shows"
    );
}

#[test]
fn what_stands_before_planes_hides_them_or_blends_last() {
    let (set, camera) = (picture(false), camera(&mut Rng::keyed(9)));
    let alone = drawn(&set, &camera, None, 5..40, Level::new());
    // Half of it before the plane, half behind it; a third opaque; three columns and a row lie outside of the band and the frame.
    let window = [50..63, 3..30];
    let at = |x: usize, y: usize| (y - 3) * 13 + x - 50;
    let colors: Vec<[u8; 4]> = (0..13 * 27)
        .map(|i| [i as u8, 1, 2, if i % 3 == 0 { 255 } else { 90 }])
        .collect();
    let nearness: Vec<f32> = (0..13 * 27)
        .map(|i| if i % 2 == 0 { 9.0 } else { 0.001 })
        .collect();
    let standing = Standing {
        window,
        colors: &colors,
        inverse_depth: &nearness,
    };
    assert_eq!(
        (standing.pixel(55, 20), standing.pixel(49, 20).1),
        ((colors[at(55, 20)], nearness[at(55, 20)]), 0.0)
    );
    let canvas = drawn(&set, &camera, Some(&standing), 5..40, Level::new());
    let mut rims = 0;
    for (y, x) in (5..40).flat_map(|y| (0..60).map(move |x| (y, x))) {
        let (there, depth) = (alone.row(y - 5).0[x], alone.row(y - 5).1[x]);
        let (color, nearness) = standing.pixel(x, y);
        let is_before = nearness > depth.max(0.0);
        let expected = if is_before && color[3] == 255 {
            (color, nearness)
        } else {
            (there, depth)
        };
        assert_eq!(
            (canvas.row(y - 5).0[x], canvas.row(y - 5).1[x]),
            expected,
            "{x}, {y}"
        );
        let rim = Rim {
            pixel: [x as u32, y as u32 - 5],
            color,
            inverse_depth: nearness,
        };
        let is_rim = is_before && color[3] < 255;
        assert_eq!(canvas.rims().contains(&rim), is_rim, "{x}, {y}");
        rims += usize::from(is_rim);
    }
    assert!(rims > 50 && canvas.rims().len() == rims);
    let (colors, _) = canvas.eight(2, 54).expect("drawn");
    assert_eq!(colors[..6], canvas.row(2).0[54..]);
}

/// Levels by which colours may err that were multiplied by a share and divided again, of shares above a half.
const OF_SHARES: u8 = 2;

#[test]
fn canvases_show_the_ground_and_its_rims() {
    let (set, camera, rows) = (picture(true), camera(&mut Rng::keyed(9)), 5..40);
    let mut view = PlanesInView::default();
    view.prepare(&set, &camera, camera.eye(), FACE_PX);
    let ground = drawn(&set, &camera, None, rows.clone(), Level::new());
    let mut depth = DepthCanvas::default();
    depth.clear(60, rows.clone());
    depth.lay(&ground);
    depth.add_rims(ground.rims());
    let canvases: [&mut dyn Canvas; 3] = [
        &mut OverCanvas::default(),
        &mut EllipseCanvas::default(),
        &mut SurfaceCanvas::default(),
    ];
    for (i, canvas) in canvases.into_iter().enumerate() {
        canvas.clear(60, rows.clone());
        canvas
            .ground_mut()
            .draw(&set, &view, None, (rows.clone(), 0), 0.01, Level::new());
        canvas.lay();
        canvas.add_rims(Level::new());
        canvas.settle(Level::new());
        for row in 0..rows.len() {
            let (mut found, mut depths_m, mut told) = ([[0; 4]; 60], [0.0; 60], [9.0; 60]);
            canvas.tell_depths(row, 0, &mut told);
            canvas.resolve(row, 0, &mut found, Level::new());
            depth.resolve(row, 0, &mut depths_m);
            for (x, (found, depth_m)) in found.into_iter().zip(depths_m).enumerate() {
                let rim = ground
                    .rims()
                    .iter()
                    .find(|rim| rim.pixel == [x as u32, row as u32]);
                let whole = (ground.row(row).0[x], ground.row(row).1[x].max(0.0));
                let (color, q) = rim.map_or(whole, |rim| (rim.color, rim.inverse_depth));
                assert_eq!(depth_m, 1.0 / q, "{x}, {row}");
                assert!(
                    i == 0 || told[x] == q,
                    "{x}, {row}: splats over one another tell no depth"
                );
                // The canvas of ellipses takes 92 % for whole, that of surfaces 120 of 128 parts, in which it counts; both give a twentieth
                // to what there is.
                let least = if color[3] > 0 { 0.05 * 255.0 } else { 0.0 };
                let of = |whole: f32| (f32::from(color[3]) / whole).clamp(least, 255.0) as u8;
                let share = [color[3], of(0.92), of(120.0 / 128.0)][i];
                let tolerance = [1, 1, 2][i].max(if color[3] >= 252 { 3 } else { 0 });
                assert!(found[3].abs_diff(share) <= tolerance, "{found:?} {color:?}");
                let near = |c: usize| found[c].abs_diff(color[c]) <= OF_SHARES;
                assert!(color[3] < 128 || (0..3).all(near), "{found:?} {color:?}");
            }
        }
    }
}

#[test]
fn rims_lie_over_what_was_drawn_in_linear_light() {
    let rim = Rim {
        pixel: [7, 2],
        color: [200, 100, 50, 102],
        inverse_depth: 0.5,
    };
    let mut canvas = OverCanvas::default();
    canvas.clear(20, 4..9);
    let mut splats = Splats::new();
    splats.len = 1;
    (
        splats.x[0],
        splats.y[0],
        splats.radius_x[0],
        splats.radius_y[0],
    ) = (7.5, 6.5, 0.5, 0.5);
    splats.color[0] = u32::from_ne_bytes([20, 40, 60, 255]);
    canvas.draw(&splats, Level::new());
    canvas.ground_mut().rims.push(rim);
    canvas.add_rims(Level::new());
    let mut found = [[0; 4]; 20];
    canvas.resolve(2, 0, &mut found, Level::new());
    assert_eq!(
        found[7],
        LinearLight::tables().over(rim.color, [20, 40, 60, 255])
    );
    assert!((0..20).all(|x| x == 7 || found[x] == [0; 4]));
}

/// Of two rims in one pixel, what shows: the share tells whether they are one surface.
fn of_rims(canvas: &mut dyn Canvas, [near, far]: [f32; 2], pixel: [u32; 2]) -> [u8; 4] {
    canvas.clear(20, 4..44);
    for inverse_depth in [near, far] {
        canvas.ground_mut().rims.push(Rim {
            pixel,
            color: [200, 100, 50, 102],
            inverse_depth,
        });
    }
    canvas.add_rims(Level::new());
    canvas.settle(Level::new());
    let mut told = [9.0; 20];
    canvas.tell_depths(pixel[1] as usize, 0, &mut told);
    assert!(
        (0..20).all(|x| told[x]
            == if x == pixel[0] as usize {
                near.max(0.0)
            } else {
                0.0
            }),
        "{told:?}"
    );
    let mut found = [[0; 4]; 20];
    canvas.resolve(pixel[1] as usize, 0, &mut found, Level::new());
    assert!((0..20).all(|x| (x == pixel[0] as usize) == (found[x] != [0; 4])));
    canvas.ground_mut().rims.clear();
    found[pixel[0] as usize]
}

#[test]
fn rims_are_surfaces_wherever_they_lie() {
    let (mut surfaces, mut ellipses) = (SurfaceCanvas::default(), EllipseCanvas::default());
    (
        surfaces.tolerance,
        surfaces.bin,
        ellipses.tolerance,
        ellipses.bin,
    ) = (0.01, 0.001, 0.01, 0.001);
    for pixel in [[0, 0], [9, 31], [19, 33], [2, 39]] {
        // What lies infinitely far away may round below 0.
        for depths in [[0.5, 0.499], [-1e-9, -1e-9]] {
            assert_eq!(
                of_rims(&mut surfaces, depths, pixel)[3],
                216,
                "102 of 128 parts of 255 each, of 120"
            );
            assert_eq!(of_rims(&mut ellipses, depths, pixel)[3], 222, "0.8 of 0.92");
        }
    }
    // A hundredth of 0.5 is 0.005; of 0.05 less than a bin of 0.001.
    for (depths, share) in [
        ([0.504, 0.5], 222),
        ([0.506, 0.5], 213),
        ([0.0508, 0.05], 222),
        ([0.0512, 0.05], 213),
    ] {
        assert_eq!(
            of_rims(&mut ellipses, depths, [3, 3])[3],
            share,
            "{depths:?}"
        );
    }
}

/// A camera at the centre whose pixels are those of the face: each shows one texel.
#[test]
fn pictures_show_to_their_last_texel() {
    let mut set = one_picture(Face::NegZ.normal() * 0.5, Face::NegZ, [20, 22], [23, 19]);
    set.texels = (0..23 * 19)
        .map(|i| [(i % 23 * 11) as u8, (i / 23 * 13) as u8, 80, 255])
        .collect();
    let camera = Camera::look_at(
        DVec3::ZERO,
        Face::NegZ.normal(),
        DVec3::Y,
        90.0,
        [FACE_PX; 2],
    )
    .expect("valid");
    for level in simd::levels() {
        let canvas = drawn(&set, &camera, None, 0..FACE_PX, level);
        for (y, x) in (0..19).flat_map(|y| (0..23).map(move |x| (y, x))) {
            assert_eq!(
                canvas.row(22 + y).0[20 + x],
                set.texels[y * 23 + x],
                "{x}, {y}"
            );
        }
    }
}

#[test]
fn splats_behind_planes_are_left_out() {
    let (set, camera) = (picture(false), camera(&mut Rng::keyed(9)));
    let ground = drawn(&set, &camera, None, 0..44, Level::new());
    let there = ground.row(22).1[30];
    assert!(there > 0.0);
    // Nearer, as near as the tolerance allows, farther; above and left of the frame; beside the picture.
    let places = [
        (30.5, 22.5, there * 1.2),
        (30.5, 22.5, there / 1.009),
        (30.5, 22.5, there / 1.011),
        (30.5, 22.5, there * 0.5),
        (-0.5, 22.5, 1e-3),
        (30.5, -0.5, 1e-3),
        (1.5, 1.5, 1e-3),
    ];
    let mut splats = Splats::new();
    splats.len = places.len();
    for (i, (x, y, inverse_depth)) in places.into_iter().enumerate() {
        (
            splats.x[i],
            splats.y[i],
            splats.inverse_depth[i],
            splats.color[i],
        ) = (x, y, inverse_depth, i as u32);
    }
    splats.retain_in_front(&ground);
    let open = |x: usize, y: usize| ground.row(y).1[x] < 0.0;
    assert!(
        open(0, 22) && open(30, 0) && open(1, 1),
        "the picture does not reach the frame's border"
    );
    assert_eq!(splats.color[..splats.len], [0, 1, 4, 5, 6]);
    assert_eq!(splats.inverse_depth[1], there / 1.009);
    splats.retain_in_front(&PlaneCanvas::default());
    assert_eq!(splats.len, 5, "without planes all stay");
    assert_eq!(
        SplatKernel::Ellipse.own_share(),
        0.4,
        "half a spacing of 1.25"
    );
}
