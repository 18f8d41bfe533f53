//! Light on the parts of a face.
//!
//! Soft light is pooled over surfaces ([`super::pool`]), so that a part on a large surface, which shares with hundreds of neighbours,
//! takes one sample where a leaf takes all. Neighbours take theirs from one evenly spread sequence, along a Morton curve over the
//! pixels: any square block of them shares an evenly spread set (Ahmed and Wonka 2020, "Screen-Space Blue-Noise Diffusion of Monte
//! Carlo Sampling Error via Hierarchical Ordering of Pixels"). What lies beyond a sample's first ray is shared by all samples
//! of the face that arrive in one cell of space ([`Arrival`]).
//!
//! Sunlight is sampled once everywhere, and again where neighbours on one surface disagree on it: at the edges of its shadows.

use super::pool::{FaceParts, Pooling, same_surface};
use super::shade::{LitPart, Shader, Spot};
use crate::capture::light::{Arrival, LightSample, luminance};
use crate::capture::rig::Face;
use crate::capture::sampler::random4;
use crate::progress::Progress;
use glam::Vec3;
use rayon::prelude::*;

/// Samples a cell of arrivals takes of what lies beyond, at most.
const SAMPLES_OF_CELL: usize = 8;

/// Samples of the sun at the edge of a shadow, as a multiple of the light samples of a depth pixel.
const SUN_AT_EDGE: u32 = 2;

/// Neighbours on its surface that a part needs to tell whether it lies at the edge of a shadow.
const ENOUGH_NEIGHBOURS: u32 = 4;

/// Lights all parts of a face: [`LitPart::sun`] and [`LitPart::soft`]. Gives up soon where `progress` says so.
pub(super) fn illuminate(parts: &mut FaceParts, face: Face, shader: &Shader, progress: &dyn Progress) {
    if shader.samples == 0 {
        progress.advance(u64::from(parts.size_px));
        return;
    }
    let light = FaceLight { face, shader, size_px: parts.size_px, progress };
    if shader.lighting.sun.is_some() {
        light.sun(parts, 0, |_, _, _| 1);
        let edges = light.shadow_edges(parts);
        light.sun(parts, 1, |p, _, _| edges[p]);
    }
    let pooling = Pooling::new(parts, shader.samples);
    let samples = share_out(parts, pooling.samples(shader.samples));
    light.soft(parts, &samples);
    pooling.pool(parts);
}

/// What lighting a face needs beside its parts.
struct FaceLight<'a> {
    face: Face,
    shader: &'a Shader<'a>,
    size_px: u32,
    progress: &'a dyn Progress,
}

/// A light sample, cut after its first ray.
struct Begun {
    part: u32,
    /// See [`Arrival::cell`].
    cell: u64,
    arrival: Arrival,
}

impl FaceLight<'_> {
    /// Calls `light` with each part of the face in turn, its number and pixel, rows in parallel; what it puts aside comes back, row
    /// after row. Each row advances the progress by `steps`.
    fn for_each_part<T: Send>(
        &self,
        parts: &mut FaceParts,
        steps: u64,
        light: impl Fn(&mut LitPart, usize, [u32; 2], &mut Vec<T>) + Sync,
    ) -> Vec<Vec<T>> {
        let (size, offsets) = (self.size_px, &parts.offsets);
        let mut rows = Vec::with_capacity(size as usize);
        let mut rest = &mut parts.parts[..];
        for y in 0..size {
            let [first, end] = [y, y + 1].map(|y| offsets[(y * size) as usize] as usize);
            let (row, after) = rest.split_at_mut(end - first);
            rows.push((y, first, row));
            rest = after;
        }
        let light_row = |(y, first, row): (u32, usize, &mut [LitPart])| {
            let mut aside = Vec::new();
            if self.progress.is_cancelled() {
                return aside;
            }
            for x in 0..size {
                let pixel = (y * size + x) as usize;
                for p in offsets[pixel] as usize..offsets[pixel + 1] as usize {
                    light(&mut row[p - first], p, [x, y], &mut aside);
                }
            }
            self.progress.advance(steps);
            aside
        };
        rows.into_par_iter().map(light_row).collect()
    }

    /// Sample `number` of `count` that a part takes. Parts of one kind of surface that take as many share a sequence.
    fn sample(&self, part: &LitPart, [x, y]: [u32; 2], kind: u32, number: u32, count: u32) -> LightSample {
        let [stream, ..] = random4([self.face.index() as u32, u32::from(part.class), kind, count]);
        LightSample { stream, index: morton(x, y).wrapping_mul(count).wrapping_add(number) }
    }

    /// Takes samples of everything but the sun.
    fn soft(&self, parts: &mut FaceParts, samples: &[u16]) {
        let lighting = self.shader.lighting;
        let begin = |part: &mut LitPart, p: usize, pixel: [u32; 2], begun: &mut Vec<Begun>| {
            let spot = self.shader.spot(part);
            let count = u32::from(samples[p]);
            for number in 0..count {
                let sample = self.sample(part, pixel, 0x50f7, number, count);
                let point = spot.point(&sample, self.face, pixel, self.size_px);
                let (light, arrival) = lighting.before(self.shader.tracer, &point, &sample);
                part.soft += light;
                let Some(arrival) = arrival else { continue };
                match arrival.cell() {
                    Some(cell) => begun.push(Begun { part: p as u32, cell, arrival }),
                    None => part.soft += arrival.albedo * lighting.beyond(self.shader.tracer, &arrival, &sample),
                }
            }
            part.light_samples = samples[p];
        };
        let begun: Vec<Begun> = self.for_each_part(parts, 1, begin).into_iter().flatten().collect();
        let (cell_of, light) = self.beyond(&begun);
        for (begun, cell) in begun.iter().zip(cell_of) {
            parts.parts[begun.part as usize].soft += begun.arrival.albedo * light[cell as usize];
        }
        let exposure = lighting.exposure;
        parts.parts.par_iter_mut().for_each(|part| part.soft *= exposure / f32::from(part.light_samples.max(1)));
    }

    /// What lies beyond the samples' arrivals: the number of the cell of each, and the light of each cell.
    fn beyond(&self, begun: &[Begun]) -> (Vec<u32>, Vec<Vec3>) {
        let filed = |(i, begun): (usize, &Begun)| {
            // Any fixed order that has nothing to do with places will do to draw those that stand for their cell.
            let rank = (i as u32).wrapping_mul(0x9e37_79b9);
            (begun.cell, rank, i as u32)
        };
        let mut order: Vec<(u64, u32, u32)> = begun.par_iter().enumerate().map(filed).collect();
        order.par_sort_unstable();
        let cells: Vec<&[(u64, u32, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
        let light_of = |cell: &&[(u64, u32, u32)]| {
            if self.progress.is_cancelled() {
                return Vec3::ZERO;
            }
            let drawn = &cell[..cell.len().min(SAMPLES_OF_CELL)];
            let [stream, ..] = random4([cell[0].0 as u32, (cell[0].0 >> 32) as u32, 0xce11, 0]);
            let light = |(index, &(_, _, i)): (u32, &(u64, u32, u32))| {
                let sample = LightSample { stream, index };
                self.shader.lighting.beyond(self.shader.tracer, &begun[i as usize].arrival, &sample)
            };
            (0..).zip(drawn).map(light).sum::<Vec3>() / drawn.len() as f32
        };
        let light = cells.par_iter().map(light_of).collect();
        let mut cell_of = vec![0; begun.len()];
        for (number, cell) in (0..).zip(&cells) {
            cell.iter().for_each(|&(_, _, i)| cell_of[i as usize] = number);
        }
        (cell_of, light)
    }

    /// Takes `count` more samples of the sun at each part, which has `before`.
    fn sun(&self, parts: &mut FaceParts, before: u32, count: impl Fn(usize, &LitPart, [u32; 2]) -> u32 + Sync) {
        let (lighting, tracer) = (self.shader.lighting, self.shader.tracer);
        let gather = |part: &mut LitPart, p: usize, pixel: [u32; 2], requests: &mut Vec<(u32, _)>| {
            let more = count(p, part, pixel);
            if more == 0 {
                return;
            }
            let spot: Spot = self.shader.spot(part);
            for number in 0..more {
                let sample = self.sample(part, pixel, 0x5111 + before, number, more);
                requests.push((p as u32, (spot.point(&sample, self.face, pixel, self.size_px), sample)));
            }
        };
        let rows = self.for_each_part(parts, 0, gather);
        let light_row = |row: Vec<(u32, (_, LightSample))>| {
            let (parts, requests): (Vec<u32>, Vec<_>) = row.into_iter().unzip();
            let light = lighting.sun_radiosities(tracer, &requests);
            (parts, light)
        };
        let rows: Vec<(Vec<u32>, Vec<Vec3>)> = rows.into_par_iter().map(light_row).collect();
        for (numbers, light) in rows {
            let mut from = 0;
            for same in numbers.chunk_by(|a, b| a == b) {
                let (part, taken) = (&mut parts.parts[same[0] as usize], same.len() as u32);
                let sum: Vec3 = light[from..from + same.len()].iter().sum();
                let of_before = before as f32 / (before + taken) as f32;
                part.sun = part.sun * of_before + sum * (lighting.exposure / (before + taken) as f32);
                from += same.len();
            }
        }
    }

    /// How many more samples of the sun each part needs.
    fn shadow_edges(&self, parts: &FaceParts) -> Vec<u32> {
        let size = self.size_px;
        let many = SUN_AT_EDGE * self.shader.samples;
        let row = |y: u32| {
            let window = |c: u32| c.saturating_sub(1)..(c + 2).min(size);
            let mut wanted = Vec::new();
            for x in 0..size {
                for part in parts.pixel(x, y) {
                    let here = luminance(part.sun.to_array());
                    let (mut low, mut high, mut count) = (here, here, 0);
                    for other in window(y).flat_map(|ny| window(x).flat_map(move |nx| parts.pixel(nx, ny))) {
                        if same_surface(part, other) {
                            let level = luminance(other.sun.to_array());
                            (low, high, count) = (low.min(level), high.max(level), count + 1);
                        }
                    }
                    // On one surface nothing but a shadow changes the sun by a quarter from pixel to pixel.
                    wanted.push(match low < 0.75 * high {
                        true => many.saturating_sub(1),
                        false if count <= ENOUGH_NEIGHBOURS => self.shader.samples.saturating_sub(1),
                        false => 0,
                    });
                }
            }
            wanted
        };
        let rows: Vec<Vec<u32>> = (0..size).into_par_iter().map(row).collect();
        rows.concat()
    }
}

/// Samples of a depth pixel, shared out over its parts by the rays that saw them, at least one each.
fn share_out(parts: &FaceParts, mut samples: Vec<u16>) -> Vec<u16> {
    for pixel in parts.offsets.windows(2) {
        let [mut first, end] = [pixel[0], pixel[1]].map(|p| p as usize);
        for bin in parts.parts[first..end].chunk_by(|a, b| a.bin == b.bin) {
            let rays: u64 = bin.iter().map(|part| u64::from(part.count)).sum();
            for (part, samples) in bin.iter().zip(&mut samples[first..]) {
                *samples = (u64::from(*samples) * u64::from(part.count)).div_ceil(rays.max(1)) as u16;
            }
            first += bin.len();
        }
    }
    samples
}

/// The place of pixel (x, y) on the Morton curve.
fn morton(x: u32, y: u32) -> u32 {
    let spread = |mut c: u32| {
        c = (c | c << 8) & 0x00ff_00ff;
        c = (c | c << 4) & 0x0f0f_0f0f;
        c = (c | c << 2) & 0x3333_3333;
        (c | c << 1) & 0x5555_5555
    };
    spread(x) | spread(y) << 1
}
