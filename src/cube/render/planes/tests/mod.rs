//! Plane layers against rays and bilinear interpolation, pixel by pixel, and canvases with a
//! background.

mod spans;

use super::layer::NOWHERE;
use super::*;
use crate::pack::{Plane, PlaneSet, PlaneTile};
use crate::render::canvas::depth::DepthCanvas;
use crate::render::canvas::ellipse::EllipseCanvas;
use crate::render::canvas::linear::LinearLight;
use crate::render::canvas::over_canvas::OverCanvas;
use crate::render::canvas::surface_canvas::SurfaceCanvas;
use crate::render::canvas::{Canvas, Tolerance};
use crate::render::footprint::splat::{SplatKernel, Splats};
use fearless_simd::Level;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::random::Rng;
use headbox_core::simd;
use spans::{FACE_PX, one_texture, trace};
use std::ops::Range;

const SIZE_PX: [u32; 2] = [60, 44];

const TOLERANCE: Tolerance = Tolerance {
    relative: 0.01,
    least: 0.001,
};

/// Tolerated error of bilinear means in integers, at distances in 1/256 of a texel, where texels
/// differ by at most 40, levels.
const LEVELS: f64 = 1.5;

/// Creates a camera in front of a texture whose texels are larger than pixels.
fn camera(random: &mut Rng) -> Camera {
    let eye = random.in_cube(0.2);
    let look = Face::NegZ.normal() + random.in_cube(0.2);
    Camera::look_at(eye, eye + look, DVec3::Y, 50.0, SIZE_PX).expect("valid")
}

/// Creates a texture on an inclined plane whose adjacent texels differ by less than 40; optionally
/// one corner fades out.
fn texture(fades: bool) -> PlaneSet {
    let mut set = one_texture(DVec3::new(0.1, -0.08, -0.5), Face::NegZ, [20, 22], [23, 19]);
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

/// Interpolates premultiplied colour and alpha bilinearly.
fn interpolate(set: &PlaneSet, u: f64, v: f64) -> [f64; 4] {
    let x = (u as usize).min(21);
    let y = (v as usize).min(17);
    let u = u - x as f64;
    let v = v - y as f64;
    std::array::from_fn(|c| {
        let texel = |x: usize, y: usize| f64::from(set.texels[y * 23 + x][c]);
        (texel(x, y) * (1.0 - u) + texel(x + 1, y) * u) * (1.0 - v)
            + (texel(x, y + 1) * (1.0 - u) + texel(x + 1, y + 1) * u) * v
    })
}

fn draw_layer(
    set: &PlaneSet,
    camera: &Camera,
    inserted: Option<&DepthLayer>,
    rows: Range<u32>,
    level: Level,
) -> PlaneLayer {
    let mut view = PlanesInView::default();
    let mut layer = PlaneLayer::default();
    view.prepare(set, camera, camera.eye(), FACE_PX);
    layer.draw(set, &view, inserted, (rows, 0), 0.01, level);
    layer
}

#[test]
fn textures_are_interpolated_where_rays_hit_them() {
    let mut random = Rng::keyed(5);
    let mut counts = [0; 3];
    for i in 0..8 {
        let set = texture(i % 2 == 1);
        let camera = camera(&mut random);
        let rows = 9..37;
        for level in simd::levels() {
            let layer = draw_layer(&set, &camera, None, rows.clone(), level);
            for (y, x) in rows
                .clone()
                .flat_map(|y| (0..SIZE_PX[0]).map(move |x| (y, x)))
            {
                let Some([u, v, _, q]) = trace(&set, &camera, [x, y]) else {
                    panic!("in front of the camera")
                };
                let inside = u.min(22.0 - u).min(v).min(18.0 - v);
                let row = (y - rows.start) as usize;
                let (colors, depths) = layer.visible_row(row);
                let color = colors[x as usize];
                let depth = depths[x as usize];
                let rim = layer.rims().iter().find(|rim| rim.pixel == [x, row as u32]);
                let centre = [x, y].map(|c| c as f32 + 0.5);
                assert_eq!(
                    layer.hides(centre, depth / 1.02),
                    depth > 0.0,
                    "1 % is tolerated"
                );
                if inside < -0.01 {
                    assert!(
                        color == [0; 4] && depth == NOWHERE && rim.is_none(),
                        "{x}, {y}: not empty"
                    );
                    counts[0] += 1;
                    continue;
                }
                if inside < 0.01 {
                    continue;
                }
                let expected = interpolate(&set, u, v);
                let near =
                    |actual: u8, expected: f64| (f64::from(actual) - expected).abs() <= LEVELS;
                let near_q = |actual: f32| (f64::from(actual) / q - 1.0).abs() < 1e-4;
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
                                && rim.color[3] >= 2
                                && near_q(rim.inverse_depth)
                        );
                        // Division by alpha amplifies rounding.
                        let scale = 255.0 / expected[3];
                        let is_near = |c: usize| {
                            (f64::from(rim.color[c]) - expected[c] * scale).abs()
                                <= LEVELS * 2.0 * scale
                        };
                        assert!((0..3).all(is_near), "{x}, {y}: {rim:?} {expected:?}");
                        counts[2] += 1;
                    }
                    _ => assert!(
                        color == [0; 4] && rim.is_none() && expected[3] < 2.0 + LEVELS,
                        "{x}, {y}: {expected:?}"
                    ),
                }
            }
        }
    }
    assert!(counts.iter().all(|count| *count > 300), "{counts:?}");
}

#[test]
fn nearer_texture_hides_farther_one_and_its_rims() {
    let mut set = texture(false);
    let behind = texture(true);
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
        [&set, &texture(false)].map(|set| draw_layer(set, &camera, None, 0..44, Level::new()));
    for (row, (both_row, alone_row)) in both.visible_rows().zip(alone.visible_rows()).enumerate() {
        for (x, ((both_color, color), depth)) in both_row
            .0
            .iter()
            .zip(alone_row.0)
            .zip(alone_row.1)
            .enumerate()
        {
            assert!(color[3] == 0 || both_color == color);
            let mut pixel_rims = both
                .rims()
                .iter()
                .filter(|rim| rim.pixel == [x as u32, row as u32]);
            assert!(pixel_rims.all(|rim| rim.inverse_depth > *depth));
        }
    }
    assert!(
        both.rims().iter().any(|rim| rim.pixel[0] > 0),
        "part of the farther texture is visible"
    );
}

#[test]
fn inserted_content_hides_planes_or_is_rim() {
    let set = texture(false);
    let camera = camera(&mut Rng::keyed(9));
    let planes_alone = draw_layer(&set, &camera, None, 5..40, Level::new());
    // Half of the content is in front of the plane, half behind it; a third is opaque; three
    // columns lie outside the frame and two rows outside the band.
    let window = [50..63, 3..30];
    let colors: Vec<[u8; 4]> = (0..13 * 27)
        .map(|i| [i as u8, 1, 2, if i % 3 == 0 { 255 } else { 90 }])
        .collect();
    let inverse_depth: Vec<f32> = (0..13 * 27)
        .map(|i| if i % 2 == 0 { 9.0 } else { 0.001 })
        .collect();
    let inserted = DepthLayer {
        window,
        colors: &colors,
        inverse_depth: &inverse_depth,
    };
    let index = (20 - 3) * 13 + 55 - 50;
    assert_eq!(
        inserted.pixel(55, 20),
        (colors[index], inverse_depth[index])
    );
    assert_eq!(inserted.pixel(49, 20).1, 0.0);
    let layer = draw_layer(&set, &camera, Some(&inserted), 5..40, Level::new());
    let mut rims = 0;
    for (y, x) in (5..40).flat_map(|y| (0..60).map(move |x| (y, x))) {
        let pixel = |layer: &PlaneLayer| {
            let (colors, depths) = layer.visible_row(y - 5);
            (colors[x], depths[x])
        };
        let plane = pixel(&planes_alone);
        let (color, inverse_depth) = inserted.pixel(x, y);
        let is_in_front = inverse_depth > plane.1.max(0.0);
        let expected = if is_in_front && color[3] == 255 {
            (color, inverse_depth)
        } else {
            plane
        };
        assert_eq!(pixel(&layer), expected, "{x}, {y}");
        let rim = Rim {
            pixel: [x as u32, y as u32 - 5],
            color,
            inverse_depth,
        };
        let is_rim = is_in_front && color[3] < 255;
        assert_eq!(layer.rims().contains(&rim), is_rim, "{x}, {y}");
        rims += usize::from(is_rim);
    }
    assert!(rims > 50 && layer.rims().len() == rims);
    let (colors, _) = layer.eight_pixels(2, 54).expect("drawn");
    assert_eq!(colors[..6], layer.visible_row(2).0[54..]);
}

/// Tolerated error of colours that were premultiplied by a coverage above a half and divided again,
/// levels.
const PREMULTIPLIED_LEVELS: u8 = 2;

#[test]
fn canvases_contain_background_and_its_rims() {
    let set = texture(true);
    let camera = camera(&mut Rng::keyed(9));
    let rows = 5..40;
    let mut view = PlanesInView::default();
    view.prepare(&set, &camera, camera.eye(), FACE_PX);
    let background = draw_layer(&set, &camera, None, rows.clone(), Level::new());
    let mut depth = DepthCanvas::default();
    depth.clear(60, rows.clone());
    depth.set_background(&background);
    depth.add_rims(background.rims());
    let canvases: [&mut dyn Canvas; 3] = [
        &mut OverCanvas::default(),
        &mut EllipseCanvas::default(),
        &mut SurfaceCanvas::default(),
    ];
    for (i, canvas) in canvases.into_iter().enumerate() {
        canvas.clear(60, rows.clone(), TOLERANCE);
        canvas
            .background_mut()
            .draw(&set, &view, None, (rows.clone(), 0), 0.01, Level::new());
        canvas.set_background();
        canvas.add_rims(Level::new());
        canvas.flush(Level::new());
        for row in 0..rows.len() {
            let mut colors = [[0; 4]; 60];
            let mut depths_m = [0.0; 60];
            let mut inverse_depths = [9.0; 60];
            canvas.read_depths(row, 0, &mut inverse_depths);
            canvas.resolve(row, 0, &mut colors, Level::new());
            depth.resolve(row, 0, &mut depths_m);
            for (x, (resolved, depth_m)) in colors.into_iter().zip(depths_m).enumerate() {
                let rim = background
                    .rims()
                    .iter()
                    .find(|rim| rim.pixel == [x as u32, row as u32]);
                let (row_colors, row_depths) = background.visible_row(row);
                let opaque = (row_colors[x], row_depths[x].max(0.0));
                let (color, q) = rim.map_or(opaque, |rim| (rim.color, rim.inverse_depth));
                assert_eq!(depth_m, 1.0 / q, "{x}, {row}");
                assert!(
                    i == 0 || inverse_depths[x] == q,
                    "{x}, {row}: only the canvas of *over* has no depths"
                );
                // Opaque are 92 % for the canvas of ellipses and 120 of 128 steps for that of
                // surfaces; both cover the share of the alpha up to 3/4.
                let covered_share = |opaque: f32| {
                    let alpha = f32::from(color[3]) / 255.0;
                    let ramp = 1.0 - (opaque - alpha) * 0.25 / (opaque - 0.75);
                    (alpha.max(ramp).min(1.0) * 255.0) as u8
                };
                let share = [color[3], covered_share(0.92), covered_share(120.0 / 128.0)][i];
                let tolerance = [1, 1, 2][i].max(if color[3] >= 252 { 3 } else { 0 });
                assert!(
                    resolved[3].abs_diff(share) <= tolerance,
                    "{resolved:?} {color:?}"
                );
                let near = |c: usize| resolved[c].abs_diff(color[c]) <= PREMULTIPLIED_LEVELS;
                assert!(color[3] < 128 || (0..3).all(near), "{resolved:?} {color:?}");
            }
        }
    }
}

#[test]
fn rims_are_composited_in_linear_light() {
    let rim = Rim {
        pixel: [7, 2],
        color: [200, 100, 50, 102],
        inverse_depth: 0.5,
    };
    let mut canvas = OverCanvas::default();
    canvas.clear(20, 4..9, TOLERANCE);
    let mut splats = Splats::new();
    splats.len = 1;
    splats.x[0] = 7.5;
    splats.y[0] = 6.5;
    splats.radius_x[0] = 0.5;
    splats.radius_y[0] = 0.5;
    splats.color[0] = u32::from_ne_bytes([20, 40, 60, 255]);
    canvas.draw(&splats, Level::new());
    canvas.background_mut().push_rim(rim);
    canvas.add_rims(Level::new());
    let mut colors = [[0; 4]; 20];
    canvas.resolve(2, 0, &mut colors, Level::new());
    assert_eq!(
        colors[7],
        LinearLight::tables().over(rim.color, [20, 40, 60, 255])
    );
    assert!((0..20).all(|x| x == 7 || colors[x] == [0; 4]));
}

/// Draws two rims in one pixel; the coverage of the result shows if they are one surface.
fn draw_rims(canvas: &mut dyn Canvas, [near, far]: [f32; 2], pixel: [u32; 2]) -> [u8; 4] {
    canvas.clear(20, 4..44, TOLERANCE);
    for inverse_depth in [near, far] {
        canvas.background_mut().push_rim(Rim {
            pixel,
            color: [200, 100, 50, 102],
            inverse_depth,
        });
    }
    canvas.add_rims(Level::new());
    canvas.flush(Level::new());
    let [column, row] = pixel.map(|c| c as usize);
    let mut inverse_depths = [9.0; 20];
    canvas.read_depths(row, 0, &mut inverse_depths);
    let mut expected = [0.0; 20];
    expected[column] = near.max(0.0);
    assert_eq!(inverse_depths, expected);
    let mut colors = [[0; 4]; 20];
    canvas.resolve(row, 0, &mut colors, Level::new());
    assert!((0..20).all(|x| (x == column) == (colors[x] != [0; 4])));
    canvas.background_mut().clear();
    colors[column]
}

#[test]
fn rims_within_tolerance_are_one_surface() {
    let mut surfaces = SurfaceCanvas::default();
    let mut ellipses = EllipseCanvas::default();
    for pixel in [[0, 0], [9, 31], [19, 33], [2, 39]] {
        // Infinitely far content may round below 0.
        for depths in [[0.5, 0.499], [-1e-9, -1e-9]] {
            assert_eq!(
                draw_rims(&mut surfaces, depths, pixel)[3],
                207,
                "102 of 255 in 128 steps, twice: 102, and 6/24 of the way from 96 to 120"
            );
            assert_eq!(
                draw_rims(&mut ellipses, depths, pixel)[3],
                210,
                "0.8, and 5/17 of the way from 0.75 to 0.92"
            );
        }
    }
    // 1 % of 0.5 is 0.005; 1 % of 0.05 is less than a bin of 0.001.
    for (depths, share) in [
        ([0.504, 0.5], 210),
        ([0.506, 0.5], 204),
        ([0.0508, 0.05], 210),
        ([0.0512, 0.05], 204),
    ] {
        assert_eq!(
            draw_rims(&mut ellipses, depths, [3, 3])[3],
            share,
            "{depths:?}"
        );
    }
}

/// A camera at the centre whose pixels are those of the face.
#[test]
fn texture_is_drawn_to_its_last_texel() {
    let mut set = one_texture(Face::NegZ.normal() * 0.5, Face::NegZ, [20, 22], [23, 19]);
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
        let layer = draw_layer(&set, &camera, None, 0..FACE_PX, level);
        for (y, x) in (0..19).flat_map(|y| (0..23).map(move |x| (y, x))) {
            assert_eq!(
                layer.visible_row(22 + y).0[20 + x],
                set.texels[y * 23 + x],
                "{x}, {y}"
            );
        }
    }
}

#[test]
fn splats_behind_planes_are_culled() {
    let set = texture(false);
    let camera = camera(&mut Rng::keyed(9));
    let layer = draw_layer(&set, &camera, None, 0..44, Level::new());
    let plane = layer.visible_row(22).1[30];
    assert!(plane > 0.0);
    // Nearer, within the tolerance, beyond it, far behind; above and left of the frame; beside the
    // texture.
    let positions = [
        (30.5, 22.5, plane * 1.2),
        (30.5, 22.5, plane / 1.009),
        (30.5, 22.5, plane / 1.011),
        (30.5, 22.5, plane * 0.5),
        (-0.5, 22.5, 1e-3),
        (30.5, -0.5, 1e-3),
        (1.5, 1.5, 1e-3),
    ];
    let mut splats = Splats::new();
    splats.len = positions.len();
    for (i, (x, y, inverse_depth)) in positions.into_iter().enumerate() {
        splats.x[i] = x;
        splats.y[i] = y;
        splats.inverse_depth[i] = inverse_depth;
        splats.color[i] = i as u32;
    }
    splats.cull_hidden(&layer);
    let is_open = |x: usize, y: usize| layer.visible_row(y).1[x] < 0.0;
    assert!(
        is_open(0, 22) && is_open(30, 0) && is_open(1, 1),
        "the texture does not reach the frame's border"
    );
    assert_eq!(splats.color[..splats.len], [0, 1, 4, 5, 6]);
    assert_eq!(splats.inverse_depth[1], plane / 1.009);
    splats.cull_hidden(&PlaneLayer::default());
    assert_eq!(splats.len, 5, "without planes none is culled");
    assert_eq!(
        SplatKernel::Ellipse.core_fraction(),
        0.4,
        "half a spacing of 1.25"
    );
}
