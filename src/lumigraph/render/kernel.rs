//! Pixels of a block, in tiles of sixteen: finds the layer that each ray hits, and blends its four
//! cameras (L9, C21).
//!
//! The slopes of a ray are sufficient: texel positions in every camera's image are linear in them,
//! layer by layer ([`LayerInView`]), and so is the crossing of the camera plane, which determines
//! the cell and the bilinear weights. The index of a layer is looked up in the nearest texel;
//! colours are bilinear over the texels of that layer, and normalised over the cameras that see it,
//! in linear light. A tile tests only layers near it ([`Cells`]), and hits are blended when one of
//! its rays hits another layer ([`Pending`]).
//!
//! The same code for every SIMD level, without fused multiply-adds and approximate reciprocals, so
//! that all give the same bits.

use super::cells::Batch;
use super::lanes::pending::Pending;
use super::lanes::rays::{Rays, TILE, inside};
use super::lanes::taps::{LANES, nearest};
use super::layer_in_view::LayerInView;
use super::plan::{LumigraphPlan, Step, cell};
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

/// Smallest remaining transparency of a pixel at which the search continues behind it.
const LEAST_OPEN: f32 = 1.0 / 256.0;

/// Block of a frame.
pub(super) struct FrameBlock<'a> {
    pub(super) lumigraph: &'a Lumigraph,
    pub(super) plan: &'a LumigraphPlan,
    /// Layers that may be visible in the block, from near to far.
    pub(super) batches: &'a [Batch],
    pub(super) columns: Range<usize>,
    pub(super) rows: Range<usize>,
    /// Width of the frame.
    pub(super) width: usize,
}

/// Alpha of hidden pixels: no camera of the ray's cell sees what the ray hits, because of an
/// occluder in a camera's image.
pub(super) const HIDDEN: u8 = 1;

/// Pixels to draw, and the cameras to draw them from.
#[derive(Clone, Copy)]
pub(super) enum Pass<'a> {
    /// All pixels, from the cameras of the ray's cell.
    First,
    /// Pixels that are [`HIDDEN`], from the cameras of each step.
    OtherCells(&'a [Step]),
}

/// Draws a block into the rows of the frame that contain it: straight colours, with alpha 255 in
/// covered pixels, else 0 or [`HIDDEN`]. Returns true if any pixel is hidden.
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
        let starts = row_starts(block, y);
        for x in block.columns.clone().step_by(TILE) {
            let first = (y - block.rows.start) * block.width + x;
            let tile = PixelTile {
                first,
                width: block.width,
                inside: [
                    TILE.min(block.columns.end - x),
                    TILE.min(block.rows.end - y),
                ],
            };
            let wanted = match pass {
                Pass::First => tile.pixels(),
                Pass::OtherCells(_) => tile.hidden(colors),
            };
            if wanted != 0 {
                let (pixels, is_any_hidden) =
                    draw_tile(simd, block, pass, wanted, &starts, x as f32);
                tile.store(wanted, &pixels, colors);
                any_hidden |= is_any_hidden;
            }
        }
    }
    any_hidden
}

/// Returns the ray directions at the left border of four rows, per lane.
fn row_starts(block: &FrameBlock, y: usize) -> [[f32; LANES]; 3] {
    let view = &block.plan.view;
    let mut starts = [[0.0; LANES]; 3];
    for lane in 0..LANES {
        let row = (y + lane / TILE) as f64 + 0.5;
        let start = (view.start + view.step[0] * 0.5 + view.step[1] * row).as_vec3();
        (starts[0][lane], starts[1][lane], starts[2][lane]) = (start.x, start.y, start.z);
    }
    starts
}

/// Tile of sixteen pixels, a lane each, row by row.
struct PixelTile {
    /// Index of the first pixel in the block's rows.
    first: usize,
    /// Width of the frame.
    width: usize,
    /// Number of columns and rows inside the block.
    inside: [usize; 2],
}

impl PixelTile {
    /// Returns the bit mask of the pixels inside the block.
    #[inline(always)]
    fn pixels(&self) -> u64 {
        let row = (1u64 << self.inside[0]) - 1;
        let rows = u64::MAX >> (64 - TILE * self.inside[1]);
        (row | row << TILE | row << (2 * TILE) | row << (3 * TILE)) & rows
    }

    #[inline(always)]
    fn index(&self, lane: usize) -> usize {
        self.first + lane / TILE * self.width + lane % TILE
    }

    /// Returns the bit mask of the hidden pixels.
    #[inline(always)]
    fn hidden(&self, colors: &[[u8; 4]]) -> u64 {
        let (mut bits, mut left) = (0, self.pixels());
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let is_hidden = colors
                .get(self.index(lane))
                .is_some_and(|color| color[3] == HIDDEN);
            bits |= u64::from(is_hidden) << lane;
        }
        bits
    }

    #[inline(always)]
    fn store(&self, wanted: u64, pixels: &[[u8; 4]; LANES], colors: &mut [[u8; 4]]) {
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
            if let Some(color) = colors.get_mut(self.index(lane)) {
                *color = pixels[lane];
            }
        }
    }
}

/// Results of sixteen pixels.
struct TileResults<S: Simd> {
    color: [f32x16<S>; 3],
    /// Remaining transparency.
    open: f32x16<S>,
    pending: Pending<S>,
}

/// Draws the `wanted` pixels of a tile whose left border is at column `x`; also returns true if any
/// pixel is hidden.
#[inline(always)]
fn draw_tile<S: Simd>(
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
    let mut results = TileResults {
        color: [zero; 3],
        open,
        pending: Pending::new(simd, block.lumigraph.pyramid.levels[0]),
    };
    let mut occluded = mask32x16::from_bitmask(simd, 0);
    if ahead.any_true() {
        // Slopes of all sixteen pixels, so that those of the corners bound the others.
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
                draw_layers(simd, block, false, &rays, &mut results);
                let nothing = results.open.simd_ge(1.0);
                if nothing.any_true() {
                    occluded = find_occluded(simd, block, &rays, nothing);
                }
            }
            Pass::OtherCells(steps) => {
                search_other_cells(simd, block, steps, slopes, &mut results);
                occluded = ahead;
            }
        }
    }
    resolve(simd, &results, ahead, occluded)
}

/// Draws layers as seen from the cells of each step, until all pixels are opaque.
#[inline(always)]
fn search_other_cells<S: Simd>(
    simd: S,
    block: &FrameBlock,
    steps: &[Step],
    slopes: [f32x16<S>; 2],
    results: &mut TileResults<S>,
) {
    for step in steps {
        // The outermost cell again would give the same result.
        if leaves_grid(block, slopes, step.shift) {
            continue;
        }
        let rays = Rays::new(
            simd,
            block.plan,
            block.lumigraph.pyramid.stride,
            slopes,
            step.shift,
        );
        draw_layers(simd, block, step.with_neighbours, &rays, results);
        if !results.open.simd_ge(LEAST_OPEN).any_true() {
            break;
        }
    }
}

/// Returns the lanes of `rays_without_hit` for which a camera of the cell sees an occluder in place
/// of infinity.
#[inline(always)]
fn find_occluded<S: Simd>(
    simd: S,
    block: &FrameBlock,
    rays: &Rays<S>,
    rays_without_hit: mask32x16<S>,
) -> mask32x16<S> {
    let none = mask32x16::from_bitmask(simd, 0);
    let Some(infinity) = block
        .plan
        .layers
        .last()
        .filter(|layer| layer.indices == [0, 0])
    else {
        return none;
    };
    let positions = rays.texel_positions(infinity);
    let pyramid = &block.lumigraph.pyramid;
    let level = pyramid.levels[infinity.level];
    let mut occluded = none;
    for k in 0..4 {
        let at = positions.in_camera(k);
        let inside = rays_without_hit & inside(level, at);
        if inside.any_true() {
            occluded |=
                inside & nearest(simd, &pyramid.texels, level, rays.base[k], at, inside).simd_gt(0);
        }
    }
    occluded
}

/// Returns true if a shift leads out of the grid for all rays: the cells inside have been tested
/// before.
#[inline(always)]
fn leaves_grid<S: Simd>(block: &FrameBlock, slopes: [f32x16<S>; 2], shift: [i32; 2]) -> bool {
    let (view, positions) = (&block.plan.view, [&block.plan.columns, &block.plan.rows]);
    let eye = view.eye.as_vec3().to_array();
    for axis in 0..2 {
        if shift[axis] != 0 {
            let crossings = (slopes[axis] * -eye[2] + eye[axis]).to_array();
            let last = positions[axis].len() as i32 - 2;
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for crossing in crossings {
                (low, high) = (low.min(crossing), high.max(crossing));
            }
            let shifted = |crossing: f32| cell(positions[axis], crossing) as i32 + shift[axis];
            if shifted(high) < 0 || shifted(low) > last {
                return true;
            }
        }
    }
    false
}

/// Draws the block's layers from near to far, until all pixels are opaque.
#[inline(always)]
fn draw_layers<S: Simd>(
    simd: S,
    block: &FrameBlock,
    with_neighbours: bool,
    rays: &Rays<S>,
    results: &mut TileResults<S>,
) {
    'layers: for batch in block.batches {
        let visible = match &rays.bundle {
            Some(bundle) if block.plan.skip => {
                batch.visible(simd, &block.lumigraph.cells, bundle, with_neighbours)
            }
            _ => batch.all(),
        };
        let mut left = visible.layers;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            let mut ranges = [[0, u16::MAX]; 4];
            if let Some(squares) = &visible.squares {
                for k in 0..4 {
                    ranges[k] = block.lumigraph.cells.range(squares[k][i]);
                }
            }
            if !draw_layer(
                simd,
                block,
                &batch.layers[i],
                ranges,
                with_neighbours,
                rays,
                results,
            ) {
                break 'layers;
            }
        }
    }
    results.pending.blend(
        simd,
        &block.lumigraph.pyramid,
        block.plan.paint.as_ref(),
        rays,
        &mut results.color,
    );
}

/// Tests the rays against a layer, where the indices in the four cameras' images lie in `ranges`.
/// Returns false if all pixels are opaque.
#[inline(always)]
fn draw_layer<S: Simd>(
    simd: S,
    block: &FrameBlock,
    layer: &LayerInView,
    ranges: [[u16; 2]; 4],
    with_neighbours: bool,
    rays: &Rays<S>,
    results: &mut TileResults<S>,
) -> bool {
    let indices = if with_neighbours {
        layer.with_neighbours
    } else {
        layer.indices
    };
    let pyramid = &block.lumigraph.pyramid;
    let level = pyramid.levels[layer.level];
    let positions = rays.texel_positions(layer);
    let open = results.open.simd_ge(LEAST_OPEN);
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
        let at = positions.in_camera(k);
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
    if !results.pending.has_room(shown, level) {
        results.pending.blend(
            simd,
            pyramid,
            block.plan.paint.as_ref(),
            rays,
            &mut results.color,
        );
    }
    let one = f32x16::splat(simd, 1.0);
    let opacity = match block.plan.blend {
        Blend::Whole => one,
        Blend::Shared => showing / shown.select(showing + passing, one),
    };
    let coverage = shown.select(results.open * opacity, zero);
    results
        .pending
        .add(shown, level, indices, &positions, weight, coverage);
    results.open -= coverage;
    results.open.simd_ge(LEAST_OPEN).any_true()
}

/// Converts results to straight sRGB colours, with alpha 255 in covered pixels, [`HIDDEN`] in
/// others of `hidden`, else 0; also returns true if any pixel is hidden.
#[inline(always)]
fn resolve<S: Simd>(
    simd: S,
    results: &TileResults<S>,
    ahead: mask32x16<S>,
    hidden: mask32x16<S>,
) -> ([[u8; 4]; LANES], bool) {
    let one = f32x16::splat(simd, 1.0);
    let opacity = one - results.open;
    let any = ahead & opacity.simd_gt(0.0);
    let scale =
        f32x16::splat(simd, f32::from(LinearLight::MAX) / 65535.0) / any.select(opacity, one);
    let mut linear = [[0; LANES]; 3];
    for c in 0..3 {
        let rounded = (results.color[c] * scale + 0.5).min(f32::from(LinearLight::MAX));
        linear[c] = rounded.to_int::<i32x16<S>>().to_array();
    }
    let mut pixels = [[0; 4]; LANES];
    let (any, hidden) = (any.to_bitmask(), (hidden & !any).to_bitmask());
    let mut bits = hidden;
    while bits != 0 {
        pixels[bits.trailing_zeros() as usize][3] = HIDDEN;
        bits &= bits - 1;
    }
    let tables = LinearLight::tables();
    for (i, pixel) in pixels.iter_mut().enumerate() {
        if any >> i & 1 == 1 {
            let srgb = |c: usize| tables.srgb(linear[c][i] as u32);
            *pixel = [srgb(0), srgb(1), srgb(2), 255];
        }
    }
    (pixels, hidden != 0)
}
