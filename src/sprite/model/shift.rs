//! The 2-D displacement field (S7): stores the shift that the second pass adds to a position,
//! instead of a displacement.

use crate::warp::field::Field;
use crate::warp::first_pass::pure_parallax::NEAREST_DEPTH_SHARE;
use crate::warp::transfer::SpriteTransfer;
use rayon::prelude::*;

/// Shifts u3 = x1 - x3, v3 = y1 - y3 per cell (S7).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ShiftField {
    pub x0: i32,
    pub y0: i32,
    pub width: u32,
    pub height: u32,
    /// Two signed 16-bit values, u3 in the low half; [`Self::EMPTY`] in cells without a
    /// displacement.
    pub cells: Vec<u32>,
    /// Pixels per unit.
    pub scale: f32,
}

impl ShiftField {
    pub(crate) const EMPTY: u32 = 0x8000_8000;

    /// Computes the shifts at the centres of the cells that the first pass has moved.
    pub(crate) fn new(field: &Field, transfer: &SpriteTransfer, cell_px: [f64; 2]) -> Self {
        let e = -transfer.epipole_in_sprite;
        let shift = |index: usize, cell: u32| {
            let x =
                (f64::from(field.x0) + (index % field.width as usize) as f64 + 0.5) * cell_px[0];
            let y =
                (f64::from(field.y0) + (index / field.width as usize) as f64 + 0.5) * cell_px[1];
            let d = f64::from(field.coding.displacement(cell, 0.0, 0.0));
            let w = (1.0 + d * e.z).max(f64::from(NEAREST_DEPTH_SHARE));
            [
                ((x + d * e.x) / w - x) as f32,
                ((y + d * e.y) / w - y) as f32,
            ]
        };
        let shifts: Vec<[f32; 2]> = field
            .cells
            .par_iter()
            .enumerate()
            .map(|(i, &cell)| shift(i, cell))
            .collect();
        let reached = shifts
            .iter()
            .zip(&field.cells)
            .filter(|(_, cell)| **cell != 0);
        let largest = reached
            .flat_map(|(s, _)| s)
            .fold(0.0f32, |max, s| max.max(s.abs()));
        let scale = if (largest / 32767.0).is_normal() {
            largest / 32767.0
        } else {
            1.0
        };
        let pack = |(shift, &cell): (&[f32; 2], &u32)| {
            let [u, v] = shift
                .map(|s| u32::from((s / scale).round().clamp(-32767.0, 32767.0) as i16 as u16));
            if cell == 0 {
                Self::EMPTY
            } else {
                u | (v << 16)
            }
        };
        let cells = shifts.par_iter().zip(&field.cells).map(pack).collect();
        Self {
            x0: field.x0,
            y0: field.y0,
            width: field.width,
            height: field.height,
            cells,
            scale,
        }
    }
}
