//! Round trips through packing: small cubes, sample by sample.

use super::blocks::{BLOCK_COLUMNS, BLOCK_ROWS, BlockIndex};
use super::file::CUBE_LDI;
use super::validate::{PackedError, SegmentProblem};
use super::{
    CubeLdi, PackedDepthPixel, PackedSegment, Plane, PlaneSet, PlaneTile, SegmentSide,
    SplatIndexLayout, Split, UnquantisedCube,
};
use crate::model::info::CaptureInfo;
use crate::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
use crate::model::validate::MAX_FACE_SIZE_PX;
use crate::pack::runs;
use headbox_core::container::{Container, ContainerWriter, Section};
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

/// Cost that [`Split::Auto`] minimises, for a cut after some of 64 bins of inverse depth.
fn expected_touches(inverse_depths: &[f64], cut: f64, half_size: f64) -> f64 {
    let range = |samples: &[f64]| {
        let extreme =
            |pick: fn(f64, f64) -> f64| samples.iter().copied().reduce(pick).unwrap_or(0.0);
        extreme(f64::max) - extreme(f64::min)
    };
    let touches = |samples: Vec<f64>, dq: f64| {
        samples.len() as f64 * (1.15 + 0.5 * half_size * dq).powi(2).min(4.0)
    };
    let (far, near) = inverse_depths.iter().partition(|q| **q < cut);
    let least = inverse_depths.iter().copied().fold(f64::INFINITY, f64::min);
    let all = range(inverse_depths);
    touches(far, cut - least) + touches(near, least + all - cut)
}

#[test]
fn automatic_split_minimises_cost() {
    // A far cloud and fewer near samples, in one row; the headbox is so large that ranges matter.
    for far in [300, 150, 20] {
        let mut random = Rng::keyed(far);
        let mut inverse_depths: Vec<f64> = (0..far).map(|_| random.between(0.2, 0.5)).collect();
        inverse_depths.extend((far..400).map(|_| random.between(0.9, 2.6)));
        inverse_depths
            .iter_mut()
            .for_each(|q| *q = f64::from(*q as f32));
        let mut cube = ldi(20, |face, x, y| match face {
            Face::PosX => vec![sample(
                &mut Rng::keyed(1),
                face,
                inverse_depths[(y * 20 + x) as usize],
            )],
            _ => Vec::new(),
        });
        cube.info.half_size_m = 1.2;
        let packed = CubeLdi::pack(&cube, SplatIndexLayout::Normal, Split::Auto).expect("packs");
        let [far, near] = &packed.segments[..] else {
            panic!("a cut")
        };
        // Any cut between the two segments keeps the same samples.
        let [least, most] = [0.2, 2.6].map(|bound| {
            inverse_depths
                .iter()
                .copied()
                .min_by(|a, b| (a - bound).abs().total_cmp(&(b - bound).abs()))
                .expect("some")
        });
        let cuts = (1..64).map(|i| least + (most - least) * f64::from(i) / 64.0);
        let cost = |cut: f64| expected_touches(&inverse_depths, cut, 1.2);
        let best = cuts
            .clone()
            .min_by(|a, b| cost(*a).total_cmp(&cost(*b)))
            .expect("some");
        assert!(
            f64::from(far.inverse_depth_max) < best && best <= f64::from(near.inverse_depth_min),
            "{best}"
        );
    }
}

#[test]
fn split_that_saves_little_is_omitted() {
    let flat = ldi(20, |face, x, _| match face {
        Face::PosX => vec![sample(&mut Rng::keyed(1), face, 0.5 + 0.01 * f64::from(x))],
        _ => Vec::new(),
    });
    assert_eq!(
        CubeLdi::pack(&flat, SplatIndexLayout::Normal, Split::Auto)
            .expect("packs")
            .segments
            .len(),
        1
    );
}

#[test]
fn counts_are_run_length_encoded() {
    // Two rows of pixels that hold 1, 0, 2 and 0, 200, 0 samples, then a row of 131 empty ones.
    let segment = PackedSegment {
        width: 3,
        height: 2,
        row_counts: vec![0, 1, 1, 3, 0, 0, 200, 200],
        ..CubeLdi::pack(&scattered(), SplatIndexLayout::Normal, Split::None)
            .expect("packs")
            .segments
            .remove(0)
    };
    assert_eq!(
        runs::encode(&segment),
        [12, 0, 0, 0, 1, 0, 0, 2, 0, 0, 200, 1, 0, 0, 0, 0]
    );
    let empty = PackedSegment {
        width: 131,
        height: 1,
        row_counts: vec![0; 132],
        ..segment
    };
    assert_eq!(runs::encode(&empty), [4, 0, 0, 0, 0, 130, 1, 0]);
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
fn files_round_trip() {
    let folder = tempfile::tempdir().expect("a folder");
    // Pixels with more than 127 samples, and more than 127 empty ones on end.
    let many = ldi(150, |face, x, y| match (face, x, y) {
        (Face::NegY, 7, 2) => (0..300)
            .map(|i| sample(&mut Rng::keyed(i), face, 0.2 + i as f64 * 1e-3))
            .collect(),
        (Face::NegY, 149, 3) => vec![sample(&mut Rng::keyed(1), face, 0.4); 128],
        (Face::NegY, 0, 5) => vec![sample(&mut Rng::keyed(2), face, 0.4)],
        _ => Vec::new(),
    });
    for ldi in [scattered(), many] {
        let mut cube =
            CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::AtDepth(1.25)).expect("packs");
        let path = folder.path().join("cube.ldi");
        cube.write(&path).expect("written");
        assert_eq!(CubeLdi::read(&path).expect("read"), cube);
        // With plane textures, counts are run-length encoded. One tile is opaque, the other has
        // alpha.
        let tiles = [(1, 0), (0, 6)].map(|(opaque, first_texel)| PlaneTile {
            opaque,
            first_texel,
            ..TILE
        });
        let texels = (0..12)
            .map(|i| PlaneSet::covered([200, 100, i, if i < 6 { 255 } else { i * 20 }]))
            .collect();
        cube.planes = plane_set(tiles.to_vec(), texels);
        cube.write(&path).expect("written");
        assert_eq!(CubeLdi::read(&path).expect("read"), cube);
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

#[test]
fn invalid_plane_textures_are_rejected() {
    let tile = PlaneTile {
        face: 5,
        x0: -1,
        y0: -1,
        ..TILE
    };
    let mut valid = CubeLdi::pack(
        &ldi(8, |_, _, _| Vec::new()),
        SplatIndexLayout::Normal,
        Split::None,
    )
    .expect("packs");
    // One of six texels is transparent.
    let mut texels = vec![[255; 4]; 6];
    texels[5] = [0; 4];
    valid.planes = plane_set(vec![tile], texels);
    let check = |is_valid: bool, change: &dyn Fn(&mut PlaneSet)| {
        let mut cube = valid.clone();
        change(&mut cube.planes);
        assert_eq!(cube.validate().is_ok(), is_valid, "{:?}", cube.planes);
    };
    let check_tile = |is_valid, change: &dyn Fn(&mut PlaneTile)| {
        check(is_valid, &|set| change(&mut set.tiles[0]));
    };
    // From one pixel outside the face to the other.
    check_tile(true, &|_| {});
    check_tile(true, &|tile| (tile.x0, tile.y0) = (7, 6));
    check_tile(false, &|tile| tile.x0 = 8);
    check_tile(false, &|tile| tile.y0 = 7);
    check_tile(false, &|tile| tile.x0 = -2);
    check_tile(false, &|tile| (tile.width, tile.height) = (1, 6));
    check_tile(false, &|tile| tile.plane = 1);
    check_tile(false, &|tile| tile.face = 6);
    check_tile(false, &|tile| tile.opaque = 2);
    check_tile(false, &|tile| tile.opaque = 1);
    check_tile(false, &|tile| tile.first_texel = 1);
    check_tile(false, &|tile| tile.height = 4);
    check_tile(false, &|tile| tile.height = 2);
    check(false, &|set| set.error_px = 0.0);
    check(false, &|set| set.error_px = -1.0);
    check(false, &|set| set.error_px = f64::INFINITY);
    check(false, &|set| set.tiles.clear());
    check(true, &|set| *set = PlaneSet::default());
}

#[test]
fn bytes_count_all_arrays() {
    let mut cube =
        CubeLdi::pack(&scattered(), SplatIndexLayout::Normal, Split::AtDepth(1.25)).expect("packs");
    cube.environment = Environment {
        size_px: 3,
        texels: vec![[9; 4]; 54],
    };
    cube.planes = PlaneSet {
        planes: vec![Plane::default(); 2],
        ..plane_set(vec![TILE], vec![[0; 4]; 6])
    };
    let plane_bytes = 2 * size_of::<Plane>() + size_of::<PlaneTile>() + 6 * 4;
    let segment_bytes = |s: &PackedSegment| {
        8 * s.depth_pixels.len() + 4 * (s.height + 1 + s.height * (s.width + 1)) as usize
    };
    assert_eq!(
        cube.bytes(),
        cube.segments.iter().map(segment_bytes).sum::<usize>() + 54 * 4 + plane_bytes
    );
}

#[test]
fn split_plane_samples_are_near() {
    let ldi = ldi(4, |face, _, _| {
        [0.5, 0.8, 1.0]
            .map(|q| sample(&mut Rng::keyed(1), face, q))
            .to_vec()
    });
    for depth in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        assert!(
            CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::AtDepth(depth)).is_err(),
            "{depth}"
        );
    }
    let cube = CubeLdi::pack(&ldi, SplatIndexLayout::Normal, Split::AtDepth(1.25)).expect("packs");
    let ranges = cube
        .segments
        .iter()
        .map(|s| [s.inverse_depth_min, s.inverse_depth_max]);
    assert!(ranges.eq([[0.5, 0.5], [0.8, 1.0]].into_iter().cycle().take(12)));
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

/// Writes bytes to a section of a file, and opens it.
fn section(bytes: Vec<u8>) -> Section {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("section");
    let mut writer = ContainerWriter::new(CUBE_LDI);
    writer.section("bytes", move || Ok(bytes));
    writer.write(&path).expect("written");
    Container::open(&path, CUBE_LDI)
        .and_then(|file| file.section("bytes"))
        .expect("read")
}

#[test]
fn arrays_round_trip() {
    let mut cube =
        CubeLdi::pack(&scattered(), SplatIndexLayout::Normal, Split::AtDepth(1.25)).expect("packs");
    cube.environment = Environment {
        size_px: 3,
        texels: (0..54).map(|i| [i, 2, 3, 255]).collect(),
    };
    let texels = (0..6)
        .map(|i| PlaneSet::covered([200, 100, i, 40 * i]))
        .collect();
    let textures = plane_set(vec![TILE], texels);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cube.ldi");
    for planes in [PlaneSet::default(), textures] {
        cube.planes = planes;
        let mut section = section(cube.arrays());
        assert_eq!(
            CubeLdi::from_arrays(cube.header(), &mut section).expect("read"),
            cube
        );
        section.end().expect("all was read");
        cube.write(&path).expect("written");
        assert_eq!(CubeLdi::read(&path).expect("read"), cube);
    }
}

#[test]
fn invalid_run_lengths_are_rejected() {
    let decoded = |width: u32, height: u32, bytes: &[u8]| {
        let length = (bytes.len() as u32).to_le_bytes();
        runs::decode(&mut section([&length, bytes].concat()), width, height).ok()
    };
    assert_eq!(decoded(3, 1, &[5, 0, 1, 0]), Some(vec![0, 5, 5, 5]));
    assert_eq!(decoded(3, 1, &[5, 0, 1]), Some(vec![0, 5, 5, 5]));
    assert_eq!(decoded(3, 1, &[5, 0, 2, 0]), None, "a pixel more");
    assert_eq!(
        decoded(3, 1, &[5, 0, 1, 0, 0, 0, 0]),
        None,
        "four bytes at the end"
    );
    assert_eq!(decoded(3, 1, &[5, 0, 1, 0, 0, 0]), Some(vec![0, 5, 5, 5]));
    assert_eq!(decoded(3, 1, &[5, 0, 1, 7]), None, "a count at the end");
    assert_eq!(decoded(3, 1, &[5, 0, 0]), None, "a pixel less");
    // The largest number of 32 bits, and one of 33.
    assert_eq!(
        decoded(1, 1, &[255, 255, 255, 255, 15]),
        Some(vec![0, u32::MAX])
    );
    assert_eq!(decoded(1, 1, &[255, 255, 255, 255, 16]), None);
    assert_eq!(
        decoded(1, 1, &[128, 128, 128, 128, 128, 1]),
        None,
        "six bytes"
    );
    // The maximum width and height of a face, and one more.
    let all_empty = |pixels: u32| {
        [
            0,
            (pixels - 1) as u8 | 128,
            ((pixels - 1) >> 7) as u8 | 128,
            ((pixels - 1) >> 14) as u8,
        ]
    };
    assert!(decoded(MAX_FACE_SIZE_PX, 1, &all_empty(MAX_FACE_SIZE_PX)).is_some());
    assert!(decoded(1, MAX_FACE_SIZE_PX, &all_empty(MAX_FACE_SIZE_PX)).is_some());
    assert!(decoded(MAX_FACE_SIZE_PX + 1, 1, &all_empty(MAX_FACE_SIZE_PX + 1)).is_none());
    assert!(decoded(1, MAX_FACE_SIZE_PX + 1, &all_empty(MAX_FACE_SIZE_PX + 1)).is_none());
}

/// Adds an empty column before a segment's first or after its last.
fn add_column(segment: &mut PackedSegment, is_first: bool) {
    let rows = segment.row_counts.chunks_exact(segment.width as usize + 1);
    let wider = |row: &[u32]| {
        if is_first {
            [&[0], row].concat()
        } else {
            [row, &row[row.len() - 1..]].concat()
        }
    };
    segment.row_counts = rows.flat_map(wider).collect();
    (segment.x0, segment.width) = (segment.x0 - u32::from(is_first), segment.width + 1);
}

/// Adds an empty row above a segment or below it.
fn add_row(segment: &mut PackedSegment, is_first: bool) {
    let (width, end) = (segment.width as usize, segment.row_offsets.len() - 1);
    let (offset, counts) = if is_first {
        (0, 0)
    } else {
        (end, segment.row_counts.len())
    };
    segment
        .row_offsets
        .insert(offset, segment.row_offsets[offset]);
    segment
        .row_counts
        .splice(counts..counts, vec![0; width + 1]);
    (segment.y0, segment.height) = (segment.y0 - u32::from(is_first), segment.height + 1);
}

#[test]
fn invalid_segments_are_rejected() {
    use SegmentProblem::{
        Bits, InverseDepthRange, LooseRectangle, Rectangle, RowCountCount, RowCounts,
        RowOffsetCount, RowOffsets, SplitPlane,
    };
    for layout in LAYOUTS {
        let valid = CubeLdi::pack(&scattered(), layout, Split::AtDepth(1.25)).expect("packs");
        let (all, width) = (
            valid.segments[0].depth_pixels.len(),
            valid.segments[0].width as usize,
        );
        let check = |expected: Option<SegmentProblem>, change: &dyn Fn(&mut PackedSegment)| {
            let mut cube = valid.clone();
            change(&mut cube.segments[0]);
            let found = match cube.validate() {
                Err(PackedError::Segment {
                    face: Face::PosX,
                    problem,
                    ..
                }) => Some(problem),
                other => other.map(|()| None).expect("a problem of the segment"),
            };
            assert_eq!(found, expected);
        };
        let max = valid.segments[0].inverse_depth_max;
        check(Some(InverseDepthRange(0.0, max)), &|s| {
            s.inverse_depth_min = 0.0;
        });
        check(Some(InverseDepthRange(-1.0, max)), &|s| {
            s.inverse_depth_min = -1.0;
        });
        check(Some(InverseDepthRange(2.0, max)), &|s| {
            s.inverse_depth_min = 2.0;
        });
        let min = valid.segments[0].inverse_depth_min;
        check(Some(InverseDepthRange(min, f32::INFINITY)), &|s| {
            s.inverse_depth_max = f32::INFINITY;
        });
        check(None, &|s| s.inverse_depth_min = s.inverse_depth_max);
        check(Some(SplitPlane), &|s| {
            s.inverse_depth_max = valid.segments[1].inverse_depth_min;
        });
        check(None, &|s| {
            s.inverse_depth_max = valid.segments[1].inverse_depth_min.next_down();
        });
        check(Some(Rectangle), &|s| s.width = 0);
        check(Some(Rectangle), &|s| s.height = 0);
        check(Some(Rectangle), &|s| s.x0 = 171 - s.width);
        check(Some(Rectangle), &|s| s.y0 = 171 - s.height);
        check(None, &|s| (s.x0, s.y0) = (170 - s.width, 170 - s.height));
        check(Some(Bits(7)), &|s| s.depth_pixels[7].geometry |= 1 << 31);
        for is_first in [true, false] {
            check(Some(LooseRectangle), &|s| add_column(s, is_first));
            check(Some(LooseRectangle), &|s| add_row(s, is_first));
        }
        let rows = valid.segments[0].height as usize;
        let offsets = RowOffsetCount {
            found: rows,
            expected: rows + 1,
        };
        check(Some(offsets), &|s| s.row_offsets.truncate(rows));
        let expected = rows * (width + 1);
        check(
            Some(RowCountCount {
                found: expected - 1,
                expected,
            }),
            &|s| s.row_counts.truncate(expected - 1),
        );
        check(Some(RowOffsets(0)), &|s| s.row_offsets[0] = 1);
        check(Some(RowOffsets(rows as u32)), &|s| {
            s.row_offsets[rows] = all as u32 + 1;
        });
        check(Some(RowCounts(0)), &|s| s.row_counts[0] = 1);
        check(Some(RowCounts(1)), &|s| s.row_counts[2 * width + 1] += 1);
        check(Some(RowCounts(1)), &|s| s.row_counts[width + 2] = u32::MAX);
        check(Some(RowCounts(1)), &|s| s.row_counts[width + 1] = 1);
    }
    let mut twice =
        CubeLdi::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs");
    twice.segments.insert(1, twice.segments[0].clone());
    assert_eq!(twice.validate(), Err(PackedError::SegmentOrder(1)));
}
