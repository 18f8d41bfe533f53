//! What of a tent lies in a tile of the frame.

use super::mean::BLOCK;
use crate::render::footprint::tent::TOP;
use fearless_simd::{Simd, i32x8, prelude::*, u32x8};

/// Rows of a tile, which is a block of columns wide.
pub(super) const TILE_ROWS: usize = 32;

/// What of a tent lies in a tile.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Piece {
    /// Distance of the tile's first column from the tent's middle over the radius, and what it changes by from column to column, in 2^-15.
    pub(super) across: [i32; 2],
    /// The same of the tile's first row, from row to row.
    pub(super) down: [i32; 2],
    /// Weight in the middle, at most 2^16.
    pub(super) peak: u32,
    /// Red, green and blue, as they lie in memory.
    pub(super) color: [u8; 4],
    /// 1 / eye depth, 1/m.
    pub(super) inverse_depth: f32,
    /// The first row that it touches, and the one after the last.
    pub(super) rows: [u16; 2],
}

const _: () = assert!(size_of::<Piece>() == 32, "two pieces a line of the cache");

impl Piece {
    /// Heights of the tent across the tile, 0 to [`TOP`].
    #[inline(always)]
    pub(super) fn across<S: Simd>(&self, simd: S) -> u32x8<S> {
        let [at, step] = self.across;
        let at = i32x8::load_array(simd, LANES) * step + at;
        (i32x8::splat(simd, TOP) - at.abs()).max(0).bitcast()
    }

    /// Heights of the tent in as many rows of the tile, times its peak, at most 2^16.
    #[inline(always)]
    pub(super) fn heights<S: Simd>(&self, simd: S, first: usize) -> u32x8<S> {
        let [at, step] = self.down;
        let at = i32x8::load_array(simd, LANES) * step
            + at.wrapping_add((first as i32).wrapping_mul(step));
        let heights: u32x8<S> = (i32x8::splat(simd, TOP) - at.abs()).max(0).bitcast();
        (heights * self.peak) >> 15
    }
}

const LANES: [i32; BLOCK] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Weights in a row of a tile, at most [`crate::render::footprint::tent::ONE`].
#[inline(always)]
pub(super) fn weights<S: Simd>(across: u32x8<S>, height: u32) -> u32x8<S> {
    (across * height + (1 << 23)) >> 24
}
