//! The one traversal: every depth pixel of a segment, in drawing order, in batches (S17, S19).
//!
//! Kernels (scalar, SIMD, any splat) take the batches; none of them needs to know of order, offsets or layers.

use super::format::Format;
use crate::pack::PackedSegment;
use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::render::parallel::epipolar::Spans;
use crate::render::setup::order::{EyeInFace, LayerOrder, Run};
use std::ops::Range;

/// Depth pixels of a full batch.
pub(crate) const BATCH_CAPACITY: usize = 256;

/// Columns that are written at once.
const COLUMNS_ROOM: usize = 8;

/// Depth pixels of one row within one block of columns, in drawing order.
pub(crate) struct Batch<P> {
    /// Row on the face.
    pub(crate) row: u32,
    /// The block's first column on the face: the anchor.
    pub(crate) anchor_column: u32,
    /// Number of entries in use.
    pub(crate) len: usize,
    /// Columns from the anchor, 0 to `BLOCK_COLUMNS - 1`.
    pub(crate) columns: [u8; BATCH_CAPACITY + COLUMNS_ROOM],
    /// The depth pixels.
    pub(crate) depth_pixels: [P; BATCH_CAPACITY],
}

impl<P: Format> Batch<P> {
    pub(crate) fn new() -> Self {
        Self {
            row: 0,
            anchor_column: 0,
            len: 0,
            columns: [0; BATCH_CAPACITY + COLUMNS_ROOM],
            depth_pixels: [P::NOTHING; BATCH_CAPACITY],
        }
    }

    /// Fills the empty batch with the samples of neighbouring pixels, in their order in memory. `counts`: running counts of
    /// the pixels from `column` on.
    fn extend(&mut self, column: u8, counts: &[u32], samples: &[P]) {
        self.depth_pixels[..samples.len()].copy_from_slice(samples);
        // Counts of a damaged cube need not ascend.
        let starts = counts
            .iter()
            .map(|start| (start.saturating_sub(counts[0]) as usize).min(samples.len()));
        if samples.len() + 1 == counts.len()
            && starts
                .clone()
                .zip(0..)
                .all(|(start, i): (usize, usize)| start == i)
        {
            // One sample in each pixel, as over most of a simple scene.
            self.columns[..samples.len()]
                .iter_mut()
                .zip(column..)
                .for_each(|(c, column)| *c = column);
        } else {
            // Eight bytes at a time, of which the next pixel overwrites those that it needs.
            for (column, (start, end)) in (column..).zip(starts.clone().zip(starts.skip(1))) {
                for eight in (start..end).step_by(COLUMNS_ROOM) {
                    let room = self.columns.get_mut(eight..eight + COLUMNS_ROOM);
                    room.into_iter().for_each(|room| room.fill(column));
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

/// The part of a segment that is traversed: a rectangle of the face, without the blocks that clipping found hidden.
pub(crate) struct SegmentPart<'a, P> {
    pub(crate) segment: &'a PackedSegment,
    /// The segment's, in any form.
    pub(crate) depth_pixels: &'a [P],
    pub(crate) columns: Range<u32>,
    pub(crate) rows: Range<u32>,
    /// Of each block that the rectangle touches, row-major.
    pub(crate) visible: &'a [bool],
}

/// Columns and rows of a whole segment, as far as they lie on the face.
pub(crate) fn whole(segment: &PackedSegment, size_px: u32) -> [Range<u32>; 2] {
    let clip =
        |start: u32, length: u32| start.min(size_px)..start.saturating_add(length).min(size_px);
    [
        clip(segment.x0, segment.width),
        clip(segment.y0, segment.height),
    ]
}

/// Number of blocks that a rectangle touches.
pub(crate) fn block_count([columns, rows]: &[Range<u32>; 2]) -> usize {
    let blocks = |range: &Range<u32>, length: u32| {
        (range.end.div_ceil(length) - range.start / length) as usize
    };
    blocks(columns, BLOCK_COLUMNS) * blocks(rows, BLOCK_ROWS)
}

impl<'a, P> SegmentPart<'a, P> {
    /// Of a row of blocks, those from the rectangle's first on.
    fn visible_in(&self, row: u32) -> &'a [bool] {
        let first = |range: &Range<u32>, length: u32| range.start / length;
        let blocks = self.columns.end.div_ceil(BLOCK_COLUMNS) - first(&self.columns, BLOCK_COLUMNS);
        let start = (row / BLOCK_ROWS - first(&self.rows, BLOCK_ROWS)) * blocks;
        self.visible
            .get(start as usize..(start + blocks) as usize)
            .unwrap_or(&[])
    }
}

/// Which pixels of each row of a part are traversed.
pub(crate) trait Cut {
    /// What it knows of a row.
    type Row;

    /// Spans that may hold pixels, of those that [`Self::within`] gives: the first ones.
    const SPANS: usize = 3;

    /// What it knows of a row of the face.
    fn row(&self, row: u32) -> Self::Row;

    /// The pixels in a range of columns of one block, in row `y`.
    fn within(&self, row: &Self::Row, y: u32, range: &Range<u32>) -> Spans;
}

/// All pixels.
pub(crate) struct Uncut;

impl Cut for Uncut {
    type Row = ();

    const SPANS: usize = 1;

    fn row(&self, _: u32) {}

    #[inline]
    fn within(&self, (): &(), _: u32, range: &Range<u32>) -> Spans {
        [range.clone(), range.end..range.end, range.end..range.end]
    }
}

/// Passes the depth pixels of a part to `draw`, in drawing order. Rows whose tables point nowhere are left out.
pub(crate) fn traverse<P: Format, C: Cut>(
    part: &SegmentPart<P>,
    cut: &C,
    eye: &EyeInFace,
    layers: LayerOrder,
    batch: &mut Batch<P>,
    draw: &mut impl FnMut(&Batch<P>),
) {
    let segment = part.segment;
    let columns = eye.column_runs(part.columns.clone());
    let first_block = part.columns.start / BLOCK_COLUMNS;
    for row_run in eye.row_runs(part.rows.clone()) {
        for_each(&row_run, |row| {
            let visible = part.visible_in(row);
            let (samples, counts) = segment.row_of(part.depth_pixels, row - segment.y0);
            if samples.is_empty() || !visible.contains(&true) {
                return;
            }
            let row_cut = cut.row(row);
            for run in &columns {
                for_each_block(run, |run| {
                    let block = run.range.start / BLOCK_COLUMNS;
                    if !visible
                        .get((block - first_block) as usize)
                        .is_some_and(|visible| *visible)
                    {
                        return;
                    }
                    let mut spans = cut.within(&row_cut, row, &run.range);
                    if run.descending && C::SPANS > 1 {
                        spans.reverse();
                    }
                    for range in spans.into_iter().take(C::SPANS) {
                        let first = (range.start - segment.x0) as usize;
                        let counts = &counts[first..=first + range.len()];
                        if counts[0] == counts[range.len()] {
                            continue;
                        }
                        batch.row = row;
                        batch.anchor_column = block * BLOCK_COLUMNS;
                        batch.len = 0;
                        let run = Run {
                            range,
                            descending: run.descending,
                        };
                        gather(segment, eye, layers, samples, counts, &run, batch, draw);
                        if batch.len > 0 {
                            draw(batch);
                        }
                    }
                });
            }
        });
    }
}

/// Fills a batch with the samples of a run of pixels in one block, in drawing order.
#[expect(
    clippy::too_many_arguments,
    reason = "the inner loop of the traversal, apart only to be read"
)]
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
        batch.extend((run.range.start - batch.anchor_column) as u8, counts, all);
        return;
    }
    for_each(run, |x| {
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
                let foot = eye.foot_on_ray(f64::from(x) + 0.5, f64::from(batch.row) + 0.5);
                from_both_ends(segment, pixel, foot, |p| batch.push(column, *p, draw));
            }
        }
    });
}

/// The samples of one pixel by descending distance from the foot of the eye on the pixel's ray (C9). Both ends of the
/// pixel's list are the farthest on their side of the foot, so that one comparison a sample sorts them.
fn from_both_ends<P: Format>(
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

/// Calls `visit` for every index of a run, in its order.
fn for_each(run: &Run, visit: impl FnMut(u32)) {
    match run.descending {
        false => run.range.clone().for_each(visit),
        true => run.range.clone().rev().for_each(visit),
    }
}

/// Cuts a run at multiples of [`BLOCK_COLUMNS`].
fn for_each_block(run: &Run, mut visit: impl FnMut(Run)) {
    let Range { start, end } = run.range;
    if start >= end {
        return;
    }
    let blocks = Run {
        range: start / BLOCK_COLUMNS..end.div_ceil(BLOCK_COLUMNS),
        descending: run.descending,
    };
    for_each(&blocks, |block| {
        let first = block * BLOCK_COLUMNS;
        let range = start.max(first)..end.min(first + BLOCK_COLUMNS);
        visit(Run {
            range,
            descending: run.descending,
        });
    });
}

#[cfg(test)]
mod tests {
    //! Which depth pixels are passed on, whatever their order (`order.rs` tests that).

    use super::*;
    use crate::pack::tests::scattered;
    use crate::pack::{PackedCube, PackedDepthPixel, SplatIndexLayout, Split};
    use glam::DVec3;
    use headbox_core::cube_face::Face;

    /// Column, row and bits.
    type Found = Vec<(u32, u32, u32)>;

    fn traversed(part: &SegmentPart<PackedDepthPixel>, eye: DVec3, layers: LayerOrder) -> Found {
        let eye = EyeInFace::new(eye, part.segment.face, 170);
        let (mut batch, mut found) = (Batch::new(), Found::new());
        traverse(part, &Uncut, &eye, layers, &mut batch, &mut |batch| {
            assert!(
                batch.len > 0
                    && batch.len <= BATCH_CAPACITY
                    && batch.anchor_column % BLOCK_COLUMNS == 0
            );
            for (column, pixel) in batch.columns.iter().zip(&batch.depth_pixels[..batch.len]) {
                assert!(u32::from(*column) < BLOCK_COLUMNS);
                found.push((
                    batch.anchor_column + u32::from(*column),
                    batch.row,
                    pixel.geometry,
                ));
            }
        });
        found.sort_unstable();
        found
    }

    #[test]
    fn all_of_the_visible_blocks_in_the_rectangle_is_passed_on_and_nothing_else() {
        let cube =
            PackedCube::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs");
        let segment = cube
            .segments
            .iter()
            .find(|segment| segment.face == Face::PosY)
            .expect("one");
        // Epipoles in the middle of the part, beside it, and none.
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
        let cube =
            PackedCube::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs");
        let segment = &cube.segments[0];
        let (x, y) = (
            segment.x0..segment.x0 + segment.width,
            segment.y0..segment.y0 + segment.height,
        );
        assert_eq!(whole(segment, 170), [x.clone(), y.clone()]);
        assert_eq!(whole(segment, 30), [30..30, y.start..30]);
        assert_eq!(
            (
                block_count(&[x, y]),
                block_count(&[64..65, 15..17]),
                block_count(&[0..0, 0..1])
            ),
            (2 * 3, 2, 0)
        );
    }
}
