//! Canvas that averages the splats of one surface by weight, and blends surfaces (the default
//! kernel).
//!
//! With *over* alone, a splat larger than a pixel blends its rim over adjacent splats that are
//! already drawn, also where it is a hidden far layer of the next pixel: backgrounds bleed through
//! (C12). Therefore the nearest surface of each pixel is found first; its colour is the weighted
//! mean of its splats, as in bilinear interpolation. Where it leaves part of the pixel open, the
//! next surface behind it is visible, and behind that everything else. Splats are queued in tiles
//! (`tile_splat`) until a band is complete; then each tile is peeled (`peel`) and resolved
//! (`mean`): docs/decisions/0049. Pixels among the samples of a surface are covered
//! (`surroundings`).

mod mean;
mod peel;
mod surroundings;
#[cfg(test)]
mod tests;
mod tile_splat;

pub(crate) use mean::{OPAQUE, RAMP_START};

use super::linear::LinearLight;
use super::{Canvas, Tolerance};
use crate::render::footprint::splat::Splats;
use crate::render::footprint::tent;
use crate::render::footprint::tent::{ONE, PEAK_STEPS, Tents};
use crate::render::planes::PlaneLayer;
use fearless_simd::{Level, Simd, dispatch};
use mean::BLOCK;
use peel::Peel;
use std::ops::Range;
use tile_splat::{SplatKind, TILE_ROWS, TileSplat};

/// Canvas of tents, averaged per surface.
#[derive(Default)]
pub struct SurfaceCanvas {
    width: u32,
    /// Rows of the frame.
    rows: Range<u32>,
    background: PlaneLayer,
    tolerance: Tolerance,
    tents: Box<Tents>,
    /// Queued splats of each tile, row-major.
    tiles: Vec<Vec<TileSplat>>,
    peel: Box<Peel>,
    /// Resolved tiles with splats: straight colours with coverage, 0..255, in rows of whole tiles.
    colors: Vec<[u8; 4]>,
    /// 1 / eye depth of the front surface of the same pixels, 1/m.
    inverse_depth: Vec<f32>,
}

impl SurfaceCanvas {
    /// Returns the relative difference of inverse depth within which two splats of a pixel belong
    /// to one surface, for faces of `face_px` pixels: 1.5 %, within which a capture merges samples,
    /// and the change of depth over one face pixel of a surface at 74 degrees to the line of sight
    /// (2 / `face_px` is a face pixel's angle, tan 74 = 3.6). Other values: docs/decisions/0049.
    pub fn tolerance(face_px: u32) -> f32 {
        0.015 + 3.6 * 2.0 / face_px as f32
    }

    fn tiles_across(&self) -> usize {
        (self.width as usize).div_ceil(BLOCK)
    }

    /// Pixels in a row of whole tiles.
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
        let first_row = self.rows.start.cast_signed();
        let tiles_across = self.tiles_across();
        for i in 0..splats.count() {
            let columns = self.tents.columns.touched(i);
            let rows = self.tents.rows.touched(i);
            if columns.is_empty() || rows.is_empty() {
                continue;
            }
            let [left, right] = [columns.start, columns.end - 1]
                .map(|column| column.cast_unsigned() as usize / BLOCK);
            let rows = [rows.start, rows.end].map(|row| (row - first_row).cast_unsigned() as usize);
            let [r, g, b, alpha] = splats.color[i].to_ne_bytes();
            let kind = if alpha == u8::MAX {
                SplatKind::Opaque
            } else {
                SplatKind::Translucent
            };
            for down in rows[0] / TILE_ROWS..(rows[1] - 1) / TILE_ROWS + 1 {
                let top = down * TILE_ROWS;
                let mut tile_splat = TileSplat {
                    across: [0; 2],
                    down: self.tents.rows.starting_at(i, top as i32 + first_row),
                    peak: self.tents.peak[i],
                    color: [r, g, b],
                    kind,
                    inverse_depth: splats.inverse_depth[i],
                    rows: rows.map(|row| row.clamp(top, top + TILE_ROWS) as u16 - top as u16),
                };
                for column in left..right + 1 {
                    tile_splat.across = self.tents.columns.starting_at(i, (column * BLOCK) as i32);
                    if let Some(tile) = self.tiles.get_mut(down * tiles_across + column) {
                        tile.push(tile_splat);
                    }
                }
            }
        }
    }

    /// Peels and resolves all tiles with splats.
    #[inline(always)]
    fn peel_all<S: Simd>(&mut self, simd: S) {
        let light = LinearLight::tables();
        let tiles_across = self.tiles_across();
        let stride = self.stride();
        for (tile, splats) in self.tiles.iter().enumerate() {
            if splats.is_empty() {
                continue;
            }
            let first_row = tile / tiles_across * TILE_ROWS;
            let column = tile % tiles_across * BLOCK;
            let background = |row: usize| self.background.eight_pixels(first_row + row, column);
            let touched = self
                .peel
                .draw(simd, splats, background, self.tolerance, light);
            for row in 0..TILE_ROWS.min(self.rows.len() - first_row) {
                let start = (first_row + row) * stride + column;
                let block = start..start + BLOCK;
                let colors = &mut self.colors[block.clone()];
                let inverse_depths = &mut self.inverse_depth[block];
                if touched.contains(row) {
                    let peeled = self.peel.result(row);
                    colors.copy_from_slice(&peeled.0.map(u32::to_le_bytes));
                    inverse_depths.copy_from_slice(peeled.1);
                } else if let Some(background) = background(row) {
                    colors.copy_from_slice(background.0);
                    inverse_depths
                        .iter_mut()
                        .zip(background.1)
                        .for_each(|(to, q)| *to = q.max(0.0));
                } else {
                    colors.fill([0; 4]);
                    inverse_depths.fill(0.0);
                }
            }
        }
    }

    /// Splits columns of a row into runs of tiles with and without splats. Yields the columns of
    /// each run, and the indices of its resolved pixels if it has splats.
    fn tile_runs(
        &self,
        row: usize,
        columns: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, Option<Range<usize>>)> {
        let start = row * self.stride();
        let tiles = row / TILE_ROWS * self.tiles_across();
        let tiles = self
            .tiles
            .get(tiles..tiles + self.tiles_across())
            .unwrap_or(&[]);
        let mut next = columns.start;
        std::iter::from_fn(move || {
            let first = next / BLOCK;
            let is_empty = tiles.get(first).filter(|_| next < columns.end)?.is_empty();
            let count = tiles[first..]
                .iter()
                .take_while(|tile| tile.is_empty() == is_empty)
                .count();
            let run = next..((first + count) * BLOCK).min(columns.end);
            next = run.end;
            Some((
                run.clone(),
                (!is_empty).then_some(start + run.start..start + run.end),
            ))
        })
    }
}

impl Canvas for SurfaceCanvas {
    fn clear(&mut self, width: u32, rows: Range<u32>, tolerance: Tolerance) {
        self.width = width;
        self.rows = rows;
        self.tolerance = tolerance;
        let tiles = self.tiles_across() * self.rows.len().div_ceil(TILE_ROWS);
        self.tiles.iter_mut().for_each(Vec::clear);
        self.tiles.resize_with(tiles, Vec::new);
        // Overwritten when tiles are peeled.
        self.colors.resize(self.stride() * self.rows.len(), [0; 4]);
        self.inverse_depth.resize(self.colors.len(), 0.0);
    }

    fn background(&self) -> &PlaneLayer {
        &self.background
    }

    fn background_mut(&mut self) -> &mut PlaneLayer {
        &mut self.background
    }

    /// Queues each rim as a tent of one pixel whose weight is the rim's coverage.
    fn add_rims(&mut self, _: Level) {
        let tiles_across = self.tiles_across();
        for rim in self.background.rims() {
            let [column, row] = rim.pixel.map(|line| line as usize);
            let tile_column = (column % BLOCK) as i32;
            let tile_row = (row % TILE_ROWS) as i32;
            let [r, g, b, alpha] = rim.color;
            let tile_splat = TileSplat {
                across: [-tile_column * tent::TOP, tent::TOP],
                down: [-tile_row * tent::TOP, tent::TOP],
                peak: (u32::from(alpha) * ONE * PEAK_STEPS + 127) / 255,
                color: [r, g, b],
                kind: SplatKind::Rim,
                inverse_depth: rim.inverse_depth.max(0.0),
                rows: [tile_row as u16, tile_row as u16 + 1],
            };
            if let Some(tile) = self
                .tiles
                .get_mut(row / TILE_ROWS * tiles_across + column / BLOCK)
            {
                tile.push(tile_splat);
            }
        }
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => self.draw_all(simd, splats));
    }

    fn flush(&mut self, level: Level) {
        dispatch!(level, simd => self.peel_all(simd));
    }

    fn read_depths(&self, row: usize, column: usize, to: &mut [f32]) {
        let (_, background) = self.background.visible_row(row);
        for (run, resolved) in self.tile_runs(row, column..column + to.len()) {
            let to = &mut to[run.start - column..run.end - column];
            match (resolved, background.get(run)) {
                (Some(resolved), _) => to.copy_from_slice(&self.inverse_depth[resolved]),
                (None, Some(background)) => to
                    .iter_mut()
                    .zip(background)
                    .for_each(|(to, background)| *to = background.max(0.0)),
                (None, None) => to.fill(0.0),
            }
        }
    }

    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], _: Level) {
        let (background, _) = self.background.visible_row(row);
        for (run, resolved) in self.tile_runs(row, column..column + to.len()) {
            let to = &mut to[run.start - column..run.end - column];
            match (resolved, background.get(run)) {
                (Some(resolved), _) => to.copy_from_slice(&self.colors[resolved]),
                (None, Some(background)) => to.copy_from_slice(background),
                (None, None) => to.fill([0; 4]),
            }
        }
    }
}
