//! Invalid packed cubes, which are rejected.

use super::super::validate::{PackedError, SegmentProblem};
use super::super::{CubeLdi, PackedSegment, PlaneSet, PlaneTile, SplatIndexLayout, Split};
use super::{LAYOUTS, TILE, ldi, plane_set, scattered};
use headbox_core::cube_face::Face;

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
