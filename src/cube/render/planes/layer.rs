//! The opaque layer behind splats: plane textures and inserted content, with depth.

use super::kernel;
use super::kernel::TargetRows;
use super::plan::PlanesInView;
use crate::pack::PlaneSet;
use fearless_simd::Level;
use std::ops::Range;

/// Inverse depth of empty pixels: farther than infinity, where a plane may be.
pub(super) const NOWHERE: f32 = -1.0;

/// The opaque layer behind the splats in some rows of a frame.
#[derive(Default)]
pub(crate) struct PlaneLayer {
    /// Straight colour and 255 where a plane or inserted content is opaque; 0 elsewhere.
    colors: Vec<[u8; 4]>,
    /// 1 / eye depth, 1/m, of the opaque pixels; [`NOWHERE`] elsewhere.
    inverse_depth: Vec<f32>,
    rims: Vec<Rim>,
    width: usize,
    /// Rows of the frame that are visible in the band.
    rows: Range<usize>,
    /// Rows of the frame that are stored: also some around the visible ones, for splats centred
    /// there.
    stored_rows: Range<usize>,
    /// Relative difference of inverse depth by which a hidden splat is farther.
    tolerance: f32,
}

/// A pixel that a plane covers partly. It is blended after the samples that may be visible through
/// it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rim {
    /// Column, and row counted from the first visible one.
    pub(crate) pixel: [u32; 2],
    /// Straight colour, and coverage, 0..255.
    pub(crate) color: [u8; 4],
    /// 1 / eye depth, 1/m.
    pub(crate) inverse_depth: f32,
}

/// Content with depth that another renderer drew into a part of the frame (S25).
#[derive(Clone, Debug)]
pub struct DepthLayer<'a> {
    /// Columns and rows of the frame.
    pub window: [Range<usize>; 2],
    /// Straight colours, sRGB, and coverage, 0..255, of the window's pixels, row-major.
    pub colors: &'a [[u8; 4]],
    /// 1 / eye depth of the same pixels, 1/m; 0 for empty ones.
    pub inverse_depth: &'a [f32],
}

impl DepthLayer<'_> {
    /// Returns colour and inverse depth of a pixel of the frame; zeros outside the window.
    pub fn pixel(&self, x: usize, y: usize) -> ([u8; 4], f32) {
        let [columns, rows] = &self.window;
        let get = |i: usize| Some((*self.colors.get(i)?, *self.inverse_depth.get(i)?));
        let is_inside = columns.contains(&x) && rows.contains(&y);
        let index = is_inside.then(|| (y - rows.start) * columns.len() + x - columns.start);
        index.and_then(get).unwrap_or_default()
    }
}

/// Columns that are added to each row for whole registers.
const MARGIN: usize = headbox_core::image::texels::LANES;

/// Rows above and below a band that are drawn where splats are tested at their centres.
pub(crate) const ROWS_AROUND: u32 = 5;

/// Largest radius, px, of splats that are tested at their centres. Larger ones are tested pixel by
/// pixel, since their centres may lie outside the stored rows, where bands of a frame would
/// disagree. Rounding to the pixel grid moves a footprint by up to a pixel.
pub(crate) const MAX_RADIUS_TESTED_AT_CENTRE_PX: f32 = ROWS_AROUND as f32 - 1.0;

impl PlaneLayer {
    /// Empties the layer.
    pub(crate) fn clear(&mut self) {
        self.colors.clear();
        self.inverse_depth.clear();
        self.rims.clear();
    }

    /// Returns true if nothing was drawn.
    pub(crate) fn is_empty(&self) -> bool {
        self.colors.is_empty()
    }

    /// Returns true if a splat at `inverse_depth`, 1/m, is hidden in the pixel that contains a
    /// frame position; positions outside the stored pixels are clamped.
    #[inline]
    pub(crate) fn hides(&self, [x, y]: [f32; 2], inverse_depth: f32) -> bool {
        // Casts of negative numbers saturate to 0.
        let column = (x as usize).min(self.width.saturating_sub(1));
        let row = (y as usize)
            .max(self.stored_rows.start)
            .min(self.stored_rows.end.saturating_sub(1));
        let stored = self
            .inverse_depth
            .get(row.wrapping_sub(self.stored_rows.start) * (self.width + MARGIN) + column);
        stored.is_some_and(|stored| inverse_depth * (1.0 + self.tolerance) < *stored)
    }

    /// Draws the plane textures in `rows` of a frame, and the inserted content. For tests of
    /// splats, `around` more rows above and below are drawn, and splats count as hidden if they are
    /// farther by a relative `tolerance`.
    pub(crate) fn draw(
        &mut self,
        set: &PlaneSet,
        view: &PlanesInView,
        inserted: Option<&DepthLayer>,
        (rows, around): (Range<u32>, u32),
        tolerance: f32,
        level: Level,
    ) {
        let [width, height] = view.size_px();
        self.width = width as usize;
        self.tolerance = tolerance;
        self.rows = rows.start as usize..rows.end as usize;
        let rows = rows.start.saturating_sub(around)..rows.end.saturating_add(around).min(height);
        self.stored_rows = rows.start as usize..rows.end as usize;
        let stride = self.width + MARGIN;
        self.clear();
        self.colors.resize(stride * rows.len(), [0; 4]);
        self.inverse_depth.resize(stride * rows.len(), NOWHERE);
        let mut target = TargetRows {
            frame: &view.frame,
            colors: bytemuck::cast_slice_mut(&mut self.colors),
            depths: &mut self.inverse_depth,
            stride,
            rows,
            rims: &mut self.rims,
        };
        for tile in &view.tiles {
            kernel::draw(
                tile,
                set.mip_texels(tile.index as usize, tile.level),
                &mut target,
                level,
            );
        }
        if let Some(inserted) = inserted {
            self.insert(inserted);
        }
        let above = self.rows_above() as u32;
        let visible = self.rows.len() as u32;
        let depths = &self.inverse_depth;
        self.rims.retain_mut(|rim| {
            let [column, row] = rim.pixel;
            let is_in_front = depths
                .get(row as usize * stride + column as usize)
                .is_some_and(|depth| rim.inverse_depth > *depth);
            rim.pixel[1] = row.wrapping_sub(above);
            is_in_front && rim.pixel[1] < visible
        });
        // Nearest tiles came first.
        self.rims.reverse();
    }

    /// Returns the number of stored rows above the visible ones.
    fn rows_above(&self) -> usize {
        self.rows.start - self.stored_rows.start
    }

    /// Inserts content where it is nearer than the planes: opaque pixels over them, partly covered
    /// ones among the rims.
    fn insert(&mut self, inserted: &DepthLayer) {
        let [columns, rows] = &inserted.window;
        let columns = columns.start..columns.end.min(self.width);
        for y in rows.start.max(self.stored_rows.start)..rows.end.min(self.stored_rows.end) {
            let row = y - self.stored_rows.start;
            for x in columns.clone() {
                let (color, inverse_depth) = inserted.pixel(x, y);
                let index = row * (self.width + MARGIN) + x;
                if inverse_depth <= self.inverse_depth[index].max(0.0) {
                    continue;
                }
                if color[3] == 255 {
                    self.colors[index] = color;
                    self.inverse_depth[index] = inverse_depth;
                } else {
                    self.rims.push(Rim {
                        pixel: [x as u32, row as u32],
                        color,
                        inverse_depth,
                    });
                }
            }
        }
    }

    /// Returns the opaque colours and inverse depths of a row, counted from the first visible one;
    /// empty if nothing was drawn.
    pub(crate) fn visible_row(&self, row: usize) -> (&[[u8; 4]], &[f32]) {
        let start = (self.rows_above() + row) * (self.width + MARGIN);
        let pixels = start..start + self.width;
        (
            self.colors.get(pixels.clone()).unwrap_or(&[]),
            self.inverse_depth.get(pixels).unwrap_or(&[]),
        )
    }

    /// Returns eight pixels of a visible row, which may extend beyond its end; `None` if nothing
    /// was drawn.
    #[inline]
    pub(crate) fn eight_pixels(
        &self,
        row: usize,
        column: usize,
    ) -> Option<(&[[u8; 4]; 8], &[f32; 8])> {
        let start = (self.rows_above() + row) * (self.width + MARGIN) + column;
        Some((
            self.colors.get(start..)?.first_chunk()?,
            self.inverse_depth.get(start..)?.first_chunk()?,
        ))
    }

    /// Returns all visible rows.
    pub(crate) fn visible_rows(&self) -> impl Iterator<Item = (&[[u8; 4]], &[f32])> {
        let count = if self.is_empty() { 0 } else { self.rows.len() };
        (0..count).map(|row| self.visible_row(row))
    }

    /// Returns the partly covered pixels that no plane hides; within a pixel, mostly far ones
    /// first.
    pub(crate) fn rims(&self) -> &[Rim] {
        &self.rims
    }

    /// Adds a rim to a layer without planes.
    #[cfg(test)]
    pub(super) fn push_rim(&mut self, rim: Rim) {
        self.rims.push(rim);
    }
}
