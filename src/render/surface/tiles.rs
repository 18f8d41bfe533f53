//! The pixels of a canvas of surfaces, made tile by tile once something is drawn on them.
//!
//! Where pictures on planes or the environment fill a frame, most pixels never meet a splat. These need no cell: what they show is
//! what the ground under the canvas shows (docs/decisions.md: cells are made where splats come).

use super::cell::{self, Cell, Second};
use crate::render::planes::PlaneCanvas;
use fearless_simd::Simd;
use std::ops::Range;

/// Columns of a tile: as many as are resolved at a time.
pub(super) const TILE_COLUMNS: usize = 16;

/// Rows of a tile.
const TILE_ROWS: usize = 4;

/// Cells of a piece of a row, and what each has beside it.
type MadeCells<'a> = (&'a [Cell], &'a [Second]);

/// Cells of some rows of a frame. A cell that is not made shows what the ground shows.
#[derive(Default)]
pub(super) struct Tiles {
    /// What pictures on planes show; empty if there are none.
    pub(super) ground: PlaneCanvas,
    width: usize,
    /// Row by row, [`Self::stride`] a row, also those that are not made.
    cells: Vec<Cell>,
    /// What each cell has beside it.
    seconds: Vec<Second>,
    /// Of each tile, row by row.
    is_made: Vec<bool>,
}

impl Tiles {
    /// Makes it empty, keeping the memory it has.
    pub(super) fn clear(&mut self, width: usize, rows: usize) {
        self.width = width;
        let (across, down) = (self.tiles_across(), rows.div_ceil(TILE_ROWS));
        // What the cells hold does not matter before they are made.
        self.cells.resize(across * TILE_COLUMNS * down * TILE_ROWS, Cell::default());
        self.seconds.resize(self.cells.len(), Second::default());
        self.is_made.clear();
        self.is_made.resize(across * down, false);
    }

    fn tiles_across(&self) -> usize {
        self.width.div_ceil(TILE_COLUMNS)
    }

    /// Cells of a row.
    pub(super) fn stride(&self) -> usize {
        self.tiles_across() * TILE_COLUMNS
    }

    /// The cells from one on, with what they have beside them.
    #[inline]
    pub(super) fn cells_from(&mut self, at: usize) -> Option<(&mut [Cell], &mut [Second])> {
        Some((self.cells.get_mut(at..)?, self.seconds.get_mut(at..)?))
    }

    /// Makes the cells in some columns and rows.
    #[inline(always)]
    pub(super) fn make<S: Simd>(&mut self, simd: S, columns: Range<usize>, rows: Range<usize>) {
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let across = self.tiles_across();
        for down in rows.start / TILE_ROWS..rows.end.div_ceil(TILE_ROWS) {
            let (start, end) = (columns.start / TILE_COLUMNS, columns.end.div_ceil(TILE_COLUMNS));
            for tile in down * across + start..down * across + end {
                if self.is_made.get(tile) == Some(&false) {
                    self.make_tile(simd, tile);
                }
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn make_tile<S: Simd>(&mut self, simd: S, tile: usize) {
        simd.vectorize(
            #[inline(always)]
            || self.make_tile_at(simd, tile),
        );
    }

    #[inline(always)]
    fn make_tile_at<S: Simd>(&mut self, simd: S, tile: usize) {
        self.is_made[tile] = true;
        let (across, stride) = (self.tiles_across(), self.stride());
        let (first_row, column) = (tile / across * TILE_ROWS, tile % across * TILE_COLUMNS);
        for row in first_row..first_row + TILE_ROWS {
            let start = row * stride + column;
            let Some(cells) = self.cells.get_mut(start..).and_then(|cells| cells.first_chunk_mut()) else { return };
            match self.ground.sixteen(row, column) {
                Some((colors, inverse_depths)) => *cells = cell::of_ground(simd, colors, inverse_depths),
                None => *cells = [Cell::default(); TILE_COLUMNS],
            }
        }
    }

    /// The cell of a pixel, made if it is not, and the second surfaces from its own on.
    #[inline(always)]
    pub(super) fn cell_mut<S: Simd>(
        &mut self,
        simd: S,
        column: usize,
        row: usize,
    ) -> Option<(&mut Cell, &mut [Second])> {
        if column >= self.width {
            return None;
        }
        self.make(simd, column..column + 1, row..row + 1);
        let stride = self.stride();
        let at = row * stride + column;
        self.cells.get_mut(at).zip(self.seconds.get_mut(at..))
    }

    /// Some columns of a row, in runs of tiles that are made or not: which, and their cells with what these have beside them if they are
    /// made.
    pub(super) fn pieces(
        &self,
        row: usize,
        columns: Range<usize>,
    ) -> impl Iterator<Item = (Range<usize>, Option<MadeCells<'_>>)> {
        let (start, tiles) = (row * self.stride(), row / TILE_ROWS * self.tiles_across());
        let of_row = self.is_made.get(tiles..tiles + self.tiles_across()).unwrap_or(&[]);
        let mut next = columns.start;
        std::iter::from_fn(move || {
            let first = next / TILE_COLUMNS;
            let is_made = *of_row.get(first).filter(|_| next < columns.end)?;
            let run = of_row[first..].iter().take_while(|made| **made == is_made).count();
            let piece = next..((first + run) * TILE_COLUMNS).min(columns.end);
            next = piece.end;
            let of_piece = start + piece.start..start + piece.end;
            let both = self.cells.get(of_piece.clone()).zip(self.seconds.get(of_piece));
            let cells = is_made.then_some(both).flatten();
            Some((piece, cells))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::random::Rng;
    use fearless_simd::{Level, dispatch};

    #[test]
    fn what_is_asked_for_is_made_and_its_tiles_alone() {
        let (mut random, level, mut tiles) = (Rng::keyed(7), Level::new(), Tiles::default());
        for (width, rows) in [(1, 1), (16, 4), (17, 5), (83, 31)] {
            for _ in 0..50 {
                tiles.clear(width, rows);
                let mut some_of = |end: usize| {
                    let first = random.below(end as u64) as usize;
                    first..first + 1 + random.below((end - first) as u64) as usize
                };
                let (columns, down) = (some_of(width), some_of(rows));
                dispatch!(level, simd => tiles.make(simd, columns.clone(), down.clone()));
                let tiles_of =
                    |lines: &Range<usize>, side: usize| lines.start / side * side..lines.end.next_multiple_of(side);
                let (made_columns, made_rows) = (tiles_of(&columns, TILE_COLUMNS), tiles_of(&down, TILE_ROWS));
                for row in 0..rows {
                    let mut next = 0;
                    for (piece, cells) in tiles.pieces(row, 0..width) {
                        assert_eq!(piece.start, next);
                        assert!(cells.is_none_or(|(cells, _)| cells.len() == piece.len()));
                        next = piece.end;
                        for column in piece {
                            let is_made = made_columns.contains(&column) && made_rows.contains(&row);
                            assert_eq!(cells.is_some(), is_made, "{column}, {row} of {columns:?}, {down:?}");
                        }
                    }
                    assert_eq!(next, width);
                }
            }
        }
    }
}
