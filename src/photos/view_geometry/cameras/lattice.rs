//! Positions of the nodes of a frame's grid, in subpixels.

use headbox_core::image::triangle_scan::SUBPIXELS;

/// Grid of nodes over a frame. It extends one cell beyond the frame on every side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Lattice {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    /// Distance between nodes, subpixels.
    pub(crate) spacing: i32,
}

impl Lattice {
    /// Creates the grid for a frame of `width` x `height` pixels.
    pub(crate) fn new(width: u32, height: u32, spacing_px: f32) -> Self {
        // Beyond 256 px a grid shows nothing of use; a spacing below a pixel adds no detail.
        let spacing = (spacing_px.clamp(1.0, 256.0) * SUBPIXELS as f32) as i32;
        let nodes =
            |side: u32| (i64::from(side) * i64::from(SUBPIXELS) / i64::from(spacing)) as u32 + 4;
        Self {
            columns: nodes(width),
            rows: nodes(height),
            spacing,
        }
    }

    /// Returns the number of nodes per pixel, along an axis.
    #[inline]
    pub(crate) fn nodes_per_px(&self) -> f32 {
        SUBPIXELS as f32 / self.spacing as f32
    }

    /// Returns the centre of a node's cell, subpixels.
    #[inline]
    pub(crate) fn cell_centre(&self, column: usize, row: usize) -> [i32; 2] {
        [column, row].map(|number| (number as i32 - 1) * self.spacing)
    }
}
