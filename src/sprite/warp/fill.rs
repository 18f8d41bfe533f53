//! Gap filling after the first pass (S9, C7).

use super::cell::{Coding, VISIBLE};
use fearless_simd::{Simd, f32x16, i32x16, prelude::*, u32x16};

/// Number of cells of a row that are processed together.
const LANES: usize = 16;

/// Buffers of gap filling, reused from frame to frame.
#[derive(Clone, Debug, Default)]
pub(super) struct GapBuffers {
    /// Blocks with gaps, ascending.
    blocks: Vec<CellBlock>,
    /// Blocks that still have gaps after a step.
    open: Vec<CellBlock>,
    /// Start and new cells of the blocks that a step changes.
    filled: Vec<(u32, [u32; LANES])>,
}

/// [`LANES`] consecutive cells of a row, or a whole shorter row. The first block of a row starts
/// with it; the last one ends with it, and overlaps the one before.
#[derive(Clone, Copy, Debug)]
struct CellBlock {
    /// Index of its first cell.
    start: u32,
    /// [`FIRST`] if the row begins with it, [`LAST`] if the row ends with it.
    ends: u32,
}

const FIRST: u32 = 1;
const LAST: u32 = 2;

/// Grows the filled cells into the empty ones by one cell, `steps` times, in rows of `width` cells.
/// An empty cell takes the displacement of a neighbour, extrapolated along that neighbour's slope:
/// visible neighbours before transparent ones, then the one farthest from the target eye, since a
/// gap at a silhouette is a disocclusion of the background. In a gap within a magnified smooth
/// surface all neighbours agree.
#[inline(always)]
pub(super) fn fill<S: Simd>(
    simd: S,
    cells: &mut [u32],
    width: usize,
    coding: &Coding,
    steps: u32,
    gaps: &mut GapBuffers,
) {
    if steps == 0 || width == 0 {
        return;
    }
    find_gaps(simd, cells, width, &mut gaps.blocks);
    let count = LANES.min(width);
    for _ in 0..steps {
        grow(simd, cells, width, coding, gaps);
        for (start, grown) in &gaps.filled {
            let start = *start as usize;
            if let Some(target) = cells
                .get_mut(start..start + LANES)
                .filter(|_| count == LANES)
            {
                target.copy_from_slice(grown);
            } else {
                cells[start..start + count].copy_from_slice(&grown[..count]);
            }
        }
        std::mem::swap(&mut gaps.blocks, &mut gaps.open);
    }
}

/// Collects the blocks with empty cells.
#[inline(always)]
fn find_gaps<S: Simd>(simd: S, cells: &[u32], width: usize, blocks: &mut Vec<CellBlock>) {
    blocks.clear();
    for (y, row) in cells.chunks_exact(width).enumerate() {
        let mut whole = row.chunks_exact(LANES);
        let mut x = 0;
        let ends =
            |x: usize| if x == 0 { FIRST } else { 0 } | if x + LANES >= width { LAST } else { 0 };
        for block in &mut whole {
            if u32x16::from_slice(simd, block).simd_eq(0).any_true() {
                blocks.push(CellBlock {
                    start: (y * width + x) as u32,
                    ends: ends(x),
                });
            }
            x += LANES;
        }
        if whole.remainder().contains(&0) {
            let x = width.saturating_sub(LANES);
            blocks.push(CellBlock {
                start: (y * width + x) as u32,
                ends: ends(x),
            });
        }
    }
}

/// Computes one step into `gaps.filled`, without changing `cells`.
#[inline(always)]
fn grow<S: Simd>(simd: S, cells: &[u32], width: usize, coding: &Coding, gaps: &mut GapBuffers) {
    // Value steps per unit of slope.
    let ratio = coding.slope_scale / coding.scale;
    let count = LANES.min(width);
    let zero = u32x16::splat(simd, 0);
    let lane = u32x16::load_array_ref(simd, &LANE_NUMBERS);
    gaps.filled.clear();
    gaps.open.clear();
    for &block in &gaps.blocks {
        let start = block.start as isize;
        // Cells of other rows are not neighbours.
        let first = if block.ends & FIRST != 0 { 0 } else { u32::MAX };
        let last = if block.ends & LAST != 0 {
            count as u32 - 1
        } else {
            u32::MAX
        };
        let (left, right) = (
            load_lanes(simd, cells, start - 1),
            load_lanes(simd, cells, start + 1),
        );
        let neighbors = [
            (lane.simd_eq(first).select(zero, left), ratio, 8),
            (lane.simd_eq(last).select(zero, right), -ratio, 8),
            (load_lanes(simd, cells, start - width as isize), ratio, 0),
            (load_lanes(simd, cells, start + width as isize), -ratio, 0),
        ];
        let here = load_lanes(simd, cells, start);
        // With the visible bit flipped, the minimum is "visible first, then farthest".
        let none = u32x16::splat(simd, u32::MAX);
        let mut best = none;
        for (cells, ratio, slope_bit) in neighbors {
            let preferred = extrapolate(cells, ratio, slope_bit) ^ VISIBLE;
            best = best.min(cells.simd_eq(0).select(none, preferred));
        }
        let fillable = here.simd_eq(0) & best.simd_ne(u32::MAX);
        if (here.simd_eq(0) & best.simd_eq(u32::MAX)).any_true() {
            gaps.open.push(block);
        }
        if fillable.any_true() {
            gaps.filled.push((
                block.start,
                fillable.select(best ^ VISIBLE, here).to_array(),
            ));
        }
    }
}

/// Lane numbers of a vector.
const LANE_NUMBERS: [u32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Loads [`LANES`] cells from `start`; 0 before the first and after the last cell.
#[inline(always)]
fn load_lanes<S: Simd>(simd: S, all: &[u32], start: isize) -> u32x16<S> {
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

/// Extrapolates cells to their neighbours: `ratio` is the change of the value per unit of slope,
/// `slope_bit` the lowest bit of the slope.
#[inline(always)]
fn extrapolate<S: Simd>(cells: u32x16<S>, ratio: f32, slope_bit: u32) -> u32x16<S> {
    let slope = ((cells.bitcast::<i32x16<S>>() << (24 - slope_bit)) >> 24).to_float::<f32x16<S>>();
    let value = ((cells >> 16) & 0x7fff).to_float::<f32x16<S>>() + (slope * ratio + 0.5);
    let value = value
        .max(1.0)
        .min(32767.0)
        .to_int::<i32x16<S>>()
        .bitcast::<u32x16<S>>();
    (cells & (VISIBLE | 0xffff)) | (value << 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    fn filled(width: usize, mut cells: Vec<u32>, coding: &Coding, steps: u32) -> Vec<u32> {
        dispatch!(Level::new(), simd => fill::<_>(simd, &mut cells, width, coding, steps, &mut GapBuffers::default()));
        cells
    }

    #[test]
    fn gaps_take_background_step_by_step() {
        let coding = Coding::new(0.0, 1.0, 0.0, 1.0);
        let (near, far) = (
            coding.pack(true, 0.9, [0.0; 2]),
            coding.pack(true, 0.1, [0.0; 2]),
        );
        let row = vec![near, 0, 0, 0, 0, 0, 0, far, 0, near];
        for (steps, want) in [
            (0, vec![near, 0, 0, 0, 0, 0, 0, far, 0, near]),
            (1, vec![near, near, 0, 0, 0, 0, far, far, far, near]),
            (2, vec![near, near, near, 0, 0, far, far, far, far, near]),
        ] {
            assert_eq!(
                filled(10, row.clone(), &coding, steps),
                want,
                "{steps} steps"
            );
        }
    }

    #[test]
    fn fill_continues_slope() {
        let coding = Coding::new(0.0, 1.0, 0.1, 1.0);
        let cell = |x: f32| coding.pack(true, 0.2 + 0.01 * x, [0.01, 0.0]);
        let cells = filled(3, vec![cell(0.0), 0, cell(2.0)], &coding, 1);
        let tolerance = 0.51 * (coding.scale + coding.slope_scale);
        assert!((coding.displacement(cells[1], 0.0, 0.0) - 0.21).abs() < tolerance);
    }
}
