//! The pixels of a block, in tiles of sixteen: which layer each ray meets, and the blend of its
//! four cameras (L9, C21).
//!
//! Of a ray the slopes say all: texels in every camera's image are linear in them, layer by layer
//! ([`LayerInView`]), and so is the crossing of the camera plane, which decides the cell and the
//! bilinear weights. The index of a layer is looked up in the nearest texel; colours are bilinear
//! over those texels that show the layer, and normalised over the cameras that show it, in linear
//! light. A tile asks only for layers that show near it ([`Cells`]), and what its rays meet is
//! blended when one of them meets more ([`Pending`]).
//!
//! One code for every SIMD level, without fused multiply-adds and approximate reciprocals, so that
//! all give the same bits.

use super::cells::Batch;
use super::layer_in_view::LayerInView;
use super::pending::Pending;
use super::plan::{LumigraphPlan, Step, cell};
use super::rays::{Rays, TILE, inside};
use super::taps::{LANES, nearest};
use crate::Lumigraph;
use crate::grid::LEAST_FORWARD;
use crate::settings::Blend;
use fearless_simd::{Level as SimdLevel, Simd, dispatch, f32x16, i32x16, mask32x16, prelude::*};
use headbox_cube::render::canvas::linear::LinearLight;
use std::ops::Range;

/// Columns of a tile's pixels.
const LANE_COLUMNS: [f32; LANES] = [
    0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3.,
];

/// Smallest transparency of a pixel at which the search behind it goes on.
const LEAST_OPEN: f32 = 1.0 / 256.0;

/// A part of a frame.
pub(super) struct FrameBlock<'a> {
    pub(super) lumigraph: &'a Lumigraph,
    pub(super) plan: &'a LumigraphPlan,
    /// The layers that may show in it, near ones first.
    pub(super) batches: &'a [Batch],
    pub(super) columns: Range<usize>,
    pub(super) rows: Range<usize>,
    /// Width of the frame.
    pub(super) width: usize,
}

/// Alpha of pixels of which no camera of the ray's cell sees anything, though one looks there:
/// something nearer hides it.
pub(super) const HIDDEN: u8 = 1;

/// Pixels to draw, and the cameras to draw them from.
#[derive(Clone, Copy)]
pub(super) enum Pass<'a> {
    /// All, from the cameras of the ray's cell.
    First,
    /// Those that are [`HIDDEN`], in steps.
    Wider(&'a [Step]),
}

/// Draws a block on rows of the frame, of which the first is the block's: straight colours, with
/// alpha 255 where anything is, else 0 or [`HIDDEN`]. Returns whether any pixel is hidden.
pub(super) fn draw(
    block: &FrameBlock,
    pass: Pass,
    colors: &mut [[u8; 4]],
    level: SimdLevel,
) -> bool {
    dispatch!(level, simd => draw_block(simd, block, pass, colors))
}

#[inline(always)]
fn draw_block<S: Simd>(simd: S, block: &FrameBlock, pass: Pass, colors: &mut [[u8; 4]]) -> bool {
    let mut any_hidden = false;
    for y in block.rows.clone().step_by(TILE) {
        let starts = starts(block, y);
        for x in block.columns.clone().step_by(TILE) {
            let first = (y - block.rows.start) * block.width + x;
            let inside = [
                TILE.min(block.columns.end - x),
                TILE.min(block.rows.end - y),
            ];
            let tile = PixelTile {
                first,
                width: block.width,
                inside,
            };
            let wanted = match pass {
                Pass::First => tile.pixels(),
                Pass::Wider(_) => tile.hidden(colors),
            };
            if wanted != 0 {
                let (pixels, is_any_hidden) = sixteen(simd, block, pass, wanted, &starts, x as f32);
                tile.put(wanted, &pixels, colors);
                any_hidden |= is_any_hidden;
            }
        }
    }
    any_hidden
}

/// Directions of the left border of four rows, as lanes have them.
fn starts(block: &FrameBlock, y: usize) -> [[f32; LANES]; 3] {
    let view = &block.plan.view;
    let mut starts = [[0.0; LANES]; 3];
    for lane in 0..LANES {
        let row = (y + lane / TILE) as f64 + 0.5;
        let start = (view.start + view.step[0] * 0.5 + view.step[1] * row).as_vec3();
        (starts[0][lane], starts[1][lane], starts[2][lane]) = (start.x, start.y, start.z);
    }
    starts
}

/// Sixteen pixels, a lane each, row by row.
struct PixelTile {
    /// The first of them in the block's rows.
    first: usize,
    /// Width of the frame.
    width: usize,
    /// Columns and rows of it that are the block's.
    inside: [usize; 2],
}

impl PixelTile {
    /// Those that are the block's, a bit each.
    #[inline(always)]
    fn pixels(&self) -> u64 {
        let row = (1u64 << self.inside[0]) - 1;
        let rows = u64::MAX >> (64 - TILE * self.inside[1]);
        (row | row << TILE | row << (2 * TILE) | row << (3 * TILE)) & rows
    }

    #[inline(always)]
    fn place(&self, lane: usize) -> usize {
        self.first + lane / TILE * self.width + lane % TILE
    }

    /// Those that are hidden.
    #[inline(always)]
    fn hidden(&self, colors: &[[u8; 4]]) -> u64 {
        let (mut bits, mut left) = (0, self.pixels());
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let is_hidden = colors
                .get(self.place(lane))
                .is_some_and(|color| color[3] == HIDDEN);
            bits |= u64::from(is_hidden) << lane;
        }
        bits
    }

    #[inline(always)]
    fn put(&self, wanted: u64, pixels: &[[u8; 4]; LANES], colors: &mut [[u8; 4]]) {
        if wanted == 0xffff {
            for (row, pixels) in pixels.chunks_exact(TILE).enumerate() {
                let first = self.first + row * self.width;
                if let Some(colors) = colors.get_mut(first..first + TILE) {
                    colors.copy_from_slice(pixels);
                }
            }
            return;
        }
        let mut left = wanted;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            if let Some(color) = colors.get_mut(self.place(lane)) {
                *color = pixels[lane];
            }
        }
    }
}

/// Results of sixteen pixels.
struct TileResults<S: Simd> {
    color: [f32x16<S>; 3],
    /// Share of the pixel that is not taken yet.
    open: f32x16<S>,
    pending: Pending<S>,
}

/// Those of a tile's pixels that are `wanted`, and whether any is hidden; the tile's left border is
/// at column `x`.
#[inline(always)]
fn sixteen<S: Simd>(
    simd: S,
    block: &FrameBlock,
    pass: Pass,
    wanted: u64,
    starts: &[[f32; LANES]; 3],
    x: f32,
) -> ([[u8; 4]; LANES], bool) {
    let step = block.plan.view.step[0].as_vec3().to_array();
    let number = f32x16::load_array_ref(simd, &LANE_COLUMNS) + x;
    let forward = number * step[2] + f32x16::load_array_ref(simd, &starts[2]);
    let ahead = forward.simd_gt(LEAST_FORWARD as f32) & mask32x16::from_bitmask(simd, wanted);
    let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
    let open = ahead.select(one, zero);
    let mut found = TileResults {
        color: [zero; 3],
        open,
        pending: Pending::new(simd, block.lumigraph.pyramid.levels[0]),
    };
    let mut behind_something = mask32x16::from_bitmask(simd, 0);
    if ahead.any_true() {
        // Of all sixteen, so that those of the corners are about the others'.
        let per_forward = one / forward.max(LEAST_FORWARD as f32);
        let slopes = [
            (number * step[0] + f32x16::load_array_ref(simd, &starts[0])) * per_forward,
            (number * step[1] + f32x16::load_array_ref(simd, &starts[1])) * per_forward,
        ];
        match pass {
            Pass::First => {
                let rays = Rays::new(
                    simd,
                    block.plan,
                    block.lumigraph.pyramid.stride,
                    slopes,
                    Step::FIRST.shift,
                );
                draw_layers(simd, block, false, &rays, &mut found);
                let nothing = found.open.simd_ge(1.0);
                if nothing.any_true() {
                    behind_something = hides(simd, block, &rays, nothing);
                }
            }
            Pass::Wider(steps) => {
                look_beside(simd, block, steps, slopes, &mut found);
                behind_something = ahead;
            }
        }
    }
    resolve(simd, &found, ahead, behind_something)
}

/// Looks for what rays meet in steps, until nothing is left open.
#[inline(always)]
fn look_beside<S: Simd>(
    simd: S,
    block: &FrameBlock,
    steps: &[Step],
    slopes: [f32x16<S>; 2],
    found: &mut TileResults<S>,
) {
    for step in steps {
        // The same cell again shows the same.
        if leads_away(block, slopes, step.shift) {
            continue;
        }
        let rays = Rays::new(
            simd,
            block.plan,
            block.lumigraph.pyramid.stride,
            slopes,
            step.shift,
        );
        draw_layers(simd, block, step.loose, &rays, found);
        if !found.open.simd_ge(LEAST_OPEN).any_true() {
            break;
        }
    }
}

/// Lanes for which a camera of the cell that looks at infinity sees an occluder.
#[inline(always)]
fn hides<S: Simd>(simd: S, block: &FrameBlock, rays: &Rays<S>, of: mask32x16<S>) -> mask32x16<S> {
    let none = mask32x16::from_bitmask(simd, 0);
    let Some(infinity) = block
        .plan
        .layers
        .last()
        .filter(|layer| layer.indices == [0, 0])
    else {
        return none;
    };
    let places = rays.places(infinity);
    let pyramid = &block.lumigraph.pyramid;
    let level = pyramid.levels[infinity.level];
    let mut hides = none;
    for k in 0..4 {
        let at = places.of(k);
        let inside = of & inside(level, at);
        if inside.any_true() {
            hides |=
                inside & nearest(simd, &pyramid.texels, level, rays.base[k], at, inside).simd_gt(0);
        }
    }
    hides
}

/// Returns true if a shift leads out of the grid for all rays: nearer cells were tested before.
#[inline(always)]
fn leads_away<S: Simd>(block: &FrameBlock, slopes: [f32x16<S>; 2], shift: [i32; 2]) -> bool {
    let (view, places) = (&block.plan.view, [&block.plan.columns, &block.plan.rows]);
    let eye = view.eye.as_vec3().to_array();
    for axis in 0..2 {
        if shift[axis] != 0 {
            let crossings = (slopes[axis] * -eye[2] + eye[axis]).to_array();
            let last = places[axis].len() as i32 - 2;
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for crossing in crossings {
                (low, high) = (low.min(crossing), high.max(crossing));
            }
            let led = |crossing: f32| cell(places[axis], crossing) as i32 + shift[axis];
            if led(high) < 0 || led(low) > last {
                return true;
            }
        }
    }
    false
}

/// Adds what the rays meet in the block's layers, from near to far, until nothing is left to see
/// behind.
#[inline(always)]
fn draw_layers<S: Simd>(
    simd: S,
    block: &FrameBlock,
    loose: bool,
    rays: &Rays<S>,
    found: &mut TileResults<S>,
) {
    'layers: for batch in block.batches {
        let near = match &rays.bundle {
            Some(bundle) if block.plan.skip => {
                batch.near(simd, &block.lumigraph.cells, bundle, loose)
            }
            _ => batch.all(),
        };
        let mut left = near.layers;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            let mut ranges = [[0, u16::MAX]; 4];
            if let Some(squares) = &near.squares {
                for k in 0..4 {
                    ranges[k] = block.lumigraph.cells.range(squares[k][i]);
                }
            }
            if !draw_layer(simd, block, &batch.layers[i], ranges, loose, rays, found) {
                break 'layers;
            }
        }
    }
    found.pending.blend(
        simd,
        &block.lumigraph.pyramid,
        block.plan.paint.as_ref(),
        rays,
        &mut found.color,
    );
}

/// Finds what the rays meet in a layer, where the four cameras show indices of some ranges; false
/// if nothing is left to see behind it.
#[inline(always)]
fn draw_layer<S: Simd>(
    simd: S,
    block: &FrameBlock,
    layer: &LayerInView,
    ranges: [[u16; 2]; 4],
    loose: bool,
    rays: &Rays<S>,
    found: &mut TileResults<S>,
) -> bool {
    let indices = if loose {
        layer.with_neighbours
    } else {
        layer.indices
    };
    let pyramid = &block.lumigraph.pyramid;
    let level = pyramid.levels[layer.level];
    let places = rays.places(layer);
    let open = found.open.simd_ge(LEAST_OPEN);
    let zero = f32x16::splat(simd, 0.0);
    let (mut weight, mut showing, mut passing) = ([zero; 4], zero, zero);
    let (first, last) = (i32::from(indices[0]), i32::from(indices[1]));
    for k in 0..4 {
        let [lowest, highest] = ranges[k];
        if lowest > indices[1] {
            continue;
        }
        if highest < indices[0] {
            passing += open.select(rays.weight[k], zero);
            continue;
        }
        if lowest >= indices[0] && highest <= indices[1] {
            weight[k] = open.select(rays.weight[k], zero);
            showing += weight[k];
            continue;
        }
        let at = places.of(k);
        let inside = open & inside(level, at);
        if inside.any_true() {
            let index = nearest(simd, &pyramid.texels, level, rays.base[k], at, inside);
            weight[k] =
                (inside & index.simd_ge(first) & index.simd_le(last)).select(rays.weight[k], zero);
            showing += weight[k];
            passing += (inside & index.simd_lt(first)).select(rays.weight[k], zero);
        }
    }
    let shown = showing.simd_gt(0.0);
    if !shown.any_true() {
        return true;
    }
    if !found.pending.has_room(shown, level) {
        found.pending.blend(
            simd,
            pyramid,
            block.plan.paint.as_ref(),
            rays,
            &mut found.color,
        );
    }
    let one = f32x16::splat(simd, 1.0);
    let share = match block.plan.blend {
        Blend::Whole => one,
        Blend::Shared => showing / shown.select(showing + passing, one),
    };
    let taken = shown.select(found.open * share, zero);
    found
        .pending
        .put(shown, level, indices, &places, weight, taken);
    found.open -= taken;
    found.open.simd_ge(LEAST_OPEN).any_true()
}

/// Straight sRGB colours, with alpha 255 where anything was found, else 0 or, behind something,
/// [`HIDDEN`]; and whether any is hidden.
#[inline(always)]
fn resolve<S: Simd>(
    simd: S,
    found: &TileResults<S>,
    ahead: mask32x16<S>,
    behind: mask32x16<S>,
) -> ([[u8; 4]; LANES], bool) {
    let one = f32x16::splat(simd, 1.0);
    let share = one - found.open;
    let any = ahead & share.simd_gt(0.0);
    let scale = f32x16::splat(simd, f32::from(LinearLight::MAX) / 65535.0) / any.select(share, one);
    let mut linear = [[0; LANES]; 3];
    for c in 0..3 {
        let rounded = (found.color[c] * scale + 0.5).min(f32::from(LinearLight::MAX));
        linear[c] = rounded.to_int::<i32x16<S>>().to_array();
    }
    let mut pixels = [[0; 4]; LANES];
    let (any, hidden) = (any.to_bitmask(), (behind & !any).to_bitmask());
    let mut bits = hidden;
    while bits != 0 {
        pixels[bits.trailing_zeros() as usize][3] = HIDDEN;
        bits &= bits - 1;
    }
    let tables = LinearLight::tables();
    for (i, pixel) in pixels.iter_mut().enumerate() {
        if any >> i & 1 == 1 {
            let of = |c: usize| tables.srgb(linear[c][i] as u32);
            *pixel = [of(0), of(1), of(2), 255];
        }
    }
    (pixels, hidden != 0)
}
