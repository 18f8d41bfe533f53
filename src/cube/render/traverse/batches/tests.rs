//! Which depth pixels are passed on, whatever their order (`order.rs` tests that).

use super::*;
use headbox_core::cube_face::Face;
use crate::pack::tests::scattered;
use crate::pack::{PackedCube, PackedDepthPixel, SplatIndexLayout, Split};
use glam::DVec3;

/// Column, row and bits.
type Found = Vec<(u32, u32, u32)>;

fn traversed(part: &SegmentPart<PackedDepthPixel>, eye: DVec3, layers: LayerOrder) -> Found {
    let eye = EyeInFace::new(eye, part.segment.face, 170);
    let (mut batch, mut found) = (Batch::new(), Found::new());
    traverse(part, &Uncut, &eye, layers, &mut batch, &mut |batch| {
        assert!(batch.len > 0 && batch.len <= BATCH_CAPACITY && batch.anchor_column % BLOCK_COLUMNS == 0);
        for (column, pixel) in batch.columns.iter().zip(&batch.depth_pixels[..batch.len]) {
            assert!(u32::from(*column) < BLOCK_COLUMNS);
            found.push((batch.anchor_column + u32::from(*column), batch.row, pixel.geometry));
        }
    });
    found.sort_unstable();
    found
}

#[test]
fn all_of_the_visible_blocks_in_the_rectangle_is_passed_on_and_nothing_else() {
    let cube = PackedCube::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs");
    let segment = cube.segments.iter().find(|segment| segment.face == Face::PosY).expect("one");
    // Epipoles in the middle of the part, beside it, and none.
    let eyes = [segment.face.direction(110.3, 35.6, 170) * 0.3, DVec3::new(-0.4, 0.1, 0.3), DVec3::ZERO];
    for (i, (eye, layers)) in eyes
        .into_iter()
        .flat_map(|eye| {
            [LayerOrder::FarthestFirst, LayerOrder::NearestFirst, LayerOrder::PerPixel].map(|layers| (eye, layers))
        })
        .enumerate()
    {
        let (columns, rows) = (71 + 5 * i as u32..151 - i as u32, 21..49);
        // Two columns of blocks, and three rows: each is hidden once in a while.
        let visible: Vec<bool> = (0..2 * 3).map(|block| (block + i) % 4 > 0).collect();
        let part = SegmentPart {
            segment,
            depth_pixels: &segment.depth_pixels,
            columns: columns.clone(),
            rows: rows.clone(),
            visible: &visible,
        };
        let mut expected = Found::new();
        for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
            if visible[((y / BLOCK_ROWS - 1) * 2 + x / BLOCK_COLUMNS - 1) as usize] {
                let pixel = segment.pixel(x - segment.x0, y - segment.y0);
                expected.extend(pixel.iter().map(|pixel| (x, y, pixel.geometry)));
            }
        }
        expected.sort_unstable();
        assert!(expected.len() > 100);
        assert_eq!(traversed(&part, eye, layers), expected, "{eye} {layers:?}");
    }
}

#[test]
fn a_segment_has_as_many_blocks_as_it_touches_on_the_face() {
    let cube = PackedCube::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs");
    let segment = &cube.segments[0];
    let (x, y) = (segment.x0..segment.x0 + segment.width, segment.y0..segment.y0 + segment.height);
    assert_eq!(whole(segment, 170), [x.clone(), y.clone()]);
    assert_eq!(whole(segment, 30), [30..30, y.start..30]);
    assert_eq!((block_count(&[x, y]), block_count(&[64..65, 15..17]), block_count(&[0..0, 0..1])), (2 * 3, 2, 0));
}
