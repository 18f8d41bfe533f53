//! The one traversal: every depth pixel of a segment, in drawing order, in batches (inventory S17, S19).
//!
//! Kernels (scalar, SIMD, any splat) take the batches; none of them needs to know of order, offsets or layers.

use super::order::{EyeInFace, LayerOrder, Run};
use crate::packed::{PackedDepthPixel, PackedSegment};
use std::ops::Range;

/// Columns between two anchors of the incremental warp; blocks start at multiples of it.
pub(crate) const BLOCK_COLUMNS: u32 = 64;

/// Depth pixels of a full batch.
pub(crate) const BATCH_CAPACITY: usize = 256;

/// Depth pixels of one row within one block of columns, in drawing order.
pub(crate) struct Batch {
    /// Row on the face.
    pub(crate) row: u32,
    /// The block's first column on the face: the anchor.
    pub(crate) anchor_column: u32,
    /// Number of entries in use.
    pub(crate) len: usize,
    /// Columns from the anchor, 0 to `BLOCK_COLUMNS - 1`.
    pub(crate) columns: [u8; BATCH_CAPACITY],
    /// The depth pixels.
    pub(crate) depth_pixels: [PackedDepthPixel; BATCH_CAPACITY],
}

impl Batch {
    pub(crate) fn new() -> Self {
        let nothing = PackedDepthPixel { geometry: 0, color_srgb: [0; 4] };
        Self { row: 0, anchor_column: 0, len: 0, columns: [0; BATCH_CAPACITY], depth_pixels: [nothing; BATCH_CAPACITY] }
    }

    /// Appends a depth pixel; a full batch is drawn first.
    #[inline(always)]
    fn push(&mut self, column: u8, depth_pixel: PackedDepthPixel, draw: &mut impl FnMut(&Self)) {
        if self.len >= BATCH_CAPACITY {
            draw(self);
            self.len = 0;
        }
        self.columns[self.len] = column;
        self.depth_pixels[self.len] = depth_pixel;
        self.len += 1;
    }
}

/// Passes all depth pixels of a segment to `draw`, in drawing order. Parts of the rectangle outside the face, and rows
/// whose tables point nowhere, are left out.
pub(crate) fn traverse(
    segment: &PackedSegment,
    size_px: u32,
    eye: &EyeInFace,
    batch: &mut Batch,
    draw: &mut impl FnMut(&Batch),
) {
    let clip = |start: u32, length: u32| start.min(size_px)..start.saturating_add(length).min(size_px);
    let layers = eye.layer_order(segment);
    let columns = eye.column_runs(clip(segment.x0, segment.width));
    for row_run in eye.row_runs(clip(segment.y0, segment.height)) {
        for_each(&row_run, |row| {
            let (samples, counts) = segment.row(row - segment.y0);
            if samples.is_empty() {
                return;
            }
            for run in &columns {
                for_each_block(run, |run| {
                    batch.row = row;
                    batch.anchor_column = run.range.start - run.range.start % BLOCK_COLUMNS;
                    batch.len = 0;
                    let first = (run.range.start - segment.x0) as usize;
                    let counts = &counts[first..=first + run.range.len()];
                    if counts[0] == counts[run.range.len()] {
                        return;
                    }
                    for_each(&run, |x| {
                        let i = (x - run.range.start) as usize;
                        let Some(pixel) = samples.get(counts[i] as usize..counts[i + 1] as usize) else { return };
                        let column = (x - batch.anchor_column) as u8;
                        match layers {
                            LayerOrder::FarthestFirst => pixel.iter().for_each(|p| batch.push(column, *p, draw)),
                            LayerOrder::NearestFirst => pixel.iter().rev().for_each(|p| batch.push(column, *p, draw)),
                            LayerOrder::PerPixel => {
                                let foot = eye.foot_on_ray(f64::from(x) + 0.5, f64::from(row) + 0.5);
                                from_both_ends(segment, pixel, foot, |p| batch.push(column, *p, draw));
                            }
                        }
                    });
                    if batch.len > 0 {
                        draw(batch);
                    }
                });
            }
        });
    }
}

/// The samples of one pixel by descending distance from the foot of the eye on the pixel's ray (C9). Both ends of the
/// pixel's list are the farthest on their side of the foot, so that one comparison a sample sorts them.
fn from_both_ends(
    segment: &PackedSegment,
    mut pixel: &[PackedDepthPixel],
    foot: f64,
    mut push: impl FnMut(&PackedDepthPixel),
) {
    let from_foot = |p: &PackedDepthPixel| (1.0 / segment.inverse_depth(p.inverse_depth_code()) - foot).abs();
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
    let blocks = Run { range: start / BLOCK_COLUMNS..end.div_ceil(BLOCK_COLUMNS), descending: run.descending };
    for_each(&blocks, |block| {
        let first = block * BLOCK_COLUMNS;
        let range = start.max(first)..end.min(first + BLOCK_COLUMNS);
        visit(Run { range, descending: run.descending });
    });
}
