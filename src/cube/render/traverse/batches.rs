//! Traversal of a segment: its depth pixels in drawing order, in batches of one row (S17, S19).
//!
//! Warp kernels take the batches, and are independent of order, offsets and layers.

use super::format::Format;
use crate::pack::PackedSegment;
use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::render::setup::order::{EyeInFace, LayerOrder, Run};
use std::ops::Range;

/// Depth pixels of a full batch.
pub(crate) const BATCH_CAPACITY: usize = 256;

/// Columns that are written at once.
const COLUMNS_AT_ONCE: usize = 8;

/// Depth pixels of one row within one block of columns, in drawing order.
pub(crate) struct Batch<P> {
    /// Row on the face.
    pub(crate) row: u32,
    /// First column of the block on the face: the anchor of the incremental warp.
    pub(crate) anchor_column: u32,
    /// Number of entries in use.
    pub(crate) len: usize,
    /// Columns from the anchor, 0 to `BLOCK_COLUMNS - 1`.
    pub(crate) columns: [u8; BATCH_CAPACITY + COLUMNS_AT_ONCE],
    /// Depth pixels in drawing order.
    pub(crate) depth_pixels: [P; BATCH_CAPACITY],
}

impl<P: Format> Batch<P> {
    pub(crate) fn new() -> Self {
        Self {
            row: 0,
            anchor_column: 0,
            len: 0,
            columns: [0; BATCH_CAPACITY + COLUMNS_AT_ONCE],
            depth_pixels: [P::EMPTY; BATCH_CAPACITY],
        }
    }

    /// Fills the empty batch with the samples of adjacent pixels, in memory order. `counts`:
    /// running counts of the pixels from `column` on.
    fn fill(&mut self, column: u8, counts: &[u32], samples: &[P]) {
        self.depth_pixels[..samples.len()].copy_from_slice(samples);
        // Counts of a damaged cube need not ascend.
        let starts = counts
            .iter()
            .map(|start| (start.saturating_sub(counts[0]) as usize).min(samples.len()));
        if samples.len() + 1 == counts.len() && starts.clone().eq(0..counts.len()) {
            // One sample in each pixel, as over most of a simple scene.
            self.columns[..samples.len()]
                .iter_mut()
                .zip(column..)
                .for_each(|(c, column)| *c = column);
        } else {
            // Eight bytes at a time; the next pixel overwrites the excess.
            for (column, (start, end)) in (column..).zip(starts.clone().zip(starts.skip(1))) {
                for first in (start..end).step_by(COLUMNS_AT_ONCE) {
                    let columns = self.columns.get_mut(first..first + COLUMNS_AT_ONCE);
                    columns.into_iter().for_each(|columns| columns.fill(column));
                }
            }
        }
        self.len = samples.len();
    }

    /// Appends a depth pixel; a full batch is drawn first.
    #[inline(always)]
    fn push(&mut self, column: u8, depth_pixel: P, draw: &mut impl FnMut(&Self)) {
        if self.len >= BATCH_CAPACITY {
            draw(self);
            self.len = 0;
        }
        self.columns[self.len] = column;
        self.depth_pixels[self.len] = depth_pixel;
        self.len += 1;
    }
}

/// The traversed part of a segment: a rectangle of the face, without the culled blocks.
pub(crate) struct SegmentPart<'a, P> {
    pub(crate) segment: &'a PackedSegment,
    /// Depth pixels of the segment, in any format.
    pub(crate) depth_pixels: &'a [P],
    pub(crate) columns: Range<u32>,
    pub(crate) rows: Range<u32>,
    /// One flag for each block that the rectangle touches, row-major.
    pub(crate) visible: &'a [bool],
}

impl<'a, P> SegmentPart<'a, P> {
    /// Returns the flags of the row of blocks that contains a face row, from the rectangle's first
    /// block on.
    fn visible_blocks(&self, row: u32) -> &'a [bool] {
        let first = |range: &Range<u32>, length: u32| range.start / length;
        let blocks = self.columns.end.div_ceil(BLOCK_COLUMNS) - first(&self.columns, BLOCK_COLUMNS);
        let start = (row / BLOCK_ROWS - first(&self.rows, BLOCK_ROWS)) * blocks;
        self.visible
            .get(start as usize..(start + blocks) as usize)
            .unwrap_or(&[])
    }
}

/// Passes the depth pixels of a part to `draw`, in drawing order. Rows with damaged tables are
/// skipped.
pub(crate) fn traverse<P: Format>(
    part: &SegmentPart<P>,
    eye: &EyeInFace,
    layers: LayerOrder,
    batch: &mut Batch<P>,
    draw: &mut impl FnMut(&Batch<P>),
) {
    let segment = part.segment;
    let columns = eye.column_runs(part.columns.clone());
    let first_block = part.columns.start / BLOCK_COLUMNS;
    for row_run in eye.row_runs(part.rows.clone()) {
        row_run.for_each(|row| {
            let visible = part.visible_blocks(row);
            let (samples, counts) = segment.slice_row(part.depth_pixels, row - segment.y0);
            if samples.is_empty() || !visible.contains(&true) {
                return;
            }
            for run in &columns {
                run.for_each_block(|run| {
                    let block = run.range.start / BLOCK_COLUMNS;
                    if visible.get((block - first_block) as usize) != Some(&true) {
                        return;
                    }
                    let first = (run.range.start - segment.x0) as usize;
                    let counts = &counts[first..=first + run.range.len()];
                    if counts[0] == counts[run.range.len()] {
                        return;
                    }
                    batch.row = row;
                    batch.anchor_column = block * BLOCK_COLUMNS;
                    batch.len = 0;
                    gather(segment, eye, layers, samples, counts, &run, batch, draw);
                    if batch.len > 0 {
                        draw(batch);
                    }
                });
            }
        });
    }
}

/// Fills a batch with the samples of a run of pixels in one block, in drawing order.
#[inline(always)]
fn gather<P: Format>(
    segment: &PackedSegment,
    eye: &EyeInFace,
    layers: LayerOrder,
    samples: &[P],
    counts: &[u32],
    run: &Run,
    batch: &mut Batch<P>,
    draw: &mut impl FnMut(&Batch<P>),
) {
    let all = samples
        .get(counts[0] as usize..counts[run.range.len()] as usize)
        .unwrap_or(&[]);
    if layers == LayerOrder::FarthestFirst && !run.descending && all.len() <= BATCH_CAPACITY {
        batch.fill((run.range.start - batch.anchor_column) as u8, counts, all);
        return;
    }
    run.for_each(|x| {
        let i = (x - run.range.start) as usize;
        let Some(pixel) = samples.get(counts[i] as usize..counts[i + 1] as usize) else {
            return;
        };
        let column = (x - batch.anchor_column) as u8;
        match layers {
            LayerOrder::FarthestFirst => pixel.iter().for_each(|p| batch.push(column, *p, draw)),
            LayerOrder::NearestFirst => pixel
                .iter()
                .rev()
                .for_each(|p| batch.push(column, *p, draw)),
            LayerOrder::PerPixel => {
                let foot = eye.foot_depth(f64::from(x) + 0.5, f64::from(batch.row) + 0.5);
                merge_from_ends(segment, pixel, foot, |p| batch.push(column, *p, draw));
            }
        }
    });
}

/// Passes the samples of one pixel to `push` by descending distance from the foot of the
/// perpendicular from the eye to the pixel's ray (C9). Both ends of the pixel's list are the
/// farthest on their side of the foot, so that one comparison per sample sorts them.
fn merge_from_ends<P: Format>(
    segment: &PackedSegment,
    mut pixel: &[P],
    foot: f64,
    mut push: impl FnMut(&P),
) {
    let from_foot = |p: &P| (1.0 / p.inverse_depth(segment) - foot).abs();
    while let [first, .., last] = pixel {
        if from_foot(first) >= from_foot(last) {
            push(first);
            pixel = &pixel[1..];
        } else {
            push(last);
            pixel = &pixel[..pixel.len() - 1];
        }
    }
    pixel.iter().for_each(push);
}

#[cfg(test)]
mod tests {
    //! The set of depth pixels that is passed on; `setup/order.rs` tests their order.

    use super::*;
    use crate::pack::tests::scattered;
    use crate::pack::{CubeLdi, PackedDepthPixel, SplatIndexLayout, Split};
    use glam::DVec3;
    use headbox_core::cube_face::Face;

    /// Column, row and geometry bits of a depth pixel.
    type Visit = (u32, u32, u32);

    fn visits(part: &SegmentPart<PackedDepthPixel>, eye: DVec3, layers: LayerOrder) -> Vec<Visit> {
        let eye = EyeInFace::new(eye, part.segment.face, 170);
        let mut batch = Batch::new();
        let mut visits = Vec::new();
        traverse(part, &eye, layers, &mut batch, &mut |batch| {
            assert!(
                batch.len > 0
                    && batch.len <= BATCH_CAPACITY
                    && batch.anchor_column % BLOCK_COLUMNS == 0
            );
            for (column, pixel) in batch.columns.iter().zip(&batch.depth_pixels[..batch.len]) {
                assert!(u32::from(*column) < BLOCK_COLUMNS);
                visits.push((
                    batch.anchor_column + u32::from(*column),
                    batch.row,
                    pixel.geometry,
                ));
            }
        });
        visits.sort_unstable();
        visits
    }

    #[test]
    fn visible_blocks_in_rectangle_are_visited_once() {
        let cube =
            CubeLdi::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs");
        let segment = cube
            .segments
            .iter()
            .find(|segment| segment.face == Face::PosY)
            .expect("one");
        // Epipoles in the middle of the part, outside it, and none.
        let eyes = [
            segment.face.direction(110.3, 35.6, 170) * 0.3,
            DVec3::new(-0.4, 0.1, 0.3),
            DVec3::ZERO,
        ];
        for (i, (eye, layers)) in eyes
            .into_iter()
            .flat_map(|eye| {
                [
                    LayerOrder::FarthestFirst,
                    LayerOrder::NearestFirst,
                    LayerOrder::PerPixel,
                ]
                .map(|layers| (eye, layers))
            })
            .enumerate()
        {
            let columns = 71 + 5 * i as u32..151 - i as u32;
            let rows = 21..49;
            // Two columns of blocks, and three rows: each is hidden in some cases.
            let visible: Vec<bool> = (0..2 * 3).map(|block| (block + i) % 4 > 0).collect();
            let part = SegmentPart {
                segment,
                depth_pixels: &segment.depth_pixels,
                columns: columns.clone(),
                rows: rows.clone(),
                visible: &visible,
            };
            let mut expected = Vec::new();
            for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
                if visible[((y / BLOCK_ROWS - 1) * 2 + x / BLOCK_COLUMNS - 1) as usize] {
                    let pixel = segment.pixel(x - segment.x0, y - segment.y0);
                    expected.extend(pixel.iter().map(|pixel| (x, y, pixel.geometry)));
                }
            }
            expected.sort_unstable();
            assert!(expected.len() > 100);
            assert_eq!(visits(&part, eye, layers), expected, "{eye} {layers:?}");
        }
    }
}
