//! What clipping leaves of an LDI, counted (S19, C15, C17).

use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::pack::{PackedCube, PackedSegment};
use crate::render::footprint::size::Size;
use crate::render::parallel::band::{Clipped, ForSegment, Scope};
use crate::render::setup::clip::{Band, BlockClip};
use crate::render::setup::order;
use crate::render::{RenderSettings, Renderer, SegmentPlan};
use headbox_core::camera::Camera;
use serde::Serialize;

/// Depth pixels of an LDI by what clipping against a whole frame says of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ClipCounts {
    /// In segments of which nothing can show.
    pub culled: u64,
    /// In the other segments, in rows, columns and blocks of which nothing can show.
    pub clipped: u64,
    /// The rest, which is warped.
    pub kept: u64,
}

/// Counts what each segment keeps.
struct Counting<'a> {
    counts: ClipCounts,
    frame: &'a Band,
    face_px: u32,
    visible: Vec<bool>,
}

impl ForSegment for Counting<'_> {
    fn segment<S: Size>(
        &mut self,
        i: usize,
        of_frame: &SegmentPlan,
        segment: &PackedSegment,
        size: &S,
    ) {
        let all = segment.depth_pixels.len() as u64;
        let clip = BlockClip {
            transfer: &of_frame.transfer,
            segment,
            band: self.frame,
            face_px: self.face_px,
        };
        let Some([columns, rows]) =
            (Clipped { unclipped: false }).part(i, &clip, size, &mut self.visible)
        else {
            self.counts.culled += all;
            return;
        };
        let blocks = columns.start / BLOCK_COLUMNS..columns.end.div_ceil(BLOCK_COLUMNS);
        let mut kept = 0;
        for y in rows.clone() {
            let (_, counts) = segment.row(y - segment.y0);
            let first = (y / BLOCK_ROWS - rows.start / BLOCK_ROWS) as usize * blocks.len();
            let row = blocks.clone().zip(self.visible.get(first..).unwrap_or(&[]));
            for (block, _) in row.filter(|(_, visible)| **visible) {
                let start = (block * BLOCK_COLUMNS).max(columns.start);
                let end = ((block + 1) * BLOCK_COLUMNS).min(columns.end);
                let until = |x: u32| {
                    counts
                        .get((x - segment.x0) as usize)
                        .map_or(0, |count| u64::from(*count))
                };
                kept += until(end).saturating_sub(until(start));
            }
        }
        self.counts.kept += kept;
        self.counts.clipped += all - kept;
    }
}

impl Renderer {
    /// How much of a cube LDI clipping keeps for a frame. A frame in bands keeps more: what reaches into two bands counts in
    /// both.
    pub fn clip_counts(
        &mut self,
        cube: &PackedCube,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> ClipCounts {
        order::segment_order(
            &cube.segments,
            camera.eye() - cube.info.centre,
            &mut self.order,
        );
        self.plan.prepare(cube, camera, settings, &self.order);
        let (width, height, principal_px) =
            (camera.width(), camera.height(), camera.principal_px());
        let frame = Band {
            width,
            height,
            principal_px,
            rows: 0..height,
        };
        let (counts, face_px) = (ClipCounts::default(), self.plan.face_px);
        let mut counting = Counting {
            counts,
            frame: &frame,
            face_px,
            visible: Vec::new(),
        };
        self.plan.for_each_segment(cube, &mut counting);
        counting.counts
    }
}
