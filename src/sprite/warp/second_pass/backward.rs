//! Second pass: one visit of each output pixel (Eq. 7, 8; corrected by C5), for all variants that
//! sample backward.

use super::footprints::{BlockLookups, parallax_footprints, plane_footprints};
use super::pixel_block::{PixelBlock, pixels_of_one_level};
use super::sampling::{BLOCK, Footprints, LANES, sample};
use crate::model::shift::ShiftField;
use crate::model::texture::Texture;
use crate::warp::field::Field;
use crate::warp::transfer::SpriteTransfer;
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;

/// Mapping from positions on the plane to positions in the texture.
#[derive(Clone, Copy)]
pub(crate) enum Parallax<'a> {
    /// Identity: homography only (Eq. 3).
    None,
    /// By a displacement: `(x3, y3, 1) + d3 e21` (Eq. 8 with C5).
    Displacement(&'a Field),
    /// Same as `Displacement`, with the first term not divided by its third component, as printed.
    AsPrinted(&'a Field),
    /// Same as `Displacement`, with the epipole at infinity (S8): no division.
    Affine(&'a Field),
    /// By a stored shift (S7, Eq. 9).
    Shift(&'a ShiftField),
}

/// Inputs of a frame.
pub(crate) struct BackwardPlan<'a> {
    pub texture: &'a Texture,
    pub transfer: &'a SpriteTransfer,
    /// Size of a displacement cell in pixels of the image.
    pub cell_px: [f64; 2],
    pub parallax: Parallax<'a>,
}

/// Cells of a displacement or shift field, and their layout.
#[derive(Clone, Copy)]
pub(super) struct Cells<'a> {
    pub(super) cells: &'a [u32],
    pub(super) origin: [i32; 2],
    pub(super) size: [u32; 2],
    /// Upper bound of the absolute displacement; 0 for shift fields.
    pub(super) largest: f32,
}

impl<'a> Cells<'a> {
    /// Returns the cells of a parallax; `None` if it has none.
    pub(super) fn new(parallax: Parallax<'a>) -> Option<Self> {
        match parallax {
            Parallax::None => None,
            Parallax::Displacement(f) | Parallax::AsPrinted(f) | Parallax::Affine(f) => {
                Some(Self {
                    cells: &f.cells,
                    origin: [f.x0, f.y0],
                    size: [f.width, f.height],
                    largest: f.coding.largest(),
                })
            }
            Parallax::Shift(f) => Some(Self {
                cells: &f.cells,
                origin: [f.x0, f.y0],
                size: [f.width, f.height],
                largest: 0.0,
            }),
        }
    }
}

/// Draws every pixel of a frame of `width` columns.
pub(crate) fn backward(
    level: Level,
    plan: &BackwardPlan,
    nearest: bool,
    width: u32,
    pixels: &mut [u32],
) {
    const BAND_ROWS: usize = 16;
    if width == 0 || Cells::new(plan.parallax).is_some_and(|c| c.cells.is_empty()) {
        pixels.fill(0);
        return;
    }
    let draw = |(band, pixels): (usize, &mut [u32])| {
        let first = band * BAND_ROWS;
        if nearest {
            dispatch!(level, simd => draw_band::<_, true>(simd, plan, width as usize, first, pixels));
        } else {
            dispatch!(level, simd => draw_band::<_, false>(simd, plan, width as usize, first, pixels));
        }
    };
    let band_pixels = width as usize * BAND_ROWS;
    if rayon::current_num_threads() == 1 {
        pixels.chunks_mut(band_pixels).enumerate().for_each(draw);
    } else {
        pixels
            .par_chunks_mut(band_pixels)
            .enumerate()
            .for_each(draw);
    }
}

/// Draws the rows of a band, whose first row is `first` of the frame.
#[inline(always)]
fn draw_band<S: Simd, const NEAREST: bool>(
    simd: S,
    plan: &BackwardPlan,
    width: usize,
    first: usize,
    pixels: &mut [u32],
) {
    let cells = Cells::new(plan.parallax);
    let mut footprints = Footprints::new();
    let mut lookups = BlockLookups::new();
    let mut colors = [0; BLOCK];
    // Tile by tile: the next row reads the same cells and texels again, from the first-level cache
    // while rows are short.
    for left in (0..width).step_by(BLOCK) {
        let right = width.min(left + BLOCK);
        for (y, row) in pixels.chunks_mut(width).enumerate() {
            let y = first + y;
            let mut x = left;
            while x < right {
                let pixels = pixels_of_one_level(plan, [x, y], right - x);
                let out = &mut row[x..x + pixels];
                let block = PixelBlock::new(plan, cells, [x, y], pixels);
                x += pixels;
                let Some(block) = block else {
                    out.fill(0);
                    continue;
                };
                let count = pixels.next_multiple_of(LANES);
                if matches!(plan.parallax, Parallax::None) {
                    plane_footprints::<S, NEAREST>(simd, &block, count, &mut footprints);
                } else {
                    parallax_footprints::<S, NEAREST>(
                        simd,
                        plan.parallax,
                        &block,
                        count,
                        &mut lookups,
                        &mut footprints,
                    );
                }
                sample::<S, NEAREST>(simd, plan.texture, &mut footprints, count, &mut colors);
                out.copy_from_slice(&colors[..pixels]);
            }
        }
    }
}
