//! First pass: moving displacements by pure parallax (Eq. 6), d1(x1, y1) to d3(x3, y3) with d3 = d1 / w3 (C5).

use super::field::{Coding, Field};
use super::sampling::LANE_NUMBERS;
use super::transfer::Transfer;
use fearless_simd::{Level, Simd, dispatch, f32x16, i32x16, prelude::*, u32x16};
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
    let width = out.width as f32;
    let encoding = Encoding::of(&out.coding);
    let parallax = Parallax { epipole, stored, origin, width, source_coding: source.coding, encoding };

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
    let width = source.width as usize;
    let [_, epipole_y, epipole_z] = parallax.epipole;
    for (y, row) in source.cells.chunks_exact(width).enumerate() {
        // A row stays a row up to its displacements: it reaches only these.
        let reached = range.map(|d| moved(y as f32 + 0.5, d, epipole_y, epipole_z) + parallax.origin[1]);
        let (low, high) = (reached[0].min(reached[1]) - 1.0, reached[0].max(reached[1]) + 1.0);
        if high < first as f32 || low > end as f32 {
            continue;
        }
        let target_rows = [first as f32, end as f32];
        let mut chunks = row.chunks_exact(16);
        let mut x = 0.5;
        for chunk in &mut chunks {
            let source_cells = u32x16::from_slice(simd, chunk);
            scatter(move_cells(simd, parallax, source_cells, [x, y as f32 + 0.5], target_rows), cells);
            x += 16.0;
        }
        let rest = chunks.remainder();
        if !rest.is_empty() {
            let mut padded = [0; 16];
            padded[..rest.len()].copy_from_slice(rest);
            let source_cells = u32x16::load_array(simd, padded);
            scatter(move_cells(simd, parallax, source_cells, [x, y as f32 + 0.5], target_rows), cells);
        }
    }
}

/// Sixteen indices into a band and the cells to put there; an index beyond every band where there is nothing to put.
type Moved = ([u32; 16], [u32; 16]);

/// The nearer of what is there and what comes.
#[inline(always)]
fn scatter((indices, values): Moved, cells: &mut [u32]) {
    for (&index, &value) in indices.iter().zip(&values) {
        if let Some(cell) = cells.get_mut(index as usize) {
            *cell = value.max(*cell);
        }
    }
}

/// Sixteen neighbours of a row, the first of them centred at `position`.
#[inline(always)]
fn move_cells<S: Simd>(
    simd: S,
    parallax: &Parallax,
    cells: u32x16<S>,
    position: [f32; 2],
    target_rows: [f32; 2],
) -> Moved {
    let (d, slope_x, slope_y) = decode(cells, &parallax.source_coding);
    let [ex, ey, ez] = parallax.epipole;
    let x = f32x16::load_array_ref(simd, &LANE_NUMBERS) + position[0];
    let w3 = d * ez + 1.0;
    // Slopes seen from the new place: grad3 d3 = grad1 d1 / (w3 + (e - x1 e_z) . grad1 d1). Where that goes to zero or
    // below, the surface turns away from the target eye.
    let toward_x = f32x16::splat(simd, ex) - x * ez;
    let stretch = w3 + toward_x * slope_x + slope_y * (ey - position[1] * ez);
    let stretch = stretch.max(w3 * 0.25);
    // One division for 1 / w3 and 1 / stretch.
    let both = f32x16::splat(simd, 1.0) / (w3 * stretch);
    let share = both * stretch;
    let x3 = (x + d * ex) * share;
    let y3 = (d * ey + position[1]) * share;
    let (column, row) = (x3.floor(), y3.floor());
    let (value, factor) = match parallax.stored {
        Stored::Corrected => (d * share, both * w3),
        Stored::AsPrinted => (d, both * w3 * w3 * w3),
    };
    let (slope_x, slope_y) = (slope_x * factor, slope_y * factor);
    let value = value + slope_x * (column + 0.5 - x3) + slope_y * (row + 0.5 - y3);

    let (column, row) = (column + parallax.origin[0], row + parallax.origin[1]);
    let inside = column.simd_ge(0.0)
        & column.simd_lt(parallax.width)
        & row.simd_ge(target_rows[0])
        & row.simd_lt(target_rows[1])
        & w3.simd_ge(NEAREST_DEPTH_SHARE)
        & cells.simd_ne(0);
    let zero = f32x16::splat(simd, 0.0);
    let row = inside.select(row - target_rows[0], zero).to_int::<i32x16<S>>();
    let column = inside.select(column, zero).to_int::<i32x16<S>>();
    let index = inside.select(row * parallax.width as i32 + column, i32x16::splat(simd, -1));
    let packed = encode(&parallax.encoding, cells, inside.select(value, zero), slope_x, slope_y);
    (index.bitcast::<u32x16<S>>().to_array(), packed.to_array())
}

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
    (source & super::field::VISIBLE) | (value << 16) | (x << 8) | y
}

/// A slope in units as 8 bits, rounded to nearest: shifted to be positive, so that truncation rounds.
#[inline(always)]
fn slope_units<S: Simd>(units: f32x16<S>) -> u32x16<S> {
    let units = units.max(-127.0).min(127.0) + 128.5;
    (units.to_int::<i32x16<S>>() - 128).bitcast::<u32x16<S>>() & 0xff
}
