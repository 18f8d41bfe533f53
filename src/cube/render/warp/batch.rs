//! The warp of a batch, sixteen depth pixels at a time: unpack, transfer, cull, size (S18, S20, C8).
//!
//! One code for every SIMD level, down to plain scalars: IEEE operations in a fixed order, without fused multiply-adds and
//! approximate reciprocals, so that all levels give the same bits.

use crate::render::setup::clip::{Band, W_NEAR};
use crate::render::traverse::format::{Format, Unpacked};
use crate::render::setup::transfer::{RowTransfer, Transfer};
use crate::render::traverse::batches::{BATCH_CAPACITY, Batch};
use crate::render::footprint::size::{LANES, Lanes, Size};
use crate::render::footprint::splat::Splats;
use fearless_simd::{ExtractToken, Level, Simd, dispatch, f32x16, mask32x16, prelude::*};

/// What the warp of one segment needs.
pub(crate) struct SegmentWarp<'a> {
    transfer: &'a Transfer,
    /// Inverse depth of code 0 and its change from code to code, 1/m.
    scale: [f64; 2],
    /// Frame width, px.
    width: f32,
    /// Where the viewing axis meets the frame, px.
    principal_px: [f32; 2],
    /// First row of the band, and the row after its last.
    rows: [f32; 2],
    level: Level,
}

impl<'a> SegmentWarp<'a> {
    /// `scale`: of the depth pixels' inverse depths, as [`Format::scale`] gives it.
    pub(crate) fn new(transfer: &'a Transfer, scale: [f64; 2], band: &Band, level: Level) -> Self {
        Self {
            transfer,
            scale,
            width: band.width as f32,
            principal_px: band.principal_px.map(|c| c as f32),
            rows: [band.rows.start as f32, band.rows.end as f32],
            level,
        }
    }

    /// Warps a batch; depth pixels behind the eye or whose footprint misses the band are left out of `splats`.
    pub(crate) fn warp<P: Format>(&self, batch: &Batch<P>, size: &impl Size, splats: &mut Splats) {
        dispatch!(self.level, simd => self.warp_at(simd, batch, size, splats));
    }

    #[inline(always)]
    fn warp_at<S: Simd, P: Format>(&self, simd: S, batch: &Batch<P>, size: &impl Size, splats: &mut Splats) {
        let row = self.transfer.anchored(batch.anchor_column, batch.row, self.scale[0], self.scale[1]);
        (splats.len, splats.by_footprint) = (0, [0; 4]);
        for start in (0..batch.len.min(BATCH_CAPACITY)).step_by(LANES) {
            self.warp_lanes(simd, &row, batch, start, size, splats);
        }
    }

    /// Warps the depth pixels from `start` on, as many as there are lanes (a batch has room for whole lanes).
    #[inline(always)]
    fn warp_lanes<S: Simd, P: Format, Z: Size>(
        &self,
        simd: S,
        row: &RowTransfer,
        batch: &Batch<P>,
        start: usize,
        size: &Z,
        splats: &mut Splats,
    ) {
        let mut columns = [0.0; LANES];
        for (column, byte) in columns.iter_mut().zip(&batch.columns[start..start + LANES]) {
            *column = f32::from(*byte);
        }
        let Unpacked { code, normals, color } = P::load(simd, &batch.depth_pixels[start..start + LANES]);
        let k = f32x16::load_array(simd, columns);

        // As `RowTransfer::apply`.
        let hx = (k * row.step.x + row.anchor.x) + code * row.per_code.x;
        let hy = (k * row.step.y + row.anchor.y) + code * row.per_code.y;
        let hz = (k * row.step.z + row.anchor.z) + code * row.per_code.z;
        // All comparisons are false for NaN, which is outside.
        let in_front = hz.simd_ge(W_NEAR);
        let reciprocal_w = f32x16::splat(simd, 1.0) / hz;
        let inverse_depth = code * self.scale[1] as f32 + self.scale[0] as f32;
        let lanes = Lanes {
            homogeneous: [hx, hy, hz],
            reciprocal_w,
            inverse_depth,
            x: k + (batch.anchor_column as f32 + 0.5),
            y: batch.row as f32 + 0.5,
            normals,
        };
        let px = hx * reciprocal_w + self.principal_px[0];
        let py = hy * reciprocal_w + self.principal_px[1];
        let footprints = size.footprints(simd, &lanes);
        let (rx, ry) = (footprints.radius_x, footprints.radius_y);
        let touches = (px + rx).simd_gt(0.0)
            & (px - rx).simd_lt(self.width)
            & (py + ry).simd_gt(self.rows[0])
            & (py - ry).simd_lt(self.rows[1]);
        let there = mask32x16::from_bitmask(simd, (1u64 << (batch.len - start).min(LANES)) - 1);
        let shown = in_front & touches & there;
        let n = splats.len;
        keep(px, shown, &mut splats.x, n);
        keep(py, shown, &mut splats.y, n);
        keep(inverse_depth * reciprocal_w, shown, &mut splats.inverse_depth, n);
        keep(rx, shown, &mut splats.radius_x, n);
        keep(ry, shown, &mut splats.radius_y, n);
        keep(footprints.weight, shown, &mut splats.weight, n);
        if Z::IS_ELLIPTICAL {
            keep(footprints.correlation, shown, &mut splats.correlation, n);
        }
        simd.compress_u32x16(color, shown).store_slice(&mut splats.color[n..n + LANES]);
        let larger = rx.max_precise(ry);
        let all = count(shown);
        let three = count(shown & larger.simd_ge(1.0));
        let five = count(shown & larger.simd_ge(2.0));
        let seven = count(shown & larger.simd_ge(3.0));
        splats.by_footprint[0] += all - three;
        splats.by_footprint[1] += three - five;
        splats.by_footprint[2] += five - seven;
        splats.by_footprint[3] += seven;
        splats.len += all as usize;
    }
}

/// Appends the lanes that are `shown` to the first `n` values of an array.
#[inline(always)]
fn keep<S: Simd>(values: f32x16<S>, shown: mask32x16<S>, to: &mut [f32; Splats::ROOM], n: usize) {
    let simd = values.token();
    simd.compress_f32x16(values, shown).store_slice(&mut to[n..n + LANES]);
}

/// How many lanes are set.
#[inline(always)]
fn count<S: Simd>(mask: mask32x16<S>) -> u64 {
    u64::from(mask.to_bitmask().count_ones())
}

#[cfg(test)]
mod tests;
