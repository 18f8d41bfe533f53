//! Lens and places of colour cameras for which points of depth images have one colour in all pictures.
//!
//! Unknown are four numbers of the lens (focal length, principal point, the first radial coefficient), one place beside the depth
//! camera, and then a place for each view. A residual is the difference of the levels in which two views see a point, one
//! of them times the ratio of their means. Points that one of them does not see by its depth image are left out; robust (Cauchy)
//! weights leave out what else does not agree. Gauss-Newton
//! steps, damped where they fail, from blurred pictures to sharp ones.

use super::evidence::{Evidence, Smooth, UNSEEN};
use super::part::apart;
use super::solve::{Block, OF_PAIR, OF_VIEW, SHARED, solve};
use super::state::{Projected, State};
use super::{Pinhole, Pose};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

/// Views, and which of them see the same.
pub(super) struct Problem {
    pub(super) evidence: Vec<Evidence>,
    given: Pinhole,
    pairs: Vec<Pair>,
    /// The pictures as they were blurred last, and by how many rounds.
    blurred: Mutex<Option<(u32, Arc<Vec<Smooth>>)>>,
}

/// Two views that see the same.
pub(super) struct Pair {
    pub(super) views: [usize; 2],
    /// Numbers of the first's points that nothing hides from the second.
    points: Vec<usize>,
}

/// What is free.
#[derive(Clone, Copy, PartialEq)]
enum Stage {
    OneForAll,
    EachView,
}

/// A view is paired with those that are its so many-th nearest.
const RANKS: [usize; 6] = [0, 1, 3, 7, 15, 27];

/// A pair has at least so many points in common, or such a share of those of one.
const LEAST_POINTS: usize = 100;
const LEAST_SHARE: f64 = 0.1;

/// Rounds of blur, from coarse to fine: standard deviations of 3.5, 1.7 and 1 pixels of the small pictures.
const BLURS: [u32; 3] = [24, 6, 2];

/// Residuals beyond this, levels, count for less and less.
const ROBUST: f64 = 8.0;

/// What is likely before the pictures speak, standard deviations: a lens's principal point (of the picture's width) and radial
/// coefficient; a colour camera's turn (radians) and step (of the depth: sensors are a few centimetres wide); a view's own.
const PRINCIPAL: f64 = 0.02;
const RADIAL: f64 = 0.05;
const TURN: f64 = 0.02;
const STEP: f64 = 0.015;
const OWN_TURN: f64 = 0.009;
const OWN_STEP: f64 = 0.01;

/// The weight of that: as much as this share of all equations, off by [`ROBUST`].
const PRIOR_SHARE: f64 = 0.002;

/// Focal lengths that are tried first, over the given one.
const FOCAL_FACTORS: std::ops::RangeInclusive<i32> = -10..=10;
const FOCAL_STEP: f64 = 0.025;

/// A point that two views see: of each its projection, and level and slopes there.
struct Seen {
    views: [(Projected, [f64; 3]); 2],
}

impl Problem {
    /// Of views through one ideal lens, paired where they see the same.
    pub(super) fn new(evidence: Vec<Evidence>, given: Pinhole) -> Self {
        let mut problem = Self {
            evidence,
            given,
            pairs: Vec::new(),
            blurred: Mutex::default(),
        };
        let pair = |views: [usize; 2]| {
            let [first, second] = views.map(|view| &problem.evidence[view]);
            let sees = |number: &usize| second.sees(&given, first.points[*number]);
            Pair {
                views,
                points: (0..first.points.len()).filter(sees).collect(),
            }
        };
        let is_enough = |pair: &Pair| {
            let all = problem.evidence[pair.views[0]].points.len() as f64;
            pair.points.len() >= LEAST_POINTS.min((all * LEAST_SHARE).ceil() as usize).max(1)
        };
        problem.pairs = problem
            .candidates()
            .into_par_iter()
            .map(pair)
            .filter(is_enough)
            .collect();
        problem
    }

    pub(super) fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    fn candidates(&self) -> Vec<[usize; 2]> {
        let mut pairs = BTreeSet::new();
        for (i, own) in self.evidence.iter().enumerate() {
            let apart = |j: usize| (apart(&own.pose, &self.evidence[j].pose, own.depth_m), j);
            let mut others: Vec<(f64, usize)> = (0..self.evidence.len())
                .filter(|&j| j != i)
                .map(apart)
                .collect();
            others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            pairs.extend(
                RANKS
                    .iter()
                    .filter_map(|&rank| others.get(rank))
                    .map(|&(_, j)| [i.min(j), i.max(j)]),
            );
        }
        pairs.into_iter().collect()
    }

    fn blurred(&self, rounds: u32) -> Arc<Vec<Smooth>> {
        let mut held = self.blurred.lock().unwrap_or_else(PoisonError::into_inner);
        match &*held {
            Some((of, pictures)) if *of == rounds => Arc::clone(pictures),
            _ => {
                let blurred = |view: &Evidence| Smooth::new(&view.grey, view.size, rounds);
                let pictures = Arc::new(self.evidence.par_iter().map(blurred).collect());
                *held = Some((rounds, Arc::clone(&pictures)));
                pictures
            }
        }
    }

    pub(super) fn poses(&self) -> impl ExactSizeIterator<Item = Pose> {
        self.evidence.iter().map(|view| view.pose)
    }

    pub(super) fn as_given(&self) -> State {
        State::as_given(&self.given, self.poses())
    }

    /// The best lens, and the best place beside the depth cameras, the same for all views.
    pub(super) fn one_for_all(&self, given: &State) -> State {
        let pictures = self.blurred(BLURS[0]);
        let scaled = |factor: i32| State {
            focal_px: given.focal_px * (1.0 + FOCAL_STEP * f64::from(factor)),
            ..given.clone()
        };
        let start = FOCAL_FACTORS
            .map(scaled)
            .map(|state| (self.cost(&state, &pictures), state))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let mut state = start.map_or_else(|| given.clone(), |(_, state)| state);
        for (rounds, steps) in [(BLURS[0], 8), (BLURS[1], 6)] {
            self.descend(&mut state, rounds, steps, Stage::OneForAll);
        }
        state
    }

    /// A place for each view, beginning with that of all.
    pub(super) fn each_view(&self, one: &State) -> State {
        let mut state = one.clone();
        for (rounds, steps) in [(BLURS[0], 4), (BLURS[1], 6), (BLURS[2], 6)] {
            self.descend(&mut state, rounds, steps, Stage::EachView);
        }
        state
    }

    fn descend(&self, state: &mut State, rounds: u32, steps: usize, stage: Stage) {
        let pictures = self.blurred(rounds);
        let (mut cost, mut blocks) = self.equations(state, &pictures);
        let mut damping = 1e-3;
        for _ in 0..steps {
            let prior = self.prior(state, stage);
            let free = |i: usize| match stage {
                Stage::OneForAll => i < SHARED,
                Stage::EachView => true,
            };
            let next = state.stepped(&solve(&blocks, &prior, damping, &free));
            let (next_cost, next_blocks) = self.equations(&next, &pictures);
            if next_cost < cost {
                (*state, cost, blocks) = (next, next_cost, next_blocks);
                damping = (damping / 4.0).max(1e-6);
            } else {
                damping *= 16.0;
            }
        }
    }

    /// Weight and present value of each unknown's prior.
    fn prior(&self, state: &State, stage: Stage) -> Vec<[f64; 2]> {
        let count = self.evidence.len() as f64;
        let depth_m = self.evidence.iter().map(|view| view.depth_m).sum::<f64>() / count;
        let width = 2.0 * self.given.principal_px[0];
        let of_pairs: f64 = self.pairs.iter().map(|pair| pair.points.len() as f64).sum();
        let weight = of_pairs * PRIOR_SHARE * ROBUST * ROBUST;
        let [principal, step, own] = [PRINCIPAL * width, STEP * depth_m, OWN_STEP * depth_m];
        let deviations = [
            f64::INFINITY,
            principal,
            principal,
            RADIAL,
            TURN,
            TURN,
            TURN,
            step,
            step,
            step,
        ];
        let mut prior: Vec<[f64; 2]> = deviations
            .iter()
            .zip(state.shared)
            .map(|(deviation, value)| [weight / deviation.powi(2), value])
            .collect();
        for moved in &state.moved {
            for (i, &value) in moved.iter().enumerate() {
                let deviation = if i < 3 { OWN_TURN } else { own };
                prior.push(match stage {
                    Stage::OneForAll => [0.0; 2],
                    Stage::EachView => [weight / count / deviation.powi(2), value],
                });
            }
        }
        prior
    }

    /// The points of the first view that both see, of those whose numbers are `wanted`.
    fn seen(
        &self,
        state: &State,
        pictures: &[Smooth],
        pair: &Pair,
        wanted: &dyn Fn(usize) -> bool,
    ) -> Vec<Seen> {
        let [first, second] = pair.views;
        let look = |view: usize, point: DVec3| {
            let projected = state.project(view, point)?;
            let small = projected.at / f64::from(self.evidence[view].reduced);
            let level = pictures[view].at(small.x, small.y)?;
            Some((projected, level))
        };
        let points = pair
            .points
            .iter()
            .filter(|number| wanted(**number))
            .map(|&number| self.evidence[first].points[number]);
        points
            .filter_map(|point| {
                Some(Seen {
                    views: [look(first, point)?, look(second, point)?],
                })
            })
            .collect()
    }

    /// The mean robust cost of the points that are used.
    fn cost(&self, state: &State, pictures: &[Smooth]) -> f64 {
        self.mean(state, pictures, &is_used, &robust)
    }

    /// Mean difference of levels at the points that are not used, no more than 40 each.
    pub(super) fn unseen_levels(&self, state: &State) -> f64 {
        self.mean(
            state,
            &self.blurred(BLURS[2]),
            &|number| !is_used(number),
            &|residual| residual.abs().min(40.0),
        )
    }

    fn mean(
        &self,
        state: &State,
        pictures: &[Smooth],
        wanted: &(dyn Fn(usize) -> bool + Sync),
        value: &(dyn Fn(f64) -> f64 + Sync),
    ) -> f64 {
        let of_pair = |pair: &Pair| {
            let seen = self.seen(state, pictures, pair, wanted);
            let ratio = ratio(&seen);
            (
                seen.iter()
                    .map(|seen| value(residual(seen, ratio)))
                    .sum::<f64>(),
                seen.len(),
            )
        };
        mean_of(self.pairs.par_iter().map(of_pair).collect())
    }

    /// The mean robust cost of the points that are used, and each pair's normal equations.
    fn equations(&self, state: &State, pictures: &[Smooth]) -> (f64, Vec<Block>) {
        let of_pair = |pair: &Pair| {
            let seen = self.seen(state, pictures, pair, &is_used);
            let ratio = ratio(&seen);
            let mut block = Block::new(pair.views);
            let mut cost = 0.0;
            for point in &seen {
                let mut row = [0.0; OF_PAIR];
                for (k, sign) in [(0, 1.0), (1, -ratio)] {
                    let (projected, [_, slope_x, slope_y]) = &point.views[k];
                    let slope = DVec2::new(*slope_x, *slope_y)
                        * (sign / f64::from(self.evidence[pair.views[k]].reduced));
                    self.derivatives(state, projected, slope, k, &mut row);
                }
                let residual = residual(point, ratio);
                cost += robust(residual);
                block.add(&row, residual, 1.0 / (1.0 + (residual / ROBUST).powi(2)));
            }
            ((cost, seen.len()), block)
        };
        let (costs, blocks) = self.pairs.par_iter().map(of_pair).unzip();
        (mean_of(costs), blocks)
    }

    /// Adds what the level of one view changes by with each unknown, given its slopes in the picture.
    fn derivatives(
        &self,
        state: &State,
        projected: &Projected,
        slope: DVec2,
        k: usize,
        row: &mut [f64; OF_PAIR],
    ) {
        let Projected { n, point, .. } = projected;
        let square = n.length_squared();
        let radial = 1.0 + state.radial * square;
        row[0] += slope.dot(*n) * radial;
        row[1] += slope.x;
        row[2] += slope.y;
        row[3] += slope.dot(*n) * square * state.focal_px;
        // Of n (1 + k |n|^2), and of n = (x, y) / z.
        let of_n = (slope * radial + *n * (2.0 * state.radial * n.dot(slope))) * state.focal_px;
        let step = DVec3::new(of_n.x, of_n.y, -of_n.dot(*n)) / point.z;
        let turn = point.cross(step);
        let own = SHARED + k * OF_VIEW;
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

    /// Levels of three channels in which the two views of a pair see points, from their small pictures.
    pub(super) fn colors(&self, state: &State, pair: &Pair) -> Vec<[[u8; 3]; 2]> {
        let look = |view: usize, point: DVec3| {
            let evidence = &self.evidence[view];
            let at = state.project(view, point)?.at / f64::from(evidence.reduced);
            let [width, height] = evidence.size;
            let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < width as f64 && at.y < height as f64;
            inside.then(|| {
                [0, 1, 2].map(|c| evidence.planes[c][at.y as usize * width + at.x as usize])
            })
        };
        let [first, second] = pair.views;
        let points = pair
            .points
            .iter()
            .map(|&number| self.evidence[first].points[number]);
        points
            .filter_map(|point| Some([look(first, point)?, look(second, point)?]))
            .collect()
    }
}

/// Whether the point of a number is estimated from, not judged by.
fn is_used(number: usize) -> bool {
    !number.is_multiple_of(UNSEEN)
}

fn robust(residual: f64) -> f64 {
    (residual / ROBUST).powi(2).ln_1p()
}

/// The mean of pairs' sums and counts; infinite of nothing.
fn mean_of(sums: Vec<(f64, usize)>) -> f64 {
    let (sum, count) = sums
        .into_iter()
        .fold((0.0, 0), |total, pair| (total.0 + pair.0, total.1 + pair.1));
    if count == 0 {
        f64::INFINITY
    } else {
        sum / count as f64
    }
}

/// How much brighter the first view sees the points than the second, as their sums say.
fn ratio(seen: &[Seen]) -> f64 {
    let [a, b] = [0, 1].map(|k| seen.iter().map(|seen| seen.views[k].1[0]).sum::<f64>());
    if a > 0.0 && b > 0.0 { a / b } else { 1.0 }
}

fn residual(seen: &Seen, ratio: f64) -> f64 {
    seen.views[0].1[0] - ratio * seen.views[1].1[0]
}
