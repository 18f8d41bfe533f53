//! A tent clipped to a tile.

use super::mean::BLOCK;
use crate::render::footprint::tent::TOP;
use fearless_simd::{Simd, i32x8, prelude::*, u32x8};

/// Rows of a tile, which is [`BLOCK`] columns wide.
pub(super) const TILE_ROWS: usize = 32;

/// Kind of a [`TileSplat`], by what it says about the surface around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum SplatKind {
    /// A sample that covers its depth pixel in part: nothing.
    Translucent,
    /// A sample that covers its depth pixel: it continues to the next sample.
    Opaque,
    /// A partly covered pixel of a plane texture.
    Rim,
}

/// A tent clipped to a tile.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct TileSplat {
    /// Distance of the tile's first column from the tent's centre over the radius, and its change
    /// from column to column, in 2^-15.
    pub(super) across: [i32; 2],
    /// Distance of the tile's first row, and its change from row to row.
    pub(super) down: [i32; 2],
    /// Weight at the centre, at most 2^16.
    pub(super) peak: u32,
    /// Red, green and blue.
    pub(super) color: [u8; 3],
    pub(super) kind: SplatKind,
    /// 1 / eye depth, 1/m.
    pub(super) inverse_depth: f32,
    /// First row of the tile that the tent touches, and the one after the last.
    pub(super) rows: [u16; 2],
}

const _: () = assert!(size_of::<TileSplat>() == 32, "two per cache line");

impl TileSplat {
    /// Returns the distances of the columns of the tile from the centre.
    #[inline(always)]
    pub(super) fn column_distances<S: Simd>(&self, simd: S) -> i32x8<S> {
        let [first, step] = self.across;
        i32x8::load_array(simd, LANE_NUMBERS) * step + first
    }

    /// Returns the distances of [`BLOCK`] rows of the tile from the centre.
    #[inline(always)]
    pub(super) fn row_distances<S: Simd>(&self, simd: S, first_row: usize) -> i32x8<S> {
        let [first, step] = self.down;
        i32x8::load_array(simd, LANE_NUMBERS) * step
            + first.wrapping_add((first_row as i32).wrapping_mul(step))
    }

    /// Returns the heights of the tent in rows at some distances, times its peak, at most 2^16.
    #[inline(always)]
    pub(super) fn row_heights<S: Simd>(&self, simd: S, distances: i32x8<S>) -> u32x8<S> {
        (heights(simd, distances) * self.peak) >> 15
    }
}

/// Returns the heights of a profile at some distances from its centre, 0 to [`TOP`].
#[inline(always)]
pub(super) fn heights<S: Simd>(simd: S, distances: i32x8<S>) -> u32x8<S> {
    (i32x8::splat(simd, TOP) - distances.abs()).max(0).bitcast()
}

const LANE_NUMBERS: [i32; BLOCK] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Computes the weights in a row of a tile, at most [`crate::render::footprint::tent::ONE`].
#[inline(always)]
pub(super) fn weights<S: Simd>(column_heights: u32x8<S>, row_height: u32) -> u32x8<S> {
    (column_heights * row_height + (1 << 23)) >> 24
}
