//! Filling the gaps that the first pass leaves (S9, C7).

use super::field::{Coding, Field, VISIBLE};
use rayon::prelude::*;

/// Rows that one task looks at.
const BAND_ROWS: usize = 32;

/// Grows what was reached by one cell, `steps` times. A gap takes the displacement of a neighbour, continued along that
/// neighbour's slope: of visible neighbours before transparent ones, and of those the one farthest from the target
/// eye, since what a nearer surface uncovers is the background. In a gap that a magnified smooth surface leaves all
/// neighbours agree.
pub(super) fn fill(field: &mut Field, steps: u32) {
    let width = field.width as usize;
    if steps == 0 || width == 0 {
        return;
    }
    let mut gaps = gaps_next_to_cells(field);
    for step in 0..steps {
        let known: &Field = field;
        let found: Vec<(u32, u32)> = if gaps.len() < 4096 {
            gaps.iter().filter_map(|&gap| Some((gap, from_neighbors(known, gap)?))).collect()
        } else {
            gaps.par_iter().with_min_len(1024).filter_map(|&gap| Some((gap, from_neighbors(known, gap)?))).collect()
        };
        for &(gap, cell) in &found {
            field.cells[gap as usize] = cell;
        }
        if step + 1 < steps {
            gaps = gaps_around(field, &found);
        }
    }
}

/// Indices of empty cells in ascending order that have a neighbour to their left, right, above or below which is not.
fn gaps_next_to_cells(field: &Field) -> Vec<u32> {
    let height = field.height as usize;
    if rayon::current_num_threads() == 1 {
        let mut gaps = Vec::new();
        gaps_in_rows(field, 0..height, &mut gaps);
        return gaps;
    }
    let bands: Vec<usize> = (0..height).step_by(BAND_ROWS).collect();
    let gaps_of_band = |first: usize| {
        let mut gaps = Vec::new();
        gaps_in_rows(field, first..(first + BAND_ROWS).min(height), &mut gaps);
        gaps
    };
    bands.into_par_iter().map(gaps_of_band).collect::<Vec<_>>().concat()
}

/// [`gaps_next_to_cells`] in some rows.
fn gaps_in_rows(field: &Field, rows: std::ops::Range<usize>, gaps: &mut Vec<u32>) {
    let (width, height) = (field.width as usize, field.height as usize);
    for y in rows {
        let row = &field.cells[y * width..(y + 1) * width];
        let above = if y > 0 { &field.cells[(y - 1) * width..y * width] } else { row };
        let below = if y + 1 < height { &field.cells[(y + 1) * width..(y + 2) * width] } else { row };
        for (block, cells) in row.chunks(16).enumerate() {
            // No gap is the usual case: found sixteen cells at a time, without a branch between them.
            if !cells.iter().fold(false, |any, &cell| any | (cell == 0)) {
                continue;
            }
            let x0 = block * 16;
            for x in (x0..x0 + cells.len()).filter(|&x| row[x] == 0) {
                let beside = row[x.saturating_sub(1)] | row[(x + 1).min(width - 1)];
                if above[x] | below[x] | beside != 0 {
                    gaps.push((y * width + x) as u32);
                }
            }
        }
    }
}

/// Empty cells beside those just filled, ascending, each once.
fn gaps_around(field: &Field, filled: &[(u32, u32)]) -> Vec<u32> {
    let mut gaps = Vec::new();
    for &(index, _) in filled {
        let (x, y) = (index % field.width, index / field.width);
        let mut visit = |inside: bool, neighbor: u32| {
            if inside && field.cells[neighbor as usize] == 0 {
                gaps.push(neighbor);
            }
        };
        visit(x > 0, index.wrapping_sub(1));
        visit(x + 1 < field.width, index + 1);
        visit(y > 0, index.wrapping_sub(field.width));
        visit(y + 1 < field.height, index + field.width);
    }
    gaps.sort_unstable();
    gaps.dedup();
    gaps
}

/// What the four direct neighbours of a gap say lies there.
fn from_neighbors(field: &Field, gap: u32) -> Option<u32> {
    let (x, y) = (gap % field.width, gap / field.width);
    let neighbors = [
        (x > 0, gap.wrapping_sub(1), 1.0, 0.0),
        (x + 1 < field.width, gap + 1, -1.0, 0.0),
        (y > 0, gap.wrapping_sub(field.width), 0.0, 1.0),
        (y + 1 < field.height, gap + field.width, 0.0, -1.0),
    ];
    let mut best: Option<u32> = None;
    for (inside, index, dx, dy) in neighbors {
        let cell = if inside { field.cells[index as usize] } else { 0 };
        if cell == 0 {
            continue;
        }
        let cell = continued(&field.coding, cell, dx, dy);
        // Flipping the visible bit makes "visible first, then farthest" the least.
        let preferred = best.is_none_or(|best| cell ^ VISIBLE < best ^ VISIBLE);
        best = if preferred { Some(cell) } else { best };
    }
    best
}

/// The same surface a cell further.
fn continued(coding: &Coding, cell: u32, dx: f32, dy: f32) -> u32 {
    let d = coding.displacement(cell, dx, dy);
    let value = (d / coding.scale + coding.zero + 0.5).clamp(1.0, 32767.0) as u32;
    (cell & (VISIBLE | 0xffff)) | (value << 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(width: u32, cells: Vec<u32>, coding: Coding) -> Field {
        let height = cells.len() as u32 / width;
        Field { x0: 0, y0: 0, width, height, cells, coding, range: [0.0, 1.0] }
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
            fill(&mut field, steps);
            assert_eq!(field.cells, want, "{steps} steps");
        }
    }

    #[test]
    fn a_smooth_surface_is_continued_along_its_slope() {
        let coding = Coding::new(0.0, 1.0, 0.1, 1.0);
        let cell = |x: f32| coding.pack(true, 0.2 + 0.01 * x, [0.01, 0.0]);
        let mut field = field(3, vec![cell(0.0), 0, cell(2.0)], coding);
        fill(&mut field, 1);
        assert!(
            (coding.displacement(field.cells[1], 0.0, 0.0) - 0.21).abs() < 0.51 * (coding.scale + coding.slope_scale)
        );
    }
}
