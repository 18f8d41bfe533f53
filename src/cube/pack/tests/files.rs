//! Round trips of packed cubes through files.

use super::super::file::CUBE_LDI;
use super::super::{CubeLdi, PackedSegment, Plane, PlaneSet, PlaneTile, SplatIndexLayout, Split};
use super::{TILE, ldi, plane_set, sample, scattered};
use crate::model::validate::MAX_FACE_SIZE_PX;
use crate::pack::runs;
use headbox_core::container::{Container, ContainerWriter, Section};
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;
use headbox_core::random::Rng;

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
        let written = std::fs::metadata(&path).expect("written").len();
        assert_eq!(cube.file_bytes().expect("encoded"), written);
    }
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
