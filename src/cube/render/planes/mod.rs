//! Pictures on planes in a frame: nearest first, each pixel by a homography, with the inverse depth of every pixel (inventory S3,
//! C6, S25, D14); and what else stands there ([`Standing`]), such as polygons.
//!
//! Of a plane both the position on the face times 1/w and the inverse depth in the frame are affine in frame pixels, so that
//! depth is tested before anything else is looked up, and one division a pixel is all that a homography needs.

mod kernel;
mod plan;
#[cfg(test)]
mod tests;

pub(crate) use plan::PlanesInView;

use crate::pack::PlaneSet;
use fearless_simd::Level;
use kernel::Rows;
use std::ops::Range;

/// Inverse depth where nothing is: farther than infinity, which a plane may be at.
pub(crate) const NOWHERE: f32 = -1.0;

/// What planes show in some rows of a frame.
#[derive(Default)]
pub(crate) struct PlaneCanvas {
    /// Straight colour where a plane, or what stands there, hides its pixel wholly, and 255; 0 for nothing.
    colors: Vec<[u8; 4]>,
    /// 1 / eye depth, 1/m, of what hides its pixel wholly, and [`NOWHERE`].
    inverse_depth: Vec<f32>,
    rims: Vec<Rim>,
    width: usize,
    /// Rows of the frame that it shows.
    rows: Range<usize>,
    /// Rows of the frame that it holds: some beside those too, where splats have their middles that reach into these.
    held: Range<usize>,
    /// How much farther than what hides its pixel a splat may be to be drawn, as a share.
    tolerance: f32,
}

/// A pixel that a plane covers in part. What lies behind may be samples, which come later, so that it is blended last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rim {
    /// Column, and row counted from the canvas's first.
    pub(crate) pixel: [u32; 2],
    /// Straight colour, and the share of 255 that it covers.
    pub(crate) color: [u8; 4],
    /// 1 / eye depth, 1/m.
    pub(crate) inverse_depth: f32,
}

/// What else stands in a frame, drawn by somebody else (S25).
#[derive(Clone, Debug)]
pub struct Standing<'a> {
    /// Columns and rows of the frame that the pixels below are, row-major.
    pub window: [Range<usize>; 2],
    /// Straight colours, sRGB, and the share of 255 that each covers of its pixel.
    pub colors: &'a [[u8; 4]],
    /// 1 / eye depth, 1/m; 0 where nothing stands.
    pub inverse_depth: &'a [f32],
}

impl Standing<'_> {
    /// Colour and inverse depth in a column and row of the frame; zeros where nothing stands.
    pub fn pixel(&self, x: usize, y: usize) -> ([u8; 4], f32) {
        let [columns, rows] = &self.window;
        let at = |i: usize| Some((*self.colors.get(i)?, *self.inverse_depth.get(i)?));
        let is_inside = columns.contains(&x) && rows.contains(&y);
        let index = is_inside.then(|| (y - rows.start) * columns.len() + x - columns.start);
        index.and_then(at).unwrap_or_default()
    }
}

/// Columns that a row has at its end for whole registers.
const MARGIN: usize = headbox_core::texels::LANES;

/// Rows beside those shown that are held where splats are judged by what hides their middles.
pub(crate) const ROWS_BESIDE: u32 = 5;

/// Splats of a larger radius, pixels, are judged pixel by pixel, as their middles may lie in no row that is held: bands of one frame would
/// not agree. A footprint is moved by up to a pixel onto the grid.
pub(crate) const LARGEST_BY_MIDDLE_PX: f32 = ROWS_BESIDE as f32 - 1.0;

impl PlaneCanvas {
    /// Nothing is there.
    pub(crate) fn clear(&mut self) {
        self.colors.clear();
        self.inverse_depth.clear();
        self.rims.clear();
    }

    /// True if nothing was drawn.
    pub(crate) fn is_empty(&self) -> bool {
        self.colors.is_empty()
    }

    /// Whether what is `inverse_depth` away (1/m) is hidden in the column and row of the frame that hold a position, or those of the frame
    /// that are next to it.
    #[inline]
    pub(crate) fn hides(&self, [x, y]: [f32; 2], inverse_depth: f32) -> bool {
        // Casts saturate: what is above or on the left is in the first.
        let column = (x as usize).min(self.width.saturating_sub(1));
        let row = (y as usize)
            .max(self.held.start)
            .min(self.held.end.saturating_sub(1));
        let there = self
            .inverse_depth
            .get(row.wrapping_sub(self.held.start) * (self.width + MARGIN) + column);
        there.is_some_and(|there| inverse_depth * (1.0 + self.tolerance) < *there)
    }

    /// Draws all that lies in some rows of a frame, and what stands there; and in `beside` more rows above and below what hides splats
    /// that are farther by more than a share of `tolerance`.
    pub(crate) fn draw(
        &mut self,
        set: &PlaneSet,
        view: &PlanesInView,
        standing: Option<&Standing>,
        (rows, beside): (Range<u32>, u32),
        tolerance: f32,
        level: Level,
    ) {
        let [width, height] = view.size_px();
        (self.width, self.tolerance) = (width as usize, tolerance);
        self.rows = rows.start as usize..rows.end as usize;
        let rows = rows.start.saturating_sub(beside)..rows.end.saturating_add(beside).min(height);
        self.held = rows.start as usize..rows.end as usize;
        let stride = self.width + MARGIN;
        self.clear();
        self.colors.resize(stride * rows.len(), [0; 4]);
        self.inverse_depth.resize(stride * rows.len(), NOWHERE);
        let mut to = Rows {
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
                set.texels_at(tile.index as usize, tile.level),
                &mut to,
                level,
            );
        }
        if let Some(standing) = standing {
            self.stand(standing);
        }
        let (depths, at) = (&self.inverse_depth, |[column, row]: [u32; 2]| {
            row as usize * stride + column as usize
        });
        let (above, shown) = (self.above() as u32, self.rows.len() as u32);
        self.rims.retain_mut(|rim| {
            let is_seen = depths
                .get(at(rim.pixel))
                .is_some_and(|depth| rim.inverse_depth > *depth);
            rim.pixel[1] = rim.pixel[1].wrapping_sub(above);
            is_seen && rim.pixel[1] < shown
        });
        // Nearest tiles came first.
        self.rims.reverse();
    }

    /// Rows that are held above those shown.
    fn above(&self) -> usize {
        self.rows.start - self.held.start
    }

    /// Puts what stands in the frame where it is nearer than the planes: over them, or, where it covers a pixel in part, among what is
    /// blended last.
    fn stand(&mut self, standing: &Standing) {
        let [columns, rows] = &standing.window;
        let columns = columns.start..columns.end.min(self.width);
        for y in rows.start.max(self.held.start)..rows.end.min(self.held.end) {
            let row = y - self.held.start;
            for x in columns.clone() {
                let (color, nearness) = standing.pixel(x, y);
                let at = row * (self.width + MARGIN) + x;
                if nearness <= self.inverse_depth[at].max(0.0) {
                    continue;
                }
                match color[3] {
                    255 => (self.colors[at], self.inverse_depth[at]) = (color, nearness),
                    _ => self.rims.push(Rim {
                        pixel: [x as u32, row as u32],
                        color,
                        inverse_depth: nearness,
                    }),
                }
            }
        }
    }

    /// Colours and inverse depths of a row, counted from the first that is shown, of what hides its pixel wholly. Empty if nothing was drawn.
    pub(crate) fn row(&self, row: usize) -> (&[[u8; 4]], &[f32]) {
        let start = (self.above() + row) * (self.width + MARGIN);
        let pixels = start..start + self.width;
        (
            self.colors.get(pixels.clone()).unwrap_or(&[]),
            self.inverse_depth.get(pixels).unwrap_or(&[]),
        )
    }

    /// Eight pixels of a row, also where the row ends among them; `None` if nothing was drawn.
    #[inline]
    pub(crate) fn eight(&self, row: usize, column: usize) -> Option<(&[[u8; 4]; 8], &[f32; 8])> {
        let start = (self.above() + row) * (self.width + MARGIN) + column;
        Some((
            self.colors.get(start..)?.first_chunk()?,
            self.inverse_depth.get(start..)?.first_chunk()?,
        ))
    }

    /// All rows that are shown.
    pub(crate) fn rows(&self) -> impl Iterator<Item = (&[[u8; 4]], &[f32])> {
        let count = if self.is_empty() { 0 } else { self.rows.len() };
        (0..count).map(|row| self.row(row))
    }

    /// What covers its pixel in part, and is not hidden by planes; of a pixel, mostly far ones first.
    pub(crate) fn rims(&self) -> &[Rim] {
        &self.rims
    }
}
