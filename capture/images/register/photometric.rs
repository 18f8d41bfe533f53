//! Photometric estimation of the colour cameras: points of the depth images must have the same
//! colour in all images.
//!
//! The unknowns are four parameters of the lens (focal length, principal point, the first radial
//! coefficient), one offset from the depth camera shared by all views, and then a pose for each
//! view. A residual is the difference of the levels of a point in two views, one of them scaled by
//! the ratio of their means. Points that are hidden from one view by its depth image are skipped;
//! robust (Cauchy) weights suppress other outliers. Solved by damped Gauss-Newton steps, from
//! blurred images to sharp ones.

use super::calibration::{Calibration, ProjectedPoint};
use super::solve::{PAIR_UNKNOWNS, PairBlock, SHARED_UNKNOWNS, VIEW_UNKNOWNS, solve};
use super::subset::rank_others;
use super::view_samples::{BlurredImage, VALIDATION_STRIDE, ViewSamples};
use super::{Pinhole, Pose};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

/// Views and the pairs of them that overlap.
pub(super) struct PhotometricProblem {
    pub(super) views: Vec<ViewSamples>,
    given: Pinhole,
    pub(super) pairs: Vec<ViewPair>,
    /// Cached blurred images and their number of blur rounds.
    blurred: Mutex<Option<(u32, Arc<Vec<BlurredImage>>)>>,
}

/// Two overlapping views.
pub(super) struct ViewPair {
    pub(super) views: [usize; 2],
    /// Indices of the first view's points that are visible in the second.
    points: Vec<usize>,
}

/// Free unknowns of a stage.
#[derive(Clone, Copy, PartialEq)]
enum Stage {
    SharedOffset,
    PerView,
}

/// Ranks by distance of the views that a view is paired with.
const RANKS: [usize; 6] = [0, 1, 3, 7, 15, 27];

/// Minimum number of common points of a pair, and minimum fraction of the first view's points; the
/// smaller applies.
const MIN_POINTS: usize = 100;
const MIN_SHARE: f64 = 0.1;

/// Numbers of blur rounds, from coarse to fine: standard deviations of 3.5, 1.7 and 1 pixels of the
/// small images.
const BLURS: [u32; 3] = [24, 6, 2];

/// Scale of the robust cost, levels.
const ROBUST: f64 = 8.0;

/// Prior standard deviations: principal point (relative to the image's width) and radial
/// coefficient of the lens; turn (radians) and step (relative to depth: sensors are a few
/// centimetres wide) of the shared offset; and of a view's own pose.
const PRINCIPAL: f64 = 0.02;
const RADIAL: f64 = 0.05;
const TURN: f64 = 0.02;
const STEP: f64 = 0.015;
const OWN_TURN: f64 = 0.009;
const OWN_STEP: f64 = 0.01;

/// Weight of the prior relative to all equations with a residual of [`ROBUST`].
const PRIOR_SHARE: f64 = 0.002;

/// Focal lengths tried first, relative to the given one: steps and step size.
const FOCAL_FACTORS: std::ops::RangeInclusive<i32> = -10..=10;
const FOCAL_STEP: f64 = 0.025;

/// Projections of a point into two views, with level and slopes there.
struct Observation {
    samples: [(ProjectedPoint, [f64; 3]); 2],
}

impl PhotometricProblem {
    /// Pairs overlapping views that share one undistorted lens.
    pub(super) fn new(views: Vec<ViewSamples>, given: Pinhole) -> Self {
        let mut problem = Self {
            views,
            given,
            pairs: Vec::new(),
            blurred: Mutex::default(),
        };
        let pair = |views: [usize; 2]| {
            let [first, second] = views.map(|view| &problem.views[view]);
            let is_visible = |index: &usize| second.is_visible(&given, first.points[*index]);
            ViewPair {
                views,
                points: (0..first.points.len()).filter(is_visible).collect(),
            }
        };
        let is_enough = |pair: &ViewPair| {
            let all = problem.views[pair.views[0]].points.len() as f64;
            pair.points.len() >= MIN_POINTS.min((all * MIN_SHARE).ceil() as usize).max(1)
        };
        problem.pairs = problem
            .candidates()
            .into_par_iter()
            .map(pair)
            .filter(is_enough)
            .collect();
        problem
    }

    /// Returns the pairs of views to test for overlap.
    fn candidates(&self) -> Vec<[usize; 2]> {
        let poses: Vec<Pose> = self.poses().collect();
        let mut pairs = BTreeSet::new();
        for (i, own) in self.views.iter().enumerate() {
            let others = rank_others(&poses, i, own.depth_m);
            let ranked = RANKS.iter().filter_map(|&rank| others.get(rank));
            pairs.extend(ranked.map(|&j| [i.min(j), i.max(j)]));
        }
        pairs.into_iter().collect()
    }

    /// Returns the images blurred by a number of rounds.
    fn blurred(&self, rounds: u32) -> Arc<Vec<BlurredImage>> {
        let mut cache = self.blurred.lock().unwrap_or_else(PoisonError::into_inner);
        match &*cache {
            Some((cached, pictures)) if *cached == rounds => Arc::clone(pictures),
            _ => {
                let blur = |view: &ViewSamples| BlurredImage::new(view, rounds);
                let pictures = Arc::new(self.views.par_iter().map(blur).collect());
                *cache = Some((rounds, Arc::clone(&pictures)));
                pictures
            }
        }
    }

    pub(super) fn poses(&self) -> impl ExactSizeIterator<Item = Pose> {
        self.views.iter().map(|view| view.pose)
    }

    pub(super) fn initial_calibration(&self) -> Calibration {
        Calibration::as_given(&self.given, self.poses())
    }

    /// Estimates the lens and the offset from the depth cameras that all views share.
    pub(super) fn estimate_shared_offset(&self, given: &Calibration) -> Calibration {
        let pictures = self.blurred(BLURS[0]);
        let scaled = |factor: i32| Calibration {
            focal_px: given.focal_px * (1.0 + FOCAL_STEP * f64::from(factor)),
            ..given.clone()
        };
        let cost = |calibration: &Calibration| {
            self.mean_residual(calibration, &pictures, &is_estimation_point, &robust)
        };
        let start = FOCAL_FACTORS
            .map(scaled)
            .map(|calibration| (cost(&calibration), calibration))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let mut calibration = start.map_or_else(|| given.clone(), |(_, calibration)| calibration);
        for (rounds, steps) in [(BLURS[0], 8), (BLURS[1], 6)] {
            self.descend(&mut calibration, rounds, steps, Stage::SharedOffset);
        }
        calibration
    }

    /// Estimates a pose for each view, starting from the shared offset.
    pub(super) fn estimate_per_view(&self, shared: &Calibration) -> Calibration {
        let mut calibration = shared.clone();
        for (rounds, steps) in [(BLURS[0], 4), (BLURS[1], 6), (BLURS[2], 6)] {
            self.descend(&mut calibration, rounds, steps, Stage::PerView);
        }
        calibration
    }

    /// Takes Gauss-Newton steps with images blurred by `rounds`.
    fn descend(&self, calibration: &mut Calibration, rounds: u32, steps: usize, stage: Stage) {
        let pictures = self.blurred(rounds);
        let (mut cost, mut blocks) = self.equations(calibration, &pictures);
        let mut damping = 1e-3;
        for _ in 0..steps {
            let prior = self.prior(calibration, stage);
            let free = |i: usize| match stage {
                Stage::SharedOffset => i < SHARED_UNKNOWNS,
                Stage::PerView => true,
            };
            let next = calibration.apply_step(&solve(&blocks, &prior, damping, &free));
            let (next_cost, next_blocks) = self.equations(&next, &pictures);
            if next_cost < cost {
                (*calibration, cost, blocks) = (next, next_cost, next_blocks);
                damping = (damping / 4.0).max(1e-6);
            } else {
                damping *= 16.0;
            }
        }
    }

    /// Returns the weight and the current value of each unknown's prior.
    fn prior(&self, calibration: &Calibration, stage: Stage) -> Vec<[f64; 2]> {
        let count = self.views.len() as f64;
        let depth_m = self.views.iter().map(|view| view.depth_m).sum::<f64>() / count;
        let width = 2.0 * self.given.principal_px[0];
        let points: f64 = self.pairs.iter().map(|pair| pair.points.len() as f64).sum();
        let weight = points * PRIOR_SHARE * ROBUST * ROBUST;
        let [principal, step, own] = [PRINCIPAL * width, STEP * depth_m, OWN_STEP * depth_m];
        let lens = [f64::INFINITY, principal, principal, RADIAL];
        let deviations = [lens.as_slice(), &[TURN; 3], &[step; 3]].concat();
        let mut prior: Vec<[f64; 2]> = deviations
            .iter()
            .zip(calibration.shared)
            .map(|(deviation, value)| [weight / deviation.powi(2), value])
            .collect();
        for view in &calibration.own {
            for (i, &value) in view.iter().enumerate() {
                let deviation = if i < 3 { OWN_TURN } else { own };
                prior.push(match stage {
                    Stage::SharedOffset => [0.0; 2],
                    Stage::PerView => [weight / count / deviation.powi(2), value],
                });
            }
        }
        prior
    }

    /// Observes the common points of a pair whose index passes `filter`.
    fn observe(
        &self,
        calibration: &Calibration,
        pictures: &[BlurredImage],
        pair: &ViewPair,
        filter: &dyn Fn(usize) -> bool,
    ) -> Vec<Observation> {
        let [first, second] = pair.views;
        let sample = |view: usize, point: DVec3| {
            let projected = calibration.project(view, point)?;
            let small = projected.pixel / f64::from(self.views[view].reduction);
            let level = pictures[view].sample(small.x, small.y)?;
            Some((projected, level))
        };
        let points = pair
            .points
            .iter()
            .filter(|index| filter(**index))
            .map(|&index| self.views[first].points[index]);
        points
            .filter_map(|point| {
                Some(Observation {
                    samples: [sample(first, point)?, sample(second, point)?],
                })
            })
            .collect()
    }

    /// Returns the mean difference of levels at the validation points, clamped to 40 each.
    pub(super) fn validate(&self, calibration: &Calibration) -> f64 {
        self.mean_residual(
            calibration,
            &self.blurred(BLURS[2]),
            &|index| !is_estimation_point(index),
            &|residual| residual.abs().min(40.0),
        )
    }

    /// Returns the mean `value` of the residuals of points whose index passes `filter`.
    fn mean_residual(
        &self,
        calibration: &Calibration,
        pictures: &[BlurredImage],
        filter: &(dyn Fn(usize) -> bool + Sync),
        value: &(dyn Fn(f64) -> f64 + Sync),
    ) -> f64 {
        let sum_pair = |pair: &ViewPair| {
            let observations = self.observe(calibration, pictures, pair, filter);
            let ratio = level_ratio(&observations);
            let values = observations
                .iter()
                .map(|observation| value(residual(observation, ratio)));
            (values.sum::<f64>(), observations.len())
        };
        overall_mean(self.pairs.par_iter().map(sum_pair).collect())
    }

    /// Returns the mean robust cost of the estimation points and each pair's normal equations.
    fn equations(
        &self,
        calibration: &Calibration,
        pictures: &[BlurredImage],
    ) -> (f64, Vec<PairBlock>) {
        let pair_equations = |pair: &ViewPair| {
            let observations = self.observe(calibration, pictures, pair, &is_estimation_point);
            let ratio = level_ratio(&observations);
            let mut block = PairBlock::new(pair.views);
            let mut cost = 0.0;
            for observation in &observations {
                let mut row = [0.0; PAIR_UNKNOWNS];
                for (k, sign) in [(0, 1.0), (1, -ratio)] {
                    let (projected, [_, slope_x, slope_y]) = &observation.samples[k];
                    let slope = DVec2::new(*slope_x, *slope_y)
                        * (sign / f64::from(self.views[pair.views[k]].reduction));
                    self.add_derivatives(calibration, projected, slope, k, &mut row);
                }
                let residual = residual(observation, ratio);
                cost += robust(residual);
                block.add(&row, residual, 1.0 / (1.0 + (residual / ROBUST).powi(2)));
            }
            ((cost, observations.len()), block)
        };
        let (costs, blocks) = self.pairs.par_iter().map(pair_equations).unzip();
        (overall_mean(costs), blocks)
    }

    /// Adds the derivatives of one view's level by each unknown, given its slopes in the image.
    fn add_derivatives(
        &self,
        calibration: &Calibration,
        projected: &ProjectedPoint,
        slope: DVec2,
        k: usize,
        row: &mut [f64; PAIR_UNKNOWNS],
    ) {
        let ProjectedPoint { n, point, .. } = projected;
        let square = n.length_squared();
        let radial = 1.0 + calibration.radial * square;
        row[0] += slope.dot(*n) * radial;
        row[1] += slope.x;
        row[2] += slope.y;
        row[3] += slope.dot(*n) * square * calibration.focal_px;
        // Derivatives of n (1 + k |n|^2), and of n = (x, y) / z.
        let by_n = (slope * radial + *n * (2.0 * calibration.radial * n.dot(slope)))
            * calibration.focal_px;
        let step = DVec3::new(by_n.x, by_n.y, -by_n.dot(*n)) / point.z;
        let turn = point.cross(step);
        let own = SHARED_UNKNOWNS + k * VIEW_UNKNOWNS;
        for (i, value) in turn
            .to_array()
            .into_iter()
            .chain(step.to_array())
            .enumerate()
        {
            row[4 + i] += value;
            row[own + i] += value;
        }
    }

    /// Samples the colours of a pair's common points in both small images.
    pub(super) fn colors(&self, calibration: &Calibration, pair: &ViewPair) -> Vec<[[u8; 3]; 2]> {
        let sample = |view: usize, point: DVec3| {
            let samples = &self.views[view];
            let pixel = calibration.project(view, point)?.pixel / f64::from(samples.reduction);
            let [width, height] = samples.size;
            let is_inside = pixel.x >= 0.0
                && pixel.y >= 0.0
                && pixel.x < width as f64
                && pixel.y < height as f64;
            let index = pixel.y as usize * width + pixel.x as usize;
            let is_seen = is_inside && samples.is_opaque[index];
            is_seen.then(|| [0, 1, 2].map(|c| samples.planes[c][index]))
        };
        let [first, second] = pair.views;
        let points = pair
            .points
            .iter()
            .map(|&index| self.views[first].points[index]);
        points
            .filter_map(|point| Some([sample(first, point)?, sample(second, point)?]))
            .collect()
    }
}

/// Returns true if the point of an index is used for estimation instead of validation.
fn is_estimation_point(index: usize) -> bool {
    !index.is_multiple_of(VALIDATION_STRIDE)
}

fn robust(residual: f64) -> f64 {
    (residual / ROBUST).powi(2).ln_1p()
}

/// Returns the mean of sums and counts of pairs; infinite if all counts are 0.
fn overall_mean(sums: Vec<(f64, usize)>) -> f64 {
    let (sum, count) = sums
        .into_iter()
        .fold((0.0, 0), |total, pair| (total.0 + pair.0, total.1 + pair.1));
    if count == 0 {
        f64::INFINITY
    } else {
        sum / count as f64
    }
}

/// Returns the ratio of the summed levels of the first view to those of the second.
fn level_ratio(observations: &[Observation]) -> f64 {
    let sum = |k: usize| {
        observations
            .iter()
            .map(|observation| observation.samples[k].1[0])
            .sum::<f64>()
    };
    let [a, b] = [0, 1].map(sum);
    if a > 0.0 && b > 0.0 { a / b } else { 1.0 }
}

fn residual(observation: &Observation, ratio: f64) -> f64 {
    observation.samples[0].1[0] - ratio * observation.samples[1].1[0]
}
