//! Path guiding: ray directions sampled from the learned distribution of incident light.
//!
//! A room is lit through its windows, and few cosine-weighted rays hit one. Surface points are
//! therefore hashed into cells by position and normal, and each cell learns a density over the unit
//! square from which cosine-weighted directions are warped: high where bright light arrived. Guided
//! rays are weighted by its reciprocal, so that no mean changes (Jensen 1995, "Importance Driven
//! Path Tracing using the Photon Map"; Mueller et al. 2017, "Practical Path Guiding"), and the
//! density is proportional to the root mean square of the light, which minimises the variance of
//! one ray (Rath et al. 2020, "Variance-Aware Path Guiding").

use super::cells::{CellGrid, CellPoint, by_cell};
use super::path::{FIRST_DIRECTION, Path};
use super::reflectors::{AIMED_FRACTION, Reflectors};
use super::square::{BINS, SquareDensity};
use super::{LightSample, Lighting, LitPoint, srgb_slope};
use crate::bvh::{Hit, Ray, Tracer};
use crate::light::square;
use crate::sampler::{cosine_direction, random4, square_from_disk};
use glam::{Quat, Vec3};
use headbox_core::bounces::Bounces;
use headbox_core::color::luminance;
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::f32::consts::{PI, TAU};
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

/// Incident light distributions, by cells of position and normal.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Guide {
    cells: FxHashMap<u64, SquareDensity>,
    grid: CellGrid,
}

impl Guide {
    /// Returns the density at a point, if its cell is guided.
    fn density(&self, point: &LitPoint) -> Option<&SquareDensity> {
        if self.cells.is_empty() {
            None
        } else {
            self.cells.get(&self.grid.key(point))
        }
    }
}

/// Distribution of the rays that leave a point: some aimed at reflectors, the others
/// cosine-weighted about its shading normal, or guided.
pub(super) struct Directions<'a> {
    /// Rotation from +Z to the shading normal.
    turn: Quat,
    guide: Option<&'a SquareDensity>,
    reflectors: Option<Reflectors<'a>>,
}

/// Direction of a ray before it is traced.
#[derive(Clone, Copy)]
pub(super) struct Aim {
    /// Unit direction.
    pub(super) direction: Vec3,
    /// Reflector at which the ray is aimed; it counts only if it hits that triangle.
    target: Option<u32>,
    /// Density of the rays that are not aimed, over the cosine-weighted one.
    guided: f32,
}

impl Aim {
    /// Returns true if the ray is aimed at a reflector.
    pub(super) fn is_aimed(&self) -> bool {
        self.target.is_some()
    }
}

impl Directions<'_> {
    /// Samples the direction of a ray by decision `dimension`.
    pub(super) fn sample(&self, tracer: &Tracer, sample: &LightSample, dimension: u32) -> Aim {
        let pair = sample.pair(dimension);
        let aimed = self.reflectors.and_then(|reflectors| {
            let number = sample.single(dimension) / AIMED_FRACTION;
            (number < 1.0).then(|| reflectors.aim(tracer, number, pair))?
        });
        let Some((direction, target)) = aimed else {
            return self.sample_unaimed(pair);
        };
        Aim {
            direction,
            target: Some(target),
            guided: self.guided_density(direction),
        }
    }

    /// Maps two numbers in [0, 1) to a direction that is not aimed at a reflector.
    pub(super) fn sample_unaimed(&self, pair: [f32; 2]) -> Aim {
        let (pair, guided) = self.guide.map_or((pair, 1.0), |guide| {
            let warped = guide.warp(pair);
            (warped, guide.density(warped))
        });
        Aim {
            direction: self.turn * Vec3::from_array(cosine_direction(pair[0], pair[1])),
            target: None,
            guided,
        }
    }

    /// Returns the importance weight of a ray with its hit; `None` if it does not count. `cos` > 0
    /// is the cosine of its angle with the shading normal.
    pub(super) fn weight(
        &self,
        tracer: &Tracer,
        aim: &Aim,
        cos: f32,
        hit: Option<&Hit>,
    ) -> Option<f32> {
        let Some(reflectors) = &self.reflectors else {
            return Some(1.0 / aim.guided);
        };
        if aim.target.is_some() && aim.target != hit.map(|hit| hit.primitive) {
            return None;
        }
        let aimed = hit.map_or(0.0, |hit| {
            reflectors.density(tracer, aim.direction, (hit.primitive, hit.t))
        });
        let aimed = aimed * PI / cos;
        Some(1.0 / ((1.0 - AIMED_FRACTION) * aim.guided + AIMED_FRACTION * aimed))
    }

    /// Returns the probability density of a direction, per steradian, in which a ray hits the
    /// triangle of a number at a distance in metres, or nothing; `cos` > 0 is the cosine of its
    /// angle with the shading normal.
    pub(super) fn density(
        &self,
        tracer: &Tracer,
        direction: Vec3,
        cos: f32,
        hit: Option<(u32, f32)>,
    ) -> f32 {
        let guided = self.guided_density(direction) * cos / PI;
        self.reflectors.map_or(guided, |reflectors| {
            let aimed = hit.map_or(0.0, |hit| reflectors.density(tracer, direction, hit));
            (1.0 - AIMED_FRACTION) * guided + AIMED_FRACTION * aimed
        })
    }

    /// Returns the density of the rays that are not aimed, over the cosine-weighted one.
    fn guided_density(&self, direction: Vec3) -> f32 {
        self.guide.map_or(1.0, |guide| {
            let local = self.turn.inverse() * direction;
            guide.density(square_from_disk([local.x, local.y]))
        })
    }
}

impl Lighting {
    /// Returns the distribution of rays that leave a point.
    pub(super) fn directions(&self, point: &LitPoint) -> Directions<'_> {
        Directions {
            guide: self.guide.density(point),
            ..self.unguided_directions(point)
        }
    }

    /// Returns the distribution of rays that leave a point without a guide.
    pub(super) fn unguided_directions(&self, point: &LitPoint) -> Directions<'_> {
        Directions {
            turn: Quat::from_rotation_arc(Vec3::Z, point.shading_normal),
            guide: None,
            reflectors: self.reflectors(point),
        }
    }

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
            let (_, arrival) = self.before(tracer, &point, &sample);
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
        let direct = self.direct(tracer, point, &sample, first, Some(&directions));
        statistics.by_points.add(level(direct));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::path::LAST_GUIDED_BOUNCE;
    use crate::light::tests::{add_quad, lit_point};
    use glam::{DVec3, dvec3};
    use headbox_scene::material::Material;
    use headbox_scene::scene::{Scene, Sky, SkyGradient, SkyPicture, Triangle};
    use std::sync::Arc;

    fn white_sky() -> Sky {
        Sky::Gradient(SkyGradient::uniform([5.0; 3]))
    }

    /// Returns a room of 4 m around the origin, closed except for a window of 0.8 m in a corner of
    /// its ceiling; its second material is a lamp's.
    fn room(sky: Sky) -> Scene {
        let lamp = Material {
            emission: [2.0; 3],
            ..Material::default()
        };
        let materials = vec![
            Material {
                albedo: [0.6; 3],
                ..Material::default()
            },
            lamp,
        ];
        let mut scene = Scene {
            materials,
            sky: Some(sky),
            ..Scene::default()
        };
        let mut quad = |corners: [DVec3; 4]| add_quad(&mut scene, corners, 0);
        let at = |x: f64, y: f64, z: f64| dvec3(x, y, z) * 2.0;
        quad([
            at(-1.0, -1.0, -1.0),
            at(1.0, -1.0, -1.0),
            at(1.0, -1.0, 1.0),
            at(-1.0, -1.0, 1.0),
        ]);
        for [[x0, z0], [x1, z1]] in [
            [[-1, -1], [1, -1]],
            [[1, -1], [1, 1]],
            [[1, 1], [-1, 1]],
            [[-1, 1], [-1, -1]],
        ] {
            let [x0, z0, x1, z1] = [x0, z0, x1, z1].map(f64::from);
            quad([
                at(x0, -1.0, z0),
                at(x1, -1.0, z1),
                at(x1, 1.0, z1),
                at(x0, 1.0, z0),
            ]);
        }
        for [x0, z0, x1, z1] in [
            [-1.0, -1.0, 1.0, 0.5],
            [-1.0, 0.5, 0.5, 1.0],
            [0.5, 0.9, 1.0, 1.0],
            [0.9, 0.5, 1.0, 0.9],
        ] {
            quad([
                at(x0, 1.0, z0),
                at(x1, 1.0, z0),
                at(x1, 1.0, z1),
                at(x0, 1.0, z1),
            ]);
        }
        scene
    }

    fn tracer(scene: Scene) -> Tracer {
        Tracer::new(Arc::new(scene), DVec3::ZERO)
    }

    const SAMPLES: u32 = 1 << 18;

    /// Returns mean and variance of samples at a point on the floor.
    fn floor_light(lighting: &Lighting, tracer: &Tracer) -> (f64, f64) {
        let point = lit_point(Vec3::new(-0.5, -2.0, -0.7), Vec3::Y, 2.0);
        let mut moments = Moments::default();
        for index in 0..SAMPLES {
            let sample = LightSample { stream: 77, index };
            moments.add(lighting.soft_radiosity(tracer, &point, &sample).x);
        }
        (moments.mean(), moments.variance())
    }

    /// Returns the variances of samples at the floor without and with guiding; checks that the
    /// means agree.
    fn variances(tracer: &Tracer, bounces: u32) -> [f64; 2] {
        let lighting = Lighting::unmetered(tracer, bounces);
        let (mean, variance) = floor_light(&lighting, tracer);
        let (guided_mean, guided_variance) = floor_light(&lighting.guided(tracer), tracer);
        // Two standard errors of independent samples; stratified samples have a smaller error.
        let tolerance = 2.0 * (variance / f64::from(SAMPLES)).sqrt();
        assert!(
            (guided_mean - mean).abs() < tolerance,
            "{bounces}: {guided_mean}, not {mean} +- {tolerance}"
        );
        [variance, guided_variance]
    }

    #[test]
    fn guiding_keeps_mean_and_reduces_variance() {
        // Bounced light comes from all over the room.
        for (bounces, most) in [(0, 0.4), (2, 0.6)] {
            let [variance, guided] = variances(&tracer(room(white_sky())), bounces);
            assert!(
                guided < most * variance,
                "{bounces}: {guided}, without {variance}"
            );
        }
    }

    #[test]
    fn later_bounces_are_not_guided() {
        let tracer = tracer(room(white_sky()));
        let mut lighting = Lighting::unmetered(&tracer, Bounces::Full).guided(&tracer);
        let floor = lit_point(Vec3::new(-0.5, -2.0, -0.7), Vec3::Y, 2.0);
        let mut is_guided = false;
        for index in 0..4096 {
            let [short, long] = [LAST_GUIDED_BOUNCE + 1, 20].map(|bounces| {
                lighting.bounces = Bounces::Exactly(bounces);
                let mut path = Path::new(&floor);
                lighting.follow(&tracer, &mut path, 0, &LightSample { stream: 7, index });
                path.weight
            });
            is_guided |= short != 1.0;
            assert_eq!(short, long, "path {index}");
        }
        assert!(is_guided);
    }

    #[test]
    fn guiding_keeps_mean_with_lamps_and_sky_image() {
        for bounces in [0, 1] {
            let texels = (0..32 * 16)
                .map(|i| [if i % 7 == 0 { 20.0 } else { 3.0 }; 3])
                .collect();
            let mut scene = room(Sky::Picture(Arc::new(
                SkyPicture::new([32, 16], texels, 0.0).expect("a sky"),
            )));
            let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| axis * 0.6);
            add_quad(&mut scene, [x + y, x + z, -x + z, -x + y], 1);
            let tracer = tracer(scene);
            let [variance, guided] = variances(&tracer, bounces);
            assert!(guided < variance, "{bounces}: {guided}, without {variance}");
            let lighting = Lighting::unmetered(&tracer, bounces).guided(&tracer);
            assert!(!lighting.guide.cells.is_empty());
        }
    }

    #[test]
    fn guide_is_independent_of_thread_count() {
        let tracer = tracer(room(white_sky()));
        let guide = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("threads");
            pool.install(|| Lighting::unmetered(&tracer, 1).guided(&tracer).guide)
        };
        let one = guide(1);
        let three = guide(3);
        assert!(!one.cells.is_empty() && one == three);
    }

    #[test]
    fn few_gaining_cells_are_not_worthwhile() {
        let visible = |visibility: f64| {
            move |points: usize, variance: f64, saved: f64| {
                let estimate = CellEstimate {
                    variance,
                    visibility,
                    saved,
                    density: None,
                };
                (points, estimate)
            }
        };
        let cells = visible(1.0);
        assert!(
            is_worthwhile([cells(6, 4.0, 2.0), cells(4, 4.0, 0.0)].into_iter()),
            "12 of 40"
        );
        assert!(
            !is_worthwhile([cells(4, 4.0, 2.0), cells(6, 4.0, 0.0)].into_iter()),
            "8 of 40"
        );
        // Most cells gain, but not those that are noisy.
        assert!(!is_worthwhile(
            [cells(8, 4.0, 2.0), cells(2, 40.0, 0.0)].into_iter()
        ));
        // Noise is invisible where light is bright.
        assert!(is_worthwhile(
            [cells(8, 4.0, 2.0), visible(0.01)(2, 40.0, 0.0)].into_iter()
        ));
        assert!(!is_worthwhile(std::iter::empty()));
    }

    #[test]
    fn noise_is_less_visible_in_bright_areas() {
        let visible_variance = |light: f64| {
            let mut statistics = CellStatistics::default();
            for level in [0.5 * light, 1.5 * light] {
                statistics.by_rays.add(level as f32);
            }
            let estimate = statistics.estimate();
            estimate.variance * estimate.visibility
        };
        assert!(
            visible_variance(0.9) < 9.1 * visible_variance(0.3)
                && visible_variance(0.3) > visible_variance(0.1),
            "grows less than the square of the light"
        );
        assert!(
            visible_variance(2.0) < visible_variance(0.9) && visible_variance(0.0) == 0.0,
            "noise above white is hardly visible"
        );
    }

    #[test]
    fn uniform_light_trains_no_guide() {
        let mut scene = Scene {
            materials: vec![Material::default()],
            ..Scene::default()
        };
        scene.sky = Some(white_sky());
        scene.positions = vec![
            dvec3(-9.0, -1.0, -9.0),
            dvec3(9.0, -1.0, -9.0),
            dvec3(0.0, -1.0, 9.0),
        ];
        scene.triangles = vec![Triangle {
            vertices: [0, 1, 2],
            material: 0,
        }];
        for tracer in [tracer(scene), tracer(Scene::default())] {
            let lighting = Lighting::unmetered(&tracer, 1).guided(&tracer);
            assert!(lighting.guide.cells.is_empty());
        }
    }
}
