//! Splats of one surface are averaged by weight, surfaces are then blended (the default kernel).
//!
//! With *over* alone, a splat that is larger than a pixel blends its rim over neighbours that are drawn already, also
//! where it is a hidden far layer of the next pixel: backgrounds bleed through (C12). Here each pixel remembers the inverse depth of its front surface. A splat that lies on it adds to
//! a weighted mean, as bilinear interpolation does; a nearer one first sends the mean behind itself. Because drawing is
//! back to front, pixel of the LDI by pixel, two means and one blended colour behind them are enough.
//! Cell by cell, with branches: docs/decisions.md: surfaces are averaged before they are blended.

mod cell;
mod tiles;

pub(super) use cell::{MIN_SHARE, OPAQUE};

use super::linear::LinearLight;
use super::planes::PlaneCanvas;
use super::size::LANES;
use super::splat::{Canvas, Splats, load};
use super::tent::{ONE, SIDE, SmallWeights, Tents};
use crate::render::Spans;
use cell::{Added, Cell, Second};
use fearless_simd::{Level, Simd, dispatch, prelude::*};
use std::ops::Range;
use tiles::Tiles;

/// An image of surfaces.
#[derive(Default)]
pub(crate) struct SurfaceCanvas {
    width: u32,
    /// Rows of the frame that it holds.
    rows: Range<u32>,
    tiles: Tiles,
    tents: Box<Tents>,
    /// Relative difference of inverse depth up to which two splats of one pixel are of one surface.
    pub(crate) tolerance: f32,
    /// The least difference: the width of a depth bin of the capture, 1/m. A grazing, far surface puts several samples
    /// into one LDI pixel, each in a bin of its own; taken for surfaces behind one another, they let the background
    /// through.
    pub(crate) bin: f32,
}

impl SurfaceCanvas {
    /// The tolerance for faces of `face_px` pixels: 1.5 % for what a capture merges, and the change of depth over one face pixel
    /// of a surface at 74 degrees to the line of sight (2 / `face_px` is a face pixel's angle, tan 74 = 3.6). Other tolerances:
    /// docs/decisions.md: surfaces are averaged before they are blended.
    pub(crate) fn tolerance(face_px: u32) -> f32 {
        0.015 + 3.6 * 2.0 / face_px as f32
    }
}

impl SurfaceCanvas {
    #[inline(always)]
    fn draw_all<S: Simd>(&mut self, simd: S, splats: &Splats) {
        let light = LinearLight::tables();
        let (stride, first_row) = (self.tiles.stride(), self.rows.start as i32);
        let bounds = [[0.0, self.width as f32], [self.rows.start as f32, self.rows.end as f32]];
        self.tents.fill(simd, splats, bounds);
        for start in (0..splats.count()).step_by(LANES) {
            let (small, [nearest_behind, farthest_in_front]) =
                (self.tents.small(simd, start), self.one_surface(simd, splats, start));
            let sixteen = start..splats.count().min(start + LANES);
            let [columns, rows] = self.tents.bounds(sixteen.clone());
            self.tiles.make(
                simd,
                index(columns.start)..index(columns.end),
                index(rows.start - first_row)..index(rows.end - first_row),
            );
            for (lane, i) in sixteen.enumerate() {
                let [columns, rows] = self.tents.pixels(i);
                if columns.is_empty() || rows.is_empty() {
                    continue;
                }
                let added = Added {
                    color: cell::lanes(splats.color[i].to_ne_bytes()),
                    inverse_depth: splats.inverse_depth[i],
                    nearest_behind: nearest_behind[lane],
                    farthest_in_front: farthest_in_front[lane],
                };
                let at = (rows.start - first_row) as usize * stride + columns.start as usize;
                let Some((cells, seconds)) = self.tiles.cells_from(at) else { continue };
                let small = Small { weights: &small, lane, rows: rows.len() };
                match if rows.len() <= SIDE { columns.len() } else { usize::MAX } {
                    1 => small.add::<1>(cells, seconds, stride, &added, light),
                    2 => small.add::<2>(cells, seconds, stride, &added, light),
                    3 => small.add::<3>(cells, seconds, stride, &added, light),
                    SIDE => small.add::<SIDE>(cells, seconds, stride, &added, light),
                    _ => {
                        let of_rows = cells.chunks_mut(stride).take(rows.len()).zip(self.tents.any(i));
                        for (row, (cells, weights)) in of_rows.enumerate() {
                            for (column, (cell, weight)) in
                                cells.iter_mut().take(columns.len()).zip(weights).enumerate()
                            {
                                cell.add(seconds, row * stride + column, &added, weight, light);
                            }
                        }
                    }
                }
            }
        }
    }

    /// See [`Canvas::add_rims`].
    #[inline(always)]
    fn add_all_rims<S: Simd>(&mut self, simd: S) {
        let light = LinearLight::tables();
        for i in 0..self.tiles.ground.rims().len() {
            let rim = self.tiles.ground.rims()[i];
            let q = rim.inverse_depth.max(0.0);
            let apart = (q * self.tolerance).max(self.bin);
            let (nearest_behind, farthest_in_front) = (q - apart, q + apart);
            let added = Added { color: cell::lanes(rim.color), inverse_depth: q, nearest_behind, farthest_in_front };
            let [column, row] = rim.pixel.map(|v| v as usize);
            if let Some((cell, seconds)) = self.tiles.cell_mut(simd, column, row) {
                cell.add(seconds, 0, &added, (u64::from(rim.color[3]) * ONE + 127) / 255, light);
            }
        }
    }

    /// See [`Canvas::resolve`].
    #[inline(always)]
    fn resolve_row<S: Simd>(&self, simd: S, row: usize, column: usize, to: &mut [[u8; 4]]) {
        let (ground, _) = self.tiles.ground.row(row);
        for (piece, cells) in self.tiles.pieces(row, column..column + to.len()) {
            let to = &mut to[piece.start - column..piece.end - column];
            match (cells, ground.get(piece)) {
                (Some((cells, seconds)), _) => cell::resolve(simd, cells, seconds, to),
                (None, Some(ground)) => to.copy_from_slice(ground),
                (None, None) => to.fill([0; 4]),
            }
        }
    }

    /// Of sixteen splats, the inverse depths below and above which another surface lies behind and in front of the splat's.
    #[inline(always)]
    fn one_surface<S: Simd>(&self, simd: S, splats: &Splats, start: usize) -> [[f32; LANES]; 2] {
        let inverse_depth = load(simd, &splats.inverse_depth, start);
        let apart = (inverse_depth * self.tolerance).max(self.bin);
        [(inverse_depth - apart).to_array(), (inverse_depth + apart).to_array()]
    }
}

/// A splat that touches at most [`SIDE`] columns and rows.
struct Small<'a> {
    weights: &'a SmallWeights,
    lane: usize,
    /// Rows that it touches.
    rows: usize,
}

impl Small<'_> {
    /// Adds it to `COLUMNS` cells of each of its rows: a number that is known here, for a loop without an end that no processor
    /// foresees. `cells` begin with its first, in rows of `stride`.
    #[inline(always)]
    fn add<const COLUMNS: usize>(
        &self,
        cells: &mut [Cell],
        seconds: &mut [Second],
        stride: usize,
        added: &Added,
        light: &LinearLight,
    ) {
        for (row, weights) in self.weights.iter().take(self.rows).enumerate() {
            let at = row * stride;
            let Some(cells) = cells.get_mut(at..).and_then(|cells| cells.first_chunk_mut::<COLUMNS>()) else {
                return;
            };
            for (column, (cell, weights)) in cells.iter_mut().zip(weights).enumerate() {
                cell.add(seconds, at + column, added, u64::from(weights[self.lane]), light);
            }
        }
    }
}

/// A column or row that may lie outside, before the first.
#[inline(always)]
fn index(line: i32) -> usize {
    line.max(0) as usize
}

impl Canvas for SurfaceCanvas {
    fn clear(&mut self, width: u32, rows: Range<u32>) {
        (self.width, self.rows) = (width, rows);
        self.tiles.clear(width as usize, self.rows.len());
    }

    fn clear_spans(&mut self, [width, height]: [u32; 2], _: &dyn Fn(u32) -> Spans) {
        self.clear(width, 0..height);
    }

    fn ground(&self) -> &PlaneCanvas {
        &self.tiles.ground
    }

    fn ground_mut(&mut self) -> &mut PlaneCanvas {
        &mut self.tiles.ground
    }

    fn add_rims(&mut self, level: Level) {
        dispatch!(level, simd => self.add_all_rims(simd));
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => self.draw_all(simd, splats));
    }

    fn tell_depths(&self, row: usize, column: usize, to: &mut [f32]) {
        let (_, ground) = self.tiles.ground.row(row);
        for (piece, cells) in self.tiles.pieces(row, column..column + to.len()) {
            let to = &mut to[piece.start - column..piece.end - column];
            match (cells, ground.get(piece)) {
                (Some((cells, _)), _) => to.iter_mut().zip(cells).for_each(|(to, cell)| *to = cell.inverse_depth),
                (None, Some(ground)) => to.iter_mut().zip(ground).for_each(|(to, ground)| *to = ground.max(0.0)),
                (None, None) => to.fill(0.0),
            }
        }
    }

    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], level: Level) {
        dispatch!(level, simd => self.resolve_row(simd, row, column, to));
    }
}
