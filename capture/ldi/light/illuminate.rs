//! Light on the parts of a face.
//!
//! Soft light is pooled over surfaces ([`super::pool`]), so that a part in the middle of a wall, which shares with thousands of
//! neighbours, hardly ever takes a sample of its own where a leaf takes all. A first round of few samples tells how far light can be
//! pooled about each part and what it varies by; the rest go where the error that is left would show. What lies beyond a sample's
//! first ray is shared by all samples of a round that arrive in one cell of space ([`Arrival`]).
//!
//! Sunlight is sampled once everywhere, and again where neighbours on one surface disagree on it: at the edges of its shadows.

use super::pool::{Blocks, Classes, Gathered, Pooled, Pooling, Survey, Windows, same_surface};
use super::shade::{LitPart, Shader, Spot};
use crate::surfaces::distribute::{Share, spread};
use crate::surfaces::rows;
use crate::surfaces::rows::Row;
use crate::surfaces::surface_samples::FaceParts;
use glam::Vec3;
use headbox_core::color::luminance;
use headbox_core::cube_face::Face;
use headbox_core::progress::Progress;
use headbox_trace::light::{Arrival, LightSample, LitPoint, shown_slope};
use headbox_trace::sampler::random4;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Samples a cell of arrivals takes of what lies beyond, at most.
const SAMPLES_OF_CELL: usize = 8;

/// Samples of the sun at the edge of a shadow, as a multiple of the light samples of a depth pixel.
const SUN_AT_EDGE: u32 = 2;

/// Neighbours on its surface that a part needs to tell whether it lies at the edge of a shadow.
const ENOUGH_NEIGHBOURS: u32 = 4;

/// Rounds of soft light; each advances the progress by the rows of the face.
pub(crate) const ROUNDS: u64 = 2;

/// Samples of the first round in the widest window, as a multiple of the light samples of a depth pixel.
const FIRST_ROUND: f32 = 32.0;

/// Error of a colour, sRGB levels, at which a part takes no more samples of one light sample a depth pixel; of more, less by the root
/// of their number.
const ENOUGH_LEVELS: f32 = 0.5;

/// What the light samples of a face have found.
pub(crate) struct FaceSamples {
    gathered: Vec<Gathered>,
    blocks: Blocks,
    classes: Classes,
}

/// Takes the light samples of all parts of a face; [`LitPart::sun`] is known then. Gives up soon where `progress` says so.
pub(crate) fn sample(
    parts: &mut FaceParts,
    face: Face,
    shader: &Shader,
    progress: &dyn Progress,
) -> FaceSamples {
    let light = FaceLight {
        face,
        shader,
        size_px: parts.size_px,
        progress,
    };
    if shader.lighting.is_sharp() {
        light.sun(parts, 0, |_, _| 1);
        let edges = light.shadow_edges(parts);
        light.sun(parts, 1, |p, _| edges[p]);
    }
    light.soft(parts)
}

/// Pools the samples of all faces, in their order, for the parts of one: [`LitPart::soft`]. Its own are gone then.
pub(crate) fn pool(parts: &mut FaceParts, face: Face, samples: &mut [FaceSamples]) {
    let gathered = std::mem::take(&mut samples[face.index()].gathered);
    let all = Face::ALL.map(|face| samples.get(face.index()).map(|of| &of.blocks));
    let windows = Windows::new(face, parts.size_px, &samples[face.index()].blocks, all);
    let mut classes = Classes::default();
    samples.iter().for_each(|of| classes.absorb(&of.classes));
    let pooled = Pooling::new(parts, face).pool(&gathered, &windows, &classes.variances());
    parts
        .parts
        .iter_mut()
        .zip(pooled)
        .for_each(|(part, pooled)| part.soft = pooled.light);
}

/// What lighting a face needs beside its parts.
struct FaceLight<'a> {
    face: Face,
    shader: &'a Shader<'a>,
    size_px: u32,
    progress: &'a dyn Progress,
}

/// A sample of the sun that the part of this number wants.
type SunRequest = (u32, (LitPoint, LightSample));

/// A light sample, cut after its first ray.
struct Begun {
    part: u32,
    /// See [`Arrival::cell`].
    cell: u64,
    /// What it found before it arrived.
    before: Vec3,
    arrival: Arrival,
}

impl Gathered {
    /// Adds a sample, exposed.
    fn add(&mut self, light: Vec3) {
        let level = luminance(light.to_array());
        self.light += light;
        self.squares += level * level;
    }
}

impl FaceLight<'_> {
    /// Calls `visit` with the number and the pixel of each part of the face in turn, and with its place in `all`, rows in parallel;
    /// what it puts aside comes back, row after row. Each row advances the progress by `steps`.
    fn for_each_part<P: Send, T: Send>(
        &self,
        offsets: &[u32],
        all: &mut [P],
        steps: u64,
        visit: impl Fn(&mut P, usize, [u32; 2], &mut Vec<T>) + Sync,
    ) -> Vec<Vec<T>> {
        let size = self.size_px;
        let visit_row = |(y, (first, row)): (usize, Row<P>)| {
            let (mut aside, pixels) = (Vec::new(), &offsets[y * size as usize..][..=size as usize]);
            if self.progress.is_cancelled() {
                return aside;
            }
            for (x, ends) in (0..).zip(pixels.windows(2)) {
                for p in ends[0] as usize..ends[1] as usize {
                    visit(&mut row[p - first], p, [x, y as u32], &mut aside);
                }
            }
            self.progress.advance(steps);
            aside
        };
        let rows = rows::of_face(offsets, size, all);
        rows.into_par_iter().enumerate().map(visit_row).collect()
    }

    /// Samples of everything but the light straight from the sun.
    fn soft(&self, parts: &FaceParts) -> FaceSamples {
        let (mut blocks, members) = Blocks::new(parts);
        let classes = parts.classes();
        let mut gathered = vec![Gathered::default(); parts.parts.len()];
        let windows = |blocks: &Blocks| Windows::new(self.face, self.size_px, blocks, [None; 6]);
        let survey = Survey::new(
            self.face,
            self.size_px,
            &blocks,
            &windows(&blocks),
            &members,
        );
        let first_round = FIRST_ROUND * self.shader.samples as f32;
        let first = |p: usize| (first_round / survey.widest(p)).min(1.0);
        let wanted: Vec<f32> = (0..parts.parts.len()).into_par_iter().map(first).collect();
        self.gather(
            parts,
            &survey,
            0,
            spread(parts, &classes, &wanted),
            &mut gathered,
        );
        blocks.fill(&members, &gathered);
        let pooled = survey.pooled(
            &windows(&blocks),
            &Classes::of(&classes, &gathered).variances(),
        );
        let more = |(p, part): (usize, &LitPart)| {
            self.wanted(
                part,
                &pooled[survey.of(p)],
                survey.most_samples(p, self.shader.samples as f32),
            )
        };
        let wanted: Vec<f32> = parts.parts.par_iter().enumerate().map(more).collect();
        self.gather(
            parts,
            &survey,
            1,
            spread(parts, &classes, &wanted),
            &mut gathered,
        );
        blocks.fill(&members, &gathered);
        FaceSamples {
            classes: Classes::of(&classes, &gathered),
            gathered,
            blocks,
        }
    }

    /// How many more samples a part takes: as many as bring the error of its colour down to what is enough, and no more than `most`.
    fn wanted(&self, part: &LitPart, pooled: &Pooled, most: f32) -> f32 {
        let shown = luminance(
            LitPart {
                soft: pooled.light,
                ..*part
            }
            .color()
            .to_array(),
        );
        let albedo = luminance(part.albedo.map(|c| f32::from(c) / 65_535.0));
        // Variance of the colour that one sample a part leaves, squared sRGB levels.
        let variance =
            (255.0 * albedo * shown_slope(shown)).powi(2) * pooled.variance / pooled.parts.max(1.0);
        let needed = self.shader.samples as f32 * variance / (ENOUGH_LEVELS * ENOUGH_LEVELS);
        let taken = pooled.samples / pooled.parts.max(1.0);
        (needed.min(most) - taken).max(0.0)
    }

    /// Takes samples of soft light, each part its share, in a round of that number.
    fn gather(
        &self,
        parts: &FaceParts,
        survey: &Survey,
        round: u32,
        shares: Vec<Share>,
        gathered: &mut [Gathered],
    ) {
        let (lighting, tracer) = (self.shader.lighting, self.shader.tracer);
        let begin = |gathered: &mut Gathered, p: usize, pixel: [u32; 2], begun: &mut Vec<Begun>| {
            let (part, Share { first, count }) = (&parts.parts[p], shares[p]);
            if count == 0 {
                return;
            }
            let (spot, stream) = (self.shader.spot(part), self.stream(part, 0x50f7 + round));
            for number in 0..count {
                let sample = LightSample {
                    stream,
                    index: first.wrapping_add(number),
                };
                let point = spot.point(&sample, self.face, pixel, self.size_px);
                let (before, arrival) = lighting.before(tracer, &point, &sample);
                let Some(arrival) = arrival else {
                    gathered.add(before * lighting.exposure);
                    continue;
                };
                gathered.nearness += arrival.weight / arrival.distance_m.max(survey.width_m(p));
                match arrival.cell() {
                    Some(cell) => begun.push(Begun {
                        part: p as u32,
                        cell,
                        before,
                        arrival,
                    }),
                    None => {
                        let light =
                            before + arrival.brings(lighting.beyond(tracer, &arrival, &sample));
                        gathered.add(light * lighting.exposure);
                    }
                }
            }
            gathered.samples += count as f32;
        };
        let rows = self.for_each_part(&parts.offsets, gathered, 1, begin);
        let beyond = self.beyond(round, &rows);
        let add =
            |((first, gathered), (row, beyond)): (Row<Gathered>, (&Vec<Begun>, Vec<Vec3>))| {
                for (begun, beyond) in row.iter().zip(beyond) {
                    let light = begun.before + begun.arrival.brings(beyond);
                    gathered[begun.part as usize - first].add(light * lighting.exposure);
                }
            };
        let gathered = rows::of_face(&parts.offsets, self.size_px, gathered);
        gathered
            .into_par_iter()
            .zip(rows.par_iter().zip(beyond))
            .for_each(add);
    }

    /// The stream of samples of one kind that all parts of a class share.
    fn stream(&self, part: &LitPart, kind: u32) -> u32 {
        random4([self.face.index() as u32, u32::from(part.class), kind, 1])[0]
    }

    /// What lies beyond the arrivals of the samples of each row, in a round of that number.
    fn beyond(&self, round: u32, rows: &[Vec<Begun>]) -> Vec<Vec<Vec3>> {
        let mut count = 0;
        let firsts: Vec<u32> = rows
            .iter()
            .map(|row| (count, count += row.len() as u32).0)
            .collect();
        let filed = |(first, row): (&u32, &Vec<Begun>)| -> Vec<(u64, u32, u32)> {
            // Any fixed order that has nothing to do with places will do to draw those that stand for their cell.
            (*first..)
                .zip(row)
                .map(|(i, begun)| (begun.cell, i.wrapping_mul(0x9e37_79b9), i))
                .collect()
        };
        let filed: Vec<Vec<_>> = firsts.par_iter().zip(rows).map(filed).collect();
        let mut order = rows::concat(&filed, |row| row);
        order.par_sort_unstable();
        let cells: Vec<&[(u64, u32, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
        // Each sample's cell, written by whatever thread has the cell.
        let cell_of: Vec<AtomicU32> = order.par_iter().map(|_| AtomicU32::new(0)).collect();
        let light_of = |(number, cell): (usize, &&[(u64, u32, u32)])| {
            cell.iter()
                .for_each(|&(_, _, i)| cell_of[i as usize].store(number as u32, Ordering::Relaxed));
            if self.progress.is_cancelled() {
                return Vec3::ZERO;
            }
            // Copied first: each lies elsewhere in memory, and to wait for one is to wait for all.
            let mut drawn = [None; SAMPLES_OF_CELL];
            for (arrival, &(_, _, i)) in drawn.iter_mut().zip(*cell) {
                let row = firsts.partition_point(|&first| first <= i) - 1;
                *arrival = Some(rows[row][(i - firsts[row]) as usize].arrival);
            }
            let [stream, ..] = random4([cell[0].0 as u32, (cell[0].0 >> 32) as u32, 0xce11, round]);
            let light = |(index, arrival): (u32, &Arrival)| {
                self.shader.lighting.beyond(
                    self.shader.tracer,
                    arrival,
                    &LightSample { stream, index },
                )
            };
            (0..).zip(drawn.iter().flatten()).map(light).sum::<Vec3>()
                / cell.len().min(SAMPLES_OF_CELL) as f32
        };
        let light: Vec<Vec3> = cells.par_iter().enumerate().map(light_of).collect();
        let of_sample = |i: usize| light[cell_of[i].load(Ordering::Relaxed) as usize];
        let of_row = |(&first, row): (&u32, &Vec<Begun>)| {
            (first as usize..).take(row.len()).map(of_sample).collect()
        };
        firsts.par_iter().zip(rows).map(of_row).collect()
    }

    /// Sample `number` of `count` of the sun that a part takes. Parts of one kind of surface that take as many share a sequence.
    fn sun_sample(
        &self,
        part: &LitPart,
        [x, y]: [u32; 2],
        before: u32,
        number: u32,
        count: u32,
    ) -> LightSample {
        let [stream, ..] = random4([
            self.face.index() as u32,
            u32::from(part.class),
            0x5111 + before,
            count,
        ]);
        LightSample {
            stream,
            index: morton(x, y).wrapping_mul(count).wrapping_add(number),
        }
    }

    /// Takes `count` more samples of the sun at each part, which has `before`.
    fn sun(
        &self,
        parts: &mut FaceParts,
        before: u32,
        count: impl Fn(usize, [u32; 2]) -> u32 + Sync,
    ) {
        let (lighting, tracer) = (self.shader.lighting, self.shader.tracer);
        let gather =
            |part: &mut LitPart, p: usize, pixel: [u32; 2], requests: &mut Vec<(u32, _)>| {
                let more = count(p, pixel);
                if more == 0 {
                    return;
                }
                let spot: Spot = self.shader.spot(part);
                for number in 0..more {
                    let sample = self.sun_sample(part, pixel, before, number, more);
                    requests.push((
                        p as u32,
                        (spot.point(&sample, self.face, pixel, self.size_px), sample),
                    ));
                }
            };
        let rows = self.for_each_part(&parts.offsets, &mut parts.parts, 0, gather);
        let light_row = |(row, (first, parts)): (Vec<SunRequest>, Row<LitPart>)| {
            let (numbers, requests): (Vec<u32>, Vec<_>) = row.into_iter().unzip();
            let mut light = &*lighting.sharp_radiosities(tracer, &requests);
            for same in numbers.chunk_by(|a, b| a == b) {
                let (part, taken) = (&mut parts[same[0] as usize - first], same.len() as u32);
                let (of_part, rest) = light.split_at(same.len());
                let of_before = before as f32 / (before + taken) as f32;
                part.sun = part.sun * of_before
                    + of_part.iter().sum::<Vec3>() * (lighting.exposure / (before + taken) as f32);
                light = rest;
            }
        };
        let parts = rows::of_face(&parts.offsets, self.size_px, &mut parts.parts);
        rows.into_par_iter().zip(parts).for_each(light_row);
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
                    for other in
                        window(y).flat_map(|ny| window(x).flat_map(move |nx| parts.pixel(nx, ny)))
                    {
                        if same_surface(part, other) {
                            let level = luminance(other.sun.to_array());
                            (low, high, count) = (low.min(level), high.max(level), count + 1);
                        }
                    }
                    // On one surface nothing but a shadow changes the sun by a quarter from pixel to pixel.
                    wanted.push(match low < 0.75 * high {
                        true => many.saturating_sub(1),
                        false if count <= ENOUGH_NEIGHBOURS => {
                            self.shader.samples.saturating_sub(1)
                        }
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
