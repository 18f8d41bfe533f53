//! Round trips through packing: small cubes, sample by sample.

mod files;
mod invalid;
mod split;

use super::blocks::{BLOCK_COLUMNS, BLOCK_ROWS, BlockIndex};
use super::{
    CubeLdi, PackedDepthPixel, Plane, PlaneSet, PlaneTile, SegmentSide, SplatIndexLayout, Split,
    UnquantisedCube,
};
use crate::model::info::CaptureInfo;
use crate::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_core::random::Rng;
use std::collections::HashMap;

/// Creates a cube about the origin; `samples` returns those of a pixel of a face, farthest first.
pub(crate) fn ldi(
    face_px: u32,
    samples: impl Fn(Face, u32, u32) -> Vec<DepthPixel>,
) -> CubeSamples {
    let faces = Face::ALL.map(|face| {
        let mut ldi = LayeredDepthImage::empty(face, face_px);
        for i in 0..face_px * face_px {
            ldi.samples.extend(samples(face, i % face_px, i / face_px));
            ldi.offsets[i as usize + 1] = ldi.samples.len() as u32;
        }
        ldi
    });
    let info = CaptureInfo {
        half_size_m: 0.5,
        exposure: 1.0,
        ..CaptureInfo::default()
    };
    CubeSamples {
        info,
        faces: faces.to_vec(),
        environment: Environment::default(),
    }
}

/// Creates a sample that roughly faces the centre.
pub(crate) fn sample(random: &mut Rng, face: Face, inverse_depth: f64) -> DepthPixel {
    let normal = (random.in_cube(0.5) - face.normal()).normalize().as_vec3();
    let color_srgb = [0; 4].map(|_: u8| random.below(256) as u8);
    DepthPixel {
        inverse_depth: inverse_depth as f32,
        normal: EncodedNormal::new(normal),
        color_srgb,
    }
}

/// Creates a cube with up to eleven samples in each pixel of the rectangle from (70, 20) to (150,
/// 50) of faces of 170 pixels, which touches neither the first column nor the first row of blocks.
pub(crate) fn scattered() -> CubeSamples {
    ldi(170, |face, x, y| {
        let mut random = Rng::keyed(u64::from(x) << 32 | u64::from(y) << 8 | face.index() as u64);
        if !(70..=150).contains(&x) || !(20..=50).contains(&y) {
            return Vec::new();
        }
        let mut inverse_depths: Vec<f64> = (0..random.below(12))
            .map(|_| random.between(0.1, 1.9))
            .collect();
        inverse_depths.sort_by(f64::total_cmp);
        inverse_depths
            .into_iter()
            .map(|q| sample(&mut random, face, q))
            .collect()
    })
}

const LAYOUTS: [SplatIndexLayout; 2] = [SplatIndexLayout::Normal, SplatIndexLayout::Paper];

/// Half a code of the range 0.1..1.9, and the rounding of f32.
const HALF_CODE: f64 = 0.5 * 1.8 / ((1 << 20) - 1) as f64 + 2e-7;

/// Half the diagonal of a cell, as in `splat_index`, of rings on the front and of the paper's code;
/// plus the ring by which normals of surfaces seen edge-on are moved.
const NORMAL_DEG: [f32; 2] = [2.9 + 3.6, 30.0];

#[test]
fn packing_round_trips_samples() {
    let ldi = scattered();
    for (layout, normal_deg) in LAYOUTS.into_iter().zip(NORMAL_DEG) {
        for (split, segments) in [(Split::None, 6), (Split::AtDepth(1.25), 12)] {
            let cube = CubeLdi::pack(&ldi, layout, split).expect("packs");
            cube.validate().expect("valid");
            assert_eq!(cube.segments.len(), segments);
            for (face, back) in ldi.faces.iter().zip(cube.unpack().faces) {
                assert_eq!(face.offsets, back.offsets);
                for (sample, back) in face.samples.iter().zip(&back.samples) {
                    assert!(
                        f64::from(sample.inverse_depth - back.inverse_depth).abs() <= HALF_CODE
                    );
                    let error_deg = sample
                        .normal
                        .decode()
                        .angle_between(back.normal.decode())
                        .to_degrees();
                    assert!(error_deg < normal_deg, "{layout:?} {error_deg}");
                    assert_eq!(sample.color_srgb, back.color_srgb);
                }
            }
            for segment in &cube.segments {
                let far = segment.side == SegmentSide::Far;
                // The paper's codes of depth err by half a step of a 32nd of the range, in the
                // logarithm.
                let range = segment.depth_code_range();
                let half_step =
                    (range.farthest_m / range.nearest_m).powf(0.5 / 32.0) * (1.0 + 1e-6);
                let depth = |index: u32| range.decode(index as usize % 32);
                assert!(
                    layout == SplatIndexLayout::Normal
                        || segment.depth_pixels.iter().all(|pixel| {
                            let ratio = depth(pixel.splat_index())
                                * segment.inverse_depth(pixel.inverse_depth_code());
                            ratio <= half_step && ratio >= 1.0 / half_step
                        })
                );
                assert!(
                    (segment.inverse_depth_min < 0.8) == (far || segments == 6),
                    "cut at 1/1.25"
                );
                assert_eq!(far, segment.inverse_depth_max < 0.8);
            }
        }
    }
}

#[test]
fn exact_samples_keep_positions() {
    for layout in LAYOUTS {
        let ldi = scattered();
        let exact = UnquantisedCube::pack(&ldi, layout, Split::AtDepth(1.25)).expect("packs");
        for (segment, exact) in exact.cube.segments.iter().zip(&exact.depth_pixels) {
            assert_eq!(exact.len(), segment.depth_pixels.len());
            for (a, b) in exact.iter().zip(&segment.depth_pixels) {
                let inverse_depth = segment.inverse_depth(b.inverse_depth_code()) as f32;
                assert!(f64::from(a.inverse_depth - inverse_depth).abs() <= HALF_CODE);
                assert_eq!(
                    (a.color_srgb, a.splat_index),
                    (b.color_srgb, b.splat_index())
                );
                let normal = layout.normal(b.splat_index()).to_array();
                let cosine: f32 = a.normal.iter().zip(normal).map(|(a, b)| a * b).sum();
                assert!(cosine > NORMAL_DEG[1].to_radians().cos(), "{cosine}");
            }
        }
        assert_eq!(
            exact.depth_pixel_bytes(),
            24 * exact.cube.depth_pixel_count()
        );
    }
}

#[test]
fn blocks_bound_their_depth_codes() {
    // Across two borders of blocks in each direction; every third pixel holds a sample, every ninth
    // two.
    let ([x0, y0], [width, height]) = ([70, 23], [130, 36]);
    let code = |x: u32, y: u32, i: u32| (x * 7919 + y * 104_729 + i * 13) % 1_000_000;
    let count = |x: u32, y: u32| {
        u32::from((x + y).is_multiple_of(3)) + u32::from((x + y).is_multiple_of(9))
    };
    let rows: Vec<(Vec<PackedDepthPixel>, Vec<u32>)> = (y0..y0 + height)
        .map(|y| {
            let (mut samples, mut counts) = (Vec::new(), vec![0]);
            for x in x0..x0 + width {
                let pixel = |i| PackedDepthPixel {
                    geometry: code(x, y, i),
                    color_srgb: [0; 4],
                };
                samples.extend((0..count(x, y)).map(pixel));
                counts.push(samples.len() as u32);
            }
            (samples, counts)
        })
        .collect();
    let index = BlockIndex::new([x0, y0], [width, height], |y| {
        let (samples, counts) = &rows[y as usize];
        (samples, counts)
    });
    let mut expected: HashMap<[u32; 2], [u32; 2]> = HashMap::new();
    for (x, y) in (y0..y0 + height).flat_map(|y| (x0..x0 + width).map(move |x| (x, y))) {
        for code in (0..count(x, y)).map(|i| code(x, y, i)) {
            let codes = expected
                .entry([x / BLOCK_COLUMNS, y / BLOCK_ROWS])
                .or_insert([code; 2]);
            *codes = [codes[0].min(code), codes[1].max(code)];
        }
    }
    assert_eq!(expected.len(), 3 * 3);
    for ([column, row], codes) in expected {
        assert_eq!(
            index.codes(column, row),
            Some(codes),
            "block {column}, {row}"
        );
    }
    let empty = BlockIndex::new([0, 0], [1, 1], |_| (&[], &[0, 0]));
    assert_eq!(empty.codes(0, 0), None, "nothing there");
    assert_eq!(
        empty.codes(0, 9),
        Some([0, super::INVERSE_DEPTH_CODE_MAX]),
        "nothing known"
    );
}

/// A tile of six texels.
const TILE: PlaneTile = PlaneTile {
    opaque: 0,
    face: 0,
    plane: 0,
    first_texel: 0,
    x0: 1,
    y0: 2,
    width: 2,
    height: 3,
};

fn plane_set(tiles: Vec<PlaneTile>, texels: Vec<[u8; 4]>) -> PlaneSet {
    PlaneSet {
        error_px: 1.0,
        planes: vec![Plane::default()],
        tiles,
        texels,
        ..PlaneSet::default()
    }
}

#[test]
fn texels_are_premultiplied_and_rounded() {
    for alpha in 0..=255 {
        for c in 0..=255 {
            let exact = (f64::from(c) * f64::from(alpha) / 255.0).round() as u8;
            assert_eq!(
                PlaneSet::covered([c, 0, 255, alpha]),
                [exact, 0, alpha, alpha]
            );
        }
    }
}

/// Few pixels, so that half a pixel is an angle of seven degrees.
#[test]
fn front_facing_normal_stays_front_facing() {
    let (mut random, mut grazing) = (Rng::keyed(2), 0);
    let mut ldi = ldi(8, |face, _, _| vec![sample(&mut Rng::keyed(1), face, 0.5)]);
    for face in &mut ldi.faces {
        for (i, sample) in (0..).zip(&mut face.samples) {
            let toward = face
                .face
                .direction(f64::from(i % 8) + 0.5, f64::from(i / 8) + 0.5, 8)
                .normalize();
            let across = toward.cross(random.in_cube(1.0)).normalize();
            sample.normal =
                EncodedNormal::new((across - toward * random.between(0.001, 0.05)).as_vec3());
        }
    }
    let unpacked = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::None)
        .expect("packs")
        .unpack();
    for (face, back) in ldi.faces.iter().zip(unpacked.faces) {
        for (i, (sample, back)) in (0..).zip(face.samples.iter().zip(back.samples)) {
            let toward = face
                .face
                .direction(f64::from(i % 8) + 0.5, f64::from(i / 8) + 0.5, 8)
                .normalize();
            // Beyond 95 degrees from the face's middle codes lie too far apart.
            let normal = sample.normal.decode().as_dvec3();
            if normal.dot(toward) < 0.0 && normal.dot(-face.face.normal()) > -0.08 {
                grazing += 1;
                assert!(
                    back.normal.decode().as_dvec3().dot(toward) < 1e-4,
                    "{normal} {toward}"
                );
            }
        }
    }
    assert!(grazing > 100, "{grazing}");
}
