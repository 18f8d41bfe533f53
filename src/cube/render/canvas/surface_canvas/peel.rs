//! Surface peeling of a tile: in each pixel the nearest surface is found and accumulated, then the
//! next one behind it, then all the rest together.
//!
//! Each step takes all splats of the tile and adds integers or takes maxima, so that their order
//! does not matter, and no step branches per pixel.

use super::mean::{BLOCK, NO_SUMS, Sums, blend_surfaces, means};
use super::surroundings;
use super::tile_splat::{TILE_ROWS, TileSplat, heights, weights};
use crate::render::canvas::Tolerance;
use crate::render::canvas::linear::LinearLight;
use crate::render::footprint::tent::ONE;
use fearless_simd::{Simd, f32x8, i32x8, mask32x8, prelude::*, u32x8};

/// Inverse depth where there is no surface.
const NOWHERE: f32 = -1.0;

/// Fraction of the relative tolerance that applies to the background, whose depth is exact in each
/// pixel, while that of a splat is the depth of its centre (docs/decisions/0051).
pub(in crate::render) const BACKGROUND_TOLERANCE: f32 = 0.25;

impl Tolerance {
    /// Returns the largest inverse depth of a front splat whose surface a splat at `inverse_depth`
    /// belongs to.
    #[inline(always)]
    fn reach(self, inverse_depth: f32) -> f32 {
        inverse_depth + self.difference(inverse_depth)
    }

    /// Same as [`Self::reach`], for the background in lanes.
    #[inline(always)]
    fn background_reach<S: Simd>(self, inverse_depth: f32x8<S>) -> f32x8<S> {
        inverse_depth + (inverse_depth * (self.relative * BACKGROUND_TOLERANCE)).max(self.least)
    }

    /// Returns the least [`Self::reach`] of splats that belong to the surface of a background in
    /// front of them, in lanes: of those a quarter of the tolerance behind it.
    #[inline(always)]
    fn reach_at_background<S: Simd>(self, inverse_depth: f32x8<S>) -> f32x8<S> {
        inverse_depth + inverse_depth * (self.relative * (1.0 - BACKGROUND_TOLERANCE))
    }
}

/// Set of rows of a tile, one bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RowMask(u32);

const _: () = assert!(TILE_ROWS == u32::BITS as usize, "one bit per row");

impl RowMask {
    /// Returns the rows that splats touch.
    #[inline(always)]
    fn from_splats(splats: &[TileSplat]) -> Self {
        let below = |row: u16| (1u64 << row.min(TILE_ROWS as u16)) - 1;
        Self(splats.iter().fold(0, |rows, splat| {
            rows | (below(splat.rows[1]) & !below(splat.rows[0])) as u32
        }))
    }

    /// Returns the rows of the set in ascending order.
    #[inline(always)]
    pub(super) fn rows(self) -> impl Iterator<Item = usize> {
        (0..TILE_ROWS).filter(move |row| self.0 >> row & 1 == 1)
    }

    #[inline(always)]
    pub(super) fn contains(self, row: usize) -> bool {
        self.0 >> row & 1 == 1
    }
}

/// One row of a [`TileSplat`], with the data of all steps.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct TentSpan {
    /// With the [`surroundings::column_bits`].
    weights: [u32; BLOCK],
    /// See [`surroundings::row_bits`].
    row_bits: u32,
    color: [u32; 3],
    inverse_depth: f32,
    /// See [`Tolerance::reach`].
    reach: f32,
    /// Row of the tile.
    row: u32,
}

const NO_SPAN: TentSpan = TentSpan {
    weights: [0; BLOCK],
    row_bits: 0,
    color: [0; 3],
    inverse_depth: NOWHERE,
    reach: NOWHERE,
    row: 0,
};

/// One row of a tile. Aligned so that no register is loaded from two cache lines.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct TileRow {
    /// Inverse depth of the front surface: the maximum.
    front: [f32; BLOCK],
    /// Least [`Tolerance::reach`] of splats on the front surface.
    least_reach: [f32; BLOCK],
    /// Inverse depth of the second surface.
    second: [f32; BLOCK],
    /// Weights of the front surface, when `sums` has those of the second.
    front_weights: [u32; BLOCK],
    /// Sums of the front surface, later of the second.
    sums: Sums,
    /// Sums of everything behind the second surface.
    rest: Sums,
    /// Opaque background: colours, 0 where there is none.
    background: [u32; BLOCK],
    /// Inverse depth of the background, [`NOWHERE`] where there is none.
    background_depth: [f32; BLOCK],
    /// Result: colours with coverage, 0..255.
    colors: [u32; BLOCK],
}

const EMPTY: TileRow = TileRow {
    front: [0.0; BLOCK],
    least_reach: [0.0; BLOCK],
    second: [NOWHERE; BLOCK],
    front_weights: [0; BLOCK],
    sums: NO_SUMS,
    rest: NO_SUMS,
    background: [0; BLOCK],
    background_depth: [NOWHERE; BLOCK],
    colors: [0; BLOCK],
};

/// Peeling state of a tile; its buffers are reused from tile to tile.
pub(super) struct Peel {
    rows: [TileRow; TILE_ROWS],
    /// The first `count` are in use.
    spans: Vec<TentSpan>,
    count: usize,
    /// Indices of the spans that lie behind the front surface somewhere; the first `count_behind`
    /// are in use.
    behind: Vec<u32>,
    count_behind: usize,
}

impl Default for Peel {
    fn default() -> Self {
        Self {
            rows: [EMPTY; TILE_ROWS],
            spans: Vec::new(),
            count: 0,
            behind: Vec::new(),
            count_behind: 0,
        }
    }
}

impl Peel {
    /// Peels the splats of a tile, and returns the rows that they touch; [`Self::result`] has the
    /// pixels of these.
    ///
    /// `background`: colours of a row, opaque where alpha is 255 and absent elsewhere, and 1 / eye
    /// depth, 1/m.
    #[inline(always)]
    pub(super) fn draw<'a, S: Simd>(
        &mut self,
        simd: S,
        splats: &[TileSplat],
        background: impl Fn(usize) -> Option<(&'a [[u8; 4]; BLOCK], &'a [f32; BLOCK])>,
        tolerance: Tolerance,
        light: &LinearLight,
    ) -> RowMask {
        let touched = RowMask::from_splats(splats);
        for row in touched.rows() {
            self.rows[row].set_background(simd, background(row));
        }
        self.find_front(simd, splats, tolerance);
        for row in touched.rows() {
            self.rows[row].begin_front(simd, tolerance);
        }
        self.accumulate_front(simd);
        let mut any_open = false;
        for row in touched.rows() {
            any_open |= self.rows[row].resolve_front(simd, tolerance);
        }
        if any_open {
            self.accumulate_behind(simd);
            for row in touched.rows() {
                self.rows[row].blend(simd, light);
            }
        }
        touched
    }

    /// Returns colours with coverage, 0..255, and inverse depths, 0 where there is no surface, of a
    /// row.
    #[inline(always)]
    pub(super) fn result(&self, row: usize) -> (&[u32; BLOCK], &[f32; BLOCK]) {
        (&self.rows[row].colors, &self.rows[row].front)
    }

    /// Computes the largest inverse depth of each pixel, and the spans.
    #[inline(always)]
    fn find_front<S: Simd>(&mut self, simd: S, splats: &[TileSplat], tolerance: Tolerance) {
        self.count = splats
            .iter()
            .map(|splat| usize::from(splat.rows[1] - splat.rows[0]))
            .sum();
        if self.spans.len() < self.count {
            self.spans.resize(self.count, NO_SPAN);
        }
        let mut spans = self.spans.iter_mut();
        for splat in splats {
            let inverse_depth = splat.inverse_depth;
            let reach = tolerance.reach(inverse_depth);
            let color = splat.color.map(u32::from);
            let column_distances = splat.column_distances(simd);
            let column_heights = heights(simd, column_distances);
            let column_bits = surroundings::column_bits(simd, splat.kind, column_distances);
            let q = f32x8::splat(simd, inverse_depth);
            let [mut first, end] = splat.rows.map(usize::from);
            while first < end {
                let row_distances = splat.row_distances(simd, first);
                let row_heights = splat.row_heights(simd, row_distances).to_array();
                let row_bits = surroundings::row_bits(simd, row_distances).to_array();
                for i in 0..BLOCK {
                    let row = first + i;
                    if row >= end {
                        break;
                    }
                    let Some(span) = spans.next() else { return };
                    let weight = weights(column_heights, row_heights[i]);
                    let bits = is_positive(weight).select(column_bits, u32x8::splat(simd, 0));
                    (weight | bits).store_array(&mut span.weights);
                    span.row_bits = row_bits[i];
                    span.color = color;
                    span.row = row as u32;
                    span.inverse_depth = inverse_depth;
                    span.reach = reach;
                    self.rows[row % TILE_ROWS].accumulate_nearest(simd, weight, q);
                }
                first += BLOCK;
            }
        }
    }

    /// Accumulates the splats on the front surface, and finds the largest inverse depth of those
    /// behind it.
    #[inline(always)]
    fn accumulate_front<S: Simd>(&mut self, simd: S) {
        if self.behind.len() < self.count {
            self.behind.resize(self.count, 0);
        }
        let nowhere = f32x8::splat(simd, NOWHERE);
        let zero = u32x8::splat(simd, 0);
        let mut count = 0;
        for (i, span) in self.spans.iter().take(self.count).enumerate() {
            let row = &mut self.rows[span.row as usize % TILE_ROWS];
            let weight = u32x8::load_array(simd, span.weights);
            let on_front = f32x8::load_array(simd, row.least_reach).simd_le(span.reach);
            add(simd, &mut row.sums, on_front.select(weight, zero), span);
            let behind = is_positive(weight) & !on_front;
            let q = behind.select(f32x8::splat(simd, span.inverse_depth), nowhere);
            f32x8::load_array(simd, row.second)
                .max(q)
                .store_array(&mut row.second);
            // Always written, and counted only if behind: avoids an unpredictable branch.
            self.behind[count] = i as u32;
            count += usize::from(behind.any_true());
        }
        self.count_behind = count;
    }

    /// Accumulates the splats behind the front surface in pixels that it does not fill: on the
    /// second surface, and behind.
    #[inline(always)]
    fn accumulate_behind<S: Simd>(&mut self, simd: S) {
        let zero = u32x8::splat(simd, 0);
        for &i in self.behind.iter().take(self.count_behind) {
            let span = &self.spans[i as usize];
            let row = &mut self.rows[span.row as usize % TILE_ROWS];
            let second = f32x8::load_array(simd, row.second);
            let behind =
                f32x8::load_array(simd, row.least_reach).simd_gt(span.reach) & second.simd_ge(0.0);
            if !behind.any_true() {
                continue;
            }
            let weight = behind.select(u32x8::load_array(simd, span.weights), zero);
            let on_second = second.simd_le(span.reach);
            add(simd, &mut row.sums, on_second.select(weight, zero), span);
            add(simd, &mut row.rest, on_second.select(zero, weight), span);
        }
    }
}

impl TileRow {
    /// Initialises the row from the background.
    #[inline(always)]
    fn set_background<S: Simd>(
        &mut self,
        simd: S,
        background: Option<(&[[u8; 4]; BLOCK], &[f32; BLOCK])>,
    ) {
        self.background = [0; BLOCK];
        self.background_depth = [NOWHERE; BLOCK];
        if let Some((colors, inverse_depths)) = background {
            let colors = u32x8::load_array(simd, colors.map(u32::from_le_bytes));
            let is_opaque = (colors >> 24).simd_eq(255);
            is_opaque
                .select(colors, u32x8::splat(simd, 0))
                .store_array(&mut self.background);
            let inverse_depth = f32x8::load_array(simd, *inverse_depths).max(0.0);
            is_opaque
                .select(inverse_depth, f32x8::splat(simd, NOWHERE))
                .store_array(&mut self.background_depth);
        }
        self.front = self.background_depth;
    }

    /// Takes the maximum of `front` and `inverse_depth` where `weight > 0`.
    #[inline(always)]
    fn accumulate_nearest<S: Simd>(&mut self, simd: S, weight: u32x8<S>, inverse_depth: f32x8<S>) {
        let candidate = is_positive(weight).select(inverse_depth, f32x8::splat(simd, NOWHERE));
        f32x8::load_array(simd, self.front)
            .max(candidate)
            .store_array(&mut self.front);
    }

    /// Initialises the sums of the front surface with the background where that belongs to it;
    /// elsewhere the background is a candidate for the second surface.
    #[inline(always)]
    fn begin_front<S: Simd>(&mut self, simd: S, tolerance: Tolerance) {
        let q = f32x8::load_array(simd, self.background_depth);
        let exists = q.simd_ge(0.0);
        let front = f32x8::load_array(simd, self.front);
        let on_front = front.simd_le(tolerance.background_reach(q)) & exists;
        // The depth of the background is exact: it hides splats that are barely behind it.
        (exists & front.simd_le(q))
            .select(tolerance.reach_at_background(front), front)
            .store_array(&mut self.least_reach);
        self.sums = background_sums(simd, on_front, &self.background);
        (!on_front & exists)
            .select(q, f32x8::splat(simd, NOWHERE))
            .store_array(&mut self.second);
    }

    /// Computes the colours of the front surface, and initialises the sums of the second surface
    /// and of the rest with the background. Pixels that the front surface fills have no second
    /// surface; returns true if any pixel has one.
    #[inline(always)]
    fn resolve_front<S: Simd>(&mut self, simd: S, tolerance: Tolerance) -> bool {
        let color = means(simd, &self.sums);
        color.store_array(&mut self.colors);
        let nowhere = f32x8::splat(simd, NOWHERE);
        let front = f32x8::load_array(simd, self.front).max(0.0);
        front.store_array(&mut self.front);
        let second = (color >> 24)
            .simd_lt(255)
            .select(f32x8::load_array(simd, self.second), nowhere);
        second.store_array(&mut self.second);
        let is_open = second.simd_ge(0.0);
        if !is_open.any_true() {
            return false;
        }
        self.front_weights = self.sums[3];
        let q = f32x8::load_array(simd, self.background_depth);
        let reach = tolerance.background_reach(q);
        let behind = is_open & q.simd_ge(0.0) & front.simd_gt(reach);
        let on_second = second.simd_le(reach);
        self.sums = background_sums(simd, behind & on_second, &self.background);
        self.rest = background_sums(simd, behind & !on_second, &self.background);
        true
    }

    /// Blends the front surface with the surfaces behind it. The second one covers what the front
    /// leaves of pixels that lie among the samples of both.
    #[inline(always)]
    fn blend<S: Simd>(&mut self, simd: S, light: &LinearLight) {
        let mut open = f32x8::load_array(simd, self.second)
            .simd_ge(0.0)
            .to_bitmask();
        if open == 0 {
            return;
        }
        let second = means(simd, &self.sums).to_array();
        let rest = means(simd, &self.rest).to_array();
        while open != 0 {
            let i = open.trailing_zeros() as usize;
            open &= open - 1;
            let mut surfaces = [self.colors[i], second[i], rest[i]].map(u32::to_le_bytes);
            if surroundings::is_surrounded(self.front_weights[i] | self.sums[3][i]) {
                surfaces[1][3] = 255;
            }
            self.colors[i] = u32::from_le_bytes(blend_surfaces(surfaces, light));
        }
    }
}

/// Returns the lanes with weight > 0, with or without bits of [`surroundings`].
#[inline(always)]
fn is_positive<S: Simd>(weight: u32x8<S>) -> mask32x8<S> {
    let weight: i32x8<S> = weight.bitcast();
    weight.simd_gt(0)
}

/// Adds the colour of a span times weights, and the weights; combines the bits of [`surroundings`].
#[inline(always)]
fn add<S: Simd>(simd: S, sums: &mut Sums, weight: u32x8<S>, span: &TentSpan) {
    let [reds, greens, blues, weights] = sums;
    let [red, green, blue] = span.color;
    let bits = weight & span.row_bits;
    let weight = weight & !surroundings::MASK;
    (u32x8::load_array(simd, *reds) + weight * red).store_array(reds);
    (u32x8::load_array(simd, *greens) + weight * green).store_array(greens);
    (u32x8::load_array(simd, *blues) + weight * blue).store_array(blues);
    ((u32x8::load_array(simd, *weights) + weight) | bits).store_array(weights);
}

/// Returns sums of the background in some lanes, as of a splat of weight 1.
#[inline(always)]
fn background_sums<S: Simd>(simd: S, lanes: mask32x8<S>, colors: &[u32; BLOCK]) -> Sums {
    let color = lanes.select(u32x8::load_array(simd, *colors), u32x8::splat(simd, 0));
    let weight = lanes.select(u32x8::splat(simd, ONE), u32x8::splat(simd, 0));
    let [red, green, blue] = [color & 255, (color >> 8) & 255, (color >> 16) & 255];
    [
        (red * ONE).to_array(),
        (green * ONE).to_array(),
        (blue * ONE).to_array(),
        weight.to_array(),
    ]
}
