//! Splats of one surface are averaged by weight, surfaces are then blended (the default kernel).
//!
//! With *over* alone, a splat that is larger than a pixel blends its rim over neighbours that are drawn already, also
//! where it is a hidden far layer of the next pixel: backgrounds bleed through (C12). So of each pixel the nearest surface is found
//! first; the splats on it are a weighted mean, as bilinear interpolation is. Where that leaves a part of the pixel open, the next surface
//! behind it shows, and behind that all that is left. Splats wait in tiles of the frame until all have come (`piece`), then each
//! tile is peeled at once (`peel`): docs/decisions/0049.

mod mean;
mod peel;
mod piece;
#[cfg(test)]
mod tests;

pub(crate) use mean::{MIN_SHARE, OPAQUE};

use super::linear::LinearLight;
use crate::render::Spans;
use crate::render::footprint::splat::{Canvas, Splats};
use crate::render::footprint::tent;
use crate::render::footprint::tent::{ONE, PEAK_STEPS, Tents};
use crate::render::planes::PlaneCanvas;
use fearless_simd::{Level, Simd, dispatch};
use mean::BLOCK;
use peel::{Peel, Tolerance};
use piece::{Piece, TILE_ROWS};
use std::ops::Range;

/// An image of surfaces.
#[derive(Default)]
pub struct SurfaceCanvas {
    width: u32,
    /// Rows of the frame that it holds.
    rows: Range<u32>,
    ground: PlaneCanvas,
    tents: Box<Tents>,
    /// What is drawn on each tile, row by row of tiles.
    tiles: Vec<Vec<Piece>>,
    peel: Box<Peel>,
    /// What shows in tiles on which something is drawn: straight colours with shares of 255, and inverse depths, in rows of whole tiles.
    colors: Vec<[u8; 4]>,
    inverse_depth: Vec<f32>,
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
    /// docs/decisions/0049.
    pub fn tolerance(face_px: u32) -> f32 {
        0.015 + 3.6 * 2.0 / face_px as f32
    }

    fn tiles_across(&self) -> usize {
        (self.width as usize).div_ceil(BLOCK)
    }

    /// Pixels of a row of tiles.
    fn stride(&self) -> usize {
        self.tiles_across() * BLOCK
    }

    #[inline(always)]
    fn draw_all<S: Simd>(&mut self, simd: S, splats: &Splats) {
        let bounds = [
            [0.0, self.width as f32],
            [self.rows.start as f32, self.rows.end as f32],
        ];
        self.tents.fill(simd, splats, bounds);
        let (first_row, across) = (self.rows.start.cast_signed(), self.tiles_across());
        for i in 0..splats.count() {
            let (columns, rows) = (self.tents.columns.of(i), self.tents.rows.of(i));
            if columns.is_empty() || rows.is_empty() {
                continue;
            }
            let [left, right] = [columns.start, columns.end - 1]
                .map(|column| column.cast_unsigned() as usize / BLOCK);
            let rows = [rows.start, rows.end].map(|row| (row - first_row).cast_unsigned() as usize);
            for down in rows[0] / TILE_ROWS..(rows[1] - 1) / TILE_ROWS + 1 {
                let top = down * TILE_ROWS;
                let mut piece = Piece {
                    across: [0; 2],
                    down: self.tents.rows.from(i, top as i32 + first_row),
                    peak: self.tents.peak[i],
                    color: splats.color[i].to_ne_bytes(),
                    inverse_depth: splats.inverse_depth[i],
                    rows: rows.map(|row| row.clamp(top, top + TILE_ROWS) as u16 - top as u16),
                };
                for column in left..right + 1 {
                    piece.across = self.tents.columns.from(i, (column * BLOCK) as i32);
                    if let Some(tile) = self.tiles.get_mut(down * across + column) {
                        tile.push(piece);
                    }
                }
            }
        }
    }

    /// See [`Canvas::settle`].
    #[inline(always)]
    fn settle_all<S: Simd>(&mut self, simd: S) {
        let (light, across, stride) = (LinearLight::tables(), self.tiles_across(), self.stride());
        let tolerance = Tolerance {
            relative: self.tolerance,
            least: self.bin,
        };
        for (tile, pieces) in self.tiles.iter().enumerate() {
            if pieces.is_empty() {
                continue;
            }
            let (first_row, column) = (tile / across * TILE_ROWS, tile % across * BLOCK);
            let ground = |row: usize| self.ground.eight(first_row + row, column);
            let touched = self.peel.draw(simd, pieces, ground, tolerance, light);
            for row in 0..TILE_ROWS.min(self.rows.len() - first_row) {
                let start = (first_row + row) * stride + column;
                let to = start..start + BLOCK;
                let (colors, inverse_depths) =
                    (&mut self.colors[to.clone()], &mut self.inverse_depth[to]);
                if touched.contains(row) {
                    let shown = self.peel.shown(row);
                    colors.copy_from_slice(&shown.0.map(u32::to_le_bytes));
                    inverse_depths.copy_from_slice(shown.1);
                } else if let Some(shown) = ground(row) {
                    colors.copy_from_slice(shown.0);
                    inverse_depths
                        .iter_mut()
                        .zip(shown.1)
                        .for_each(|(to, q)| *to = q.max(0.0));
                } else {
                    colors.fill([0; 4]);
                    inverse_depths.fill(0.0);
                }
            }
        }
    }

    /// Some columns of a row, in runs of tiles on which something is drawn or not: which, and where they are kept if something is.
    fn pieces(
        &self,
        row: usize,
        columns: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, Option<Range<usize>>)> {
        let (start, tiles) = (row * self.stride(), row / TILE_ROWS * self.tiles_across());
        let of_row = self
            .tiles
            .get(tiles..tiles + self.tiles_across())
            .unwrap_or(&[]);
        let mut next = columns.start;
        std::iter::from_fn(move || {
            let first = next / BLOCK;
            let is_empty = of_row.get(first).filter(|_| next < columns.end)?.is_empty();
            let run = of_row[first..]
                .iter()
                .take_while(|tile| tile.is_empty() == is_empty)
                .count();
            let piece = next..((first + run) * BLOCK).min(columns.end);
            next = piece.end;
            Some((
                piece.clone(),
                (!is_empty).then_some(start + piece.start..start + piece.end),
            ))
        })
    }
}

impl Canvas for SurfaceCanvas {
    fn clear(&mut self, width: u32, rows: Range<u32>) {
        (self.width, self.rows) = (width, rows);
        let tiles = self.tiles_across() * self.rows.len().div_ceil(TILE_ROWS);
        self.tiles.iter_mut().for_each(Vec::clear);
        self.tiles.resize_with(tiles, Vec::new);
        // What they hold does not matter before tiles are settled.
        self.colors.resize(self.stride() * self.rows.len(), [0; 4]);
        self.inverse_depth.resize(self.colors.len(), 0.0);
    }

    fn clear_spans(&mut self, [width, height]: [u32; 2], _: &dyn Fn(u32) -> Spans) {
        self.clear(width, 0..height);
    }

    fn ground(&self) -> &PlaneCanvas {
        &self.ground
    }

    fn ground_mut(&mut self) -> &mut PlaneCanvas {
        &mut self.ground
    }

    /// A rim is a tent that weighs its share in its pixel, and nothing beside it.
    fn add_rims(&mut self, _: Level) {
        let across = self.tiles_across();
        for rim in self.ground.rims() {
            let [column, row] = rim.pixel.map(|line| line as usize);
            let (column_in, row_in) = ((column % BLOCK) as i32, (row % TILE_ROWS) as i32);
            let piece = Piece {
                across: [-column_in * tent::TOP, tent::TOP],
                down: [-row_in * tent::TOP, tent::TOP],
                peak: (u32::from(rim.color[3]) * ONE * PEAK_STEPS + 127) / 255,
                color: rim.color,
                inverse_depth: rim.inverse_depth.max(0.0),
                rows: [row_in as u16, row_in as u16 + 1],
            };
            if let Some(tile) = self
                .tiles
                .get_mut(row / TILE_ROWS * across + column / BLOCK)
            {
                tile.push(piece);
            }
        }
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => self.draw_all(simd, splats));
    }

    fn settle(&mut self, level: Level) {
        dispatch!(level, simd => self.settle_all(simd));
    }

    fn tell_depths(&self, row: usize, column: usize, to: &mut [f32]) {
        let (_, ground) = self.ground.row(row);
        for (piece, kept) in self.pieces(row, column..column + to.len()) {
            let to = &mut to[piece.start - column..piece.end - column];
            match (kept, ground.get(piece)) {
                (Some(kept), _) => to.copy_from_slice(&self.inverse_depth[kept]),
                (None, Some(ground)) => to
                    .iter_mut()
                    .zip(ground)
                    .for_each(|(to, ground)| *to = ground.max(0.0)),
                (None, None) => to.fill(0.0),
            }
        }
    }

    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], _: Level) {
        let (ground, _) = self.ground.row(row);
        for (piece, kept) in self.pieces(row, column..column + to.len()) {
            let to = &mut to[piece.start - column..piece.end - column];
            match (kept, ground.get(piece)) {
                (Some(kept), _) => to.copy_from_slice(&self.colors[kept]),
                (None, Some(ground)) => to.copy_from_slice(ground),
                (None, None) => to.fill([0; 4]),
            }
        }
    }
}
