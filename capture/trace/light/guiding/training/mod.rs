//! Training of the guide: densities of incident light, learned from paths in cells of surface
//! points.

#[cfg(test)]
mod tests;

use crate::bvh::{Ray, Tracer};
use crate::light::cells::{CellGrid, CellPoint, by_cell};
use crate::light::guiding::guide::Guide;
use crate::light::guiding::square::{self, BINS, SquareDensity};
use crate::light::path::{FIRST_DIRECTION, Path};
use crate::light::{LightSample, Lighting, LitPoint, srgb_slope};
use crate::sampler::random4;
use glam::Vec3;
use headbox_core::bounces::Bounces;
use headbox_core::color::luminance;
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Minimum width of a cell as a fraction of its distance from the local origin; the maximum is
/// twice that.
const CELL_SHARE: f32 = 1.0 / 8.0;

/// Maximum number of training paths of a cell.
const MAX_TRAINING_PATHS: u32 = 512;

/// Number of training paths after which a cell without a gain is abandoned.
const INITIAL_TRAINING_PATHS: u32 = 128;

/// Minimum number of training points of a cell.
const MIN_CELL_POINTS: usize = 2;

/// Fraction of the rays that are sampled from the learned density; the others are cosine-weighted,
/// in case training missed a light.
const GUIDED_FRACTION: f32 = 0.75;

/// Minimum variance reduction, as a fraction of a light sample's variance, for which guiding is
/// used: within a cell, and, since every point pays for the lookup, over all training points
/// together. Without a guide rays cost a fifth less.
const MIN_VARIANCE_REDUCTION: f64 = 0.25;

/// Number of rays from the local origin. Their hits, and the hit of one further ray from each of
/// these, are the training points.
const TRAINING_RAYS: u32 = 4096;

impl Lighting {
    /// Trains the guide at surface points visible from the tracer's origin and at points visible
    /// from these, with at most two million paths. Reduces noise in rooms lit through windows; no
    /// mean changes.
    pub fn guided(mut self, tracer: &Tracer) -> Self {
        let training_points = |index: u32| {
            let [u, v] = LightSample {
                stream: 0x6a1d,
                index,
            }
            .pair(0);
            let z = 1.0 - 2.0 * u;
            let (sin, cos) = (v * TAU).sin_cos();
            let radius = (1.0 - z * z).max(0.0).sqrt();
            let direction = Vec3::new(radius * cos, radius * sin, z);
            let ray = Ray::new(Vec3::ZERO, direction);
            let point = LitPoint::from_hit(tracer, &ray, &tracer.closest(&ray)?).0;
            let sample = LightSample {
                stream: 0x6a1e,
                index,
            };
            let arrival = self.first_segment(tracer, &point, &sample).arrival;
            Some([Some(point), arrival.map(|arrival| arrival.point)])
        };
        let points: Vec<[Option<LitPoint>; 2]> = (0..TRAINING_RAYS)
            .into_par_iter()
            .filter_map(training_points)
            .collect();
        let points: Vec<LitPoint> = points.into_iter().flatten().flatten().collect();
        self.learn(tracer, &points, &|_, _| ControlFlow::Continue(()));
        self
    }

    /// Finds reflectors and trains the guide at given points. `progress` receives the number of
    /// training paths traced and their maximum; after a `Break` there is no guide.
    pub fn learn(
        &mut self,
        tracer: &Tracer,
        points: &[LitPoint],
        progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
    ) {
        self.guide = Guide::default();
        self.reflectors = self.find_reflectors(tracer);
        // Full light is guided by its first bounce, which varies most and costs least to trace.
        let bounces = self.bounces;
        if bounces == Bounces::Full {
            self.bounces = Bounces::Exactly(1);
        }
        self.guide = self.trained_guide(tracer, points, progress);
        self.bounces = bounces;
    }

    /// Returns the guide that [`Self::learn`] trains.
    fn trained_guide(
        &self,
        tracer: &Tracer,
        points: &[LitPoint],
        progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
    ) -> Guide {
        let mut guide = Guide {
            grid: CellGrid::new(points, CELL_SHARE),
            ..Guide::default()
        };
        let sorted = by_cell(&guide.grid, points);
        let cells: Vec<&[CellPoint]> = sorted
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|points| points.len() >= MIN_CELL_POINTS)
            .collect();
        let mut statistics: Vec<CellStatistics> =
            cells.iter().map(|_| CellStatistics::default()).collect();
        let traced = AtomicUsize::new(0);
        let max_paths = cells.len() * MAX_TRAINING_PATHS as usize;
        for (total, added) in [
            (INITIAL_TRAINING_PATHS, INITIAL_TRAINING_PATHS),
            (
                MAX_TRAINING_PATHS,
                MAX_TRAINING_PATHS - INITIAL_TRAINING_PATHS,
            ),
        ] {
            let outcome =
                cells
                    .par_iter()
                    .zip(&mut statistics)
                    .try_for_each(|(points, statistics)| {
                        self.train_cell(tracer, points, statistics, total);
                        // Paths that a cell skips count, too.
                        let before = traced.fetch_add(added as usize, Ordering::Relaxed);
                        progress(before + added as usize, max_paths)
                    });
            if outcome.is_break() {
                return Guide::default();
            }
            let estimates = cells
                .iter()
                .zip(&statistics)
                .map(|(points, statistics)| (points.len(), statistics.estimate()));
            if !is_worthwhile(estimates) {
                return Guide::default(); // few paths overestimate the gain, if anything
            }
        }
        let density = |(points, statistics): (&&[CellPoint], &CellStatistics)| {
            Some((points[0].0, statistics.estimate().density?))
        };
        guide.cells = cells.iter().zip(&statistics).filter_map(density).collect();
        guide
    }

    /// Traces training paths from the points of one cell up to `total` paths; none if the cell has
    /// had some without a gain.
    fn train_cell(
        &self,
        tracer: &Tracer,
        points: &[CellPoint],
        statistics: &mut CellStatistics,
        total: u32,
    ) {
        if statistics.by_rays.count > 0 && statistics.estimate().density.is_none() {
            return;
        }
        let cell = points[0].0;
        let [stream, ..] = random4([cell as u32, (cell >> 32) as u32, 0x6a1f, 0]);
        for index in statistics.by_rays.count..total {
            let (.., point) = &points[index as usize % points.len()];
            self.trace_training_path(tracer, point, LightSample { stream, index }, statistics);
        }
    }

    /// Traces one training path and records the light along its first ray by direction.
    fn trace_training_path(
        &self,
        tracer: &Tracer,
        point: &LitPoint,
        sample: LightSample,
        statistics: &mut CellStatistics,
    ) {
        let directions = self.unguided_directions(point);
        let level = |light: Vec3| luminance((light * self.exposure).to_array());
        let first = self.vertex(0);
        let mut direct = Path::new(point);
        self.add_direct(tracer, &mut direct, &sample, first, Some(&directions));
        statistics.by_points.add(level(direct.sum));
        let mut path = Path::new(point);
        let pair = sample.pair(FIRST_DIRECTION);
        let aim = directions.sample_unaimed(pair);
        if self
            .trace_ray(tracer, &mut path, first, &sample, &directions, &aim)
            .is_some()
        {
            self.follow(tracer, &mut path, 1, &sample);
        }
        let [u, v] = pair.map(square::bin);
        statistics.squares[v * BINS + u] += level(path.sum).powi(2);
        statistics.counts[v * BINS + u] += 1.0;
        statistics.by_rays.add(level(path.sum));
    }
}

/// Returns true if guiding reduces the variance enough over all cells, each with its number of
/// training points.
fn is_worthwhile(cells: impl Iterator<Item = (usize, CellEstimate)>) -> bool {
    let mut variance = 0.0;
    let mut saved = 0.0;
    for (points, estimate) in cells {
        variance += points as f64 * estimate.variance * estimate.visibility;
        saved += points as f64 * estimate.saved * estimate.visibility;
    }
    saved > MIN_VARIANCE_REDUCTION * variance
}

/// Statistics of a cell's training paths.
struct CellStatistics {
    /// Sums of the squared light along first rays, by bins of the unit square.
    squares: [f32; BINS * BINS],
    /// Number of first rays, by bins of the unit square.
    counts: [f32; BINS * BINS],
    /// Light along first rays.
    by_rays: Moments,
    /// Light by next-event estimation at first vertices.
    by_points: Moments,
}

impl Default for CellStatistics {
    fn default() -> Self {
        Self {
            squares: [0.0; BINS * BINS],
            counts: [0.0; BINS * BINS],
            by_rays: Moments::default(),
            by_points: Moments::default(),
        }
    }
}

impl CellStatistics {
    /// Estimates the density of first rays and its gain.
    fn estimate(&self) -> CellEstimate {
        let variance = self.by_rays.variance() + self.by_points.variance();
        let mean = (self.by_rays.mean() + self.by_points.mean()) as f32;
        let gain = self
            .guided_densities()
            .filter(|(saved, _)| *saved > MIN_VARIANCE_REDUCTION * variance);
        CellEstimate {
            variance,
            visibility: f64::from(srgb_slope(mean)).powi(2),
            saved: gain.as_ref().map_or(0.0, |(saved, _)| *saved),
            density: gain.map(|(_, densities)| SquareDensity::new(&densities)),
        }
    }

    /// Returns the variance that guiding removes, and the density in each bin; `None` if no light
    /// arrived.
    fn guided_densities(&self) -> Option<(f64, [f32; BINS * BINS])> {
        let squares = blur(&self.squares);
        let counts = blur(&self.counts);
        let mean_squares: [f32; BINS * BINS] =
            std::array::from_fn(|i| squares[i] / counts[i].max(1e-3));
        let roots = mean_squares.map(f32::sqrt);
        let mean = roots.iter().sum::<f32>() / roots.len() as f32;
        if mean <= 0.0 || !mean.is_finite() {
            return None;
        }
        let densities = roots.map(|root| 1.0 - GUIDED_FRACTION + GUIDED_FRACTION * root / mean);
        let unguided: f32 = mean_squares.iter().sum();
        let guided: f32 = mean_squares
            .iter()
            .zip(&densities)
            .map(|(square, density)| square / density)
            .sum();
        let saved = f64::from((unguided - guided) / (BINS * BINS) as f32);
        Some((saved, densities))
    }
}

/// Estimated gain and density of a cell.
struct CellEstimate {
    /// Variance of a light sample whose first ray is cosine-weighted.
    variance: f64,
    /// Visible fraction of the variance: less in bright areas. Next to a lamp samples vary more
    /// than in the entire room that it lights.
    visibility: f64,
    /// Variance removed by guiding; 0 without a density.
    saved: f64,
    /// Density of first rays, if guiding reduces the variance enough.
    density: Option<SquareDensity>,
}

/// Sums of values and of their squares, for mean and variance.
#[derive(Default)]
struct Moments {
    sum: f64,
    squares: f64,
    count: u32,
}

impl Moments {
    fn add(&mut self, value: f32) {
        self.sum += f64::from(value);
        self.squares += f64::from(value).powi(2);
        self.count += 1;
    }

    fn mean(&self) -> f64 {
        self.sum / f64::from(self.count.max(1))
    }

    fn variance(&self) -> f64 {
        (self.squares / f64::from(self.count.max(1)) - self.mean().powi(2)).max(0.0)
    }
}

/// Blurs over 3x3 bins, with weights of 1, 2, 1 along each axis (not normalised).
fn blur(values: &[f32; BINS * BINS]) -> [f32; BINS * BINS] {
    let along = |values: &[f32; BINS * BINS], step: usize| -> [f32; BINS * BINS] {
        std::array::from_fn(|i| {
            let position = i / step % BINS;
            let below = if position > 0 { values[i - step] } else { 0.0 };
            let above = if position + 1 < BINS {
                values[i + step]
            } else {
                0.0
            };
            below + 2.0 * values[i] + above
        })
    };
    along(&along(values, 1), BINS)
}
