//! How a frame is made, for overlays that show it: what happens at each pixel, and what clipping leaves out. A second, slow
//! pass over the same plan as the frame's; the renderer itself knows nothing of it.

use crate::render::parallel::band::{Clipped, ForSegment, Scope};
use crate::render::setup::clip::{Band, BlockClip};
use crate::render::traverse::format::Format;
use crate::render::warp::batch::SegmentWarp;
use crate::render::traverse::batches as traverse;
use crate::render::traverse::batches::{Batch, SegmentPart, Uncut};
use crate::render::{FramePlan, RenderSettings, Renderer, SegmentPlan};
use crate::render::setup::order;
use headbox_core::camera::Camera;
use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::pack::{PackedCube, PackedDepthPixel, PackedSegment};
use crate::render::footprint::size::Size;
use crate::render::footprint::splat::Splats;
use crate::render::canvas::touched::{Touched, touch};
use rayon::prelude::*;
use std::ops::Range;

/// What clipping leaves of a segment for a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept {
    /// Which of the cube's segments.
    pub segment: usize,
    /// Columns and rows of the face that the planes of the view leave; empty if they leave nothing.
    rectangle: [Range<u32>; 2],
    /// Of each block that the rectangle touches, row-major, whether it is drawn.
    visible: Vec<bool>,
}

/// What becomes of a pixel of a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// Its samples are drawn.
    Drawn,
    /// It lies outside of the rectangle that the planes of the view cut out of its segment (C15).
    OutsideRectangle,
    /// It lies in a block that is wholly outside of the view (C17).
    HiddenBlock,
}

impl Kept {
    /// What becomes of the pixel in column `x` and row `y` of the face.
    pub fn fate(&self, x: u32, y: u32) -> Fate {
        let [columns, rows] = &self.rectangle;
        if !columns.contains(&x) || !rows.contains(&y) {
            return Fate::OutsideRectangle;
        }
        let first = columns.start / BLOCK_COLUMNS;
        let blocks = columns.end.div_ceil(BLOCK_COLUMNS) - first;
        let block = (y / BLOCK_ROWS - rows.start / BLOCK_ROWS) * blocks + x / BLOCK_COLUMNS - first;
        if self.visible.get(block as usize).is_some_and(|visible| *visible) { Fate::Drawn } else { Fate::HiddenBlock }
    }

    /// Calls `visit` for each run of the segment's columns in a row that share a fate: with their fate, and their columns
    /// counted from the segment's first.
    pub fn for_each_run(&self, segment: &PackedSegment, y: u32, mut visit: impl FnMut(Fate, Range<u32>)) {
        let end = segment.x0.saturating_add(segment.width);
        let mut x = segment.x0;
        while x < end {
            let borders = [self.rectangle[0].start, self.rectangle[0].end, (x / BLOCK_COLUMNS + 1) * BLOCK_COLUMNS];
            let next = borders.into_iter().filter(|border| *border > x).min().unwrap_or(end).min(end);
            visit(self.fate(x, y), x - segment.x0..next - segment.x0);
            x = next;
        }
    }
}

/// Rows of a band, the work of one thread at a time. Any number counts the same.
const BAND_ROWS: u32 = 48;

impl Renderer {
    /// What happens at each pixel, row by row, when a camera looks at a cube; drawn on the current rayon thread pool.
    pub fn touched(&mut self, cube: &PackedCube, camera: &Camera, settings: &RenderSettings) -> Vec<Touched> {
        self.plan_for(cube, camera, settings);
        let (plan, [width, height]) = (&self.plan, [camera.width(), camera.height()]);
        let mut touched = vec![Touched::default(); width as usize * height as usize];
        let bands = touched.par_chunks_mut(width as usize * BAND_ROWS as usize).enumerate().with_max_len(1);
        bands.for_each(|(i, pixels)| {
            let start = i as u32 * BAND_ROWS;
            let band = band_of(camera, start..start.saturating_add(BAND_ROWS).min(height));
            let (batch, splats) = (Box::new(Batch::new()), Box::new(Splats::new()));
            plan.for_each_segment(cube, &mut Touching { plan, band: &band, pixels, batch, splats });
        });
        touched
    }

    /// What clipping leaves of each segment when a camera looks at a cube.
    pub fn kept(&mut self, cube: &PackedCube, camera: &Camera, settings: &RenderSettings) -> Vec<Kept> {
        self.plan_for(cube, camera, settings);
        let band = band_of(camera, 0..camera.height());
        let mut keeping = Keeping { plan: &self.plan, band: &band, kept: Vec::new() };
        self.plan.for_each_segment(cube, &mut keeping);
        keeping.kept
    }

    fn plan_for(&mut self, cube: &PackedCube, camera: &Camera, settings: &RenderSettings) {
        order::segment_order(&cube.segments, camera.eye() - cube.info.centre, &mut self.order);
        self.plan.prepare(cube, camera, settings, &self.order);
    }
}

fn band_of(camera: &Camera, rows: Range<u32>) -> Band {
    Band { width: camera.width(), height: camera.height(), principal_px: camera.principal_px(), rows }
}

/// What clipping leaves of a segment in a band.
fn keep<S: Size>(plan: &FramePlan, band: &Band, of_frame: &SegmentPlan, segment: &PackedSegment, size: &S) -> Kept {
    let clip = BlockClip { transfer: &of_frame.transfer, segment, band, face_px: plan.face_px };
    let mut visible = Vec::new();
    let rectangle = Clipped { unclipped: plan.unclipped }.part(0, &clip, size, &mut visible);
    let rectangle = rectangle.unwrap_or([segment.x0..segment.x0, segment.y0..segment.y0]);
    Kept { segment: of_frame.index, rectangle, visible }
}

/// Collects what is kept of all segments.
struct Keeping<'a> {
    plan: &'a FramePlan,
    band: &'a Band,
    kept: Vec<Kept>,
}

impl ForSegment for Keeping<'_> {
    fn segment<S: Size>(&mut self, _: usize, of_frame: &SegmentPlan, segment: &PackedSegment, size: &S) {
        self.kept.push(keep(self.plan, self.band, of_frame, segment, size));
    }
}

/// Counts the footprints of all segments in a band.
struct Touching<'a> {
    plan: &'a FramePlan,
    band: &'a Band,
    pixels: &'a mut [Touched],
    batch: Box<Batch<PackedDepthPixel>>,
    splats: Box<Splats>,
}

impl ForSegment for Touching<'_> {
    fn segment<S: Size>(&mut self, _: usize, of_frame: &SegmentPlan, segment: &PackedSegment, size: &S) {
        let Self { plan, band, pixels, batch, splats } = self;
        let Kept { rectangle: [columns, rows], visible, .. } = keep(plan, band, of_frame, segment, size);
        if visible.is_empty() {
            return;
        }
        let part = SegmentPart { segment, depth_pixels: &segment.depth_pixels, columns, rows, visible: &visible };
        let warp = SegmentWarp::new(&of_frame.transfer, PackedDepthPixel::scale(segment), band, plan.level);
        let own = plan.kernel.own_share();
        traverse::traverse(&part, &Uncut, &of_frame.eye, of_frame.layers, batch, &mut |batch| {
            warp.warp(batch, size, splats);
            touch(pixels, band.width, &band.rows, splats, own);
        });
    }
}

#[cfg(test)]
mod tests;
