//! Patches of planes in the first pass: a plane moves whole, to a parallelogram.

use super::patches::{GROUP, PatchGroup};
use super::pure_parallax::{CellBand, Encoding, NEAREST_DEPTH_SHARE, PureParallax, StoredValue};
use super::sampling::LANE_NUMBERS;
use fearless_simd::{Simd, f32x16, i32x16, prelude::*, u32x16};

/// Placement of a group of patches in the output, and their linear values: at the first column and
/// row, with increments per column and row.
#[repr(align(64))]
pub(super) struct Setups {
    /// First column and row, columns and rows of the patch's box.
    boxes: [[i32; GROUP]; 4],
    /// Position in the source relative to the patch's centre times the source's share of depth:
    /// across, down.
    across: [[f32; GROUP]; 3],
    down: [[f32; GROUP]; 3],
    /// Largest absolute values of either.
    reach: [[f32; GROUP]; 3],
    /// Value in units of 2^-16.
    value: [[i32; GROUP]; 3],
    /// Visibility and slopes.
    rest: [u32; GROUP],
}

impl Setups {
    pub(super) fn new() -> Self {
        let linear = [[0.0; GROUP]; 3];
        let (boxes, value, rest) = ([[0; GROUP]; 4], [[0; GROUP]; 3], [0; GROUP]);
        Self {
            boxes,
            across: linear,
            down: linear,
            reach: linear,
            value,
            rest,
        }
    }
}

/// Finds where the patches of a group go. The result has a bit for each that moves whole: that is
/// turned towards the target eye, in front of it and inside the output.
///
/// On a plane `d1 = a + b u + c v` about the patch's centre pure parallax gives, about the same
/// place, `d3 = (a + b U + c V) / (1 + a e_z + b e_x + c e_y)`, e relative to the centre, and (U,
/// V) comes from `(u, v) = ((U, V) - d3 (e_x, e_y)) / (1 - d3 e_z)`: all linear in (U, V) but for
/// the last division, which a comparison does not need.
pub(super) fn set_up<S: Simd>(
    simd: S,
    parallax: &PureParallax,
    group: &PatchGroup,
    out: &mut Setups,
) -> u64 {
    simd.vectorize(
        #[inline(always)]
        || set_up_at(simd, parallax, group, out),
    )
}

#[inline(always)]
fn set_up_at<S: Simd>(
    simd: S,
    parallax: &PureParallax,
    group: &PatchGroup,
    out: &mut Setups,
) -> u64 {
    let (x, y) = (
        f32x16::load_array_ref(simd, &group.x),
        f32x16::load_array_ref(simd, &group.y),
    );
    let (half, a) = (
        f32x16::load_array_ref(simd, &group.half),
        f32x16::load_array_ref(simd, &group.d),
    );
    let (b, c) = (
        f32x16::load_array_ref(simd, &group.slope_x),
        f32x16::load_array_ref(simd, &group.slope_y),
    );
    let [ex, ey, ez] = parallax.epipole;
    let one = f32x16::splat(simd, 1.0);
    let (ex, ey) = (
        f32x16::splat(simd, ex) - x * ez,
        f32x16::splat(simd, ey) - y * ez,
    );
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
        let corner = [
            (half * right + d * ex) * share,
            (half * below + d * ey) * share,
            d * share,
        ];
        for (range, at) in boxed.iter_mut().zip(corner) {
            *range = [range[0].min(at), range[1].max(at)];
        }
    }
    // Neighbouring planes miss each other by twice what displacements are off them.
    let margin = (ex.max(-ex).max(ey.max(-ey)) * (2.0 * parallax.tolerance) + MARGIN).min(0.45);
    let [cx, cy] = [
        x + (parallax.origin[0] - 0.5),
        y + (parallax.origin[1] - 0.5),
    ];
    let (column, row) = (
        (boxed[0][0] + cx - margin).ceil(),
        (boxed[1][0] + cy - margin).ceil(),
    );
    let (last_column, last_row) = (
        (boxed[0][1] + cx + margin).floor(),
        (boxed[1][1] + cy + margin).floor(),
    );
    let Encoding {
        steps_per_unit,
        rounded_zero,
        slopes_per_unit,
    } = parallax.encoding;
    let slack = (q.max(-q) + r.max(-r)) * margin;
    let least = (boxed[2][0] - slack) * steps_per_unit + rounded_zero;
    let most = (boxed[2][1] + slack) * steps_per_unit + rounded_zero;
    let whole = stretch.simd_ge(w3 * LEAST_STRETCH)
        & shallowest.simd_ge(NEAREST_DEPTH_SHARE)
        & half.simd_gt(0.0)
        & column.simd_ge(0.0)
        & row.simd_ge(0.0)
        & last_column.simd_lt(parallax.width)
        & last_row.simd_lt(parallax.height)
        & least.min(most).simd_ge(1.0)
        & least.max(most).simd_lt(32768.0);
    if parallax.stored == StoredValue::AsPrinted {
        return 0;
    }

    let (from_x, from_y) = (column - cx, row - cy);
    let d3 = p + q * from_x + r * from_y;
    store([from_x - d3 * ex, one - q * ex, -(r * ex)], &mut out.across);
    store([from_y - d3 * ey, -(q * ey), one - r * ey], &mut out.down);
    let depth = half * ez;
    store(
        [half + margin - d3 * depth, -(q * depth), -(r * depth)],
        &mut out.reach,
    );
    let boxes = [
        column,
        row,
        last_column - column + 1.0,
        last_row - row + 1.0,
    ];
    for i in 0..4 {
        boxes[i]
            .to_int::<i32x16<S>>()
            .store_slice(&mut out.boxes[i]);
    }
    let fixed = steps_per_unit * 65536.0;
    let values = [d3 * fixed + rounded_zero * 65536.0, q * fixed, r * fixed];
    for i in 0..3 {
        values[i]
            .to_int::<i32x16<S>>()
            .store_slice(&mut out.value[i]);
    }
    let slopes = (slope_units(q * slopes_per_unit) << 8) | slope_units(r * slopes_per_unit);
    (slopes | u32x16::load_array_ref(simd, &group.visible)).store_slice(&mut out.rest);
    whole.to_bitmask()
}

/// Linear quantities for [`Setups`].
#[inline(always)]
fn store<S: Simd>(values: [f32x16<S>; 3], out: &mut [[f32; GROUP]; 3]) {
    for i in 0..3 {
        values[i].store_slice(&mut out[i]);
    }
}

/// Least cells by which a patch reaches beyond its square, for the rounding of its edges.
const MARGIN: f32 = 1e-3;

/// Surfaces that pure parallax compresses by more than this, or turns round, move cell by cell.
pub const LEAST_STRETCH: f32 = 0.25;

/// Puts a patch where it is nearer than what is there.
pub(super) fn draw_patch<S: Simd>(simd: S, setups: &Setups, lane: usize, band: &mut CellBand) {
    simd.vectorize(
        #[inline(always)]
        || draw_patch_at(simd, setups, lane, band),
    );
}

#[inline(always)]
fn draw_patch_at<S: Simd>(simd: S, setups: &Setups, lane: usize, band: &mut CellBand) {
    // One by one: `map` over arrays of arrays would copy all lanes of each.
    let boxes = &setups.boxes;
    let [column, row, columns, rows] = [
        boxes[0][lane],
        boxes[1][lane],
        boxes[2][lane],
        boxes[3][lane],
    ];
    if row >= band.first + band.rows || row + rows <= band.first {
        return;
    }
    let whole_lanes = i32x16::load_array_ref(simd, &WHOLE_LANE_NUMBERS);
    let rest = u32x16::splat(simd, setups.rest[lane]);
    for skipped in (0..columns).step_by(16) {
        let (mut across, across_down) = linear(simd, &setups.across, lane, skipped as f32);
        let (mut down, down_down) = linear(simd, &setups.down, lane, skipped as f32);
        let (mut reach, reach_down) = linear(simd, &setups.reach, lane, skipped as f32);
        let [start, step, value_down] = [
            setups.value[0][lane],
            setups.value[1][lane],
            setups.value[2][lane],
        ];
        let start = start.wrapping_add(step.wrapping_mul(skipped));
        let mut value = whole_lanes * step + start;
        for y in row - band.first..row - band.first + rows {
            if (0..band.rows).contains(&y) {
                let farthest = across.abs().max(down.abs());
                let packed = (value.bitcast::<u32x16<S>>() & 0x7fff_0000) | rest;
                let packed = farthest
                    .simd_le(reach)
                    .select(packed, u32x16::splat(simd, 0));
                put(
                    simd,
                    packed,
                    (y * band.width + column + skipped) as usize,
                    band.cells,
                );
            }
            (across, down, reach) = (across + across_down, down + down_down, reach + reach_down);
            value += value_down;
        }
    }
}

/// A linear quantity of a patch in sixteen columns of its first row, so many columns from the
/// first, and its change per row.
#[inline(always)]
fn linear<S: Simd>(
    simd: S,
    values: &[[f32; GROUP]; 3],
    lane: usize,
    skipped: f32,
) -> (f32x16<S>, f32x16<S>) {
    let [start, step, down] = [values[0][lane], values[1][lane], values[2][lane]];
    let lanes = f32x16::load_array_ref(simd, &LANE_NUMBERS);
    (
        lanes * step + (start + step * skipped),
        f32x16::splat(simd, down),
    )
}

/// The larger of what is there and what comes.
#[inline(always)]
fn put<S: Simd>(simd: S, values: u32x16<S>, index: usize, cells: &mut [u32]) {
    if let Some(target) = cells.get_mut(index..index + 16) {
        u32x16::from_slice(simd, target)
            .max(values)
            .store_slice(target);
    } else if let Some(target) = cells.get_mut(index..) {
        for (cell, value) in target.iter_mut().zip(values.to_array()) {
            *cell = value.max(*cell);
        }
    }
}

/// Numbers of the cells in a vector.
const WHOLE_LANE_NUMBERS: [i32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// A slope in units as 8 bits, rounded to nearest: shifted to be positive, so that truncation
/// rounds.
#[inline(always)]
pub(super) fn slope_units<S: Simd>(units: f32x16<S>) -> u32x16<S> {
    let units = units.max(-127.0).min(127.0) + 128.5;
    (units.to_int::<i32x16<S>>() - 128).bitcast::<u32x16<S>>() & 0xff
}
