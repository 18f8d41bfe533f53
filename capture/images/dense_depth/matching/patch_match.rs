//! PatchMatch for several views (Bleyer, Rhemann and Rother 2011; chequerboard of Galliani,
//! Lasinger and Schindler 2015; neighbourhoods of Xu and Tao 2019).
//!
//! Half of the pixels at a time take planes from the other half: the cheapest pixel of each of
//! eight neighbourhoods proposes its plane, then random perturbations of the best are tried. A
//! plane's cost is the mean over the best-matching half of the neighbouring views, because a
//! surface may be occluded in some. If the neighbours have depths, a plane that leads to another
//! surface there and back to another pixel costs more.

use super::hypotheses::{Chequerboard, Hypothesis};
use super::picture::Grey;
use super::relative::Relative;
use super::zncc::{Patch, WORST};
use fearless_simd::{Level, Simd, dispatch};
use headbox_core::random;
use rayon::prelude::*;
use std::sync::Arc;

/// Maximum number of neighbouring views.
pub(crate) const MAX_NEIGHBORS: usize = 8;

/// Maximum slope of a plane: metres of depth per metre across.
const MAX_PLANE_SLOPE: f32 = 4.0;

/// Cost per pixel of forward-backward reprojection error, and the maximum error, pixels.
const INCONSISTENCY_COST: f32 = 0.2;
const MAX_RETURN_PX: f32 = 3.0;

/// A neighbouring view.
pub(crate) struct NeighborView<'a> {
    pub(crate) relative: Relative,
    pub(crate) picture: &'a Grey,
    /// Its depths, if they are estimated already.
    pub(crate) known: Option<KnownDepths>,
}

/// Inverse depths of a neighbouring view, row by row, 0 where unknown, and the warp back.
pub(crate) struct KnownDepths {
    pub(crate) inverse_depths: Arc<Vec<f32>>,
    pub(crate) back: Relative,
}

/// Matcher of an image with its neighbours.
pub(crate) struct Matcher<'a> {
    pub(crate) picture: &'a Grey,
    pub(crate) focal_px: f32,
    /// Neighbouring views, at most [`MAX_NEIGHBORS`].
    pub(crate) others: Vec<NeighborView<'a>>,
    /// Smallest and largest inverse depth, 1/m.
    pub(crate) range: [f32; 2],
    /// Seed of random numbers.
    pub(crate) seed: u64,
    pub(crate) level: Level,
}

/// Range of random perturbations of the best plane.
#[derive(Clone, Copy)]
pub(crate) struct Perturbation {
    /// Maximum motion in a neighbouring image, pixels.
    pub(crate) motion_px: f32,
    /// Maximum change of slope: metres of depth per metre across.
    pub(crate) slope: f32,
    /// True if planes from the whole range are tried as well.
    pub(crate) anywhere: bool,
    /// Index of the round, part of the random seed.
    pub(crate) round: u64,
}

/// Operation on half of the pixels.
#[derive(Clone, Copy)]
enum Pass {
    /// Tries this number of fronto-parallel planes over the range.
    Sweep(u32),
    /// Computes the costs of the current planes.
    Evaluate,
    /// Tries the planes of the neighbourhoods and random perturbations.
    Improve(Perturbation),
}

impl Matcher<'_> {
    /// Selects the best of `steps` fronto-parallel planes for each pixel: a plane sweep.
    pub(crate) fn sweep(&self, board: &mut Chequerboard, steps: u32) {
        self.run(board, Pass::Sweep(steps));
    }

    /// Computes the costs of the current planes.
    pub(crate) fn evaluate(&self, board: &mut Chequerboard) {
        self.run(board, Pass::Evaluate);
    }

    /// Runs one round over both halves.
    pub(crate) fn improve(&self, board: &mut Chequerboard, perturbation: Perturbation) {
        self.run(board, Pass::Improve(perturbation));
    }

    fn run(&self, board: &mut Chequerboard, pass: Pass) {
        let stride = board.stride();
        for colour in 0..2 {
            // Reads only the other half, which does not change: the order of rows is irrelevant.
            let mut half = std::mem::take(&mut board.halves[colour]);
            let fixed = &*board;
            half.par_chunks_mut(stride)
                .enumerate()
                .for_each(|(y, row)| {
                    dispatch!(self.level, simd => self.row(simd, fixed, [colour, y], row, pass));
                });
            board.halves[colour] = half;
        }
    }

    #[inline(always)]
    fn row<S: Simd>(
        &self,
        simd: S,
        board: &Chequerboard,
        [colour, y]: [usize; 2],
        row: &mut [Hypothesis],
        pass: Pass,
    ) {
        let first = Chequerboard::first_column(colour, y);
        let columns = (board.width - first.min(board.width)).div_ceil(2);
        for (k, best) in row[..columns].iter_mut().enumerate() {
            let x = first + 2 * k;
            if self.picture.background[y * self.picture.width + x] {
                *best = Hypothesis {
                    cost: WORST,
                    ..Hypothesis::default()
                };
                continue;
            }
            let mut pixel = PixelSearch {
                matcher: self,
                patch: Patch::new(self.picture, x, y),
                position: [x, y],
                best: *best,
            };
            match pass {
                Pass::Sweep(steps) => pixel.sweep(simd, steps),
                Pass::Evaluate => pixel.best.cost = pixel.cost(simd, best),
                Pass::Improve(perturbation) => pixel.improve(simd, board, perturbation),
            }
            *best = pixel.best;
        }
    }
}

/// Search for the best plane of a pixel.
struct PixelSearch<'a> {
    matcher: &'a Matcher<'a>,
    patch: Patch,
    position: [usize; 2],
    best: Hypothesis,
}

impl PixelSearch<'_> {
    fn sweep<S: Simd>(&mut self, simd: S, steps: u32) {
        let [low, high] = self.matcher.range;
        self.best.cost = f32::INFINITY;
        for step in 0..steps {
            let inverse_depth = low + (high - low) * (step as f32 + 0.5) / steps as f32;
            self.consider(
                simd,
                Hypothesis {
                    inverse_depth,
                    ..Hypothesis::default()
                },
            );
        }
    }

    fn improve<S: Simd>(&mut self, simd: S, board: &Chequerboard, perturbation: Perturbation) {
        let max_motion_px = self.max_motion_px();
        for neighbourhood in NEIGHBOURHOODS {
            let plane = self.cheapest(board, neighbourhood);
            if let Some(plane) = plane.filter(|plane| self.best.differs(plane, max_motion_px)) {
                self.consider(simd, plane);
            }
        }
        self.perturb(simd, perturbation);
    }

    /// Returns the plane of the cheapest pixel of a neighbourhood, extrapolated to this pixel.
    fn cheapest(&self, board: &Chequerboard, offsets: &[[i8; 2]]) -> Option<Hypothesis> {
        let [x, y] = self.position.map(|side| side as i32);
        let mut cheapest: Option<(Hypothesis, [i8; 2])> = None;
        for &[dx, dy] in offsets {
            let px = x + i32::from(dx);
            let py = y + i32::from(dy);
            if px < 0 || py < 0 || px >= board.width as i32 || py >= board.height as i32 {
                continue;
            }
            let other = board.get(px as usize, py as usize);
            if other.inverse_depth > 0.0 && cheapest.is_none_or(|(best, _)| other.cost < best.cost)
            {
                cheapest = Some((*other, [dx, dy]));
            }
        }
        cheapest.map(|(plane, [dx, dy])| plane.shifted(-f32::from(dx), -f32::from(dy)))
    }

    /// Tries random perturbations of the best plane.
    fn perturb<S: Simd>(&mut self, simd: S, perturbation: Perturbation) {
        let [x, y] = self.position;
        let key = (y * self.matcher.picture.width + x) as u64;
        let mut bits =
            random::hash(self.matcher.seed ^ random::hash(key ^ perturbation.round << 40));
        // Returns a uniform number in -1..1.
        let mut next = || {
            bits = bits.wrapping_add(0x9E37_79B9_7F4A_7C15);
            (random::hash(bits) >> 40) as f32 / 8_388_608.0 - 1.0
        };
        let reach = perturbation.motion_px / self.max_motion_px().max(1e-9);
        let per_slope = |inverse_depth: f32| inverse_depth / self.matcher.focal_px;
        let [low, high] = self.matcher.range;
        let [a, b, c, d, e, f] = std::array::from_fn(|_| next());
        let [g, h, i, j, k] = std::array::from_fn(|_| next());
        let best = self.best;
        let inverse_depth = best.inverse_depth + reach * a;
        self.consider(
            simd,
            Hypothesis {
                inverse_depth,
                ..best
            },
        );
        let best = self.best;
        let turned = |[p, q]: [f32; 2]| {
            let scale = perturbation.slope * per_slope(best.inverse_depth);
            [best.slopes[0] + scale * p, best.slopes[1] + scale * q]
        };
        self.consider(
            simd,
            Hypothesis {
                slopes: turned([b, c]),
                ..best
            },
        );
        let inverse_depth = best.inverse_depth + reach * f;
        self.consider(
            simd,
            Hypothesis {
                inverse_depth,
                slopes: turned([d, e]),
                ..best
            },
        );
        if perturbation.anywhere {
            let inverse_depth = low + (high - low) * (0.5 + 0.5 * g);
            let slopes = [h, i].map(|slope| 2.0 * slope * per_slope(inverse_depth));
            self.consider(
                simd,
                Hypothesis {
                    inverse_depth,
                    slopes,
                    cost: 0.0,
                },
            );
            let slopes = [j, k].map(|slope| 2.0 * slope * per_slope(self.best.inverse_depth));
            self.consider(
                simd,
                Hypothesis {
                    slopes,
                    ..self.best
                },
            );
        }
    }

    /// Returns the largest motion of this pixel in the neighbouring images per change of inverse
    /// depth, pixels metres.
    fn max_motion_px(&self) -> f32 {
        let [x, y] = self.position.map(|side| side as f32 + 0.5);
        let others = self.matcher.others.iter();
        others
            .map(|other| other.relative.motion_px(x, y, self.best.inverse_depth))
            .fold(0.0, f32::max)
    }

    /// Replaces the best plane by a valid one that costs less.
    fn consider<S: Simd>(&mut self, simd: S, plane: Hypothesis) {
        let [low, high] = self.matcher.range;
        let steepest = MAX_PLANE_SLOPE * plane.inverse_depth / self.matcher.focal_px;
        let is_valid = plane.inverse_depth >= low
            && plane.inverse_depth <= high
            && plane.inverse_depth > 0.0
            && plane.slopes.iter().all(|slope| slope.abs() <= steepest);
        if is_valid {
            let cost = self.cost(simd, &plane);
            if cost < self.best.cost {
                self.best = Hypothesis { cost, ..plane };
            }
        }
    }

    /// Returns the mean cost over the best-matching half of the neighbours.
    #[inline(always)]
    fn cost<S: Simd>(&self, simd: S, plane: &Hypothesis) -> f32 {
        simd.vectorize(
            #[inline(always)]
            || {
                let [x, y] = self.position.map(|side| side as f32 + 0.5);
                let mut costs = [WORST; MAX_NEIGHBORS];
                let mut count = 0;
                for other in &self.matcher.others {
                    let warped = other
                        .relative
                        .warp_plane(x, y, plane.inverse_depth, plane.slopes);
                    let mut cost = self.patch.cost(simd, &warped, other.picture);
                    if let Some(known) = &other.known {
                        cost += INCONSISTENCY_COST
                            * known.return_error_px(other, [x, y], plane.inverse_depth);
                    }
                    // Insertion sort: there are at most eight.
                    let mut slot = count;
                    while slot > 0 && costs[slot - 1] > cost {
                        costs[slot] = costs[slot - 1];
                        slot -= 1;
                    }
                    costs[slot] = cost;
                    count += 1;
                }
                let best = required_matches(count);
                let mut sum = 0.0;
                for cost in &costs[..best] {
                    sum += cost;
                }
                sum / best.max(1) as f32
            },
        )
    }
}

impl Hypothesis {
    /// Returns true if another plane moves a pixel of the patch visibly; `max_motion_px` is the
    /// motion per change of inverse depth.
    #[inline(always)]
    fn differs(&self, other: &Self, max_motion_px: f32) -> bool {
        /// Minimum visible motion, pixels.
        const MIN_MOTION_PX: f32 = 0.02;
        /// Half side of a patch, pixels.
        const PATCH_RADIUS: f32 = 5.0;
        let slopes = (self.slopes[0] - other.slopes[0])
            .abs()
            .max((self.slopes[1] - other.slopes[1]).abs());
        ((self.inverse_depth - other.inverse_depth).abs() + slopes * PATCH_RADIUS) * max_motion_px
            > MIN_MOTION_PX
    }
}

/// Returns the number of neighbours that must match, out of `others`.
pub(crate) fn required_matches(others: usize) -> usize {
    others.div_ceil(2).min(3)
}

impl KnownDepths {
    /// Returns the forward-backward reprojection error of a position through a neighbour's depth,
    /// pixels, at most [`MAX_RETURN_PX`].
    #[inline(always)]
    fn return_error_px(&self, other: &NeighborView, [x, y]: [f32; 2], inverse_depth: f32) -> f32 {
        let h = other.relative.warp(x, y, inverse_depth);
        let px = h.x / h.z;
        let py = h.y / h.z;
        let width = other.picture.width;
        let height = other.picture.height;
        if !(h.z > 0.0 && px >= 0.0 && py >= 0.0 && px < width as f32 && py < height as f32) {
            return MAX_RETURN_PX;
        }
        let neighbor_depth = self.inverse_depths[py as usize * width + px as usize];
        if neighbor_depth <= 0.0 {
            return MAX_RETURN_PX;
        }
        let back = self.back.warp(px, py, neighbor_depth);
        let dx = back.x / back.z - x;
        let dy = back.y / back.z - y;
        let distance = (dx * dx + dy * dy).sqrt();
        if back.z > 0.0 && distance < MAX_RETURN_PX {
            distance
        } else {
            MAX_RETURN_PX
        }
    }
}

/// Offsets of the pixels that propose planes: a near fan and a far line to each of four sides. All
/// are squares of the other colour.
const NEIGHBOURHOODS: [&[[i8; 2]]; 8] = [
    &[[0, -1], [-1, -2], [1, -2], [-2, -3], [2, -3]],
    &[[0, 1], [-1, 2], [1, 2], [-2, 3], [2, 3]],
    &[[-1, 0], [-2, -1], [-2, 1], [-3, -2], [-3, 2]],
    &[[1, 0], [2, -1], [2, 1], [3, -2], [3, 2]],
    &far_line(0, -1),
    &far_line(0, 1),
    &far_line(-1, 0),
    &far_line(1, 0),
];

/// Returns the offsets of a far line in a direction.
const fn far_line(dx: i8, dy: i8) -> [[i8; 2]; 8] {
    const DISTANCES: [i8; 8] = [3, 5, 7, 9, 11, 15, 19, 23];
    let mut line = [[0; 2]; 8];
    let mut k = 0;
    while k < line.len() {
        line[k] = [dx * DISTANCES[k], dy * DISTANCES[k]];
        k += 1;
    }
    line
}
