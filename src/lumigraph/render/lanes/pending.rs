//! Pending hits: pixels of a tile that hit different layers are blended together (L9, C21).

use super::rays::{Rays, TexelPositions};
use super::taps::{LANES, add_taps, nearest};
use crate::render::plan::Paint;
use crate::render::pyramid::{Level, Pyramid};
use crate::render::show::LumigraphOverlay;
use fearless_simd::{Simd, f32x16, i32x16, mask32x16, prelude::*, u32x16};

/// At most one hit for each of sixteen rays, all at one level of detail, with its positions in the
/// cameras' images.
pub(crate) struct Pending<S: Simd> {
    /// Rays with a pending hit.
    occupied: mask32x16<S>,
    level: Level,
    /// Farthest and nearest index that belong to the layer.
    indices: [i32x16<S>; 2],
    u: [f32x16<S>; 2],
    v: [f32x16<S>; 2],
    /// Weights of the cameras that see the layer; 0 for others, and in lanes without a pending hit.
    weight: [f32x16<S>; 4],
    /// Share of the pixel that the layer covers.
    coverage: f32x16<S>,
}

impl<S: Simd> Pending<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, level: Level) -> Self {
        let zero = f32x16::splat(simd, 0.0);
        Self {
            occupied: mask32x16::from_bitmask(simd, 0),
            level,
            indices: [i32x16::splat(simd, 0); 2],
            u: [zero; 2],
            v: [zero; 2],
            weight: [zero; 4],
            coverage: zero,
        }
    }

    /// Returns true if `rays` can be added: no lane is occupied and the level matches.
    #[inline(always)]
    pub(crate) fn has_room(&self, rays: mask32x16<S>, level: Level) -> bool {
        !(self.occupied & rays).any_true() && (self.level == level || !self.occupied.any_true())
    }

    /// Adds hits, for which there must be room, with the weights of the cameras that see the layer.
    #[inline(always)]
    pub(crate) fn add(
        &mut self,
        rays: mask32x16<S>,
        level: Level,
        indices: [u16; 2],
        positions: &TexelPositions<S>,
        weight: [f32x16<S>; 4],
        coverage: f32x16<S>,
    ) {
        let simd = coverage.token();
        let indices = [
            i32x16::splat(simd, i32::from(indices[0])),
            i32x16::splat(simd, i32::from(indices[1])),
        ];
        if !self.occupied.any_true() {
            *self = Self {
                occupied: rays,
                level,
                indices,
                u: positions.u,
                v: positions.v,
                weight,
                coverage,
            };
            return;
        }
        for side in 0..2 {
            self.u[side] = rays.select(positions.u[side], self.u[side]);
            self.v[side] = rays.select(positions.v[side], self.v[side]);
            self.indices[side] = rays.select(indices[side], self.indices[side]);
        }
        for k in 0..4 {
            self.weight[k] = rays.select(weight[k], self.weight[k]);
        }
        self.coverage = rays.select(coverage, self.coverage);
        self.occupied |= rays;
    }

    /// Blends the pending hits into `color` and clears them.
    #[inline(always)]
    pub(crate) fn blend(
        &mut self,
        simd: S,
        pyramid: &Pyramid,
        paint: Option<&Paint>,
        rays: &Rays<S>,
        color: &mut [f32x16<S>; 3],
    ) {
        if !self.occupied.any_true() {
            return;
        }
        let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
        let mut sum = [zero; 4];
        for k in 0..4 {
            let shows = self.weight[k].simd_gt(0.0);
            if !shows.any_true() {
                continue;
            }
            let at = [self.u[k % 2], self.v[k / 2]];
            match paint {
                None => add_taps(
                    simd,
                    &pyramid.texels,
                    self.level,
                    rays.base[k],
                    at,
                    &self.indices,
                    self.weight[k],
                    &mut sum,
                ),
                Some(paint) => {
                    let numbers = match paint.show {
                        LumigraphOverlay::Cameras => {
                            let stride = pyramid.stride.max(1) as u32;
                            rays.base[k].to_array().map(|base| base / stride)
                        }
                        LumigraphOverlay::Merged => {
                            self.indices[1].bitcast::<u32x16<S>>().to_array()
                        }
                        _ => {
                            let index =
                                nearest(simd, &pyramid.texels, self.level, rays.base[k], at, shows);
                            index.bitcast::<u32x16<S>>().to_array()
                        }
                    };
                    add_paint(simd, paint, &numbers, self.weight[k], &mut sum);
                }
            }
        }
        let scale = self.coverage / sum[3].simd_gt(0.0).select(sum[3], one);
        for c in 0..3 {
            color[c] += sum[c] * scale;
        }
        self.weight = [zero; 4];
        self.coverage = zero;
        self.occupied = mask32x16::from_bitmask(simd, 0);
    }
}

/// Adds the colours of `numbers` times weight, and the weight.
#[inline(always)]
fn add_paint<S: Simd>(
    simd: S,
    paint: &Paint,
    numbers: &[u32; LANES],
    weight: f32x16<S>,
    sum: &mut [f32x16<S>; 4],
) {
    let mut colors = [[0.0; LANES]; 3];
    for i in 0..LANES {
        let color = paint
            .colors
            .get(numbers[i] as usize)
            .copied()
            .unwrap_or_default();
        (colors[0][i], colors[1][i], colors[2][i]) = (color[0], color[1], color[2]);
    }
    for c in 0..3 {
        sum[c] += f32x16::load_array(simd, colors[c]) * weight;
    }
    sum[3] += weight;
}
