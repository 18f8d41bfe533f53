//! Batches of both forms, at every SIMD level, against the transfer in f64.

use super::*;
use headbox_core::random::Rng;
use headbox_core::cube_face::Face;
use headbox_core::camera::Camera;
use headbox_core::simd;
use crate::pack::tests::scattered;
use crate::pack::{ExactCube, ExactDepthPixel, PackedDepthPixel, SplatIndexLayout, Split};
use crate::render::footprint::size::{FootprintLanes, Normals};
use glam::DVec3;

/// Pixels by which f32 may err (as in `transfer`), and splats that near to a border may show or not.
const F32_PX: f64 = 2e-3;

/// Footprints that tell where on the face their samples lie.
struct ByPlace {
    radius_px: f32,
}

impl Size for ByPlace {
    const MAX_RADIUS_PX: f32 = 4.0;

    fn largest_radius_px(&self, _: &Transfer, _: f64, _: f64, _: [u32; 2]) -> f64 {
        4.0
    }

    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, lanes: &Lanes<S>) -> FootprintLanes<S> {
        FootprintLanes {
            radius_x: lanes.x * (0.01 * self.radius_px),
            radius_y: f32x16::splat(simd, lanes.y * (0.03 * self.radius_px)),
            weight: lanes.inverse_depth,
            correlation: f32x16::splat(simd, 0.0),
        }
    }
}

/// x, y, 1 / eye depth, horizontal radius, inverse depth on the face, colour.
type Shown = ([f64; 5], u32);

/// A batch of some samples of a row; the pixels of a block of columns from 64 on.
fn batch<P: Format>(depth_pixels: &[P], columns: impl Fn(usize) -> u8) -> Box<Batch<P>> {
    let mut batch = Box::new(Batch::new());
    (batch.row, batch.anchor_column, batch.len) = (31, 64, depth_pixels.len());
    batch.depth_pixels[..depth_pixels.len()].copy_from_slice(depth_pixels);
    (0..depth_pixels.len()).for_each(|i| batch.columns[i] = columns(i));
    batch
}

#[test]
fn splats_lie_where_the_transfer_says_and_all_of_those_that_touch_the_band_are_kept() {
    let exact = ExactCube::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs");
    let i = exact.cube.segments.iter().position(|segment| segment.face == Face::PosZ).expect("one");
    let (segment, exact) = (&exact.cube.segments[i], &exact.depth_pixels[i]);
    let (mut random, mut kept, mut dropped) = (Rng::keyed(6), 0, 0);
    for length in [1, 15, 16, 17, 50, 49, 48] {
        for (class, radius_px) in [0.5f32, 1.1, 2.2, 3.3].into_iter().enumerate() {
            // Before the frame's left border, within, and before its right border.
            let middle = [3.0, 43.0, 77.0][(class + length) % 3];
            let columns = |i: usize| (i * 5 % 26) as u8;
            // Eyes before and behind the samples.
            let eye = random.in_cube(2.0);
            let ahead = Face::PosZ.direction(75.0, 31.5, 170) - eye * 0.5;
            let camera = Camera::look_at(eye, eye + ahead, DVec3::Y, 30.0, [80, 60]).expect("valid");
            let camera = camera.with_principal_px([middle, 26.0]);
            let band = Band { width: 80, height: 60, principal_px: camera.principal_px(), rows: 11..47 };
            let transfer = Transfer::new(&camera, eye, Face::PosZ, 170);
            let (size, radius_y) = (ByPlace { radius_px }, 31.5 * 0.03 * f64::from(radius_px));
            let (packed, exact) = (&segment.depth_pixels[7..7 + length], &exact[7..7 + length]);
            // Where each lies, and by how far its footprint reaches into the band and it lies before the eye.
            let place = |i: usize, q: f64| {
                let column = 64.5 + f64::from(columns(i));
                let h = transfer.at(column, 31.5) + transfer.inverse_depth * q;
                let (x, y, radius_x) = (h.x / h.z + middle, h.y / h.z + 26.0, column * 0.01 * f64::from(radius_px));
                let inside = [x + radius_x, 80.0 - x + radius_x, y + radius_y - 11.0, 47.0 - y + radius_y];
                let inside = inside.into_iter().fold(f64::INFINITY, f64::min);
                ([x, y, q / h.z, radius_x, q], if h.z >= f64::from(W_NEAR) { inside } else { -1.0 })
            };
            let is_sure = |i: usize, q: f64| place(i, q).1.abs() > F32_PX;
            let packed_q = |i: usize| segment.inverse_depth(packed[i].inverse_depth_code());
            let exact_q = |i: usize| f64::from(exact[i].inverse_depth);
            if !(0..length).all(|i| is_sure(i, packed_q(i)) && is_sure(i, exact_q(i))) {
                continue;
            }
            let shown = |q: &dyn Fn(usize) -> f64| -> Vec<Shown> {
                let all = (0..length).map(|i| (place(i, q(i)), u32::from_ne_bytes(exact[i].color_srgb)));
                all.filter(|((_, inside), _)| *inside > 0.0).map(|((of_splat, _), color)| (of_splat, color)).collect()
            };
            let (of_packed, of_exact) = (shown(&packed_q), shown(&exact_q));
            (kept, dropped) = (kept + of_exact.len(), dropped + length - of_exact.len());
            for level in simd::levels() {
                let mut splats = Box::new(Splats::new());
                let check = |splats: &Splats, expected: &[Shown]| {
                    assert_eq!(splats.len, expected.len());
                    let of_class = |other| if class == other { expected.len() as u64 } else { 0 };
                    assert_eq!(splats.by_footprint, [0, 1, 2, 3].map(of_class));
                    for (i, ([x, y, q, radius_x, q_face], color)) in expected.iter().enumerate() {
                        let near = |found: f32, exact: f64, within: f64| (f64::from(found) - exact).abs() <= within;
                        assert!(near(splats.x[i], *x, F32_PX) && near(splats.y[i], *y, F32_PX));
                        assert!(near(splats.inverse_depth[i], *q, q * 1e-4), "{q}");
                        assert!(near(splats.radius_x[i], *radius_x, 1e-5) && near(splats.radius_y[i], radius_y, 1e-5));
                        assert!(near(splats.weight[i], *q_face, 1e-6) && splats.color[i] == *color);
                    }
                };
                SegmentWarp::new(&transfer, PackedDepthPixel::scale(segment), &band, level).warp(
                    &batch(packed, columns),
                    &size,
                    &mut splats,
                );
                check(&splats, &of_packed);
                SegmentWarp::new(&transfer, ExactDepthPixel::scale(segment), &band, level).warp(
                    &batch(exact, columns),
                    &size,
                    &mut splats,
                );
                check(&splats, &of_exact);
            }
        }
    }
    assert!(kept > 50 && dropped > 50, "{kept} {dropped}");
}

#[test]
fn packed_depth_pixels_have_the_normals_of_their_indices() {
    let geometry = |i: u32| ((i * 331 % 2048) << 20) | (i * 65_537 % (1 << 20));
    let pixels: Vec<_> = (0..16).map(|i| PackedDepthPixel { geometry: geometry(i), color_srgb: [7; 4] }).collect();
    for level in simd::levels() {
        dispatch!(level, simd => {
            let Unpacked { code, normals: Normals::Index(indices), .. } = PackedDepthPixel::load(simd, &pixels) else {
                panic!("indices")
            };
            let found = code.to_array().into_iter().zip(indices.to_array());
            let expected = pixels.iter().map(|p| (p.inverse_depth_code() as f32, p.splat_index()));
            assert!(found.eq(expected));
        });
    }
}
