//! The surfaces of a tile, peeled: of each pixel the nearest, what lies on it added up, then the same for the next one behind it, and
//! for all the rest together.
//!
//! Each step looks at all that is drawn on the tile and adds whole numbers, or finds the largest, so that no order matters, and no step
//! has a branch for a pixel.

use super::mean::{BLOCK, NO_SUMS, Sums, means, together};
use super::piece::{Piece, TILE_ROWS, weights};
use crate::render::canvas::linear::LinearLight;
use crate::render::footprint::tent::ONE;
use fearless_simd::{Simd, f32x8, i32x8, mask32x8, prelude::*, u32x8};

/// Inverse depth where nothing is.
const NOWHERE: f32 = -1.0;

/// What lies under splats and hides a pixel wholly is as far away as it says there, where a splat is as far away as its middle: so much of
/// the relative tolerance is left (docs/decisions/0051).
pub(in crate::render) const GROUND_PART: f32 = 0.25;

/// Two splats are of one surface up to this difference of inverse depth.
#[derive(Clone, Copy)]
pub(super) struct Tolerance {
    /// Part of the inverse depth.
    pub(super) relative: f32,
    /// The least difference, 1/m.
    pub(super) least: f32,
}

impl Tolerance {
    /// The largest inverse depth of a surface's nearest splat for another to lie on it.
    #[inline(always)]
    fn reach(self, inverse_depth: f32) -> f32 {
        inverse_depth + (inverse_depth * self.relative).max(self.least)
    }

    /// The same of what lies under all that is drawn, in lanes.
    #[inline(always)]
    fn reach_of_ground<S: Simd>(self, inverse_depth: f32x8<S>) -> f32x8<S> {
        inverse_depth + (inverse_depth * (self.relative * GROUND_PART)).max(self.least)
    }
}

/// Rows of a tile, a bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Touched(u32);

const _: () = assert!(TILE_ROWS == u32::BITS as usize, "a bit for each row");

impl Touched {
    /// The rows that some pieces touch.
    #[inline(always)]
    fn by(pieces: &[Piece]) -> Self {
        let below = |row: u16| (1u64 << row.min(TILE_ROWS as u16)) - 1;
        Self(pieces.iter().fold(0, |rows, piece| {
            rows | (below(piece.rows[1]) & !below(piece.rows[0])) as u32
        }))
    }

    /// From the first to the last.
    #[inline(always)]
    pub(super) fn rows(self) -> impl Iterator<Item = usize> {
        (0..TILE_ROWS).filter(move |row| self.0 >> row & 1 == 1)
    }

    #[inline(always)]
    pub(super) fn contains(self, row: usize) -> bool {
        self.0 >> row & 1 == 1
    }
}

/// A row of a piece: what it weighs in each column, and all else that is asked of it again and again.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Stroke {
    weights: [u32; BLOCK],
    color: [u32; 3],
    inverse_depth: f32,
    /// See [`Tolerance::reach`].
    reach: f32,
    /// Row of the tile.
    row: u32,
}

const NO_STROKE: Stroke = Stroke {
    weights: [0; BLOCK],
    color: [0; 3],
    inverse_depth: NOWHERE,
    reach: NOWHERE,
    row: 0,
};

/// One row of a tile.
#[derive(Clone, Copy)]
struct Row {
    /// Inverse depth of the front surface: the largest.
    front: [f32; BLOCK],
    /// Of the surface behind it.
    second: [f32; BLOCK],
    /// Of the front surface, then of the second.
    sums: Sums,
    /// Of all that lies behind the second.
    rest: Sums,
    /// What lies under all that is drawn and hides its pixel wholly: colours, 0 for nothing, and inverse depths.
    ground: [u32; BLOCK],
    ground_inverse_depth: [f32; BLOCK],
    /// What shows: colours with shares of 255.
    colors: [u32; BLOCK],
}

const EMPTY: Row = Row {
    front: [0.0; BLOCK],
    second: [NOWHERE; BLOCK],
    sums: NO_SUMS,
    rest: NO_SUMS,
    ground: [0; BLOCK],
    ground_inverse_depth: [NOWHERE; BLOCK],
    colors: [0; BLOCK],
};

/// What is found out about a tile.
pub(super) struct Peel {
    rows: [Row; TILE_ROWS],
    /// As many as `count`, and what is left of other tiles.
    strokes: Vec<Stroke>,
    count: usize,
    /// Which of them lie behind the front surface somewhere: as many as `count_behind`, and what is left.
    behind: Vec<u32>,
    count_behind: usize,
}

impl Default for Peel {
    fn default() -> Self {
        Self {
            rows: [EMPTY; TILE_ROWS],
            strokes: Vec::new(),
            count: 0,
            behind: Vec::new(),
            count_behind: 0,
        }
    }
}

impl Peel {
    /// Draws pieces on what lies under them, and returns the rows that any of them touches. [`Self::shown`] tells what shows there.
    ///
    /// `ground`: of a row, colours that hide their pixel where alpha is 255 and are not there elsewhere, and 1 / eye depth, 1/m.
    #[inline(always)]
    pub(super) fn draw<'a, S: Simd>(
        &mut self,
        simd: S,
        pieces: &[Piece],
        ground: impl Fn(usize) -> Option<(&'a [[u8; 4]; BLOCK], &'a [f32; BLOCK])>,
        tolerance: Tolerance,
        light: &LinearLight,
    ) -> Touched {
        let touched = Touched::by(pieces);
        for row in touched.rows() {
            self.rows[row].lay(simd, ground(row));
        }
        self.find_front(simd, pieces, tolerance);
        for row in touched.rows() {
            self.rows[row].begin_front(simd, tolerance);
        }
        self.add_front(simd);
        let mut some_open = false;
        for row in touched.rows() {
            some_open |= self.rows[row].color_front(simd, tolerance);
        }
        if some_open {
            self.add_behind(simd);
            for row in touched.rows() {
                self.rows[row].blend(simd, light);
            }
        }
        touched
    }

    /// Colours with shares of 255, and inverse depths, 0 where nothing is, in a row.
    #[inline(always)]
    pub(super) fn shown(&self, row: usize) -> (&[u32; BLOCK], &[f32; BLOCK]) {
        (&self.rows[row].colors, &self.rows[row].front)
    }

    /// The largest inverse depth of each pixel; and strokes.
    #[inline(always)]
    fn find_front<S: Simd>(&mut self, simd: S, pieces: &[Piece], tolerance: Tolerance) {
        self.count = pieces
            .iter()
            .map(|piece| usize::from(piece.rows[1] - piece.rows[0]))
            .sum();
        if self.strokes.len() < self.count {
            self.strokes.resize(self.count, NO_STROKE);
        }
        let mut strokes = self.strokes.iter_mut();
        for piece in pieces {
            let (inverse_depth, reach) =
                (piece.inverse_depth, tolerance.reach(piece.inverse_depth));
            let color = [0, 1, 2].map(|channel| u32::from(piece.color[channel]));
            let (across, q) = (piece.across(simd), f32x8::splat(simd, inverse_depth));
            let [mut first, end] = piece.rows.map(usize::from);
            while first < end {
                let heights = piece.heights(simd, first).to_array();
                for (row, height) in (first..end).zip(heights) {
                    let Some(stroke) = strokes.next() else { return };
                    let weight = weights(across, height);
                    weight.store_array(&mut stroke.weights);
                    (stroke.color, stroke.row) = (color, row as u32);
                    (stroke.inverse_depth, stroke.reach) = (inverse_depth, reach);
                    self.rows[row % TILE_ROWS].come_near(simd, weight, q);
                }
                first += BLOCK;
            }
        }
    }

    /// Adds what lies on the front surface, and finds the largest inverse depth of what lies behind it.
    #[inline(always)]
    fn add_front<S: Simd>(&mut self, simd: S) {
        if self.behind.len() < self.count {
            self.behind.resize(self.count, 0);
        }
        let (nowhere, none) = (f32x8::splat(simd, NOWHERE), u32x8::splat(simd, 0));
        let mut count = 0;
        for (i, stroke) in self.strokes.iter().take(self.count).enumerate() {
            let row = &mut self.rows[stroke.row as usize % TILE_ROWS];
            let weight = u32x8::load_array(simd, stroke.weights);
            let on_front = f32x8::load_array(simd, row.front).simd_le(stroke.reach);
            add(
                simd,
                &mut row.sums,
                on_front.select(weight, none),
                &stroke.color,
            );
            let behind = is_there(weight) & !on_front;
            let q = behind.select(f32x8::splat(simd, stroke.inverse_depth), nowhere);
            f32x8::load_array(simd, row.second)
                .max(q)
                .store_array(&mut row.second);
            // Written wherever it lies, and kept if it lies behind: no branch that nobody foresees.
            self.behind[count] = i as u32;
            count += usize::from(behind.any_true());
        }
        self.count_behind = count;
    }

    /// Adds what lies behind the front surface where that leaves something open: on the second surface, and behind it.
    #[inline(always)]
    fn add_behind<S: Simd>(&mut self, simd: S) {
        let none = u32x8::splat(simd, 0);
        for &i in self.behind.iter().take(self.count_behind) {
            let stroke = &self.strokes[i as usize];
            let row = &mut self.rows[stroke.row as usize % TILE_ROWS];
            let second = f32x8::load_array(simd, row.second);
            let behind =
                f32x8::load_array(simd, row.front).simd_gt(stroke.reach) & second.simd_ge(0.0);
            if !behind.any_true() {
                continue;
            }
            let weight = behind.select(u32x8::load_array(simd, stroke.weights), none);
            let on_second = second.simd_le(stroke.reach);
            add(
                simd,
                &mut row.sums,
                on_second.select(weight, none),
                &stroke.color,
            );
            add(
                simd,
                &mut row.rest,
                on_second.select(none, weight),
                &stroke.color,
            );
        }
    }
}

impl Row {
    /// Says what lies under it.
    #[inline(always)]
    fn lay<S: Simd>(&mut self, simd: S, ground: Option<(&[[u8; 4]; BLOCK], &[f32; BLOCK])>) {
        (self.ground, self.ground_inverse_depth) = ([0; BLOCK], [NOWHERE; BLOCK]);
        if let Some((colors, inverse_depths)) = ground {
            let colors = u32x8::load_array(simd, colors.map(u32::from_le_bytes));
            let is_whole = (colors >> 24).simd_eq(255);
            is_whole
                .select(colors, u32x8::splat(simd, 0))
                .store_array(&mut self.ground);
            let inverse_depth = f32x8::load_array(simd, *inverse_depths).max(0.0);
            is_whole
                .select(inverse_depth, f32x8::splat(simd, NOWHERE))
                .store_array(&mut self.ground_inverse_depth);
        }
        self.front = self.ground_inverse_depth;
    }

    /// Something of an inverse depth is there where it weighs anything.
    #[inline(always)]
    fn come_near<S: Simd>(&mut self, simd: S, weight: u32x8<S>, inverse_depth: f32x8<S>) {
        let there = is_there(weight).select(inverse_depth, f32x8::splat(simd, NOWHERE));
        f32x8::load_array(simd, self.front)
            .max(there)
            .store_array(&mut self.front);
    }

    /// Begins the sums of the front surface with what lies under all, if it is of that surface; else it is behind.
    #[inline(always)]
    fn begin_front<S: Simd>(&mut self, simd: S, tolerance: Tolerance) {
        let q = f32x8::load_array(simd, self.ground_inverse_depth);
        let is_there = q.simd_ge(0.0);
        let on_front =
            f32x8::load_array(simd, self.front).simd_le(tolerance.reach_of_ground(q)) & is_there;
        self.sums = of_ground(simd, on_front, &self.ground);
        (!on_front & is_there)
            .select(q, f32x8::splat(simd, NOWHERE))
            .store_array(&mut self.second);
    }

    /// Colours of the front surface, and the sums of what is behind it begun. Where it fills its pixel, nothing is behind; returns whether
    /// anything is anywhere.
    #[inline(always)]
    fn color_front<S: Simd>(&mut self, simd: S, tolerance: Tolerance) -> bool {
        let color = means(simd, &self.sums);
        color.store_array(&mut self.colors);
        let (nowhere, front) = (
            f32x8::splat(simd, NOWHERE),
            f32x8::load_array(simd, self.front).max(0.0),
        );
        front.store_array(&mut self.front);
        let second = (color >> 24)
            .simd_lt(255)
            .select(f32x8::load_array(simd, self.second), nowhere);
        second.store_array(&mut self.second);
        let is_open = second.simd_ge(0.0);
        if !is_open.any_true() {
            return false;
        }
        let q = f32x8::load_array(simd, self.ground_inverse_depth);
        let reach = tolerance.reach_of_ground(q);
        let behind = is_open & q.simd_ge(0.0) & front.simd_gt(reach);
        let on_second = second.simd_le(reach);
        self.sums = of_ground(simd, behind & on_second, &self.ground);
        self.rest = of_ground(simd, behind & !on_second, &self.ground);
        true
    }

    /// Lays the front surface over what is behind it.
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
            let surfaces = [self.colors[i], second[i], rest[i]].map(u32::to_le_bytes);
            self.colors[i] = u32::from_le_bytes(together(surfaces, light));
        }
    }
}

/// Lanes of some weight.
#[inline(always)]
fn is_there<S: Simd>(weight: u32x8<S>) -> mask32x8<S> {
    let weight: i32x8<S> = weight.bitcast();
    weight.simd_gt(0)
}

/// Adds a colour by weights.
#[inline(always)]
fn add<S: Simd>(simd: S, sums: &mut Sums, weight: u32x8<S>, [red, green, blue]: &[u32; 3]) {
    let [reds, greens, blues, weights] = sums;
    (u32x8::load_array(simd, *reds) + weight * *red).store_array(reds);
    (u32x8::load_array(simd, *greens) + weight * *green).store_array(greens);
    (u32x8::load_array(simd, *blues) + weight * *blue).store_array(blues);
    (u32x8::load_array(simd, *weights) + weight).store_array(weights);
}

/// Sums of what lies under a tile, in some lanes: a splat of weight 1.
#[inline(always)]
fn of_ground<S: Simd>(simd: S, lanes: mask32x8<S>, colors: &[u32; BLOCK]) -> Sums {
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
