//! Irradiance at vertices.
//!
//! What lies beyond a sample's first ray is shared by all that arrive in one cell of space
//! ([`Arrival`]), for the whole of a bake: it is looked at once, by many samples, and costs next to
//! nothing after the first vertices that see it.

use super::corners::{Corners, separate_creases};
use super::{BakeOptions, BakeProgress};
use crate::Side;
use glam::{DVec3, Vec3};
use headbox_core::color::luminance;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::bvh::triangle_extent;
use headbox_trace::light::{Arrival, LightSample, Lighting, LitPoint};
use headbox_trace::sampler::{random4, unit_float};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Samples by which the brighter side of a surface is told.
const SIDE_SAMPLES: u32 = 4;

/// Samples by which it is told whether the edge of a shadow runs past a vertex; only there more are
/// taken of light that has such.
const SHARP_SAMPLES: u32 = 12;

/// On a smooth surface nothing but a shadow changes sharp light by a quarter about one vertex.
const SAME_LIGHT: f32 = 0.75;

/// Samples that a cell of arrivals takes of what lies beyond it.
const SAMPLES_OF_CELL: usize = 16;

/// Cells are as wide as this share of the edges, so that what they see is resolved as finely as
/// what is baked ...
const CELL_SHARE: f64 = 0.75;
/// ... and no wider than this, metres: the two sides of a corner have little else in common.
const WIDEST_CELL_M: f64 = 0.2;

/// The narrowest cells, metres, for bakes that cut nothing.
const NARROWEST_CELL_M: f64 = 1e-3;

/// Places from which it is learnt where light comes from, at most.
const MOST_PLACES: usize = 1 << 14;

/// Number of light samples in flight.
const BATCH_SAMPLES: usize = 1 << 19;
const BATCH_VERTICES: usize = 1 << 16;

/// Samples that every vertex has before any has more: what a bake that is broken off shows.
const FIRST_ROUND: u32 = 8;

pub(super) struct VertexLight<'a> {
    /// Over the source scene.
    pub(super) tracer: &'a Tracer,
    pub(super) lighting: &'a Lighting,
    pub(super) options: &'a BakeOptions,
    /// Visible side of each triangle of the source scene; any for those beyond its end.
    pub(super) sides: &'a [Side],
    /// Returns true if a position (world metres) may be visible, as far as known.
    pub(super) is_open: &'a (dyn Fn(DVec3) -> bool + Sync),
}

/// The cut scene whose vertices are lit.
struct SubdividedScene<'a> {
    scene: &'a Scene,
    corners: &'a Corners,
    /// For each triangle that of the tracer's scene which it is a piece of.
    sources: &'a [u32],
}

/// Light of a vertex, irradiance / pi.
#[derive(Clone, Copy, Default)]
struct Light {
    /// Light of the sun and of lamps without a surface: its shadows have edges.
    sharp: Vec3,
    soft: Vec3,
}

/// The samples of a vertex so far.
#[derive(Clone, Copy, Default)]
struct VertexSums {
    sharp: Sharp,
    /// Sum of the soft light of `samples`.
    soft: Vec3,
    samples: u32,
    /// The side that is lit: 1 for the front, -1 for the back, 0 before the first sample.
    side: f32,
}

impl VertexSums {
    fn light(&self) -> Light {
        Light {
            sharp: self.sharp.mean(),
            soft: self.soft / self.samples.max(1) as f32,
        }
    }
}

/// A sample of soft light that waits for what lies beyond its cell.
struct Begun {
    cell: u64,
    arrival: Arrival,
}

/// Radiosity per albedo beyond cells of arrivals.
type BeyondCells = FxHashMap<u64, Vec3>;

/// Is told how many samples of vertices are taken.
type Told<'a> = dyn Fn(usize) -> ControlFlow<()> + Sync + 'a;

/// A part of a batch, told of while it is done.
struct VertexBatch<'a> {
    told: &'a Told<'a>,
    /// Samples before it, and those that it stands for.
    before: usize,
    samples: usize,
    /// Number of steps in all.
    things: usize,
    done: AtomicUsize,
}

impl<'a> VertexBatch<'a> {
    /// A part is told of so often, about.
    const TIMES: usize = 64;

    fn new(told: &'a Told<'a>, before: usize, samples: usize, things: usize) -> Self {
        Self {
            told,
            before,
            samples,
            things,
            done: AtomicUsize::new(0),
        }
    }

    fn one_more(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if done.is_multiple_of((self.things / Self::TIMES).max(1)) {
            // Whether to go on is asked between batches: one that is begun is kept whole.
            let _ = (self.told)(
                self.before + (self.samples as f64 * done as f64 / self.things as f64) as usize,
            );
        }
    }
}

impl VertexLight<'_> {
    /// Multiplies the vertex colours of `scene` by light. `sources` names the triangle of the
    /// tracer's scene that each of its triangles is a piece of. Returns how many samples each
    /// vertex has at least.
    pub(super) fn bake(
        &self,
        scene: &mut Scene,
        sources: &[u32],
        progress: &BakeProgress<'_>,
    ) -> u32 {
        let corners = separate_creases(scene);
        let count = scene.positions.len();
        let cut = SubdividedScene {
            scene,
            corners: &corners,
            sources,
        };
        let mut guided = self.lighting.clone();
        let (lessons, samples) = (
            AtomicUsize::new(0),
            count * self.options.samples.max(1) as usize,
        );
        guided.learn(self.tracer, &self.places(&cut), &|done, all| {
            lessons.store(all, Ordering::Relaxed);
            progress(done, all + samples)
        });
        let lessons = lessons.into_inner();
        let told = |done| progress(lessons + done, lessons + samples);
        let gathered = VertexLight {
            lighting: &guided,
            ..*self
        }
        .gather(&cut, &told);
        let mut lights: Vec<Light> = gathered.iter().map(VertexSums::light).collect();
        for _ in 0..self.options.smoothing {
            lights = smooth(scene, &corners, &lights);
        }
        let exposure = self.lighting.exposure;
        scene.colors.resize(count, Vec3::ONE);
        for (color, light) in scene.colors.iter_mut().zip(lights) {
            *color *= (light.sharp + light.soft) * exposure;
        }
        gathered
            .iter()
            .map(|vertex| vertex.samples)
            .min()
            .unwrap_or(self.options.samples)
    }

    /// Places all over the scene.
    fn places(&self, cut: &SubdividedScene<'_>) -> Vec<LitPoint> {
        let step = (cut.scene.positions.len() / MOST_PLACES).max(1);
        let vertices: Vec<usize> = (0..cut.scene.positions.len()).step_by(step).collect();
        let lit = vertices
            .into_par_iter()
            .filter(|&vertex| !cut.corners.around(vertex).is_empty());
        lit.map(|vertex| self.point(cut, vertex, 0, self.side(cut, vertex)).0)
            .collect()
    }

    /// The light of all vertices, round after round and batch after batch: what is known of what
    /// lies beyond cells does not depend on threads.
    fn gather(&self, cut: &SubdividedScene<'_>, told: &Told<'_>) -> Vec<VertexSums> {
        let count = cut.scene.positions.len();
        let cell_m =
            (self.options.edge_m * CELL_SHARE).clamp(NARROWEST_CELL_M, WIDEST_CELL_M) as f32;
        let (samples, mut done) = (self.options.samples.max(1), 0);
        let (mut vertices, mut beyond) =
            (vec![VertexSums::default(); count], BeyondCells::default());
        let first = samples.min(FIRST_ROUND);
        for round in [0..first, first..samples] {
            let many = round.len();
            let batch = (BATCH_SAMPLES / many.max(1)).clamp(1, BATCH_VERTICES);
            for (number, batched) in vertices.chunks_mut(batch).enumerate().filter(|_| many > 0) {
                // Half of the work of a batch is to begin its samples, about, and half to look
                // beyond.
                let half = batched.len() * many / 2;
                let beginning = VertexBatch::new(told, done, half, batched.len());
                let begin = |(i, vertex): (usize, &mut VertexSums)| {
                    let begun = self.begin(cut, number * batch + i, vertex, round.clone(), cell_m);
                    beginning.one_more();
                    begun
                };
                let begun: Vec<Vec<Begun>> =
                    batched.par_iter_mut().enumerate().map(begin).collect();
                let looking = |cells| VertexBatch::new(told, done + half, half, cells);
                self.look_beyond(&mut beyond, begun.iter().flatten(), looking);
                batched
                    .par_iter_mut()
                    .zip(&begun)
                    .for_each(|(vertex, begun)| {
                        let found = begun
                            .iter()
                            .filter_map(|at| Some(at.arrival.brings(*beyond.get(&at.cell)?)));
                        vertex.soft += found.sum::<Vec3>();
                        vertex.samples = round.end;
                    });
                done += batched.len() * many;
                if told(done).is_break() {
                    return vertices;
                }
            }
        }
        vertices
    }

    /// A round of samples of a vertex, on the side of it that is seen, else on the brighter one;
    /// those that share what lies beyond their first ray are put aside.
    fn begin(
        &self,
        cut: &SubdividedScene<'_>,
        vertex: usize,
        gathered: &mut VertexSums,
        round: Range<u32>,
        cell_m: f32,
    ) -> Vec<Begun> {
        let mut begun = Vec::new();
        if cut.corners.around(vertex).is_empty() {
            return begun;
        }
        if gathered.side == 0.0 {
            gathered.side = self.side(cut, vertex);
        }
        for index in round {
            let (point, sample) = self.point(cut, vertex, index, gathered.side);
            if index < SHARP_SAMPLES || gathered.sharp.is_shadowed {
                gathered
                    .sharp
                    .add(self.lighting.sharp_radiosity(self.tracer, &point, &sample));
            }
            let (before, arrival) = self.lighting.before(self.tracer, &point, &sample);
            gathered.soft += before;
            let Some(arrival) = arrival else { continue };
            match arrival.cell_of_width(cell_m) {
                Some(cell) => begun.push(Begun { cell, arrival }),
                None => {
                    gathered.soft +=
                        arrival.brings(self.lighting.beyond(self.tracer, &arrival, &sample));
                }
            }
        }
        begun
    }

    /// Looks at what lies beyond those cells that are not known yet, from where samples arrived in
    /// them.
    fn look_beyond<'b, 't>(
        &self,
        beyond: &mut BeyondCells,
        begun: impl Iterator<Item = &'b Begun>,
        part: impl FnOnce(usize) -> VertexBatch<'t>,
    ) {
        let unknown = begun.filter(|begun| !beyond.contains_key(&begun.cell));
        // Any fixed order that has nothing to do with places will do to draw those that stand for
        // their cell.
        let filed = |(i, begun): (u32, &'b Begun)| {
            (begun.cell, i.wrapping_mul(0x9e37_79b9), &begun.arrival)
        };
        let mut arrivals: Vec<(u64, u32, &Arrival)> = (0_u32..).zip(unknown).map(filed).collect();
        arrivals.par_sort_unstable_by_key(|&(cell, order, _)| (cell, order));
        let cells: Vec<&[(u64, u32, &Arrival)]> = arrivals.chunk_by(|a, b| a.0 == b.0).collect();
        let part = part(cells.len());
        let light_of = |arrivals: &&[(u64, u32, &Arrival)]| {
            let cell = arrivals[0].0;
            let [stream, ..] = random4([cell as u32, (cell >> 32) as u32, 0xce11, 0]);
            let light = |(index, (_, _, arrival)): (u32, &(u64, u32, &Arrival))| {
                self.lighting
                    .beyond(self.tracer, arrival, &LightSample { stream, index })
            };
            // Where few arrived, each stands for the cell several times.
            let sum: Vec3 = (0..)
                .zip(arrivals.iter().cycle().take(SAMPLES_OF_CELL))
                .map(light)
                .sum();
            part.one_more();
            (cell, sum / SAMPLES_OF_CELL as f32)
        };
        let found: Vec<(u64, Vec3)> = cells.par_iter().map(light_of).collect();
        beyond.extend(found);
    }

    /// The side of a vertex that is lit: 1 for the front, -1 for the back.
    fn side(&self, cut: &SubdividedScene<'_>, vertex: usize) -> f32 {
        let side_of = |&(triangle, _): &(u32, u8)| self.side_of(cut, triangle);
        let seen = cut
            .corners
            .around(vertex)
            .iter()
            .map(side_of)
            .find_map(|side| match side {
                Side::Front => Some(1.0),
                Side::Back => Some(-1.0),
                Side::Any => None,
            });
        let level = |side: f32| -> f32 {
            let level = |index| {
                let (point, sample) = self.point(cut, vertex, index, side);
                luminance(
                    self.lighting
                        .radiosity_per_albedo(self.tracer, &point, &sample),
                )
            };
            (0..SIDE_SAMPLES).map(level).sum()
        };
        seen.unwrap_or_else(|| if level(-1.0) > level(1.0) { -1.0 } else { 1.0 })
    }

    /// The side of a triangle that is known to be seen.
    fn side_of(&self, cut: &SubdividedScene<'_>, triangle: u32) -> Side {
        self.sides
            .get(cut.sources[triangle as usize] as usize)
            .copied()
            .unwrap_or(Side::Any)
    }

    /// Position of sample `index` of a vertex, on the triangles around it in turn: at most half way
    /// to their far edges, so that a vertex on an edge is lit as the surface beside it is; nearer
    /// to the vertex where that lies in a wall.
    fn point(
        &self,
        cut: &SubdividedScene<'_>,
        vertex: usize,
        index: u32,
        side: f32,
    ) -> (LitPoint, LightSample) {
        let around = cut.corners.around(vertex);
        let (triangle, corner) = around[index as usize % around.len()];
        let vertices = cut.scene.triangles[triangle as usize].vertices;
        let [a, b, c] =
            [0, 1, 2].map(|i| cut.scene.positions[vertices[(corner as usize + i) % 3] as usize]);
        let [u, v, ..] = random4([vertex as u32, index, 0x6261, 0x6b65]).map(unit_float);
        let (u, v) = if u + v > 1.0 {
            (1.0 - u, 1.0 - v)
        } else {
            (u, v)
        };
        let across = (b - a) * f64::from(u / 2.0) + (c - a) * f64::from(v / 2.0);
        let geometric = (b - a).cross(c - a).normalize_or_zero().as_vec3();
        let place = match self.side_of(cut, triangle) {
            Side::Any => self.open_place(
                a,
                across,
                geometric.as_dvec3() * (f64::from(side) * Side::PROBE_M),
            ),
            Side::Front | Side::Back => a + across,
        };
        let normal = cut.corners.normals[vertex];
        let normal = if normal.dot(geometric) < 0.0 {
            -normal
        } else {
            normal
        };
        let point = LitPoint {
            position: (place - self.tracer.origin()).as_vec3(),
            normal: geometric * side,
            shading_normal: normal * side,
            extent: triangle_extent(self.tracer.triangle(cut.sources[triangle as usize])),
        };
        (
            point,
            LightSample {
                stream: vertex as u32,
                index,
            },
        )
    }
}

impl VertexLight<'_> {
    /// The place `across` from a vertex, or, if that may not be seen and one close to the vertex
    /// may, the first on the way to it that may. `before`: from the surface to where it is seen
    /// from. Of the jamb of a door a hand's breadth lies in the wall, and a thumb's before it.
    fn open_place(&self, vertex: DVec3, across: DVec3, before: DVec3) -> DVec3 {
        /// Down to a 64th of the way.
        const HALVINGS: i32 = 6;
        let place = |times: i32| vertex + across * 0.5f64.powi(times);
        let is_open = |times: &i32| (self.is_open)(place(*times) + before);
        if is_open(&0) || !is_open(&HALVINGS) {
            return place(0);
        }
        place((1..HALVINGS).find(is_open).unwrap_or(HALVINGS))
    }
}

/// Samples of sharp light about one vertex.
#[derive(Clone, Copy, Default)]
struct Sharp {
    sum: Vec3,
    samples: u32,
    /// True if one of them was lit differently from those before it.
    is_shadowed: bool,
}

impl Sharp {
    fn mean(&self) -> Vec3 {
        self.sum / self.samples.max(1) as f32
    }

    fn add(&mut self, light: Vec3) {
        let [mean, here] = [self.mean(), light].map(|light| luminance(light.to_array()));
        self.is_shadowed |= self.samples > 0 && mean.min(here) < SAME_LIGHT * mean.max(here);
        self.sum += light;
        self.samples += 1;
    }
}

/// Soft light averaged with that of the neighbours, each vertex counting as much as its neighbours
/// together.
fn smooth(scene: &Scene, corners: &Corners, lights: &[Light]) -> Vec<Light> {
    let smoothed = |vertex: usize| {
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0_f32);
        for &(triangle, corner) in corners.around(vertex) {
            let vertices = scene.triangles[triangle as usize].vertices;
            for other in [1, 2].map(|i| vertices[(corner as usize + i) % 3] as usize) {
                sum += lights[other].soft;
                weight += 1.0;
            }
        }
        let own = lights[vertex];
        Light {
            sharp: own.sharp,
            soft: if weight > 0.0 {
                (own.soft + sum / weight) / 2.0
            } else {
                own.soft
            },
        }
    };
    (0..lights.len()).into_par_iter().map(smoothed).collect()
}
