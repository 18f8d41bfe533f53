//! Pending hits: pixels of a tile that meet different layers are blended together (L9, C21).

use super::plan::Paint;
use super::pyramid::{Level, Pyramid};
use super::rays::{Rays, TexelPositions};
use super::show::Show;
use super::taps::{LANES, add_taps, nearest};
use fearless_simd::{Simd, f32x16, i32x16, mask32x16, prelude::*, u32x16};

/// At most one layer of each of sixteen rays, all of one level of detail, and where their cameras
/// show it.
pub(super) struct Pending<S: Simd> {
    /// Rays that wait.
    waits: mask32x16<S>,
    level: Level,
    /// From the farthest to the nearest that count as the layer.
    indices: [i32x16<S>; 2],
    u: [f32x16<S>; 2],
    v: [f32x16<S>; 2],
    /// Weights of the cameras that show the layer; 0 for others, and for all lanes without a
    /// pending hit.
    weight: [f32x16<S>; 4],
    /// Share of the pixel that the layer takes.
    taken: f32x16<S>,
}

impl<S: Simd> Pending<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, level: Level) -> Self {
        let (zero, none) = (f32x16::splat(simd, 0.0), i32x16::splat(simd, 0));
        let waits = mask32x16::from_bitmask(simd, 0);
        Self {
            waits,
            level,
            indices: [none; 2],
            u: [zero; 2],
            v: [zero; 2],
            weight: [zero; 4],
            taken: zero,
        }
    }

    /// Returns true if `rays` can be queued: no lane is occupied and the level matches.
    #[inline(always)]
    pub(super) fn has_room(&self, rays: mask32x16<S>, level: Level) -> bool {
        !(self.waits & rays).any_true() && (self.level == level || !self.waits.any_true())
    }

    /// Lets rays wait, if there is room for them, with the weights of the cameras that show the
    /// layer.
    #[inline(always)]
    pub(super) fn put(
        &mut self,
        rays: mask32x16<S>,
        level: Level,
        indices: [u16; 2],
        places: &TexelPositions<S>,
        weight: [f32x16<S>; 4],
        taken: f32x16<S>,
    ) {
        let simd = taken.token();
        let indices = [
            i32x16::splat(simd, i32::from(indices[0])),
            i32x16::splat(simd, i32::from(indices[1])),
        ];
        if !self.waits.any_true() {
            *self = Self {
                waits: rays,
                level,
                indices,
                u: places.u,
                v: places.v,
                weight,
                taken,
            };
            return;
        }
        for side in 0..2 {
            self.u[side] = rays.select(places.u[side], self.u[side]);
            self.v[side] = rays.select(places.v[side], self.v[side]);
            self.indices[side] = rays.select(indices[side], self.indices[side]);
        }
        for k in 0..4 {
            self.weight[k] = rays.select(weight[k], self.weight[k]);
        }
        self.taken = rays.select(taken, self.taken);
        self.waits |= rays;
    }

    /// Adds what waits to colours; then nothing waits.
    #[inline(always)]
    pub(super) fn blend(
        &mut self,
        simd: S,
        pyramid: &Pyramid,
        paint: Option<&Paint>,
        rays: &Rays<S>,
        color: &mut [f32x16<S>; 3],
    ) {
        if !self.waits.any_true() {
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
                None => {
                    let (base, weight) = (rays.base[k], self.weight[k]);
                    add_taps(
                        simd,
                        &pyramid.texels,
                        self.level,
                        base,
                        at,
                        &self.indices,
                        weight,
                        &mut sum,
                    );
                }
                Some(paint) => {
                    let numbers = match paint.show {
                        Show::Cameras => camera_numbers(rays.base[k].to_array(), pyramid.stride),
                        Show::Merged => self.indices[1].bitcast::<u32x16<S>>().to_array(),
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
        let scale = self.taken / sum[3].simd_gt(0.0).select(sum[3], one);
        for c in 0..3 {
            color[c] += sum[c] * scale;
        }
        self.weight = [zero; 4];
        self.taken = zero;
        self.waits = mask32x16::from_bitmask(simd, 0);
    }
}

/// Camera numbers of the texel offsets.
fn camera_numbers(base: [u32; LANES], stride: usize) -> [u32; LANES] {
    base.map(|base| base / stride.max(1) as u32)
}

/// Adds colours by number times weight, and weight.
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
