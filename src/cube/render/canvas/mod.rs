//! Canvases: the pixels of a band in which splats accumulate, one type for each way of blending.
//!
//! * [`over_canvas`]: kernels that blend each footprint *over* the canvas, in drawing order.
//! * [`surface_canvas`]: tents, averaged per surface; surfaces are then blended.
//! * [`ellipse`]: the same with elliptical Gaussians in floating point.
//! * [`linear`]: blending in linear light.
//! * [`depth`]: the depth of each pixel, next to any canvas.

pub(crate) mod depth;
pub(crate) mod ellipse;
pub mod linear;
pub(crate) mod over_canvas;
pub mod surface_canvas;

use crate::render::footprint::splat::{SplatKernel, Splats};
use crate::render::planes::PlaneLayer;
use ellipse::EllipseCanvas;
use fearless_simd::Level;
use over_canvas::{OverCanvas, SplatShape};
use std::ops::Range;
use surface_canvas::SurfaceCanvas;

/// Difference of inverse depth within which two splats of a pixel belong to one surface.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tolerance {
    /// Fraction of the inverse depth.
    pub(crate) relative: f32,
    /// Lower bound: the width of a depth bin of the capture, 1/m. A grazing, far surface puts
    /// several samples into one LDI pixel, each in a bin of its own; as separate surfaces they
    /// would let the background through.
    pub(crate) least: f32,
}

impl Tolerance {
    /// Returns the tolerated difference at an inverse depth, 1/m.
    #[inline(always)]
    pub(crate) fn difference(self, inverse_depth: f32) -> f32 {
        (inverse_depth * self.relative).max(self.least)
    }
}

/// The pixels of a band, drawn by splats.
///
/// Calls of a band, in order: [`Self::clear`]; drawing of [`Self::background_mut`] and
/// [`Self::set_background`], if there is one; [`Self::draw`] for each batch; [`Self::add_rims`];
/// [`Self::flush`]; then the reading methods.
pub(crate) trait Canvas: Send + Sync {
    /// Clears the canvas for some rows of a frame `width` pixels wide, keeping its memory.
    fn clear(&mut self, width: u32, rows: Range<u32>, tolerance: Tolerance);

    /// Returns the plane textures and inserted geometry behind the splats.
    fn background(&self) -> &PlaneLayer;

    /// Returns the background, to be drawn before [`Self::set_background`].
    fn background_mut(&mut self) -> &mut PlaneLayer;

    /// Initialises the empty canvas from the background. Canvases that read the background
    /// themselves do nothing.
    fn set_background(&mut self) {}

    /// Adds the pixels that the background covers partly: after all splats if depths are compared,
    /// else before them.
    fn add_rims(&mut self, level: Level);

    /// Draws splats, in their order.
    fn draw(&mut self, splats: &Splats, level: Level);

    /// Completes the pixels after the last splat and rim.
    fn flush(&mut self, _level: Level) {}

    /// Writes pixels of a row, counted from the canvas's first, from a column on: straight colour,
    /// and the share of 255 that splats cover; 0 where there are none.
    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], level: Level);

    /// Writes 1 / eye depth of the front surface of the same pixels, 0 where there is none.
    /// Canvases that do not compare depths write nothing.
    fn read_depths(&self, _row: usize, _column: usize, _to: &mut [f32]) {}
}

/// Creates the canvas of a kernel.
pub(crate) fn create(kernel: SplatKernel) -> Box<dyn Canvas> {
    let over = |shape| Box::new(OverCanvas::new(shape));
    match kernel {
        SplatKernel::Tent => Box::<SurfaceCanvas>::default(),
        SplatKernel::Ellipse => Box::<EllipseCanvas>::default(),
        SplatKernel::Paper => over(SplatShape::PaperSquare),
        SplatKernel::Plus => over(SplatShape::Plus),
        SplatKernel::Point => over(SplatShape::Point),
        SplatKernel::Opaque | SplatKernel::Square2 | SplatKernel::Square3 => {
            over(SplatShape::Rectangle)
        }
    }
}
