//! Second pass: one walk over the output (Eq. 7, 8; corrected by C5), for every variant that samples backwards.

use super::field::{Coding, Field};
use super::forward::NEAREST_DEPTH_SHARE;
use super::sampling::{BLOCK, Footprints, LANES, TexelMap, address, sample};
use super::texture::Texture;
use super::transfer::Transfer;
use fearless_simd::{Level, Simd, dispatch, f32x16, i32x16, mask32x16, prelude::*, u32x16};
use glam::{DVec3, dvec3};
use rayon::prelude::*;

/// Where a position on the plane finds its way into the picture.
#[derive(Clone, Copy)]
pub(super) enum Parallax<'a> {
    /// It is there: homography only (Eq. 3).
    None,
    /// By a displacement: `(x3, y3, 1) + d3 e21` (Eq. 8 with C5).
    Displacement(&'a Field),
    /// The same with the first term not divided by its third component, as printed.
    AsPrinted(&'a Field),
    /// The same with the epipole at infinity (S8): no division.
    Affine(&'a Field),
    /// By a stored shift (S7, Eq. 9).
    Shift(&'a ShiftField),
}

/// Shifts u3 = x1 - x3, v3 = y1 - y3 per cell (S7).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ShiftField {
    x0: i32,
    y0: i32,
    width: u32,
    height: u32,
    /// Two signed 16-bit numbers, u3 low; [`Self::EMPTY`] where nothing is.
    cells: Vec<u32>,
    /// Pixels per unit.
    scale: f32,
}

impl ShiftField {
    const EMPTY: u32 = 0x8000_8000;

    /// The shifts of displacements after the first pass, at the centres of their cells.
    pub(super) fn new(field: &Field, transfer: &Transfer, cell_px: [f64; 2]) -> Self {
        let e = -transfer.epipole_in_sprite;
        let shift = |index: usize, cell: u32| {
            let x = (f64::from(field.x0) + (index % field.width as usize) as f64 + 0.5) * cell_px[0];
            let y = (f64::from(field.y0) + (index / field.width as usize) as f64 + 0.5) * cell_px[1];
            let d = f64::from(field.coding.displacement(cell, 0.0, 0.0));
            let w = (1.0 + d * e.z).max(f64::from(NEAREST_DEPTH_SHARE));
            [((x + d * e.x) / w - x) as f32, ((y + d * e.y) / w - y) as f32]
        };
        let shifts: Vec<[f32; 2]> = field.cells.par_iter().enumerate().map(|(i, &cell)| shift(i, cell)).collect();
        let reached = shifts.iter().zip(&field.cells).filter(|(_, cell)| **cell != 0);
        let largest = reached.flat_map(|(s, _)| s).fold(0.0f32, |max, s| max.max(s.abs()));
        let scale = if (largest / 32767.0).is_normal() { largest / 32767.0 } else { 1.0 };
        let pack = |(shift, &cell): (&[f32; 2], &u32)| {
            let [u, v] = shift.map(|s| u32::from((s / scale).round().clamp(-32767.0, 32767.0) as i16 as u16));
            if cell == 0 { Self::EMPTY } else { u | (v << 16) }
        };
        let cells = shifts.par_iter().zip(&field.cells).map(pack).collect();
        Self { x0: field.x0, y0: field.y0, width: field.width, height: field.height, cells, scale }
    }
}

/// Everything that stays the same over a frame.
pub(super) struct View<'a> {
    pub texture: &'a Texture,
    pub transfer: &'a Transfer,
    /// Pixels of the picture per displacement cell.
    pub cell_px: [f64; 2],
    pub parallax: Parallax<'a>,
}

/// Cells and how they lie, whichever they are.
#[derive(Clone, Copy)]
struct Cells<'a> {
    cells: &'a [u32],
    origin: [i32; 2],
    size: [u32; 2],
}

impl<'a> Cells<'a> {
    fn of(parallax: Parallax<'a>) -> Option<Self> {
        match parallax {
            Parallax::None => None,
            Parallax::Displacement(f) | Parallax::AsPrinted(f) | Parallax::Affine(f) => {
                Some(Self { cells: &f.cells, origin: [f.x0, f.y0], size: [f.width, f.height] })
            }
            Parallax::Shift(f) => Some(Self { cells: &f.cells, origin: [f.x0, f.y0], size: [f.width, f.height] }),
        }
    }
}

/// Draws every pixel of a frame of `width` columns.
pub(super) fn backward(level: Level, view: &View, nearest: bool, width: u32, pixels: &mut [u32]) {
    const BAND_ROWS: usize = 16;
    if width == 0 || Cells::of(view.parallax).is_some_and(|c| c.cells.is_empty()) {
        pixels.fill(0);
        return;
    }
    let draw = |(band, pixels): (usize, &mut [u32])| {
        let first = band * BAND_ROWS;
        if nearest {
            dispatch!(level, simd => rows::<_, true>(simd, view, width as usize, first, pixels));
        } else {
            dispatch!(level, simd => rows::<_, false>(simd, view, width as usize, first, pixels));
        }
    };
    let bands = pixels.par_chunks_mut(width as usize * BAND_ROWS).enumerate();
    if rayon::current_num_threads() == 1 {
        pixels.chunks_mut(width as usize * BAND_ROWS).enumerate().for_each(draw);
    } else {
        bands.for_each(draw);
    }
}

#[inline(always)]
fn rows<S: Simd, const NEAREST: bool>(simd: S, view: &View, width: usize, first: usize, pixels: &mut [u32]) {
    let cells = Cells::of(view.parallax);
    let mut footprints = Footprints::new();
    let mut drawn = [0; BLOCK];
    for (y, row) in pixels.chunks_mut(width).enumerate() {
        for (block, out) in row.chunks_mut(BLOCK).enumerate() {
            let place = Block::new(view, cells, block * BLOCK, first + y);
            let Some(place) = place else {
                out.fill(0);
                continue;
            };
            match view.parallax {
                Parallax::None => straight::<S, NEAREST>(simd, &place, &mut footprints),
                _ => displaced::<S, NEAREST>(simd, view.parallax, &place, &mut footprints),
            }
            sample::<S, NEAREST>(simd, view.texture, &place.texels, &mut footprints, &mut drawn);
            out.copy_from_slice(&drawn[..out.len()]);
        }
    }
}

/// What is computed once per block, in f64: positions are then relative to a whole pixel of the picture near the
/// block (the *anchor*), so small that f32 places them to 1e-5 px.
struct Block<'a> {
    /// (x3 w, y3 w, w) relative to the anchor at the first pixel, over `normalizer`.
    start: [f32; 3],
    /// Its change from pixel to pixel.
    step: [f32; 3],
    normalizer: f32,
    texels: TexelMap,
    lookup: Option<Lookup<'a>>,
}

/// How a block finds its cells.
struct Lookup<'a> {
    cells: &'a [u32],
    stride: i32,
    cells_per_px: [f32; 2],
    /// Cell position of the anchor: what is left after `base`.
    rest: [f32; 2],
    base: [i32; 2],
    size: [i32; 2],
    /// Positions relative to the anchor beyond which nothing shows.
    low: [f32; 2],
    high: [f32; 2],
    /// e21, its first two components relative to the anchor.
    epipole: [f32; 3],
}

/// Anchors further out than this serve no precision; they keep integers small.
const FARTHEST_ANCHOR: f64 = 131_072.0;

impl<'a> Block<'a> {
    /// `None` if no pixel of the block shows anything.
    #[inline(always)]
    fn new(view: &View<'a>, cells: Option<Cells<'a>>, x: usize, y: usize) -> Option<Self> {
        let h = &view.transfer.sprite_from_target;
        let y = y as f64 + 0.5;
        let at = |x: f64| h.x_axis * x + (h.y_axis * y + h.z_axis);
        let x = x as f64;
        let (first, middle, last) = (at(x + 0.5), at(x + 32.0), at(x + 63.5));
        if first.z <= 0.0 && last.z <= 0.0 {
            return None; // the plane is behind the target eye all along
        }
        let center = [middle.x / middle.z, middle.y / middle.z];
        let level = mip_level(view.transfer, middle, center, view.texture.levels.len());
        // Pixels this far outside the picture can still touch its border's texels.
        let rim = f64::from(1u32 << level) + 1.0;
        let (low, high) = bounds(view, cells, rim);
        if first.z > 0.0 && last.z > 0.0 && outside([first, last], low, high) {
            return None;
        }
        let anchor =
            center.map(|c| if c.is_finite() { c.floor().clamp(-FARTHEST_ANCHOR, FARTHEST_ANCHOR) } else { 0.0 });
        let normalizer = if middle.z > 0.0 { middle.z } else { first.z.max(last.z) };
        let relative = |p: DVec3| dvec3(p.x - anchor[0] * p.z, p.y - anchor[1] * p.z, p.z) / normalizer;
        let to_f32 = |p: DVec3| p.to_array().map(|v| v as f32);
        Some(Self {
            start: to_f32(relative(first)),
            step: to_f32(relative(h.x_axis)),
            normalizer: normalizer as f32,
            texels: TexelMap::new(view.texture, level, anchor),
            lookup: cells.map(|cells| Lookup::new(view, cells, anchor, low, high)),
        })
    }
}

/// The level at which the picture's pixels are about as large as the frame's: both are compared along the frame's rows
/// and columns at the block's middle, by the homography.
#[inline(always)]
fn mip_level(transfer: &Transfer, middle: DVec3, center: [f64; 2], levels: usize) -> usize {
    let h = &transfer.sprite_from_target;
    let squared = |column: DVec3| {
        let (x, y) = (column.x - center[0] * column.z, column.y - center[1] * column.z);
        (x * x + y * y) / (middle.z * middle.z)
    };
    let stretch = squared(h.x_axis).max(squared(h.y_axis));
    // floor(log2(stretch^1/2) + 1/2) = floor(log2(2 stretch) / 2), read off the exponent.
    let exponent = ((2.0 * stretch).to_bits() >> 52 & 0x7ff) as i64 - 1023;
    if stretch.is_finite() { (exponent.max(0) / 2) as usize } else { 0 }.min(levels - 1)
}

/// The rectangle of plane positions, in pixels of the picture, outside of which nothing shows.
#[inline(always)]
fn bounds(view: &View, cells: Option<Cells>, rim: f64) -> ([f64; 2], [f64; 2]) {
    match cells {
        None => {
            let level = &view.texture.levels[0];
            ([-rim; 2], [f64::from(level.width) + rim, f64::from(level.height) + rim])
        }
        Some(c) => {
            let low = [0, 1].map(|i| f64::from(c.origin[i]) * view.cell_px[i] - rim);
            let high = [0, 1].map(|i| (f64::from(c.origin[i]) + f64::from(c.size[i])) * view.cell_px[i] + rim);
            (low, high)
        }
    }
}

/// Whether both ends of a line segment (w > 0) are beyond one side of a rectangle.
#[inline(always)]
fn outside(ends: [DVec3; 2], low: [f64; 2], high: [f64; 2]) -> bool {
    ends.iter().all(|p| p.x < low[0] * p.z)
        || ends.iter().all(|p| p.x > high[0] * p.z)
        || ends.iter().all(|p| p.y < low[1] * p.z)
        || ends.iter().all(|p| p.y > high[1] * p.z)
}

impl<'a> Lookup<'a> {
    #[inline(always)]
    fn new(view: &View, cells: Cells<'a>, anchor: [f64; 2], low: [f64; 2], high: [f64; 2]) -> Self {
        let position = [0, 1].map(|i| anchor[i] / view.cell_px[i] - f64::from(cells.origin[i]));
        let base = position.map(f64::floor);
        let e = -view.transfer.epipole_in_sprite;
        let epipole = match view.parallax {
            Parallax::Affine(_) => [e.x, e.y, 0.0],
            _ => [e.x - anchor[0] * e.z, e.y - anchor[1] * e.z, e.z],
        };
        Self {
            cells: cells.cells,
            stride: cells.size[0] as i32,
            cells_per_px: view.cell_px.map(|px| (1.0 / px) as f32),
            rest: [0, 1].map(|i| (position[i] - base[i]) as f32),
            base: base.map(|b| b as i32),
            size: cells.size.map(|s| s as i32),
            low: [0, 1].map(|i| (low[i] - anchor[i]) as f32),
            high: [0, 1].map(|i| (high[i] - anchor[i]) as f32),
            epipole: epipole.map(|e| e as f32),
        }
    }
}

/// Position on the plane of sixteen pixels relative to the anchor, whether it is in front, and 1 / w.
#[inline(always)]
fn on_plane<S: Simd>(simd: S, place: &Block, first: usize) -> ([f32x16<S>; 2], mask32x16<S>, f32x16<S>) {
    let lanes = f32x16::from_fn(simd, |i| i as f32) + f32x16::splat(simd, first as f32);
    let [x, y, w] = [0, 1, 2].map(|k| lanes * f32x16::splat(simd, place.step[k]) + f32x16::splat(simd, place.start[k]));
    let share = f32x16::splat(simd, 1.0) / w;
    ([x * share, y * share], w.simd_gt(f32x16::splat(simd, 0.0)), share)
}

/// Footprints of a block without parallax.
#[inline(always)]
fn straight<S: Simd, const NEAREST: bool>(simd: S, place: &Block, footprints: &mut Footprints) {
    for first in (0..BLOCK).step_by(LANES) {
        let (position, valid, _) = on_plane(simd, place, first);
        address::<S, NEAREST>(simd, &place.texels, position, valid, first, footprints);
    }
}

/// A block's positions on the plane and the cells found there.
struct Found {
    x: [f32; BLOCK],
    y: [f32; BLOCK],
    share: [f32; BLOCK],
    /// Offsets from the centre of the cell, cells.
    dx: [f32; BLOCK],
    dy: [f32; BLOCK],
    index: [u32; BLOCK],
    cell: [u32; BLOCK],
}

/// Footprints of a block with parallax.
#[inline(always)]
fn displaced<S: Simd, const NEAREST: bool>(simd: S, parallax: Parallax, place: &Block, footprints: &mut Footprints) {
    let Some(lookup) = &place.lookup else { return };
    let mut found = Found {
        x: [0.0; BLOCK],
        y: [0.0; BLOCK],
        share: [0.0; BLOCK],
        dx: [0.0; BLOCK],
        dy: [0.0; BLOCK],
        index: [0; BLOCK],
        cell: [0; BLOCK],
    };
    let empty = if matches!(parallax, Parallax::Shift(_)) { ShiftField::EMPTY } else { 0 };
    for first in (0..BLOCK).step_by(LANES) {
        find_cells(simd, place, lookup, first, &mut found);
    }
    for (cell, &index) in found.cell.iter_mut().zip(&found.index) {
        *cell = lookup.cells.get(index as usize).copied().unwrap_or(empty);
    }
    for first in (0..BLOCK).step_by(LANES) {
        let range = first..first + LANES;
        let load = |values: &[f32; BLOCK]| f32x16::from_slice(simd, &values[range.clone()]);
        let cells = u32x16::from_slice(simd, &found.cell[range.clone()]);
        let plane = [load(&found.x), load(&found.y)];
        let offset = [load(&found.dx), load(&found.dy)];
        let known = cells.simd_ne(u32x16::splat(simd, empty));
        let (position, in_front) = match parallax {
            Parallax::None => (plane, known),
            Parallax::Shift(field) => (shifted(simd, field.scale, cells, plane), known),
            Parallax::Affine(field) => {
                let d = displacement(simd, &field.coding, cells, offset);
                let moved = [0, 1].map(|i| plane[i] + d * f32x16::splat(simd, lookup.epipole[i]));
                (moved, known)
            }
            Parallax::Displacement(field) => {
                along_epipole(simd, lookup, plane, displacement(simd, &field.coding, cells, offset))
            }
            Parallax::AsPrinted(field) => {
                let d = displacement(simd, &field.coding, cells, offset);
                let share = load(&found.share) * f32x16::splat(simd, 1.0 / place.normalizer);
                along_epipole(simd, lookup, plane, d * share)
            }
        };
        address::<S, NEAREST>(simd, &place.texels, position, known & in_front, first, footprints);
    }
}

/// Eq. 8: `(x3, y3, 1) + d e21`, and whether it is in front.
#[inline(always)]
fn along_epipole<S: Simd>(
    simd: S,
    lookup: &Lookup,
    plane: [f32x16<S>; 2],
    d: f32x16<S>,
) -> ([f32x16<S>; 2], mask32x16<S>) {
    let w = d * f32x16::splat(simd, lookup.epipole[2]) + f32x16::splat(simd, 1.0);
    let moved = [0, 1].map(|i| (plane[i] + d * f32x16::splat(simd, lookup.epipole[i])) / w);
    (moved, w.simd_gt(f32x16::splat(simd, 0.0)))
}

/// Eq. 9.
#[inline(always)]
fn shifted<S: Simd>(simd: S, scale: f32, cells: u32x16<S>, plane: [f32x16<S>; 2]) -> [f32x16<S>; 2] {
    let cells = cells.bitcast::<i32x16<S>>();
    let shifts = [(cells << 16) >> 16, cells >> 16];
    [0, 1].map(|i| plane[i] + shifts[i].to_float::<f32x16<S>>() * f32x16::splat(simd, scale))
}

/// [`Coding::displacement`].
#[inline(always)]
fn displacement<S: Simd>(simd: S, coding: &Coding, cells: u32x16<S>, offset: [f32x16<S>; 2]) -> f32x16<S> {
    let splat = |x: f32| f32x16::splat(simd, x);
    let value = ((cells >> 16) & u32x16::splat(simd, 0x7fff)).to_float::<f32x16<S>>();
    let cells = cells.bitcast::<i32x16<S>>();
    let slope = [(cells << 16) >> 24, (cells << 24) >> 24].map(|s| s.to_float::<f32x16<S>>());
    (value - splat(coding.zero)) * splat(coding.scale)
        + (slope[0] * splat(coding.slope_scale) * offset[0] + slope[1] * splat(coding.slope_scale) * offset[1])
}

/// Positions on the plane and the indices of their cells; beyond the field the border's cells go on, beyond the rim
/// there is no cell.
#[inline(always)]
fn find_cells<S: Simd>(simd: S, place: &Block, lookup: &Lookup, first: usize, found: &mut Found) {
    let splat = |x: f32| f32x16::splat(simd, x);
    let (position, in_front, share) = on_plane(simd, place, first);
    let mut inside = in_front;
    let mut cell = [i32x16::splat(simd, 0); 2];
    let mut offset = position;
    for axis in 0..2 {
        inside =
            inside & position[axis].simd_ge(splat(lookup.low[axis])) & position[axis].simd_le(splat(lookup.high[axis]));
        let (low, high) = (-lookup.base[axis], lookup.size[axis] - 1 - lookup.base[axis]);
        let at = position[axis] * splat(lookup.cells_per_px[axis]) + splat(lookup.rest[axis]);
        let column = inside.select(at, splat(low as f32)).floor().max(splat(low as f32)).min(splat(high as f32));
        offset[axis] = at - column - splat(0.5);
        cell[axis] = column.to_int::<i32x16<S>>() + i32x16::splat(simd, lookup.base[axis]);
    }
    let index = cell[1] * i32x16::splat(simd, lookup.stride) + cell[0];
    let index = inside.select(index, i32x16::splat(simd, -1)).bitcast::<u32x16<S>>();
    let range = first..first + LANES;
    index.store_slice(&mut found.index[range.clone()]);
    for (value, out) in [
        (position[0], &mut found.x),
        (position[1], &mut found.y),
        (share, &mut found.share),
        (offset[0], &mut found.dx),
        (offset[1], &mut found.dy),
    ] {
        value.store_slice(&mut out[range.clone()]);
    }
}
