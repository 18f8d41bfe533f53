//! Pixels among the samples of a surface (docs/decisions/0083).
//!
//! A pixel with samples of a surface in all four quadrants around it lies inside the surface. Half
//! of the full weight covers it, because the weights of stretched or unevenly spaced samples add up
//! to less. The quadrants are bits above the value of a weight; *or* combines those of several
//! splats.

use super::tile_splat::SplatKind;
use fearless_simd::{Simd, i32x8, prelude::*, u32x8};

/// First bit: sums of weights are at most 2^24 (see [`super::mean::Sums`]).
const SHIFT: u32 = 26;

const LOWER_LEFT: u32 = 1 << SHIFT;
const LOWER_RIGHT: u32 = LOWER_LEFT << 1;
const UPPER_LEFT: u32 = LOWER_LEFT << 2;
const UPPER_RIGHT: u32 = LOWER_LEFT << 3;
/// The rim of a plane texture: it continues the surface on an unknown side.
const RIM: u32 = LOWER_LEFT << 4;

/// Bits that are not part of a weight's value.
pub(super) const MASK: u32 = UPPER_LEFT | UPPER_RIGHT | LOWER_LEFT | LOWER_RIGHT | RIM;

/// Returns the bits that a splat has in pixels at some distances across from its centre, in the
/// rows on both sides of it.
#[inline(always)]
pub(super) fn column_bits<S: Simd>(simd: S, kind: SplatKind, across: i32x8<S>) -> u32x8<S> {
    // A table, because branches would be mispredicted.
    let [left, right] = [
        [0, 0],
        [UPPER_LEFT | LOWER_LEFT, UPPER_RIGHT | LOWER_RIGHT],
        [RIM, RIM],
    ][kind as usize];
    across
        .simd_gt(0)
        .select(u32x8::splat(simd, left), u32x8::splat(simd, right))
}

/// Returns the bits that a splat may have in rows at some distances down from its centre.
#[inline(always)]
pub(super) fn row_bits<S: Simd>(simd: S, down: i32x8<S>) -> u32x8<S> {
    down.simd_gt(0).select(
        u32x8::splat(simd, UPPER_LEFT | UPPER_RIGHT | RIM),
        u32x8::splat(simd, LOWER_LEFT | LOWER_RIGHT | RIM),
    )
}

/// Bit `b` is 1 if a pixel with bits `b` is surrounded: by samples in all quadrants, or on one side
/// if a rim touches it.
const IS_SURROUNDED: u32 = {
    let all = LOWER_LEFT | LOWER_RIGHT | UPPER_LEFT | UPPER_RIGHT;
    let sides = [
        all,
        RIM | UPPER_LEFT | UPPER_RIGHT,
        RIM | LOWER_LEFT | LOWER_RIGHT,
        RIM | UPPER_LEFT | LOWER_LEFT,
        RIM | UPPER_RIGHT | LOWER_RIGHT,
    ];
    let mut table = 0;
    let mut bits = 0;
    while bits <= MASK >> SHIFT {
        let mut i = 0;
        while i < sides.len() {
            if (bits << SHIFT) & sides[i] == sides[i] {
                table |= 1 << bits;
            }
            i += 1;
        }
        bits += 1;
    }
    table
};

/// Returns 1 for pixels that are surrounded, 0 for others. `weights`: with their bits.
#[inline(always)]
pub(super) fn are_surrounded<S: Simd>(simd: S, weights: u32x8<S>) -> u32x8<S> {
    (u32x8::splat(simd, IS_SURROUNDED) >> (weights >> SHIFT)) & 1
}

/// [`are_surrounded`] for one pixel.
#[inline(always)]
pub(super) fn is_surrounded(weight: u32) -> bool {
    IS_SURROUNDED >> (weight >> SHIFT) & 1 == 1
}
