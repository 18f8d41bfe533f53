//! Planar patches in the first pass: each moves whole and becomes a parallelogram.

use super::patches::{GROUP, PatchGroup};
use super::pure_parallax::{CellBand, Encoding, NEAREST_DEPTH_SHARE, PureParallax, StoredValue};
use crate::warp::second_pass::sampling::LANE_NUMBERS;
use fearless_simd::{Simd, f32x16, i32x16, prelude::*, u32x16};

/// Bounding boxes of a group of patches in the output, and their linear quantities: value at the
/// first column and row, increments per column and row.
#[repr(align(64))]
pub(super) struct Setups {
    /// First column, first row, number of columns and of rows of the patch's bounding box.
    boxes: [[i32; GROUP]; 4],
    /// Horizontal position in the source relative to the patch's centre, times 1 - d3 e_z.
    across: [[f32; GROUP]; 3],
    /// The same for the vertical position.
    down: [[f32; GROUP]; 3],
    /// Largest absolute value of either inside the patch.
    reach: [[f32; GROUP]; 3],
    /// Value in units of 2^-16.
    value: [[i32; GROUP]; 3],
    /// Visibility and slopes.
    rest: [u32; GROUP],
}

impl Setups {
    pub(crate) fn new() -> Self {
        let linear = [[0.0; GROUP]; 3];
        Self {
            boxes: [[0; GROUP]; 4],
            across: linear,
            down: linear,
            reach: linear,
            value: [[0; GROUP]; 3],
            rest: [0; GROUP],
        }
    }
}

/// Computes where the patches of a group move. Returns a bit mask of the patches that can be drawn
/// whole: they face the target eye, are in front of it and inside the output.
///
/// On a plane `d1 = a + b u + c v` about the patch's centre pure parallax gives, about the same
/// centre, `d3 = (a + b U + c V) / (1 + a e_z + b e_x + c e_y)`, e relative to the centre, and (U,
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
        || set_up_kernel(simd, parallax, group, out),
    )
}

#[inline(always)]
fn set_up_kernel<S: Simd>(
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
    let inverse_stretch = one / stretch;
    let (p, q, r) = (
        a * inverse_stretch,
        b * inverse_stretch,
        c * inverse_stretch,
    );

    // The bounding box of the corners, and the range of values at them.
    let (across, down) = (b * half, c * half);
    let mut bounds = [[f32x16::splat(simd, f32::MAX), f32x16::splat(simd, f32::MIN)]; 3];
    let mut shallowest = w3;
    for (right, below) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        let d = a + across * right + down * below;
        let w3 = d * ez + 1.0;
        shallowest = shallowest.min(w3);
        let inverse_w3 = one / w3;
        let corner = [
            (half * right + d * ex) * inverse_w3,
            (half * below + d * ey) * inverse_w3,
            d * inverse_w3,
        ];
        for (range, value) in bounds.iter_mut().zip(corner) {
            *range = [range[0].min(value), range[1].max(value)];
        }
    }
    // Neighbouring planes can be apart by twice the tolerance of the fit.
    let margin = (ex.max(-ex).max(ey.max(-ey)) * (2.0 * parallax.tolerance) + MARGIN).min(0.45);
    let [cx, cy] = [
        x + (parallax.origin[0] - 0.5),
        y + (parallax.origin[1] - 0.5),
    ];
    let (column, row) = (
        (bounds[0][0] + cx - margin).ceil(),
        (bounds[1][0] + cy - margin).ceil(),
    );
    let (last_column, last_row) = (
        (bounds[0][1] + cx + margin).floor(),
        (bounds[1][1] + cy + margin).floor(),
    );
    let Encoding {
        steps_per_unit,
        rounded_zero,
        slopes_per_unit,
    } = parallax.encoding;
    let slack = (q.max(-q) + r.max(-r)) * margin;
    let least = (bounds[2][0] - slack) * steps_per_unit + rounded_zero;
    let most = (bounds[2][1] + slack) * steps_per_unit + rounded_zero;
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

/// Stores the coefficients of a linear quantity.
#[inline(always)]
fn store<S: Simd>(values: [f32x16<S>; 3], out: &mut [[f32; GROUP]; 3]) {
    for i in 0..3 {
        values[i].store_slice(&mut out[i]);
    }
}

/// Smallest margin of a patch beyond its square, cells, against the rounding of its edges.
const MARGIN: f32 = 1e-3;

/// Smallest stretch under pure parallax at which patches are drawn whole; surfaces compressed
/// further, or seen from behind, move cell by cell.
pub const LEAST_STRETCH: f32 = 0.25;

/// Draws a patch with a depth test.
pub(super) fn draw_patch<S: Simd>(simd: S, setups: &Setups, lane: usize, band: &mut CellBand) {
    simd.vectorize(
        #[inline(always)]
        || draw_patch_kernel(simd, setups, lane, band),
    );
}

#[inline(always)]
fn draw_patch_kernel<S: Simd>(simd: S, setups: &Setups, lane: usize, band: &mut CellBand) {
    // Not `map`: over arrays of arrays it would copy all lanes of each.
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
        let (mut across, across_down) = evaluate_linear(simd, &setups.across, lane, skipped as f32);
        let (mut down, down_down) = evaluate_linear(simd, &setups.down, lane, skipped as f32);
        let (mut reach, reach_down) = evaluate_linear(simd, &setups.reach, lane, skipped as f32);
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
                store_max(
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

/// Evaluates a linear quantity of a patch in sixteen columns of its first row, `skipped` columns
/// from the first; also returns its change per row.
#[inline(always)]
fn evaluate_linear<S: Simd>(
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

/// Stores the maximum of the stored and the new cells.
#[inline(always)]
fn store_max<S: Simd>(simd: S, values: u32x16<S>, index: usize, cells: &mut [u32]) {
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

/// Lane numbers of a vector.
const WHOLE_LANE_NUMBERS: [i32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Encodes a slope in units as 8 bits, rounded to nearest: shifted to be positive, so that
/// truncation rounds.
#[inline(always)]
pub(super) fn slope_units<S: Simd>(units: f32x16<S>) -> u32x16<S> {
    let units = units.max(-127.0).min(127.0) + 128.5;
    (units.to_int::<i32x16<S>>() - 128).bitcast::<u32x16<S>>() & 0xff
}
