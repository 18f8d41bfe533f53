//! Footprints of a block, sixteen pixels at a time: on the plane, or moved by parallax.

use super::backward::Parallax;
use super::pixel_block::{Lookup, PixelBlock};
use super::sampling::{BLOCK, Footprints, LANE_NUMBERS, LANES, address};
use crate::model::shift::ShiftField;
use crate::warp::cell::Coding;
use fearless_simd::{Simd, f32x16, i32x16, mask32x16, prelude::*, u32x16};

/// Returns the positions of sixteen pixels on the plane relative to the anchor, a mask of those in
/// front of the eye, and 1 / w.
#[inline(always)]
fn on_plane<S: Simd>(
    simd: S,
    block: &PixelBlock,
    first: usize,
) -> ([f32x16<S>; 2], mask32x16<S>, f32x16<S>) {
    let lanes = f32x16::load_array_ref(simd, &LANE_NUMBERS) + first as f32;
    let x = lanes * block.step[0] + block.start[0];
    let y = lanes * block.step[1] + block.start[1];
    let w = lanes * block.step[2] + block.start[2];
    let inverse_w = f32x16::splat(simd, 1.0) / w;
    ([x * inverse_w, y * inverse_w], w.simd_gt(0.0), inverse_w)
}

/// Computes the footprints of a block without parallax.
#[inline(always)]
pub(super) fn plane_footprints<S: Simd, const NEAREST: bool>(
    simd: S,
    block: &PixelBlock,
    count: usize,
    footprints: &mut Footprints,
) {
    for first in (0..count).step_by(LANES) {
        let (position, valid, _) = on_plane(simd, block, first);
        if block.over_texels {
            address::<S, NEAREST, true>(simd, &block.texels, position, valid, first, footprints);
        } else {
            address::<S, NEAREST, false>(simd, &block.texels, position, valid, first, footprints);
        }
    }
}

/// Positions of a block's pixels on the plane, and the cells there; aligned to cache lines.
#[repr(align(64))]
pub(super) struct BlockLookups {
    pub(super) x: [f32; BLOCK],
    pub(super) y: [f32; BLOCK],
    pub(super) inverse_w: [f32; BLOCK],
    /// Horizontal offset from the centre of the cell, cells.
    pub(super) dx: [f32; BLOCK],
    /// The same, vertical.
    pub(super) dy: [f32; BLOCK],
    pub(super) index: [u32; BLOCK],
    pub(super) cell: [u32; BLOCK],
}

impl BlockLookups {
    pub(super) fn new() -> Self {
        let zero = [0.0; BLOCK];
        Self {
            x: zero,
            y: zero,
            inverse_w: zero,
            dx: zero,
            dy: zero,
            index: [0; BLOCK],
            cell: [0; BLOCK],
        }
    }
}

/// Computes the footprints of a block with parallax.
#[inline(always)]
pub(super) fn parallax_footprints<S: Simd, const NEAREST: bool>(
    simd: S,
    parallax: Parallax,
    block: &PixelBlock,
    count: usize,
    lookups: &mut BlockLookups,
    footprints: &mut Footprints,
) {
    let Some(lookup) = &block.lookup else { return };
    let empty = if matches!(parallax, Parallax::Shift(_)) {
        ShiftField::EMPTY
    } else {
        0
    };
    for first in (0..count).step_by(LANES) {
        if lookup.inside {
            find_cells::<S, true>(simd, block, lookup, first, lookups);
        } else {
            find_cells::<S, false>(simd, block, lookup, first, lookups);
        }
    }
    fetch_cells(
        lookup.cells,
        &lookups.index,
        empty,
        &mut lookups.cell,
        count,
    );
    for first in (0..count).step_by(LANES) {
        let cells = u32x16::from_slice(simd, &lookups.cell[first..first + LANES]);
        let plane = [load(simd, &lookups.x, first), load(simd, &lookups.y, first)];
        let offset = [
            load(simd, &lookups.dx, first),
            load(simd, &lookups.dy, first),
        ];
        let known = cells.simd_ne(empty);
        let (position, in_front) = match parallax {
            Parallax::None => (plane, known),
            Parallax::Shift(field) => (shift_positions(field.scale, cells, plane), known),
            Parallax::Affine(field) => {
                let d = displacement(&field.coding, cells, offset);
                (
                    [
                        plane[0] + d * lookup.epipole[0],
                        plane[1] + d * lookup.epipole[1],
                    ],
                    known,
                )
            }
            Parallax::Displacement(field) => {
                along_epipole(lookup, plane, displacement(&field.coding, cells, offset))
            }
            Parallax::AsPrinted(field) => {
                let inverse_w = load(simd, &lookups.inverse_w, first) * (1.0 / block.normalizer);
                along_epipole(
                    lookup,
                    plane,
                    displacement(&field.coding, cells, offset) * inverse_w,
                )
            }
        };
        address::<S, NEAREST, false>(
            simd,
            &block.texels,
            position,
            known & in_front,
            first,
            footprints,
        );
    }
}

/// Gathers cells by index; `empty` for indices out of range. Not inlined, so that its values stay
/// in registers.
#[inline(never)]
fn fetch_cells(
    cells: &[u32],
    indices: &[u32; BLOCK],
    empty: u32,
    out: &mut [u32; BLOCK],
    count: usize,
) {
    let (out, indices) = (out.as_chunks_mut::<4>().0, indices.as_chunks::<4>().0);
    for (out, indices) in out.iter_mut().zip(indices).take(count / 4) {
        for i in 0..4 {
            out[i] = cells.get(indices[i] as usize).copied().unwrap_or(empty);
        }
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, values: &[f32; BLOCK], first: usize) -> f32x16<S> {
    f32x16::from_slice(simd, &values[first..first + LANES])
}

/// Evaluates Eq. 8, `(x3, y3, 1) + d e21`; also returns a mask of positions in front of the eye.
#[inline(always)]
fn along_epipole<S: Simd>(
    lookup: &Lookup,
    plane: [f32x16<S>; 2],
    d: f32x16<S>,
) -> ([f32x16<S>; 2], mask32x16<S>) {
    let w = d * lookup.epipole[2] + 1.0;
    let inverse_w = if lookup.small_parallax {
        reciprocal_near_one(d * lookup.epipole[2])
    } else {
        f32x16::splat(d.simd, 1.0) / w
    };
    let x = (plane[0] + d * lookup.epipole[0]) * inverse_w;
    let y = (plane[1] + d * lookup.epipole[1]) * inverse_w;
    ([x, y], w.simd_gt(0.0))
}

/// Bound below which a series to the third power is accurate to 2^-26, half a last bit of 1.
pub(super) const SMALL_PARALLAX: f64 = 1.0 / 96.0;

/// Approximates 1 / (1 + t) for |t| < [`SMALL_PARALLAX`] by 1 - t + t^2 - t^3. A division would
/// take as long as all other work on a displacement.
#[inline(always)]
pub(super) fn reciprocal_near_one<S: Simd>(t: f32x16<S>) -> f32x16<S> {
    let one = f32x16::splat(t.simd, 1.0);
    (one - t) * (t * t + 1.0)
}

/// Evaluates Eq. 9 for positions on the plane.
#[inline(always)]
fn shift_positions<S: Simd>(scale: f32, cells: u32x16<S>, plane: [f32x16<S>; 2]) -> [f32x16<S>; 2] {
    let cells = cells.bitcast::<i32x16<S>>();
    let x = ((cells << 16) >> 16).to_float::<f32x16<S>>() * scale;
    let y = (cells >> 16).to_float::<f32x16<S>>() * scale;
    [plane[0] + x, plane[1] + y]
}

/// Decodes displacements as [`Coding::displacement`].
#[inline(always)]
fn displacement<S: Simd>(coding: &Coding, cells: u32x16<S>, offset: [f32x16<S>; 2]) -> f32x16<S> {
    let value = ((cells >> 16) & 0x7fff).to_float::<f32x16<S>>();
    let cells = cells.bitcast::<i32x16<S>>();
    let slope_x = ((cells << 16) >> 24).to_float::<f32x16<S>>();
    let slope_y = ((cells << 24) >> 24).to_float::<f32x16<S>>();
    (value - coding.zero) * coding.scale
        + (slope_x * offset[0] + slope_y * offset[1]) * coding.slope_scale
}

/// Computes positions on the plane and the indices of their cells. Border cells extend beyond the
/// field; there is no cell beyond the rim.
#[inline(always)]
fn find_cells<S: Simd, const INSIDE: bool>(
    simd: S,
    block: &PixelBlock,
    lookup: &Lookup,
    first: usize,
    lookups: &mut BlockLookups,
) {
    let (position, in_front, inverse_w) = on_plane(simd, block, first);
    let mut inside = in_front;
    let mut cell = [i32x16::splat(simd, 0); 2];
    let mut offset = position;
    for axis in 0..2 {
        let at = position[axis] * lookup.cells_per_px[axis] + lookup.fraction[axis];
        let column = if INSIDE {
            at.floor()
        } else {
            inside = inside
                & position[axis].simd_ge(lookup.low[axis])
                & position[axis].simd_le(lookup.high[axis]);
            let low = f32x16::splat(simd, -lookup.base[axis] as f32);
            let high = (lookup.size[axis] - 1 - lookup.base[axis]) as f32;
            inside.select(at, low).floor().max(low).min(high)
        };
        offset[axis] = at - column - 0.5;
        cell[axis] = column.to_int::<i32x16<S>>() + lookup.base[axis];
    }
    let index = cell[1] * lookup.stride + cell[0];
    let index = if INSIDE {
        index
    } else {
        inside.select(index, i32x16::splat(simd, -1))
    };
    index
        .bitcast::<u32x16<S>>()
        .store_slice(&mut lookups.index[first..first + LANES]);
    position[0].store_slice(&mut lookups.x[first..first + LANES]);
    position[1].store_slice(&mut lookups.y[first..first + LANES]);
    inverse_w.store_slice(&mut lookups.inverse_w[first..first + LANES]);
    offset[0].store_slice(&mut lookups.dx[first..first + LANES]);
    offset[1].store_slice(&mut lookups.dy[first..first + LANES]);
}
