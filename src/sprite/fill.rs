//! Filling the gaps that the first pass leaves (S9, C7).

use super::field::{Field, VISIBLE};
use fearless_simd::{Level, Simd, dispatch, f32x16, i32x16, prelude::*, u32x16};
use rayon::prelude::*;

/// Cells that are looked at together: this many of one row.
const LANES: usize = 16;

/// Blocks below which threads are not worth their start.
const FEW_BLOCKS: usize = 512;

/// Rows that one task looks at.
const BAND_ROWS: usize = 32;

/// What a step does to some blocks.
struct Grown {
    /// Where blocks begin that change, and their cells after the step.
    filled: Vec<(u32, [u32; LANES])>,
    /// Blocks that still have gaps, ascending.
    open: Vec<u32>,
}

/// Grows what was reached by one cell, `steps` times. A gap takes the displacement of a neighbour, continued along that
/// neighbour's slope: of visible neighbours before transparent ones, and of those the one farthest from the target
/// eye, since what a nearer surface uncovers is the background. In a gap that a magnified smooth surface leaves all
/// neighbours agree.
pub(super) fn fill(level: Level, field: &mut Field, steps: u32) {
    let width = field.width as usize;
    if steps == 0 || width == 0 {
        return;
    }
    let mut blocks = blocks_with_gaps(level, field);
    for _ in 0..steps {
        let known: &Field = field;
        let grow = |blocks: &[u32]| dispatch!(level, simd => grown::<_>(simd, known, blocks));
        let found: Vec<Grown> = if blocks.len() < FEW_BLOCKS || rayon::current_num_threads() == 1 {
            vec![grow(&blocks)]
        } else {
            blocks.par_chunks(FEW_BLOCKS / 4).map(grow).collect()
        };
        blocks.clear();
        for (start, cells) in found.iter().flat_map(|grown| &grown.filled) {
            let row_end = (*start as usize / width + 1) * width;
            let target = &mut field.cells[*start as usize..row_end];
            if let Some(target) = target.first_chunk_mut() {
                *target = *cells;
            } else {
                target.copy_from_slice(&cells[..target.len()]);
            }
        }
        found.iter().for_each(|grown| blocks.extend(&grown.open));
    }
}

/// First cells, ascending, of blocks of [`LANES`] cells of which some are empty. Blocks begin with rows; the last of a row
/// ends with it, and shares cells with the one before.
fn blocks_with_gaps(level: Level, field: &Field) -> Vec<u32> {
    let width = field.width as usize;
    let of_band = |(band, cells): (usize, &[u32])| {
        let first = band * BAND_ROWS * width;
        dispatch!(level, simd => gaps_in_rows::<_>(simd, cells, width, first))
    };
    if rayon::current_num_threads() == 1 {
        return of_band((0, &field.cells));
    }
    field.cells.par_chunks(width * BAND_ROWS).enumerate().map(of_band).collect::<Vec<_>>().concat()
}

/// [`blocks_with_gaps`] in whole rows, the first cell of which is number `first`.
#[inline(always)]
fn gaps_in_rows<S: Simd>(simd: S, cells: &[u32], width: usize, first: usize) -> Vec<u32> {
    let mut blocks = Vec::new();
    for (y, row) in cells.chunks_exact(width).enumerate() {
        let mut whole = row.chunks_exact(LANES);
        let mut start = first + y * width;
        for block in &mut whole {
            if u32x16::from_slice(simd, block).simd_eq(0).any_true() {
                blocks.push(start as u32);
            }
            start += LANES;
        }
        let rest = whole.remainder();
        if rest.contains(&0) {
            let shared = if width < LANES { 0 } else { LANES - rest.len() };
            blocks.push((start - shared) as u32);
        }
    }
    blocks
}

/// One step.
#[inline(always)]
fn grown<S: Simd>(simd: S, field: &Field, blocks: &[u32]) -> Grown {
    let (width, height) = (field.width as usize, field.height as usize);
    // Value steps per unit of slope.
    let ratio = field.coding.slope_scale / field.coding.scale;
    let (mut filled, mut open) = (Vec::with_capacity(blocks.len()), Vec::with_capacity(blocks.len()));
    for &block in blocks {
        let start = block as isize;
        let (x, y) = (block as usize % width, block as usize / width);
        let count = LANES.min(width - x);
        let load = |start: isize| lanes(simd, &field.cells, start);
        let zero = u32x16::splat(simd, 0);
        let lane = u32x16::load_array_ref(simd, &LANE_NUMBERS);
        // Cells of other rows are not neighbours.
        let first = if x == 0 { 0 } else { u32::MAX };
        let last = if x + count == width { count as u32 - 1 } else { u32::MAX };
        let (left, right) = (load(start - 1), load(start + 1));
        let neighbors = [
            (lane.simd_eq(first).select(zero, left), ratio, 8),
            (lane.simd_eq(last).select(zero, right), -ratio, 8),
            (if y > 0 { load(start - width as isize) } else { zero }, ratio, 0),
            (if y + 1 < height { load(start + width as isize) } else { zero }, -ratio, 0),
        ];
        let here = load(start);
        // Flipping the visible bit makes "visible first, then farthest" the least.
        let none = u32x16::splat(simd, u32::MAX);
        let mut best = none;
        for (cells, ratio, slope_bit) in neighbors {
            let preferred = continued(cells, ratio, slope_bit) ^ VISIBLE;
            best = best.min(cells.simd_eq(0).select(none, preferred));
        }
        let taken = here.simd_eq(0) & best.simd_ne(u32::MAX);
        if (here.simd_eq(0) & best.simd_eq(u32::MAX)).any_true() {
            open.push(block);
        }
        if taken.any_true() {
            filled.push((block, taken.select(best ^ VISIBLE, here).to_array()));
        }
    }
    Grown { filled, open }
}

/// Numbers of the cells in a vector.
const LANE_NUMBERS: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// [`LANES`] cells from `start`; 0 before the first and beyond the last.
#[inline(always)]
fn lanes<S: Simd>(simd: S, all: &[u32], start: isize) -> u32x16<S> {
    if start >= 0
        && let Some(found) = all.get(start as usize..start as usize + LANES)
    {
        return u32x16::from_slice(simd, found);
    }
    let mut cells = [0; LANES];
    for (lane, cell) in cells.iter_mut().enumerate() {
        let index = usize::try_from(start + lane as isize).ok();
        *cell = index.and_then(|index| all.get(index)).copied().unwrap_or(0);
    }
    u32x16::load_array(simd, cells)
}

/// The same surface a cell further: `ratio` is what a unit of slope changes the value by, `slope_bit` where the slope
/// begins.
#[inline(always)]
fn continued<S: Simd>(cells: u32x16<S>, ratio: f32, slope_bit: u32) -> u32x16<S> {
    let slope = ((cells.bitcast::<i32x16<S>>() << (24 - slope_bit)) >> 24).to_float::<f32x16<S>>();
    let value = ((cells >> 16) & 0x7fff).to_float::<f32x16<S>>() + (slope * ratio + 0.5);
    let value = value.max(1.0).min(32767.0).to_int::<i32x16<S>>().bitcast::<u32x16<S>>();
    (cells & (VISIBLE | 0xffff)) | (value << 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sprite::field::Coding;
    use crate::sprite::patches::Patches;

    fn field(width: u32, cells: Vec<u32>, coding: Coding) -> Field {
        let height = cells.len() as u32 / width;
        Field { x0: 0, y0: 0, width, height, cells, coding, range: [0.0, 1.0], patches: Patches::default() }
    }

    #[test]
    fn gaps_take_the_background_and_grow_step_by_step() {
        let coding = Coding::new(0.0, 1.0, 0.0, 1.0);
        let (near, far) = (coding.pack(true, 0.9, [0.0; 2]), coding.pack(true, 0.1, [0.0; 2]));
        let row = vec![near, 0, 0, 0, 0, 0, 0, far, 0, near];
        for (steps, want) in [
            (0, vec![near, 0, 0, 0, 0, 0, 0, far, 0, near]),
            (1, vec![near, near, 0, 0, 0, 0, far, far, far, near]),
            (2, vec![near, near, near, 0, 0, far, far, far, far, near]),
        ] {
            let mut field = field(10, row.clone(), coding);
            fill(Level::new(), &mut field, steps);
            assert_eq!(field.cells, want, "{steps} steps");
        }
    }

    #[test]
    fn a_smooth_surface_is_continued_along_its_slope() {
        let coding = Coding::new(0.0, 1.0, 0.1, 1.0);
        let cell = |x: f32| coding.pack(true, 0.2 + 0.01 * x, [0.01, 0.0]);
        let mut field = field(3, vec![cell(0.0), 0, cell(2.0)], coding);
        fill(Level::new(), &mut field, 1);
        assert!(
            (coding.displacement(field.cells[1], 0.0, 0.0) - 0.21).abs() < 0.51 * (coding.scale + coding.slope_scale)
        );
    }
}
