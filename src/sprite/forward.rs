//! First pass: moving displacements by pure parallax (Eq. 6), d1(x1, y1) to d3(x3, y3) with d3 = d1 / w3 (C5).
//!
//! Tiles that lie on planes ([`super::patches`]) are drawn whole, as the parallelograms that they become; the cells of
//! all others go one by one. On the benchmark's hemisphere of 256 x 256 cells the tiles, nine tenths of the field, take 46 us, the
//! 404 blocks of cells 35 us; cells alone took 165 us. Tried and lost: drawing every cell that is magnified by more than
//! 1.05 as a patch (90 us more, where a step of filling closes the same gaps).

use super::field::{Coding, Field, VISIBLE, slopes};
use super::patches::{BLOCK_SIDE, GROUP, PatchGroup, TILE};
use super::sampling::{COPIES, LANE_NUMBERS};
use super::transfer::Transfer;
use fearless_simd::{Level, Simd, dispatch, f32x16, i32x16, prelude::*, u8x64, u32x4, u32x16};
use rayon::prelude::*;

/// A surface point whose depth from the target eye is less than this share of its plane's is not drawn: it would be
/// magnified beyond use, and at 0 it is behind the eye.
pub(super) const NEAREST_DEPTH_SHARE: f32 = 1.0 / 16.0;

/// What the first pass stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stored {
    /// d1 / w3: right with a first term of the second pass that is divided by its third component (C5).
    Corrected,
    /// d1: as equation (7) and (8) are printed.
    AsPrinted,
}

/// Pure parallax in units of displacement cells.
struct Parallax {
    epipole: [f32; 3],
    stored: Stored,
    /// Added to the column (row) of a cell in the source to find it in the output.
    origin: [f32; 2],
    width: f32,
    height: f32,
    /// By how much displacements leave their patches' planes.
    tolerance: f32,
    source_coding: Coding,
    encoding: Encoding,
}

/// A [`Coding`] as reciprocals, for packing.
struct Encoding {
    steps_per_unit: f32,
    /// Value of zero, and the half that makes truncation round to nearest.
    rounded_zero: f32,
    slopes_per_unit: f32,
}

impl Encoding {
    fn of(coding: &Coding) -> Self {
        Self {
            steps_per_unit: 1.0 / coding.scale,
            rounded_zero: coding.zero + 0.5,
            slopes_per_unit: 1.0 / coding.slope_scale,
        }
    }
}

/// Displacements between which w3 = 1 + d * epipole_z stays at least [`NEAREST_DEPTH_SHARE`].
fn in_front([low, high]: [f32; 2], epipole_z: f32) -> [f32; 2] {
    let limit = (NEAREST_DEPTH_SHARE - 1.0) / epipole_z;
    if epipole_z > 0.0 {
        [low.max(limit), high.max(limit)]
    } else if epipole_z < 0.0 {
        [low.min(limit), high.min(limit)]
    } else {
        [low, high]
    }
}

/// Where position `x` goes at displacement `d`.
fn moved(x: f32, d: f32, epipole: f32, epipole_z: f32) -> f32 {
    (x + d * epipole) / (1.0 + d * epipole_z)
}

/// First and last cell that positions 0 to `length` can reach, at most one `length` beyond either end.
fn reach(length: u32, range: [f32; 2], epipole: f32, epipole_z: f32) -> [i32; 2] {
    let length = length as f32;
    let ends = [0.0, length].into_iter().flat_map(|x| range.map(|d| moved(x, d, epipole, epipole_z)));
    let [low, high] = ends.fold([0.0, length], |[low, high]: [f32; 2], x| [low.min(x), high.max(x)]);
    [low.max(-length).floor() as i32, high.min(2.0 * length).ceil() as i32]
}

/// Moves `source` (the sprite's d1) into `out`, which takes the size that the parallax needs. `cell_px` is the size of a
/// cell in pixels. A pure function of its input: bands of rows are only a matter of threads.
pub(super) fn forward(
    level: Level,
    source: &Field,
    transfer: &Transfer,
    cell_px: [f64; 2],
    stored: Stored,
    out: &mut Field,
) {
    let e = transfer.epipole_in_sprite;
    let epipole = [(e.x / cell_px[0]) as f32, (e.y / cell_px[1]) as f32, e.z as f32];
    let range = in_front(source.range, epipole[2]);
    let [x0, x1] = reach(source.width, range, epipole[0], epipole[2]);
    let [y0, y1] = reach(source.height, range, epipole[1], epipole[2]);
    (out.x0, out.y0) = (x0, y0);
    (out.width, out.height) = ((x1 - x0) as u32, (y1 - y0) as u32);
    let share = |d: f32| if stored == Stored::Corrected { d / (1.0 + d * epipole[2]) } else { d };
    let [a, b] = range.map(share);
    let shallowest = range.map(|d| 1.0 + d * epipole[2]).into_iter().fold(1.0, f32::min);
    let steepest = 127.0 * source.coding.slope_scale / shallowest * 1.25;
    out.coding = Coding::new(a.min(b), a.max(b), steepest, transfer.side as f32);
    let origin = [-x0 as f32, -y0 as f32];
    let parallax = Parallax {
        epipole,
        stored,
        origin,
        width: out.width as f32,
        height: out.height as f32,
        tolerance: source.patches.tolerance,
        source_coding: source.coding,
        encoding: Encoding::of(&out.coding),
    };

    let width = out.width as usize;
    out.cells.clear();
    out.cells.resize(width * out.height as usize, 0);
    let band_rows = (out.height as usize).div_ceil(rayon::current_num_threads()).max(1);
    let move_band = |(band, cells): (usize, &mut [u32])| {
        let rows = [band * band_rows, band * band_rows + cells.len() / width];
        dispatch!(level, simd => forward_band(simd, source, &parallax, range, rows, cells));
    };
    if band_rows >= out.height as usize {
        move_band((0, &mut out.cells));
    } else {
        out.cells.par_chunks_mut(width * band_rows).enumerate().for_each(move_band);
    }
}

/// Moves everything that lands in the rows `first..end` of the output.
#[inline(always)]
fn forward_band<S: Simd>(
    simd: S,
    source: &Field,
    parallax: &Parallax,
    range: [f32; 2],
    [first, end]: [usize; 2],
    cells: &mut [u32],
) {
    let [_, epipole_y, epipole_z] = parallax.epipole;
    let mut band = Band { cells, first: first as i32, rows: (end - first) as i32, width: parallax.width as i32 };
    let mut setups = Setups::new();
    for (number, strip) in source.patches.strips.iter().enumerate() {
        let y0 = number as u32 * TILE;
        // Rows stay together up to their displacements: a strip reaches only these.
        let edges = [y0 as f32, (y0 + TILE) as f32];
        let reached = edges.into_iter().flat_map(|y| range.map(|d| moved(y, d, epipole_y, epipole_z)));
        let reached = reached.fold([f32::MAX, f32::MIN], |[low, high], y| [low.min(y), high.max(y)]);
        let [low, high] = reached.map(|y| y + parallax.origin[1]);
        if high < first as f32 - 1.0 || low > end as f32 + 1.0 {
            continue;
        }
        for group in &strip.groups {
            let whole = set_up(simd, parallax, group, &mut setups);
            // Neighbours not one after the other: reading cells that were written a moment ago is waited for.
            for lane in (0..GROUP).map(|i| i * 5 % GROUP) {
                if whole >> lane & 1 == 1 {
                    draw_patch(simd, &setups, lane, &mut band);
                    continue;
                }
                let side = (2.0 * group.half[lane]) as u32;
                if side > 0 {
                    let corner = [group.x[lane] - group.half[lane], group.y[lane] - group.half[lane]];
                    move_square(simd, source, parallax, corner.map(|v| v as u32), side, &mut setups, &mut band);
                }
            }
        }
        for &corner in &strip.rough {
            move_square(simd, source, parallax, corner, BLOCK_SIDE, &mut setups, &mut band);
        }
    }
}

/// The part of the output that a thread writes.
struct Band<'a> {
    cells: &'a mut [u32],
    /// First row.
    first: i32,
    /// Rows.
    rows: i32,
    /// Columns.
    width: i32,
}

/// Moves a square of cells one by one, in blocks of [`BLOCK_SIDE`]. A cell that is magnified moves as a patch too, so that
/// nothing farther shows through a surface between its cells.
#[inline(always)]
fn move_square<S: Simd>(
    simd: S,
    source: &Field,
    parallax: &Parallax,
    [x0, y0]: [u32; 2],
    side: u32,
    setups: &mut Setups,
    band: &mut Band,
) {
    for y in (y0..y0 + side).step_by(BLOCK_SIDE as usize) {
        for x in (x0..x0 + side).step_by(BLOCK_SIDE as usize) {
            let block = block_of(simd, source, [x, y]);
            let position = [x as f32 + 0.5, y as f32 + 0.5];
            let (moved, magnified) = move_cells(simd, parallax, block, position, band);
            scatter(simd, moved, band.cells);
            if magnified != 0 && parallax.stored == Stored::Corrected {
                let whole = set_up(simd, parallax, &cells_as_patches(&block.to_array(), parallax, position), setups);
                for lane in (0..GROUP).filter(|lane| (whole & magnified) >> lane & 1 == 1) {
                    draw_patch(simd, setups, lane, band);
                }
            }
        }
    }
}

/// The cells of a block, row-major; 0 beyond the field.
#[inline(always)]
fn block_of<S: Simd>(simd: S, source: &Field, [x, y]: [u32; 2]) -> u32x16<S> {
    let width = source.width as usize;
    let start = y as usize * width + x as usize;
    if x + BLOCK_SIDE <= source.width
        && let Some(cells) = source.cells.get(start..start + 3 * width + 4)
    {
        let row = |i: usize| u32x4::from_slice(simd, &cells[i * width..i * width + 4]);
        return row(0).combine(row(1)).combine(row(2).combine(row(3)));
    }
    let mut block = [0; 16];
    for (i, cell) in block.iter_mut().enumerate() {
        let inside = x as usize + i % 4 < width;
        *cell = source.cells.get(start + i / 4 * width + i % 4).copied().filter(|_| inside).unwrap_or(0);
    }
    u32x16::load_array(simd, block)
}

/// The cells of a block that begins with the cell centred at `position`.
fn cells_as_patches(block: &[u32; GROUP], parallax: &Parallax, position: [f32; 2]) -> PatchGroup {
    let mut group = PatchGroup::EMPTY;
    for (i, &cell) in block.iter().enumerate().filter(|(_, cell)| **cell != 0) {
        (group.x[i], group.y[i]) = (position[0] + BLOCK_COLUMNS[i], position[1] + BLOCK_ROWS[i]);
        group.d[i] = parallax.source_coding.displacement(cell, 0.0, 0.0);
        [group.slope_x[i], group.slope_y[i]] = slopes(cell).map(|slope| slope * parallax.source_coding.slope_scale);
        (group.half[i], group.visible[i]) = (0.5, cell & VISIBLE);
    }
    group
}

/// Sixteen indices into a band and the cells to put there; an index beyond every band where there is nothing to put.
type Moved<S> = (u32x16<S>, u32x16<S>);

/// Places in groups of four neighbours.
const IN_STEP: [u32; 16] = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3];

/// The nearer of what is there and what comes. Where a surface is smooth most groups of four stay neighbours, and go
/// to memory together.
#[inline(always)]
fn scatter<S: Simd>(simd: S, (indices, values): Moved<S>, cells: &mut [u32]) {
    let firsts = indices.swizzle_dyn_within_blocks(u8x64::load_array_ref(simd, &COPIES[0]));
    let in_step = (indices - firsts).simd_eq(u32x16::load_array_ref(simd, &IN_STEP)).to_bitmask();
    let (indices, values) = (indices.to_array(), values.to_array());
    for group in 0..4 {
        let (indices, values) = (&indices[4 * group..4 * group + 4], &values[4 * group..4 * group + 4]);
        let first = indices[0] as usize;
        if in_step >> (4 * group) & 15 == 15
            && let Some(target) = cells.get_mut(first..first + 4)
        {
            u32x4::from_slice(simd, target).max(u32x4::from_slice(simd, values)).store_slice(target);
            continue;
        }
        for (&index, &value) in indices.iter().zip(values) {
            if let Some(cell) = cells.get_mut(index as usize) {
                *cell = value.max(*cell);
            }
        }
    }
}

/// Columns and rows of the cells of a block.
const BLOCK_COLUMNS: [f32; 16] = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
const BLOCK_ROWS: [f32; 16] = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];

/// The cells of a block, the first of them centred at `position`; and a bit for each that is magnified.
#[inline(always)]
fn move_cells<S: Simd>(
    simd: S,
    parallax: &Parallax,
    cells: u32x16<S>,
    position: [f32; 2],
    band: &Band,
) -> (Moved<S>, u64) {
    let (d, slope_x, slope_y) = decode(cells, &parallax.source_coding);
    let [ex, ey, ez] = parallax.epipole;
    let x = f32x16::load_array_ref(simd, &BLOCK_COLUMNS) + position[0];
    let y = f32x16::load_array_ref(simd, &BLOCK_ROWS) + position[1];
    let w3 = d * ez + 1.0;
    // Slopes seen from the new place: grad3 d3 = grad1 d1 / (w3 + (e - x1 e_z) . grad1 d1). Where that goes to zero or
    // below, the surface turns away from the target eye.
    let toward_x = f32x16::splat(simd, ex) - x * ez;
    let stretch = w3 + toward_x * slope_x + slope_y * (f32x16::splat(simd, ey) - y * ez);
    let stretch = stretch.max(w3 * 0.25);
    // One division for 1 / w3 and 1 / stretch.
    let both = f32x16::splat(simd, 1.0) / (w3 * stretch);
    let share = both * stretch;
    let x3 = (x + d * ex) * share;
    let y3 = (y + d * ey) * share;
    let (column, row) = (x3.floor(), y3.floor());
    let (value, factor) = match parallax.stored {
        Stored::Corrected => (d * share, both * w3),
        Stored::AsPrinted => (d, both * w3 * w3 * w3),
    };
    let (slope_x, slope_y) = (slope_x * factor, slope_y * factor);
    let value = value + slope_x * (column + 0.5 - x3) + slope_y * (row + 0.5 - y3);

    let (column, row) = (column + parallax.origin[0], row + (parallax.origin[1] - band.first as f32));
    let inside = column.simd_ge(0.0)
        & column.simd_lt(parallax.width)
        & row.simd_ge(0.0)
        & row.simd_lt(band.rows as f32)
        & w3.simd_ge(NEAREST_DEPTH_SHARE)
        & cells.simd_ne(0);
    let zero = f32x16::splat(simd, 0.0);
    let row = inside.select(row, zero).to_int::<i32x16<S>>();
    let column = inside.select(column, zero).to_int::<i32x16<S>>();
    let index = inside.select(row * parallax.width as i32 + column, i32x16::splat(simd, -1));
    let packed = encode(&parallax.encoding, cells, inside.select(value, zero), slope_x, slope_y);
    let magnified = share.max(stretch * share * share).simd_gt(MAGNIFIED) & cells.simd_ne(0);
    ((index.bitcast::<u32x16<S>>(), packed), magnified.to_bitmask())
}

/// Cells that move apart by more than this leave gaps side by side. Below, a gap is one cell wide, and filling takes it
/// from its neighbours.
const MAGNIFIED: f32 = 1.5;

/// Where patches of a group lie in the output, and how their values run there. Linear quantities are given at the
/// first column and row, with their change per column and row.
struct Setups {
    /// First column and row, columns and rows of the patch's box.
    boxes: [[i32; GROUP]; 4],
    /// Position in the source relative to the patch's centre times the source's share of depth: across, down.
    across: [[f32; GROUP]; 3],
    down: [[f32; GROUP]; 3],
    /// How far either may be from 0.
    reach: [[f32; GROUP]; 3],
    /// Value in units of 2^-16.
    value: [[i32; GROUP]; 3],
    /// Visibility and slopes.
    rest: [u32; GROUP],
}

impl Setups {
    fn new() -> Self {
        let linear = [[0.0; GROUP]; 3];
        let (boxes, value, rest) = ([[0; GROUP]; 4], [[0; GROUP]; 3], [0; GROUP]);
        Self { boxes, across: linear, down: linear, reach: linear, value, rest }
    }
}

/// Finds where the patches of a group go. The result has a bit for each that moves whole: that is turned towards
/// the target eye, in front of it and inside the output.
///
/// On a plane `d1 = a + b u + c v` about the patch's centre pure parallax gives, about the same place,
/// `d3 = (a + b U + c V) / (1 + a e_z + b e_x + c e_y)`, e relative to the centre, and (U, V) comes from
/// `(u, v) = ((U, V) - d3 (e_x, e_y)) / (1 - d3 e_z)`: all linear in (U, V) but for the last division, which a
/// comparison does not need.
#[inline(always)]
fn set_up<S: Simd>(simd: S, parallax: &Parallax, group: &PatchGroup, out: &mut Setups) -> u64 {
    let load = |values: &[f32; GROUP]| f32x16::load_array_ref(simd, values);
    let (x, y, half) = (load(&group.x), load(&group.y), load(&group.half));
    let (a, b, c) = (load(&group.d), load(&group.slope_x), load(&group.slope_y));
    let [ex, ey, ez] = parallax.epipole;
    let one = f32x16::splat(simd, 1.0);
    let (ex, ey) = (f32x16::splat(simd, ex) - x * ez, f32x16::splat(simd, ey) - y * ez);
    let w3 = a * ez + 1.0;
    let stretch = w3 + b * ex + c * ey;
    let share = one / stretch;
    let (p, q, r) = (a * share, b * share, c * share);

    // The box of the corners, and the range of values at them.
    let (across, down) = (b * half, c * half);
    let mut boxed = [[f32x16::splat(simd, f32::MAX), f32x16::splat(simd, f32::MIN)]; 3];
    let mut shallowest = w3;
    for (right, below) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let d = a + across * right + down * below;
        let w3 = d * ez + 1.0;
        shallowest = shallowest.min(w3);
        let share = one / w3;
        let corner = [(half * right + d * ex) * share, (half * below + d * ey) * share, d * share];
        for (range, at) in boxed.iter_mut().zip(corner) {
            *range = [range[0].min(at), range[1].max(at)];
        }
    }
    // Neighbouring planes miss each other by twice what displacements are off them.
    let margin = (ex.max(-ex).max(ey.max(-ey)) * (2.0 * parallax.tolerance) + MARGIN).min(0.45);
    let [cx, cy] = [x + (parallax.origin[0] - 0.5), y + (parallax.origin[1] - 0.5)];
    let (column, row) = ((boxed[0][0] + cx - margin).ceil(), (boxed[1][0] + cy - margin).ceil());
    let (last_column, last_row) = ((boxed[0][1] + cx + margin).floor(), (boxed[1][1] + cy + margin).floor());
    let Encoding { steps_per_unit, rounded_zero, slopes_per_unit } = parallax.encoding;
    let slack = (q.max(-q) + r.max(-r)) * margin;
    let ends = [boxed[2][0] - slack, boxed[2][1] + slack].map(|d| d * steps_per_unit + rounded_zero);
    let whole = stretch.simd_ge(w3 * LEAST_STRETCH)
        & shallowest.simd_ge(NEAREST_DEPTH_SHARE)
        & half.simd_gt(0.0)
        & column.simd_ge(0.0)
        & row.simd_ge(0.0)
        & last_column.simd_lt(parallax.width)
        & last_row.simd_lt(parallax.height)
        & ends[0].min(ends[1]).simd_ge(1.0)
        & ends[0].max(ends[1]).simd_lt(32768.0);
    if parallax.stored == Stored::AsPrinted {
        return 0;
    }

    let (from_x, from_y) = (column - cx, row - cy);
    let d3 = p + q * from_x + r * from_y;
    let store = |values: [f32x16<S>; 3], out: &mut [[f32; GROUP]; 3]| {
        for (values, out) in values.into_iter().zip(out) {
            values.store_slice(out);
        }
    };
    store([from_x - d3 * ex, one - q * ex, -(r * ex)], &mut out.across);
    store([from_y - d3 * ey, -(q * ey), one - r * ey], &mut out.down);
    let depth = half * ez;
    store([half + margin - d3 * depth, -(q * depth), -(r * depth)], &mut out.reach);
    let boxes = [column, row, last_column - column + 1.0, last_row - row + 1.0];
    for (value, out) in boxes.into_iter().zip(&mut out.boxes) {
        value.to_int::<i32x16<S>>().store_slice(out);
    }
    let fixed = steps_per_unit * 65536.0;
    let values = [d3 * fixed + rounded_zero * 65536.0, q * fixed, r * fixed];
    for (value, out) in values.into_iter().zip(&mut out.value) {
        value.to_int::<i32x16<S>>().store_slice(out);
    }
    let slopes = (slope_units(q * slopes_per_unit) << 8) | slope_units(r * slopes_per_unit);
    (slopes | u32x16::load_array_ref(simd, &group.visible)).store_slice(&mut out.rest);
    whole.to_bitmask()
}

/// Least cells by which a patch reaches beyond its square, for the rounding of its edges.
const MARGIN: f32 = 1e-3;

/// Surfaces that pure parallax compresses by more than this, or turns round, move cell by cell.
const LEAST_STRETCH: f32 = 0.25;

/// Puts a patch where it is nearer than what is there.
#[inline(always)]
fn draw_patch<S: Simd>(simd: S, setups: &Setups, lane: usize, band: &mut Band) {
    let [column, row, columns, rows] = setups.boxes.map(|values| values[lane]);
    if row >= band.first + band.rows || row + rows <= band.first {
        return;
    }
    let lanes = f32x16::load_array_ref(simd, &LANE_NUMBERS);
    let whole_lanes = i32x16::load_array_ref(simd, &WHOLE_LANE_NUMBERS);
    let rest = u32x16::splat(simd, setups.rest[lane]);
    let linear = |values: &[[f32; GROUP]; 3], skipped: f32| {
        let [start, step, down] = [values[0][lane], values[1][lane], values[2][lane]];
        (lanes * step + (start + step * skipped), f32x16::splat(simd, down))
    };
    for skipped in (0..columns).step_by(16) {
        let (mut across, across_down) = linear(&setups.across, skipped as f32);
        let (mut down, down_down) = linear(&setups.down, skipped as f32);
        let (mut reach, reach_down) = linear(&setups.reach, skipped as f32);
        let [start, step, value_down] = setups.value.map(|values| values[lane]);
        let start = start.wrapping_add(step.wrapping_mul(skipped));
        let mut value = whole_lanes * step + start;
        for y in row - band.first..row - band.first + rows {
            if (0..band.rows).contains(&y) {
                let farthest = across.abs().max(down.abs());
                let packed = (value.bitcast::<u32x16<S>>() & 0x7fff_0000) | rest;
                let packed = farthest.simd_le(reach).select(packed, u32x16::splat(simd, 0));
                put(simd, packed, (y * band.width + column + skipped) as usize, band.cells);
            }
            (across, down, reach) = (across + across_down, down + down_down, reach + reach_down);
            value += value_down;
        }
    }
}

/// The larger of what is there and what comes.
#[inline(always)]
fn put<S: Simd>(simd: S, values: u32x16<S>, index: usize, cells: &mut [u32]) {
    if let Some(target) = cells.get_mut(index..index + 16) {
        u32x16::from_slice(simd, target).max(values).store_slice(target);
    } else if let Some(target) = cells.get_mut(index..) {
        for (cell, value) in target.iter_mut().zip(values.to_array()) {
            *cell = value.max(*cell);
        }
    }
}

/// Numbers of the cells in a vector.
const WHOLE_LANE_NUMBERS: [i32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// [`Coding::displacement`] at the centre, and the slopes.
#[inline(always)]
fn decode<S: Simd>(cells: u32x16<S>, coding: &Coding) -> (f32x16<S>, f32x16<S>, f32x16<S>) {
    let value = ((cells >> 16) & 0x7fff).to_float::<f32x16<S>>();
    let signed = cells.bitcast::<i32x16<S>>();
    let slope_x = ((signed << 16) >> 24).to_float::<f32x16<S>>() * coding.slope_scale;
    let slope_y = ((signed << 24) >> 24).to_float::<f32x16<S>>() * coding.slope_scale;
    ((value - coding.zero) * coding.scale, slope_x, slope_y)
}

/// [`Coding::pack`] with the visibility of `source`.
#[inline(always)]
fn encode<S: Simd>(
    encoding: &Encoding,
    source: u32x16<S>,
    d: f32x16<S>,
    slope_x: f32x16<S>,
    slope_y: f32x16<S>,
) -> u32x16<S> {
    let value = d * encoding.steps_per_unit + encoding.rounded_zero;
    let value = value.max(1.0).min(32767.0).to_int::<i32x16<S>>().bitcast::<u32x16<S>>();
    let x = slope_units(slope_x * encoding.slopes_per_unit);
    let y = slope_units(slope_y * encoding.slopes_per_unit);
    (source & VISIBLE) | (value << 16) | (x << 8) | y
}

/// A slope in units as 8 bits, rounded to nearest: shifted to be positive, so that truncation rounds.
#[inline(always)]
fn slope_units<S: Simd>(units: f32x16<S>) -> u32x16<S> {
    let units = units.max(-127.0).min(127.0) + 128.5;
    (units.to_int::<i32x16<S>>() - 128).bitcast::<u32x16<S>>() & 0xff
}
