//! Depth ranges of blocks of a segment's pixels, for clipping.

use super::packed_depth_pixel::{INVERSE_DEPTH_CODE_MAX, PackedDepthPixel};

/// Columns of a block; blocks start at multiples of that on the face.
pub const BLOCK_COLUMNS: u32 = 64;

/// Rows of a block; blocks start at multiples of that on the face.
pub const BLOCK_ROWS: u32 = 16;

/// Least and largest inverse depth code of every block of [`BLOCK_COLUMNS`] x [`BLOCK_ROWS`] face
/// pixels that a segment's rectangle touches. Computed from the depth pixels, not stored in files;
/// an empty index bounds nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BlockIndex {
    /// Blocks in a row.
    columns: u32,
    first_column: u32,
    first_row: u32,
    /// `[least, largest]`, row-major; least > largest in a block without depth pixels.
    codes: Vec<[u32; 2]>,
}

impl BlockIndex {
    /// Computes the index of a rectangle of face pixels at (`x0`, `y0`). `row` returns the depth
    /// pixels of a row, and the running counts of its pixels.
    pub(crate) fn new<'a>(
        [x0, y0]: [u32; 2],
        [width, height]: [u32; 2],
        row: impl Fn(u32) -> (&'a [PackedDepthPixel], &'a [u32]),
    ) -> Self {
        let blocks = |start: u32, length: u32, size: u32| {
            let end = start.saturating_add(length).div_ceil(size);
            (start / size, end - start / size)
        };
        let (first_column, columns) = blocks(x0, width, BLOCK_COLUMNS);
        let (first_row, rows) = blocks(y0, height, BLOCK_ROWS);
        let mut codes = vec![[u32::MAX, 0]; columns as usize * rows as usize];
        for y in 0..height {
            let (samples, counts) = row(y);
            let first = ((y0 + y) / BLOCK_ROWS - first_row) * columns;
            for (x, ends) in counts.windows(2).enumerate() {
                let block = first + (x0 + x as u32) / BLOCK_COLUMNS - first_column;
                let pixel = samples
                    .get(ends[0] as usize..ends[1] as usize)
                    .unwrap_or(&[]);
                if let Some([least, largest]) = codes.get_mut(block as usize) {
                    for code in pixel.iter().map(|p| p.inverse_depth_code()) {
                        (*least, *largest) = ((*least).min(code), (*largest).max(code));
                    }
                }
            }
        }
        Self {
            columns,
            first_column,
            first_row,
            codes,
        }
    }

    /// Returns the least and largest code in the block of column `x / BLOCK_COLUMNS` and row
    /// `y / BLOCK_ROWS`, or `None` if the block is empty.
    pub(crate) fn codes(&self, column: u32, row: u32) -> Option<[u32; 2]> {
        let inside = column
            .checked_sub(self.first_column)
            .zip(row.checked_sub(self.first_row));
        let found = inside.and_then(|(x, y)| self.codes.get((y * self.columns + x) as usize));
        match found {
            Some([least, largest]) => (least <= largest).then_some([*least, *largest]),
            None => Some([0, INVERSE_DEPTH_CODE_MAX]),
        }
    }
}
