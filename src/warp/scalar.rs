//! The warp of a batch of depth pixels, one by one: the specification of every faster one (inventory S18, C8).

use super::transfer::{RowTransfer, Transfer};
use super::traverse::{BATCH_CAPACITY, Batch};
use crate::packed::PackedSegment;
use crate::splat::Splats;
use crate::splat::size::{Sample, Size};

/// The least w = Z2 / Z1 that is drawn (C8: w > 0 alone lets splats grow without bound). At it, a sample is 1,024 times
/// nearer to the eye than to the centre, and f32 has lost 10 of its 24 bits.
const W_NEAR: f32 = 1.0 / 1024.0;

/// What the warp of one segment needs.
pub(crate) struct SegmentWarp<'a> {
    pub(crate) transfer: &'a Transfer,
    pub(crate) inverse_depth_min: f64,
    pub(crate) inverse_depth_step: f64,
    /// Frame size in px.
    pub(crate) frame: [f32; 2],
}

impl<'a> SegmentWarp<'a> {
    pub(crate) fn new(transfer: &'a Transfer, segment: &PackedSegment, width: u32, height: u32) -> Self {
        Self {
            transfer,
            inverse_depth_min: f64::from(segment.inverse_depth_min),
            inverse_depth_step: segment.inverse_depth_step(),
            frame: [width as f32, height as f32],
        }
    }

    /// Warps a batch; depth pixels behind the eye or whose footprint misses the frame are left out of `splats`.
    pub(crate) fn warp<S: Size>(&self, batch: &Batch, size: &S, splats: &mut Splats) {
        let mut in_reach = [0u16; BATCH_CAPACITY];
        let count = self.cull(batch, S::MAX_RADIUS_PX, &mut in_reach);
        let row = self.row(batch);
        let (q_min, q_step) = (self.inverse_depth_min as f32, self.inverse_depth_step as f32);
        let [width, height] = self.frame;
        let (y, x0) = (batch.row as f32 + 0.5, batch.anchor_column as f32 + 0.5);
        splats.len = 0;
        for i in in_reach[..count].iter().map(|i| usize::from(*i)) {
            let depth_pixel = batch.depth_pixels[i];
            let (column, code) = (f32::from(batch.columns[i]), depth_pixel.inverse_depth_code() as f32);
            let homogeneous = row.apply(column, code);
            let reciprocal_w = 1.0 / homogeneous.z;
            let inverse_depth = q_min + code * q_step;
            let splat_index = depth_pixel.splat_index();
            let sample = Sample { homogeneous, reciprocal_w, inverse_depth, x: x0 + column, y, splat_index };
            let footprint = size.footprint(&sample);
            let px = homogeneous.x * reciprocal_w + width * 0.5;
            let py = homogeneous.y * reciprocal_w + height * 0.5;
            let touches = |p: f32, radius: f32, size: f32| p + radius > 0.0 && p - radius < size;
            if touches(px, footprint.radius_x, width) && touches(py, footprint.radius_y, height) {
                let n = splats.len;
                splats.x[n] = px;
                splats.y[n] = py;
                splats.inverse_depth[n] = inverse_depth * reciprocal_w;
                splats.footprint[n] = footprint;
                splats.color[n] = depth_pixel.color_srgb;
                splats.len += 1;
            }
        }
    }

    fn row(&self, batch: &Batch) -> RowTransfer {
        self.transfer.anchored(batch.anchor_column, batch.row, self.inverse_depth_min, self.inverse_depth_step)
    }

    /// Lists the depth pixels of a batch that are in front of the eye and at most `radius_px` outside the frame, and
    /// returns how many. In homogeneous coordinates, before any division, and without branches.
    fn cull(&self, batch: &Batch, radius_px: f32, in_reach: &mut [u16; BATCH_CAPACITY]) -> usize {
        let row = self.row(batch);
        let [reach_x, reach_y] = self.frame.map(|size| size * 0.5 + radius_px);
        let mut count = 0;
        for i in 0..batch.len.min(BATCH_CAPACITY) {
            let code = batch.depth_pixels[i].inverse_depth_code() as f32;
            let h = row.apply(f32::from(batch.columns[i]), code);
            // All comparisons are false for NaN, which is outside.
            let inside = (h.z >= W_NEAR) & (h.x.abs() <= h.z * reach_x) & (h.y.abs() <= h.z * reach_y);
            in_reach[count] = i as u16;
            count += usize::from(inside);
        }
        count
    }
}
