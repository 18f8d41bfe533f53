//! Pictures on planes in a frame: nearest first, each pixel by a homography, with the inverse depth of every pixel (inventory S3,
//! C6, S25, D14).
//!
//! Of a plane both the position on the face times 1/w and the inverse depth in the frame are affine in frame pixels, so that
//! depth is tested before anything else is looked up, and one division a pixel is all that a homography needs.

mod kernel;
mod plan;

pub(crate) use plan::PlanesInView;

use super::linear::LinearLight;
use crate::packed::PlaneSet;
use fearless_simd::Level;
use kernel::Span;
use plan::TileInView;
use std::ops::Range;

/// Inverse depth where nothing is: farther than infinity, which a plane may be at.
pub(crate) const NOWHERE: f32 = -1.0;

/// What planes show in some rows of a frame.
#[derive(Default)]
pub(crate) struct PlaneCanvas {
    /// Straight colour, and the share of 255 that planes cover; 0 for nothing.
    pub(crate) colors: Vec<[u8; 4]>,
    /// 1 / eye depth, 1/m, of the nearest, and [`NOWHERE`].
    pub(crate) inverse_depth: Vec<f32>,
    width: usize,
    first_row: usize,
}

/// Columns that a row has at its end for whole registers.
pub(crate) const MARGIN: usize = kernel::LANES;

impl PlaneCanvas {
    /// Nothing is there.
    pub(crate) fn clear(&mut self) {
        self.colors.clear();
        self.inverse_depth.clear();
    }

    /// True if nothing was drawn.
    pub(crate) fn is_empty(&self) -> bool {
        self.colors.is_empty()
    }

    /// 1 / eye depth, 1/m, of what covers the pixel in a column and row of the frame; `None` outside.
    pub(crate) fn inverse_depth_at(&self, x: usize, y: usize) -> Option<f32> {
        let at = y.checked_sub(self.first_row)? * (self.width + MARGIN) + x;
        self.inverse_depth.get(at).copied().filter(|_| x < self.width)
    }

    /// Draws all that lies in some rows of a frame of `width` columns.
    pub(crate) fn draw(&mut self, set: &PlaneSet, view: &PlanesInView, width: u32, rows: Range<u32>, level: Level) {
        (self.width, self.first_row) = (width as usize, rows.start as usize);
        let stride = self.width + MARGIN;
        self.colors.clear();
        self.colors.resize(stride * rows.len(), [0; 4]);
        self.inverse_depth.clear();
        self.inverse_depth.resize(stride * rows.len(), NOWHERE);
        for tile in &view.tiles {
            let (first, end) = (tile.rows.start.max(rows.start), tile.rows.end.min(rows.end));
            for y in first..end {
                let start = (y - rows.start) as usize * stride;
                let to = start..start + stride;
                self.draw_row(set, view, tile, y, to, level);
            }
        }
    }

    fn draw_row(
        &mut self,
        set: &PlaneSet,
        view: &PlanesInView,
        tile: &TileInView,
        y: u32,
        to: Range<usize>,
        level: Level,
    ) {
        let Some((columns, start, step)) = tile.span(y, &view.frame) else { return };
        let texels = set.texels_at(tile.index as usize, tile.level);
        let span = Span { texels, width: tile.width, height: tile.height, opaque: tile.opaque, columns, start, step };
        let (colors, depths) = (&mut self.colors[to.clone()], &mut self.inverse_depth[to]);
        kernel::draw(&span, bytemuck::cast_slice_mut(colors), depths, LinearLight::tables(), level);
    }

    /// Colours and inverse depths of a row, counted from the first.
    pub(crate) fn row(&self, row: usize) -> (&[[u8; 4]], &[f32]) {
        let start = row * (self.width + MARGIN);
        (&self.colors[start..start + self.width], &self.inverse_depth[start..start + self.width])
    }
}
