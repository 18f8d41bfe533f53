//! Visibility first: each sample leaves its number in the pixels that its share of its surface covers.

use super::FrameStats;
use super::clip::{Band, W_NEAR};
use super::in_view::{InView, SheetInView};
use crate::packed::sheets::{GROUP, SHEET_COLUMNS, SHEET_LEN, SOLID, Shape, Sheets};
use fearless_simd::{Level, Simd, SimdCvtFloat, SimdCvtTruncate, dispatch, f32x8, i32x8, prelude::*, u32x8};
use std::ops::Range;

/// Lanes of a register.
pub(super) const LANES: usize = GROUP;

/// Columns of a cell of the coarse map.
const CELL_COLUMNS: usize = 16;
/// Rows of a cell of the coarse map.
const CELL_ROWS: usize = 8;

/// No footprint is larger, px.
const MAX_RADIUS_PX: f32 = 32.0;

/// Half of the width of a footprint, in spacings of its samples: the share, and a hair that closes cracks.
const SOLID_REACH: f32 = 0.52;

/// The same for samples at rims. A surface fades toward the place of a neighbour that is not there, over a whole spacing; but
/// what it covers beyond half of one is little, and would take the place of what lies behind (with 1, the sky shines through
/// crowns of leaves).
const RIM_REACH: f32 = 0.55;

/// Surfaces that end near a pixel, of which it remembers samples.
pub(super) const RIMS: usize = 3;

/// A sample in a pixel: the bits of its 1 / eye depth in the upper half, its number in the lower; 0 for none. The larger is the
/// nearer.
pub(super) type Key = u64;

/// What each pixel of a band sees.
#[derive(Default)]
pub(super) struct Visibility {
    width: usize,
    pub(super) rows: Range<u32>,
    /// The nearest solid sample.
    pub(super) solid: Vec<Key>,
    /// The nearest samples at rims, of different surfaces, the nearest first.
    pub(super) rims: Vec<[Key; RIMS]>,
    /// Of each cell, the least 1 / eye depth of the solid samples, as bits; 0 if a pixel has none.
    cells: Vec<u32>,
    cells_wide: usize,
}

/// Of a key.
#[inline(always)]
pub(super) fn inverse_depth_of(key: Key) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

impl Visibility {
    /// Makes it empty.
    pub(super) fn clear(&mut self, width: u32, rows: Range<u32>) {
        self.width = width as usize;
        self.rows = rows;
        let pixels = self.width * self.rows.len();
        self.solid.clear();
        self.solid.resize(pixels, 0);
        self.rims.clear();
        self.rims.resize(pixels, [0; RIMS]);
        self.cells_wide = self.width.div_ceil(CELL_COLUMNS);
        self.cells.clear();
        self.cells.resize(self.cells_wide * self.rows.len().div_ceil(CELL_ROWS), 0);
    }

    /// Writes 1 / eye depth of what is in front in a row, counted from its first; 0 where nothing is.
    pub(super) fn tell_depths(&self, row: usize, to: &mut [f32]) {
        let start = row * self.width;
        let samples = self.solid.iter().zip(&self.rims).skip(start);
        to.iter_mut().zip(samples).for_each(|(to, (solid, rims))| *to = inverse_depth_of(rims[0].max(*solid)));
    }

    /// Draws the samples of all sheets in view.
    pub(super) fn draw(
        &mut self,
        sheets: &Sheets,
        view: &InView,
        band: &Band,
        unclipped: bool,
        [tolerance, bin]: [f32; 2],
        stats: &mut FrameStats,
        level: Level,
    ) {
        let drawing = Drawing { sheets, view, band, tolerance, bin };
        let band_rows = [self.rows.start as i32, self.rows.end as i32];
        for sheet in &view.sheets {
            if sheet.rows[1] <= band_rows[0] || sheet.rows[0] >= band_rows[1] {
                continue;
            }
            let len = u64::from(sheets.sheets[sheet.index as usize].len);
            if !unclipped && self.hides(sheet) {
                stats.hidden += len;
                continue;
            }
            stats.depth_pixels_in += len;
            let drawn = dispatch!(level, simd => drawing.sheet(simd, self, sheet));
            stats.splatted += drawn[0];
            if drawn[1] > 0 && !unclipped {
                self.note(sheet);
            }
        }
        stats.behind_or_outside = stats.depth_pixels_in - stats.splatted;
    }

    /// Cells that a sheet touches: columns and rows.
    fn cells_of(&self, sheet: &SheetInView) -> [Range<usize>; 2] {
        let first = self.rows.start as i32;
        let rows =
            [sheet.rows[0].max(first), sheet.rows[1].min(self.rows.end as i32)].map(|y| (y - first).max(0) as usize);
        let columns = sheet.columns.map(|x| x as usize);
        [columns[0] / CELL_COLUMNS..columns[1].div_ceil(CELL_COLUMNS), rows[0] / CELL_ROWS..rows[1].div_ceil(CELL_ROWS)]
    }

    /// True if solid samples in front of all of a sheet fill all cells that it may touch.
    fn hides(&self, sheet: &SheetInView) -> bool {
        let [columns, rows] = self.cells_of(sheet);
        let nearest = sheet.nearest.to_bits();
        for row in rows {
            for cell in &self.cells[row * self.cells_wide + columns.start..row * self.cells_wide + columns.end] {
                if *cell < nearest {
                    return false;
                }
            }
        }
        true
    }

    /// Brings the cells that a sheet may have touched up to date.
    fn note(&mut self, sheet: &SheetInView) {
        let [columns, rows] = self.cells_of(sheet);
        for row in rows {
            let first = row * CELL_ROWS;
            let last = (first + CELL_ROWS).min(self.rows.len());
            for column in columns.clone() {
                let (left, right) = (column * CELL_COLUMNS, ((column + 1) * CELL_COLUMNS).min(self.width));
                let mut least = Key::MAX;
                for y in first..last {
                    for key in &self.solid[y * self.width + left..y * self.width + right] {
                        least = least.min(*key);
                    }
                    if least == 0 {
                        break;
                    }
                }
                self.cells[row * self.cells_wide + column] = (least >> 32) as u32;
            }
        }
    }
}

/// What the samples of a frame are drawn with.
struct Drawing<'a> {
    sheets: &'a Sheets,
    view: &'a InView,
    band: &'a Band,
    tolerance: f32,
    bin: f32,
}

impl Drawing<'_> {
    /// Draws a sheet. How many samples were drawn, and how many of them are solid.
    #[inline(always)]
    fn sheet<S: Simd>(&self, simd: S, to: &mut Visibility, in_view: &SheetInView) -> [u64; 2] {
        let sheet = &self.sheets.sheets[in_view.index as usize];
        let steps = self.view.faces[sheet.face.index()];
        let base = in_view.index as usize * SHEET_LEN;
        let Some(shapes) = self.sheets.shapes[base..].first_chunk::<SHEET_LEN>() else { return [0; 2] };
        let (b, anchor) = (steps.inverse_depth, in_view.anchor);
        let lane = f32x8::load_array(simd, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let (width, band_rows) = (self.band.width as f32, [to.rows.start as f32, to.rows.end as f32]);
        let [cx, cy] = self.view.principal_px;
        let (mut groups, mut counts) = (sheet.occupied, [0; 2]);
        while groups != 0 {
            let group = groups.trailing_zeros() as usize;
            groups &= groups - 1;
            let (row, column) = (group / (SHEET_COLUMNS / GROUP) + 1, group % (SHEET_COLUMNS / GROUP) * GROUP);
            let at = row * SHEET_COLUMNS + column;
            let Some(eight) = shapes[at..].first_chunk::<LANES>() else { break };
            let words: [u32; 2 * LANES] = bytemuck::cast::<[Shape; LANES], _>(*eight);
            let (low, high) = words.split_at(LANES);
            let (bits, slopes) = simd.deinterleave_u32x8(u32x8::from_slice(simd, low), u32x8::from_slice(simd, high));
            let solid = bits.simd_ge(u32x8::splat(simd, SOLID));
            let q: f32x8<S> = (bits & !SOLID).bitcast();
            let k = lane + column as f32;
            let r = row as f32;
            let hx = ((k * steps.x.x + r * steps.y.x) + anchor.x) + q * b.x;
            let hy = ((k * steps.x.y + r * steps.y.y) + anchor.y) + q * b.y;
            let hz = ((k * steps.x.z + r * steps.y.z) + anchor.z) + q * b.z;
            let reciprocal = f32x8::splat(simd, 1.0) / hz;
            let (px, py) = (hx * reciprocal, hy * reciprocal);
            let [slope_x, slope_y] = slopes_of(simd, slopes, q, self.sheets.slope_unit);
            let (xz, yz) = (slope_x * b.z + steps.x.z, slope_y * b.z + steps.y.z);
            let (xx, yx) = (slope_x * b.x + steps.x.x - px * xz, slope_y * b.x + steps.y.x - px * yz);
            let (xy, yy) = (slope_x * b.y + steps.x.y - py * xz, slope_y * b.y + steps.y.y - py * yz);
            let reach = solid.select(f32x8::splat(simd, SOLID_REACH), f32x8::splat(simd, RIM_REACH)) * reciprocal;
            let most = f32x8::splat(simd, MAX_RADIUS_PX);
            let (rx, ry) = (((xx.abs() + yx.abs()) * reach).min(most), ((xy.abs() + yy.abs()) * reach).min(most));
            let (px, py) = (px + (cx - 0.5), py + (cy - 0.5));
            let (xa, xb) = (first_beyond(px - rx, [0.0, width]), first_beyond(px + rx, [0.0, width]));
            let (ya, yb) = (first_beyond(py - ry, band_rows), first_beyond(py + ry, band_rows));
            let shown = hz.simd_ge(f32x8::splat(simd, W_NEAR))
                & xb.simd_gt(xa)
                & yb.simd_gt(ya)
                & q.simd_gt(f32x8::splat(simd, 0.0));
            let inside = match column {
                0 => 0xfe,
                c if c + GROUP == SHEET_COLUMNS => 0x7f,
                _ => 0xff,
            };
            let mut lanes = shown.to_bitmask() & inside;
            if lanes == 0 {
                continue;
            }
            let solid = solid.to_bitmask();
            counts[0] += u64::from(lanes.count_ones());
            counts[1] += u64::from((lanes & solid).count_ones());
            let z = q * reciprocal;
            let apart = (z * self.tolerance).max(f32x8::splat(simd, self.bin));
            let (farther, nearer) = ((z - apart).to_array(), (z + apart).to_array());
            let z = z.to_array();
            let (xa, xb, ya, yb) = (xa.to_array(), xb.to_array(), ya.to_array(), yb.to_array());
            while lanes != 0 {
                let i = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                let key = u64::from(z[i].to_bits()) << 32 | (base + at + i) as u64;
                let (left, columns) = (xa[i] as usize, (xb[i] - xa[i]) as usize);
                let first = (ya[i] - to.rows.start as i32) as usize * to.width + left;
                let rows = (yb[i] - ya[i]) as usize;
                if solid >> i & 1 == 1 {
                    for row in 0..rows {
                        let start = first + row * to.width;
                        for pixel in to.solid.get_mut(start..start + columns).unwrap_or_default() {
                            *pixel = (*pixel).max(key);
                        }
                    }
                } else {
                    for row in 0..rows {
                        let start = first + row * to.width;
                        let solid = to.solid.get(start..start + columns).unwrap_or_default();
                        let rims = to.rims.get_mut(start..start + columns).unwrap_or_default();
                        for (solid, rims) in solid.iter().zip(rims) {
                            if key > *solid {
                                insert(rims, key, [farther[i], nearer[i]]);
                            }
                        }
                    }
                }
            }
        }
        counts
    }
}

/// Adds a sample at a rim to the nearest of a pixel. Of a surface on one sheet, only one is kept: whatever is looked up from it
/// takes its neighbours in. What is of one surface between `farther` and `nearer`.
#[inline(always)]
fn insert(rims: &mut [Key; RIMS], mut key: Key, [farther, nearer]: [f32; 2]) {
    for i in 0..RIMS {
        let (z, is_same_sheet) = (inverse_depth_of(rims[i]), (rims[i] as u32 ^ key as u32) < SHEET_LEN as u32);
        if is_same_sheet && z >= farther && z <= nearer {
            rims[i] = rims[i].max(key);
            for k in (1..=i).rev() {
                if rims[k] > rims[k - 1] {
                    rims.swap(k, k - 1);
                }
            }
            return;
        }
    }
    for rim in rims {
        if key > *rim {
            std::mem::swap(rim, &mut key);
        }
    }
}

/// Change of inverse depth over one face pixel along x and y, 1/m.
#[inline(always)]
pub(super) fn slopes_of<S: Simd>(simd: S, slopes: u32x8<S>, q: f32x8<S>, unit: f32) -> [f32x8<S>; 2] {
    let scale = q * unit;
    let zero = f32x8::splat(simd, 2048.0);
    [(f32x8::float_from((slopes >> 8) & 0xfff) - zero) * scale, (f32x8::float_from(slopes >> 20) - zero) * scale]
}

/// The first line whose middle is not before a position (in lines, less one half), clipped.
#[inline(always)]
fn first_beyond<S: Simd>(position: f32x8<S>, [low, high]: [f32; 2]) -> i32x8<S> {
    i32x8::truncate_from(position.max(low).min(high).ceil())
}
