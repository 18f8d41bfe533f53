//! Irradiance at vertices.
//!
//! Samples whose first rays arrive in the same cell of space share the remainder of their paths
//! ([`Arrival`]). The light of a cell is traced once per bake, by several samples, so that it costs
//! almost nothing after the first vertices that see it.

use super::corners::{Corners, separate_creases};
use super::{BakeOptions, BakeProgress, KnownVisibility};
use crate::Side;
use glam::{DVec3, Vec3};
use headbox_core::color::luminance;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::{Tracer, triangle_extent};
use headbox_trace::light::{Arrival, LightSample, Lighting, LitPoint};
use headbox_trace::sampler::{random4, unit_float};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Number of samples that determine the brighter side of a surface.
const SIDE_SAMPLES: u32 = 4;

/// Number of samples of sharp light that detect a shadow edge near a vertex; only there the
/// remaining samples include sharp light.
const SHARP_SAMPLES: u32 = 12;

/// Minimum ratio of sharp light at samples of one vertex without a shadow edge between them.
const SAME_LIGHT: f32 = 0.75;

/// Number of samples of the light of a cell.
const CELL_SAMPLES: usize = 16;

/// Width of a cell relative to the maximum edge length, so that the light of cells is resolved as
/// finely as the baked light.
const CELL_SHARE: f64 = 0.75;
/// Maximum width of a cell, metres: a larger one would mix the light on both sides of a corner.
const MAX_CELL_M: f64 = 0.2;
/// Minimum width of a cell, metres, for bakes without subdivision.
const MIN_CELL_M: f64 = 1e-3;

/// Maximum number of training points of the light guide.
const MAX_TRAINING_POINTS: usize = 1 << 14;

/// Minimum width of a cell of the light that has bounced twice, as a fraction of its distance from
/// the middle of the scene.
const BOUNCED_CELL_SHARE: f32 = 1.0 / 8.0;

/// Power of the share of samples with which the time grows: the first that arrive in a cell pay for
/// its light (0.6 to 0.8 in two homes).
const TIME_POWER: f64 = 0.65;

/// Maximum number of light samples in a batch.
const BATCH_SAMPLES: usize = 1 << 19;
/// Maximum number of vertices in a batch.
const BATCH_VERTICES: usize = 1 << 16;

/// Number of samples of each vertex in the first round, which a cancelled bake shows.
const FIRST_ROUND: u32 = 8;

/// Inputs of baking light into vertices.
pub(super) struct VertexLight<'a> {
    /// Tracer of the source scene.
    pub(super) tracer: &'a Tracer,
    pub(super) lighting: &'a Lighting,
    pub(super) options: &'a BakeOptions,
    pub(super) visibility: KnownVisibility<'a>,
}

/// The subdivided scene whose vertices are lit.
struct SubdividedScene<'a> {
    scene: &'a Scene,
    corners: &'a Corners,
    /// Index of the triangle of the tracer's scene that each triangle is a piece of.
    sources: &'a [u32],
}

/// Light of a vertex, irradiance / pi.
#[derive(Clone, Copy, Default)]
struct Light {
    /// Light with sharp shadows: of the sun and of lamps without a surface.
    sharp: Vec3,
    /// All other light.
    soft: Vec3,
}

/// Sums over the samples of a vertex.
#[derive(Clone, Copy, Default)]
struct VertexSums {
    sharp: SharpSums,
    /// Sum of the soft light.
    soft: Vec3,
    /// Number of samples of soft light.
    samples: u32,
    /// The lit side: 1 for the front, -1 for the back, 0 before the first sample.
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

/// A sample of soft light that lacks the light of its cell.
struct PendingSample {
    cell: u64,
    arrival: Arrival,
}

/// Radiosity per albedo of the cells in which samples arrived.
type CellLight = FxHashMap<u64, Vec3>;

/// An arrival with the key of its cell and its position in a shuffled order.
type KeyedArrival<'a> = (u64, u32, &'a Arrival);

/// Callback with the number of vertex samples taken.
type Report<'a> = dyn Fn(usize) -> ControlFlow<()> + Sync + 'a;

/// Progress within one phase of a batch.
struct PhaseProgress<'a> {
    report: &'a Report<'a>,
    /// Number of samples before the phase.
    before: usize,
    /// Number of samples that the phase counts for.
    samples: usize,
    /// Number of steps of the phase.
    steps: usize,
    /// Number of completed steps.
    done: AtomicUsize,
}

impl<'a> PhaseProgress<'a> {
    /// Approximate number of reports in a phase.
    const REPORTS: usize = 64;

    fn new(report: &'a Report<'a>, before: usize, samples: usize, steps: usize) -> Self {
        Self {
            report,
            before,
            samples,
            steps,
            done: AtomicUsize::new(0),
        }
    }

    fn advance(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if done.is_multiple_of((self.steps / Self::REPORTS).max(1)) {
            // Cancellation is tested between batches, so that each batch is complete.
            let _ = (self.report)(
                self.before + (self.samples as f64 * done as f64 / self.steps as f64) as usize,
            );
        }
    }
}

impl VertexLight<'_> {
    /// Multiplies the vertex colours of `scene` by light. `sources` has the triangle of the
    /// tracer's scene that each of its triangles is a piece of. Returns the minimum number of
    /// samples of a vertex.
    pub(super) fn bake(
        &self,
        scene: &mut Scene,
        sources: &[u32],
        progress: &BakeProgress<'_>,
    ) -> u32 {
        let corners = separate_creases(scene);
        let count = scene.positions.len();
        let subdivided = SubdividedScene {
            scene,
            corners: &corners,
            sources,
        };
        let mut guided = self.lighting.clone();
        let samples = count * self.options.samples.max(1) as usize;
        let training_paths = AtomicUsize::new(0);
        let points = self.training_points(&subdivided);
        guided.learn(self.tracer, &points, &|done, total| {
            training_paths.store(total, Ordering::Relaxed);
            progress(done, total + samples)
        });
        guided.cache_bounces_toward(self.tracer, &points, BOUNCED_CELL_SHARE);
        let training_paths = training_paths.into_inner();
        let report = |done: usize| {
            let share = (done as f64 / samples.max(1) as f64).powf(TIME_POWER);
            let work = (share * samples as f64) as usize;
            progress(training_paths + work, training_paths + samples)
        };
        let sums = VertexLight {
            lighting: &guided,
            ..*self
        }
        .gather(&subdivided, &report);
        let mut lights: Vec<Light> = sums.iter().map(VertexSums::light).collect();
        for _ in 0..self.options.smoothing {
            lights = smooth(scene, &corners, &lights);
        }
        let exposure = self.lighting.exposure;
        scene.colors.resize(count, Vec3::ONE);
        for (color, light) in scene.colors.iter_mut().zip(lights) {
            *color *= (light.sharp + light.soft) * exposure;
        }
        sums.iter()
            .map(|vertex| vertex.samples)
            .min()
            .unwrap_or(self.options.samples)
    }

    /// Returns points all over the scene.
    fn training_points(&self, subdivided: &SubdividedScene<'_>) -> Vec<LitPoint> {
        let count = subdivided.scene.positions.len();
        let step = (count / MAX_TRAINING_POINTS).max(1);
        let vertices: Vec<usize> = (0..count).step_by(step).collect();
        let point = |vertex| {
            let side = self.lit_side(subdivided, vertex);
            self.sample_point(subdivided, vertex, 0, side).0
        };
        vertices
            .into_par_iter()
            .filter(|&vertex| !subdivided.corners.around(vertex).is_empty())
            .map(point)
            .collect()
    }

    /// Samples the light of all vertices in rounds of batches. Cells get their light between two
    /// phases of a batch, so that the result does not depend on threads.
    fn gather(&self, subdivided: &SubdividedScene<'_>, report: &Report<'_>) -> Vec<VertexSums> {
        let cell_m = (self.options.edge_m * CELL_SHARE).clamp(MIN_CELL_M, MAX_CELL_M) as f32;
        let samples = self.options.samples.max(1);
        let mut done = 0;
        let mut vertices = vec![VertexSums::default(); subdivided.scene.positions.len()];
        let mut cells = CellLight::default();
        let first = samples.min(FIRST_ROUND);
        for round in [0..first, first..samples] {
            let count = round.len();
            let batch = (BATCH_SAMPLES / count.max(1)).clamp(1, BATCH_VERTICES);
            for (number, batched) in vertices.chunks_mut(batch).enumerate().filter(|_| count > 0) {
                // The two phases of a batch take about the same time.
                let half = batched.len() * count / 2;
                let progress = PhaseProgress::new(report, done, half, batched.len());
                let trace = |(i, vertex): (usize, &mut VertexSums)| {
                    let index = number * batch + i;
                    let pending =
                        self.sample_vertex(subdivided, index, vertex, round.clone(), cell_m);
                    progress.advance();
                    pending
                };
                let pending: Vec<Vec<PendingSample>> =
                    batched.par_iter_mut().enumerate().map(trace).collect();
                self.light_cells(&mut cells, pending.iter().flatten(), |steps| {
                    PhaseProgress::new(report, done + half, half, steps)
                });
                batched
                    .par_iter_mut()
                    .zip(&pending)
                    .for_each(|(vertex, pending)| {
                        let light = pending
                            .iter()
                            .filter_map(|at| Some(at.arrival.contribution(*cells.get(&at.cell)?)));
                        vertex.soft += light.sum::<Vec3>();
                        vertex.samples = round.end;
                    });
                done += batched.len() * count;
                if report(done).is_break() {
                    return vertices;
                }
            }
        }
        vertices
    }

    /// Takes a round of samples of a vertex. Returns those that lack the light of their cell.
    fn sample_vertex(
        &self,
        subdivided: &SubdividedScene<'_>,
        vertex: usize,
        sums: &mut VertexSums,
        round: Range<u32>,
        cell_m: f32,
    ) -> Vec<PendingSample> {
        let mut pending = Vec::new();
        if subdivided.corners.around(vertex).is_empty() {
            return pending;
        }
        if sums.side == 0.0 {
            sums.side = self.lit_side(subdivided, vertex);
        }
        for index in round {
            let (point, sample) = self.sample_point(subdivided, vertex, index, sums.side);
            if index < SHARP_SAMPLES || sums.sharp.is_shadowed {
                sums.sharp
                    .add(self.lighting.sharp_radiosity(self.tracer, &point, &sample));
            }
            let first = self.lighting.first_segment(self.tracer, &point, &sample);
            sums.soft += first.light;
            let Some(arrival) = first.arrival else {
                continue;
            };
            match arrival.cell_of_width(cell_m) {
                Some(cell) => pending.push(PendingSample { cell, arrival }),
                None => {
                    sums.soft +=
                        arrival.contribution(self.lighting.beyond(self.tracer, &arrival, &sample));
                }
            }
        }
        pending
    }

    /// Traces the light of cells that have none yet, from arrivals in them.
    fn light_cells<'b, 't>(
        &self,
        cells: &mut CellLight,
        pending: impl Iterator<Item = &'b PendingSample>,
        progress: impl FnOnce(usize) -> PhaseProgress<'t>,
    ) {
        let unlit = pending.filter(|pending| !cells.contains_key(&pending.cell));
        // Shuffles the arrivals of a cell by a fixed order that is independent of position.
        let keyed = |(i, pending): (u32, &'b PendingSample)| {
            (pending.cell, i.wrapping_mul(0x9e37_79b9), &pending.arrival)
        };
        let mut arrivals: Vec<KeyedArrival> = (0_u32..).zip(unlit).map(keyed).collect();
        arrivals.par_sort_unstable_by_key(|&(cell, order, _)| (cell, order));
        let by_cell: Vec<&[KeyedArrival]> = arrivals.chunk_by(|a, b| a.0 == b.0).collect();
        let progress = progress(by_cell.len());
        let cell_light = |arrivals: &&[KeyedArrival]| {
            let cell = arrivals[0].0;
            let [stream, ..] = random4([cell as u32, (cell >> 32) as u32, 0xce11, 0]);
            let light = |(index, (_, _, arrival)): (u32, &KeyedArrival)| {
                self.lighting
                    .beyond(self.tracer, arrival, &LightSample { stream, index })
            };
            // If few samples arrived, each is used several times.
            let sum: Vec3 = (0..)
                .zip(arrivals.iter().cycle().take(CELL_SAMPLES))
                .map(light)
                .sum();
            progress.advance();
            (cell, sum / CELL_SAMPLES as f32)
        };
        let lit: Vec<(u64, Vec3)> = by_cell.par_iter().map(cell_light).collect();
        cells.extend(lit);
    }

    /// Returns the lit side of a vertex, 1 for the front and -1 for the back: the visible side if
    /// it is known, else the brighter one.
    fn lit_side(&self, subdivided: &SubdividedScene<'_>, vertex: usize) -> f32 {
        let visible =
            subdivided
                .corners
                .around(vertex)
                .iter()
                .find_map(
                    |&(triangle, _)| match self.visible_side(subdivided, triangle) {
                        Side::Front => Some(1.0),
                        Side::Back => Some(-1.0),
                        Side::Any => None,
                    },
                );
        let level = |side: f32| -> f32 {
            let level = |index| {
                let (point, sample) = self.sample_point(subdivided, vertex, index, side);
                let light = self.lighting.cached_radiosity(self.tracer, &point, &sample);
                luminance(light.to_array())
            };
            (0..SIDE_SAMPLES).map(level).sum()
        };
        visible.unwrap_or_else(|| if level(-1.0) > level(1.0) { -1.0 } else { 1.0 })
    }

    /// Returns the visible side of a triangle, as far as known.
    fn visible_side(&self, subdivided: &SubdividedScene<'_>, triangle: u32) -> Side {
        self.visibility
            .sides
            .get(subdivided.sources[triangle as usize] as usize)
            .copied()
            .unwrap_or(Side::Any)
    }

    /// Returns the point of sample `index` of a vertex, on the triangles around it in turn: at most
    /// half way to their far edges, so that a vertex on an edge is lit like the adjacent surface;
    /// nearer to the vertex where that lies in a wall.
    fn sample_point(
        &self,
        subdivided: &SubdividedScene<'_>,
        vertex: usize,
        index: u32,
        side: f32,
    ) -> (LitPoint, LightSample) {
        let around = subdivided.corners.around(vertex);
        let (triangle, corner) = around[index as usize % around.len()];
        let vertices = subdivided.scene.triangles[triangle as usize].vertices;
        let [a, b, c] = [0, 1, 2]
            .map(|i| subdivided.scene.positions[vertices[(corner as usize + i) % 3] as usize]);
        let [u, v, ..] = random4([vertex as u32, index, 0x6261, 0x6b65]).map(unit_float);
        let (u, v) = if u + v > 1.0 {
            (1.0 - u, 1.0 - v)
        } else {
            (u, v)
        };
        let offset = (b - a) * f64::from(u / 2.0) + (c - a) * f64::from(v / 2.0);
        let geometric = (b - a).cross(c - a).normalize_or_zero().as_vec3();
        let position = match self.visible_side(subdivided, triangle) {
            Side::Any => self.open_position(
                a,
                offset,
                geometric.as_dvec3() * (f64::from(side) * Side::PROBE_M),
            ),
            Side::Front | Side::Back => a + offset,
        };
        let normal = subdivided.corners.normals[vertex];
        let normal = if normal.dot(geometric) < 0.0 {
            -normal
        } else {
            normal
        };
        let point = LitPoint {
            position: (position - self.tracer.origin()).as_vec3(),
            normal: geometric * side,
            shading_normal: normal * side,
            extent: triangle_extent(self.tracer.triangle(subdivided.sources[triangle as usize])),
        };
        let sample = LightSample {
            stream: vertex as u32,
            index,
        };
        (point, sample)
    }

    /// Returns the position `offset` from a vertex; if it is hidden and positions close to the
    /// vertex are not, the first visible one of those at half the offset, a quarter, and so on.
    /// `probe` leads from the surface to the tested position in front of it. The jamb of a door,
    /// for example, is mostly in the wall and projects from it by 2 cm.
    fn open_position(&self, vertex: DVec3, offset: DVec3, probe: DVec3) -> DVec3 {
        const HALVINGS: i32 = 6;
        let position = |halvings: i32| vertex + offset * 0.5f64.powi(halvings);
        let is_open = |halvings: &i32| (self.visibility.is_open)(position(*halvings) + probe);
        if is_open(&0) || !is_open(&HALVINGS) {
            return position(0);
        }
        position((1..HALVINGS).find(is_open).unwrap_or(HALVINGS))
    }
}

/// Sums over the samples of sharp light of one vertex.
#[derive(Clone, Copy, Default)]
struct SharpSums {
    sum: Vec3,
    samples: u32,
    /// True if a sample differed from the mean of those before it.
    is_shadowed: bool,
}

impl SharpSums {
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

/// Averages the soft light of each vertex with the mean of its neighbours, in equal parts.
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
