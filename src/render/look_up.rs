//! Each pixel of a frame once: where on the surface that it sees it lies, and the colour there.

use super::in_view::InView;
use super::linear::LinearLight;
use super::visibility::{Key, LANES, RIMS, Visibility, inverse_depth_of, slopes_of};
use crate::packed::sheets::{SHEET_COLUMNS, SHEET_LEN, SOLID, Sheets};
use fearless_simd::{Level, Simd, SimdCvtFloat, SimdCvtTruncate, dispatch, f32x8, i32x8, prelude::*, u32x8};

/// Looks pixels up.
pub(super) struct LookUp<'a> {
    pub(super) sheets: &'a Sheets,
    pub(super) view: &'a InView,
}

/// The least share of 255 of a pixel that a surface has where it has any.
const MIN_SHARE: u32 = 13;

/// The share of 255 from which on a surface hides its pixel wholly. Less than all, because what lies behind a rim is often
/// known to no ray, and the sky must not shine through.
const WHOLE: u32 = 196;

/// Eight pixels of one surface each.
struct Found<S: Simd> {
    /// Straight colour; its alpha is the share of the pixel that the surface covers.
    color: u32x8<S>,
}

impl LookUp<'_> {
    /// Writes a row of a band: straight colour, and the share of 255 that surfaces cover; and, if wanted, 1 / eye depth.
    pub(super) fn row(&self, seen: &Visibility, y: u32, colors: &mut [[u8; 4]], depths: &mut [f32], level: Level) {
        dispatch!(level, simd => self.row_at(simd, seen, y, colors, depths));
    }

    #[inline(always)]
    fn row_at<S: Simd>(&self, simd: S, seen: &Visibility, y: u32, colors: &mut [[u8; 4]], depths: &mut [f32]) {
        let width = colors.len();
        let start = (y - seen.rows.start) as usize * width;
        let (solid, rims) = (&seen.solid[start..start + width], &seen.rims[start..start + width]);
        let light = LinearLight::tables();
        for (column, colors) in (0..).step_by(LANES).zip(colors.chunks_mut(LANES)) {
            let (mut back, mut fronts) = ([0; LANES], [[0; LANES]; RIMS]);
            let (mut any_back, mut any) = (0, [0; RIMS]);
            for i in 0..colors.len() {
                back[i] = solid[column + i];
                any_back |= back[i];
                for k in 0..RIMS {
                    let key = rims[column + i][k];
                    fronts[k][i] = if key > back[i] { key } else { 0 };
                    any[k] |= fronts[k][i];
                }
            }
            let position = [column as f32, y as f32];
            let mut out = [[0; 4]; LANES];
            if any_back != 0 {
                out = bytemuck::cast(self.eight::<S, true>(simd, &back, position).color.to_array());
                for (out, key) in out.iter_mut().zip(&back) {
                    *out = if *key == 0 { [0; 4] } else { *out };
                }
            }
            for (keys, any) in fronts.iter().zip(any).rev() {
                if any == 0 {
                    continue;
                }
                let found: [[u8; 4]; LANES] =
                    bytemuck::cast(self.eight::<S, false>(simd, keys, position).color.to_array());
                for i in 0..LANES {
                    if keys[i] != 0 {
                        out[i] = flattened(found[i], out[i], light);
                    }
                }
            }
            colors.copy_from_slice(&out[..colors.len()]);
            for (i, depth) in depths.iter_mut().skip(column).take(LANES).enumerate() {
                let key = if fronts[0][i] != 0 { fronts[0][i] } else { back[i] };
                *depth = inverse_depth_of(key);
            }
        }
    }

    /// Looks eight pixels up. What is found where there is no key may be anything.
    #[inline(always)]
    fn eight<S: Simd, const IS_SOLID: bool>(&self, simd: S, keys: &[Key; LANES], [x, y]: [f32; 2]) -> Found<S> {
        let sheets = self.sheets;
        let lane = f32x8::load_array(simd, [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5]);
        let [cx, cy] = self.view.principal_px;
        let (px, py) = (lane + (x - cx), f32x8::splat(simd, y + 0.5 - cy));
        let mut entries = [0u32; LANES];
        let (mut bits, mut slopes, mut places) = ([0u32; LANES], [0u32; LANES], [0u32; LANES]);
        for i in 0..LANES {
            let entry = keys[i] as u32;
            entries[i] = entry;
            if let Some(shape) = sheets.shapes.get(entry as usize) {
                (bits[i], slopes[i]) = (shape.inverse_depth, shape.slopes);
            }
            places[i] = sheets.places.get(entry as usize / SHEET_LEN).copied().unwrap_or(0);
        }
        let q: f32x8<S> = (u32x8::load_array(simd, bits) & !SOLID).bitcast();
        let slopes = u32x8::load_array(simd, slopes);
        let [slope_x, slope_y] = slopes_of(simd, slopes, q, sheets.slope_unit);
        let entry = u32x8::load_array(simd, entries);
        let places_lanes = u32x8::load_array(simd, places);
        let u = f32x8::float_from((places_lanes & 0x3fff) + (entry & (SHEET_COLUMNS as u32 - 1))) - 0.5;
        let v = f32x8::float_from(((places_lanes >> 14) & 0x3fff) + ((entry >> 5) & 15)) - 0.5;
        let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let (mut du, mut dv) = (zero, zero);
        let faces = places_lanes >> 28;
        let mut todo = 0xffu32;
        while todo != 0 {
            let face = places[todo.trailing_zeros() as usize] >> 28;
            let same = faces.simd_eq(u32x8::splat(simd, face));
            todo &= !(same.to_bitmask() as u32);
            let steps = &self.view.faces[(face as usize).min(5)];
            let b = steps.inverse_depth;
            let h0x = ((u * steps.x.x + v * steps.y.x) + steps.one.x) + q * b.x;
            let h0y = ((u * steps.x.y + v * steps.y.y) + steps.one.y) + q * b.y;
            let h0z = ((u * steps.x.z + v * steps.y.z) + steps.one.z) + q * b.z;
            let (xz, yz) = (slope_x * b.z + steps.x.z, slope_y * b.z + steps.y.z);
            let xx = slope_x * b.x + steps.x.x - px * xz;
            let yx = slope_y * b.x + steps.y.x - px * yz;
            let xy = slope_x * b.y + steps.x.y - py * xz;
            let yy = slope_y * b.y + steps.y.y - py * yz;
            let (ex, ey) = (px * h0z - h0x, py * h0z - h0y);
            let reciprocal = one / (xx * yy - yx * xy);
            du = same.select((ex * yy - yx * ey) * reciprocal, du);
            dv = same.select((xx * ey - xy * ex) * reciprocal, dv);
        }
        let (least, most) = (f32x8::splat(simd, -1.0), f32x8::splat(simd, 0.99999));
        let du = du.min_precise(most).max_precise(least);
        let dv = dv.min_precise(most).max_precise(least);
        let (left, above) = (du.floor(), dv.floor());
        let (fu, fv) = (du - left, dv - above);
        let (left, above) = (i32x8::truncate_from(left), i32x8::truncate_from(above));
        let first: u32x8<S> = (entry.bitcast::<i32x8<S>>() + left + above * SHEET_COLUMNS as i32).bitcast();
        let first = first.to_array();
        let (mut upper, mut lower) = ([[0u32; 2]; LANES], [[0u32; 2]; LANES]);
        for i in 0..LANES {
            let at = first[i] as usize;
            upper[i] = sheets.colors.get(at..).and_then(|c| c.first_chunk()).copied().unwrap_or_default();
            lower[i] =
                sheets.colors.get(at + SHEET_COLUMNS..).and_then(|c| c.first_chunk()).copied().unwrap_or_default();
        }
        let ((c00, c10), (c01, c11)) = (split(simd, upper), split(simd, lower));
        if IS_SOLID {
            let (fu, fv) = (u32x8::truncate_from(fu * 256.0 + 0.5), u32x8::truncate_from(fv * 256.0 + 0.5));
            let even = mix(simd, mix(simd, c00, c10, fu), mix(simd, c01, c11, fu), fv);
            let odd = mix(simd, mix(simd, c00 >> 8, c10 >> 8, fu), mix(simd, c01 >> 8, c11 >> 8, fu), fv);
            return Found { color: even | (odd << 8) };
        }
        // Nine bits, row by row: which of the three by three samples are of the surface.
        let around = (slopes & 0xf) | 1 << 4 | (slopes & 0xf0) << 1;
        let shift: u32x8<S> = ((above + 1) * 3 + (left + 1)).bitcast();
        let connected = simd.shrv_u32x8(around, shift);
        let (gu, gv) = (one - fu, one - fv);
        let (mut share, mut red, mut green, mut blue) = (zero, zero, zero, zero);
        for (color, weight, bit) in [(c00, gu * gv, 1), (c10, fu * gv, 2), (c01, gu * fv, 8), (c11, fu * fv, 16)] {
            let there = (connected & bit).simd_gt(u32x8::splat(simd, 0));
            let alpha = f32x8::float_from(color >> 24);
            let weight = there.select(weight * alpha, zero);
            share += weight;
            red += weight * f32x8::float_from(color & 255);
            green += weight * f32x8::float_from((color >> 8) & 255);
            blue += weight * f32x8::float_from((color >> 16) & 255);
        }
        let reciprocal = one / share.max(1e-6);
        let red = u32x8::truncate_from(red * reciprocal + 0.5);
        let green = u32x8::truncate_from(green * reciprocal + 0.5);
        let blue = u32x8::truncate_from(blue * reciprocal + 0.5);
        let share = u32x8::truncate_from(share + 0.5);
        Found { color: red | green << 8 | blue << 16 | share << 24 }
    }
}

/// Left and right ones of eight pairs.
#[inline(always)]
fn split<S: Simd>(simd: S, pairs: [[u32; 2]; LANES]) -> (u32x8<S>, u32x8<S>) {
    let words: [u32; 2 * LANES] = bytemuck::cast(pairs);
    let (low, high) = words.split_at(LANES);
    simd.deinterleave_u32x8(u32x8::from_slice(simd, low), u32x8::from_slice(simd, high))
}

/// The lowest and the third byte of each lane, between those of `a` and `b`, at a share of 256 of the way.
#[inline(always)]
fn mix<S: Simd>(simd: S, a: u32x8<S>, b: u32x8<S>, share: u32x8<S>) -> u32x8<S> {
    let two = 0x00ff_00ff;
    let rest = u32x8::splat(simd, 256) - share;
    ((((a & two) * rest) + ((b & two) * share) + 0x0080_0080) >> 8) & two
}

/// A surface over what is behind it. What is behind fills the part that the surface leaves open as it fills the pixel.
#[inline(always)]
fn flattened(front: [u8; 4], behind: [u8; 4], light: &LinearLight) -> [u8; 4] {
    let [r, g, b, share] = front;
    if share == 0 {
        return behind;
    }
    let share = (u32::from(share) * 255 / WHOLE).clamp(MIN_SHARE, 255);
    if share == 255 {
        return [r, g, b, 255];
    }
    let [br, bg, bb, behind] = behind;
    let behind = (u32::from(behind) * 255 / (255 - share)).min(255) as u8;
    light.over([r, g, b, share as u8], [br, bg, bb, behind])
}
