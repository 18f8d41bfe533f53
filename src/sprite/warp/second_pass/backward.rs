//! Second pass: one visit of each output pixel (Eq. 7, 8; corrected by C5), for all variants that
//! sample backward.

use super::sampling::{BLOCK, Footprints, LANE_NUMBERS, LANES, TexelMap, address, sample};
use crate::model::shift::ShiftField;
use crate::model::texture::Texture;
use crate::warp::cell::Coding;
use crate::warp::field::Field;
use crate::warp::transfer::SpriteTransfer;
use fearless_simd::{Level, Simd, dispatch, f32x16, i32x16, mask32x16, prelude::*, u32x16};
use glam::{DVec3, dvec3};
use rayon::prelude::*;

/// Mapping from positions on the plane to positions in the texture.
#[derive(Clone, Copy)]
pub(crate) enum Parallax<'a> {
    /// Identity: homography only (Eq. 3).
    None,
    /// By a displacement: `(x3, y3, 1) + d3 e21` (Eq. 8 with C5).
    Displacement(&'a Field),
    /// Same as `Displacement`, with the first term not divided by its third component, as printed.
    AsPrinted(&'a Field),
    /// Same as `Displacement`, with the epipole at infinity (S8): no division.
    Affine(&'a Field),
    /// By a stored shift (S7, Eq. 9).
    Shift(&'a ShiftField),
}

/// Inputs of a frame.
pub(crate) struct BackwardPlan<'a> {
    pub texture: &'a Texture,
    pub transfer: &'a SpriteTransfer,
    /// Size of a displacement cell in pixels of the image.
    pub cell_px: [f64; 2],
    pub parallax: Parallax<'a>,
}

/// Cells of a displacement or shift field, and their layout.
#[derive(Clone, Copy)]
struct Cells<'a> {
    cells: &'a [u32],
    origin: [i32; 2],
    size: [u32; 2],
    /// Upper bound of the absolute displacement; 0 for shift fields.
    largest: f32,
}

impl<'a> Cells<'a> {
    /// Returns the cells of a parallax; `None` if it has none.
    fn new(parallax: Parallax<'a>) -> Option<Self> {
        match parallax {
            Parallax::None => None,
            Parallax::Displacement(f) | Parallax::AsPrinted(f) | Parallax::Affine(f) => {
                Some(Self {
                    cells: &f.cells,
                    origin: [f.x0, f.y0],
                    size: [f.width, f.height],
                    largest: f.coding.largest(),
                })
            }
            Parallax::Shift(f) => Some(Self {
                cells: &f.cells,
                origin: [f.x0, f.y0],
                size: [f.width, f.height],
                largest: 0.0,
            }),
        }
    }
}

/// Draws every pixel of a frame of `width` columns.
pub(crate) fn backward(
    level: Level,
    plan: &BackwardPlan,
    nearest: bool,
    width: u32,
    pixels: &mut [u32],
) {
    const BAND_ROWS: usize = 16;
    if width == 0 || Cells::new(plan.parallax).is_some_and(|c| c.cells.is_empty()) {
        pixels.fill(0);
        return;
    }
    let draw = |(band, pixels): (usize, &mut [u32])| {
        let first = band * BAND_ROWS;
        if nearest {
            dispatch!(level, simd => draw_band::<_, true>(simd, plan, width as usize, first, pixels));
        } else {
            dispatch!(level, simd => draw_band::<_, false>(simd, plan, width as usize, first, pixels));
        }
    };
    let band_pixels = width as usize * BAND_ROWS;
    if rayon::current_num_threads() == 1 {
        pixels.chunks_mut(band_pixels).enumerate().for_each(draw);
    } else {
        pixels
            .par_chunks_mut(band_pixels)
            .enumerate()
            .for_each(draw);
    }
}

/// Draws the rows of a band, whose first row is `first` of the frame.
#[inline(always)]
fn draw_band<S: Simd, const NEAREST: bool>(
    simd: S,
    plan: &BackwardPlan,
    width: usize,
    first: usize,
    pixels: &mut [u32],
) {
    let cells = Cells::new(plan.parallax);
    let mut footprints = Footprints::new();
    let mut lookups = BlockLookups::new();
    let mut colors = [0; BLOCK];
    // Tile by tile: the next row reads the same cells and texels again, from the first-level cache
    // while rows are short.
    for left in (0..width).step_by(BLOCK) {
        let right = width.min(left + BLOCK);
        for (y, row) in pixels.chunks_mut(width).enumerate() {
            let y = first + y;
            let mut x = left;
            while x < right {
                let pixels = pixels_of_one_level(plan, [x, y], right - x);
                let out = &mut row[x..x + pixels];
                let block = PixelBlock::new(plan, cells, [x, y], pixels);
                x += pixels;
                let Some(block) = block else {
                    out.fill(0);
                    continue;
                };
                let count = pixels.next_multiple_of(LANES);
                if matches!(plan.parallax, Parallax::None) {
                    plane_footprints::<S, NEAREST>(simd, &block, count, &mut footprints);
                } else {
                    parallax_footprints::<S, NEAREST>(
                        simd,
                        plan.parallax,
                        &block,
                        count,
                        &mut lookups,
                        &mut footprints,
                    );
                }
                sample::<S, NEAREST>(simd, plan.texture, &mut footprints, count, &mut colors);
                out.copy_from_slice(&colors[..pixels]);
            }
        }
    }
}

/// Returns the number of pixels to draw as one block: all `pixels` if both ends use the same mip
/// level, else one vector.
#[inline(always)]
fn pixels_of_one_level(plan: &BackwardPlan, [x, y]: [usize; 2], pixels: usize) -> usize {
    let h = &plan.transfer.sprite_from_target;
    let level = |x: f64| {
        let at = h.x_axis * x + (h.y_axis * (y as f64 + 0.5) + h.z_axis);
        let inverse_w = 1.0 / at.z;
        let levels = plan.texture.levels.len();
        (at.z > 0.0).then(|| {
            mip_level(
                plan.transfer,
                inverse_w,
                [at.x * inverse_w, at.y * inverse_w],
                levels,
            )
        })
    };
    let (first, last) = (level(x as f64 + 0.5), level((x + pixels) as f64 - 0.5));
    if first == last {
        pixels
    } else {
        pixels.min(LANES)
    }
}

/// Values computed once per block in f64: positions are relative to a whole texel near the block
/// (the *anchor*), so that f32 resolves them to 1e-5 px.
struct PixelBlock<'a> {
    /// (x3 w, y3 w, w) relative to the anchor at the first pixel, divided by `normalizer`.
    start: [f32; 3],
    /// Change of `start` per pixel.
    step: [f32; 3],
    normalizer: f32,
    texels: TexelMap,
    /// True if all pixels of the block are in front of the eye and over texels.
    over_texels: bool,
    lookup: Option<Lookup<'a>>,
}

/// Parameters of the cell lookup of a block.
struct Lookup<'a> {
    cells: &'a [u32],
    stride: i32,
    cells_per_px: [f32; 2],
    /// Cell position of the anchor relative to `base`.
    fraction: [f32; 2],
    base: [i32; 2],
    size: [i32; 2],
    /// Bounds of visible positions, relative to the anchor.
    low: [f32; 2],
    high: [f32; 2],
    /// e21, with the first two components relative to the anchor.
    epipole: [f32; 3],
    /// True if all pixels of the block are in front of the eye and over cells.
    inside: bool,
    /// True if displacements are so small that [`reciprocal_near_one`] is accurate.
    small_parallax: bool,
}

/// Bound of anchor coordinates, pixels: keeps integers small; farther out the precision does not
/// matter.
const FARTHEST_ANCHOR: f64 = 131_072.0;

impl<'a> PixelBlock<'a> {
    /// Prepares a block; `None` if no pixel of it is visible.
    #[inline(always)]
    fn new(
        plan: &BackwardPlan<'a>,
        cells: Option<Cells<'a>>,
        [x, y]: [usize; 2],
        pixels: usize,
    ) -> Option<Self> {
        let h = &plan.transfer.sprite_from_target;
        let y = y as f64 + 0.5;
        let at = |x: f64| h.x_axis * x + (h.y_axis * y + h.z_axis);
        let x = x as f64;
        // Only the drawn pixels count: beyond a narrow frame a plane may appear at a very different
        // scale.
        let length = pixels as f64;
        let (first, middle, last) = (at(x + 0.5), at(x + 0.5 * length), at(x + length - 0.5));
        if first.z <= 0.0 && last.z <= 0.0 {
            return None; // the plane is behind the target eye all along
        }
        let inverse_w = 1.0 / middle.z;
        let center = [middle.x * inverse_w, middle.y * inverse_w];
        let level = mip_level(plan.transfer, inverse_w, center, plan.texture.levels.len());
        // Pixels this far outside the image can still touch its border's texels.
        let rim = f64::from(1u32 << level) + 1.0;
        let (low, high) = bounds(plan, cells, rim);
        if first.z > 0.0 && last.z > 0.0 && outside([first, last], low, high) {
            return None;
        }
        let anchor = [floor_clamped(center[0]), floor_clamped(center[1])];
        let normalizer = if middle.z > 0.0 {
            middle.z
        } else {
            first.z.max(last.z)
        };
        let to_anchor = dvec3(anchor[0], anchor[1], 0.0);
        let inverse_w = if middle.z > 0.0 {
            inverse_w
        } else {
            1.0 / normalizer
        };
        let start = (first - to_anchor * first.z) * inverse_w;
        let step = (h.x_axis - to_anchor * h.x_axis.z) * inverse_w;
        Some(Self {
            start: start.as_vec3().to_array(),
            step: step.as_vec3().to_array(),
            normalizer: normalizer as f32,
            texels: TexelMap::new(plan.texture, level, anchor),
            over_texels: over(
                [first, last],
                [0.0; 2],
                [
                    f64::from(plan.texture.levels[0].width),
                    f64::from(plan.texture.levels[0].height),
                ],
            ),
            lookup: cells.map(|cells| Lookup::new(plan, cells, anchor, low, high, [first, last])),
        })
    }
}

/// Rounds a position down to a whole pixel; 0 if it is not finite.
#[inline(always)]
fn floor_clamped(position: f64) -> f64 {
    if position.is_finite() {
        position.floor().clamp(-FARTHEST_ANCHOR, FARTHEST_ANCHOR)
    } else {
        0.0
    }
}

/// Selects the mip level whose texels are about as large as the frame's pixels, by the stretch of
/// the homography along the frame's rows and columns at the block's middle; `inverse_w` is 1 / w
/// there.
#[inline(always)]
fn mip_level(transfer: &SpriteTransfer, inverse_w: f64, center: [f64; 2], levels: usize) -> usize {
    let h = &transfer.sprite_from_target;
    let squared = |column: DVec3| {
        let [x, y] = [
            column.x - center[0] * column.z,
            column.y - center[1] * column.z,
        ];
        (x * x + y * y) * (inverse_w * inverse_w)
    };
    let stretch = squared(h.x_axis).max(squared(h.y_axis));
    // floor(log2(stretch^1/2) + 1/2) = floor(log2(2 stretch) / 2), read off the exponent.
    let exponent = ((2.0 * stretch).to_bits() >> 52 & 0x7ff) as i64 - 1023;
    if stretch.is_finite() {
        (exponent.max(0) / 2) as usize
    } else {
        0
    }
    .min(levels - 1)
}

/// Returns the rectangle of plane positions, in pixels of the image, outside of which nothing is
/// visible.
#[inline(always)]
fn bounds(plan: &BackwardPlan, cells: Option<Cells>, rim: f64) -> ([f64; 2], [f64; 2]) {
    match cells {
        None => {
            let level = &plan.texture.levels[0];
            (
                [-rim; 2],
                [f64::from(level.width) + rim, f64::from(level.height) + rim],
            )
        }
        Some(Cells { origin, size, .. }) => {
            let [px, py] = plan.cell_px;
            let (x, y) = (f64::from(origin[0]), f64::from(origin[1]));
            let high = [
                (x + f64::from(size[0])) * px + rim,
                (y + f64::from(size[1])) * py + rim,
            ];
            ([x * px - rim, y * py - rim], high)
        }
    }
}

/// Returns true if both ends of a line segment are in front of the eye and inside a rectangle.
#[inline(always)]
fn over(ends: [DVec3; 2], low: [f64; 2], high: [f64; 2]) -> bool {
    let inside = |p: &DVec3| {
        p.z > 0.0
            && p.x > low[0] * p.z
            && p.x < high[0] * p.z
            && p.y > low[1] * p.z
            && p.y < high[1] * p.z
    };
    ends.iter().all(inside)
}

/// Returns true if both ends of a line segment (w > 0) lie beyond one side of a rectangle.
#[inline(always)]
fn outside(ends: [DVec3; 2], low: [f64; 2], high: [f64; 2]) -> bool {
    ends.iter().all(|p| p.x < low[0] * p.z)
        || ends.iter().all(|p| p.x > high[0] * p.z)
        || ends.iter().all(|p| p.y < low[1] * p.z)
        || ends.iter().all(|p| p.y > high[1] * p.z)
}

impl<'a> Lookup<'a> {
    #[inline(always)]
    fn new(
        plan: &BackwardPlan,
        cells: Cells<'a>,
        anchor: [f64; 2],
        low: [f64; 2],
        high: [f64; 2],
        ends: [DVec3; 2],
    ) -> Self {
        let [px, py] = plan.cell_px;
        let x = anchor[0] / px - f64::from(cells.origin[0]);
        let y = anchor[1] / py - f64::from(cells.origin[1]);
        let (column, row) = (x.floor(), y.floor());
        let e = -plan.transfer.epipole_in_sprite;
        let e = match plan.parallax {
            Parallax::Affine(_) => dvec3(e.x, e.y, 0.0),
            _ => e - dvec3(anchor[0], anchor[1], 0.0) * e.z,
        };
        // A line between two positions over the field stays over it; the margin of an eighth of a
        // cell is for rounding.
        let [left, top] = [px, py].map(|side| 0.125 * side);
        let [left, top] = [
            left + f64::from(cells.origin[0]) * px,
            top + f64::from(cells.origin[1]) * py,
        ];
        let right = left + (f64::from(cells.size[0]) - 0.25) * px;
        let bottom = top + (f64::from(cells.size[1]) - 0.25) * py;
        Self {
            inside: over(ends, [left, top], [right, bottom]),
            small_parallax: f64::from(cells.largest) * e.z.abs() < SMALL_PARALLAX,
            cells: cells.cells,
            stride: cells.size[0] as i32,
            cells_per_px: [(1.0 / px) as f32, (1.0 / py) as f32],
            fraction: [(x - column) as f32, (y - row) as f32],
            base: [column as i32, row as i32],
            size: [cells.size[0] as i32, cells.size[1] as i32],
            low: [(low[0] - anchor[0]) as f32, (low[1] - anchor[1]) as f32],
            high: [(high[0] - anchor[0]) as f32, (high[1] - anchor[1]) as f32],
            epipole: e.as_vec3().to_array(),
        }
    }
}

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
fn plane_footprints<S: Simd, const NEAREST: bool>(
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
struct BlockLookups {
    x: [f32; BLOCK],
    y: [f32; BLOCK],
    inverse_w: [f32; BLOCK],
    /// Horizontal offset from the centre of the cell, cells.
    dx: [f32; BLOCK],
    /// The same, vertical.
    dy: [f32; BLOCK],
    index: [u32; BLOCK],
    cell: [u32; BLOCK],
}

impl BlockLookups {
    fn new() -> Self {
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
fn parallax_footprints<S: Simd, const NEAREST: bool>(
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
const SMALL_PARALLAX: f64 = 1.0 / 96.0;

/// Approximates 1 / (1 + t) for |t| < [`SMALL_PARALLAX`] by 1 - t + t^2 - t^3. A division would
/// take as long as all other work on a displacement.
#[inline(always)]
fn reciprocal_near_one<S: Simd>(t: f32x16<S>) -> f32x16<S> {
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
