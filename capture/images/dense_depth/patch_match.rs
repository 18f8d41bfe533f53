//! Planes for all pixels of a picture by trying those of others: PatchMatch for several views (Bleyer, Rhemann and Rother 2011;
//! Galliani, Lasinger and Schindler 2015, whose chequerboard it is; Xu and Tao 2019, whose neighbourhoods they are).
//!
//! Half of the pixels at a time ask the other half: in eight neighbourhoods the one with the least cost lends its plane, then a few are
//! drawn at random about the best. A plane's cost is the mean over the other pictures that agree best, for a surface may be hidden in some. Where other pictures know
//! depths already, a plane that leads to another surface there and back to another pixel costs more.

use super::hypotheses::{Chequerboard, Hypothesis};
use super::picture::Grey;
use super::relative::Relative;
use super::zncc::{Patch, WORST};
use fearless_simd::{Level, Simd, dispatch};
use headbox_core::random;
use rayon::prelude::*;
use std::sync::Arc;

/// Other pictures that are asked at most.
pub(super) const MOST_OTHERS: usize = 8;

/// The steepest planes: metres of depth for each metre across.
const STEEPEST: f32 = 4.0;

/// What a pixel's distance between itself and where it comes back to adds to a cost, and the largest such distance.
const INCONSISTENT: f32 = 0.2;
const MOST_PX: f32 = 3.0;

/// Another picture.
pub(super) struct Other<'a> {
    pub(super) relative: Relative,
    pub(super) picture: &'a Grey,
    /// What is known of it already.
    pub(super) known: Option<Known>,
}

/// Inverse depths of another picture, row by row, 0 where unknown, and the way back.
pub(super) struct Known {
    pub(super) inverse_depths: Arc<Vec<f32>>,
    pub(super) back: Relative,
}

/// A picture whose planes are wanted.
pub(super) struct Matcher<'a> {
    pub(super) picture: &'a Grey,
    pub(super) focal_px: f32,
    /// At most [`MOST_OTHERS`].
    pub(super) others: Vec<Other<'a>>,
    /// The least and the largest inverse depth, 1/m.
    pub(super) range: [f32; 2],
    /// Of random numbers.
    pub(super) seed: u64,
    pub(super) level: Level,
}

/// How far planes are drawn from the best so far.
#[derive(Clone, Copy)]
pub(super) struct Draw {
    /// Pixels of motion in another picture.
    pub(super) motion_px: f32,
    /// Metres of depth for each metre across.
    pub(super) slope: f32,
    /// Whether some are drawn from all that is possible.
    pub(super) anywhere: bool,
    /// No two draws have the same.
    pub(super) round: u64,
}

/// What is done with half of the pixels.
#[derive(Clone, Copy)]
enum Task {
    /// Planes that face the camera, this many, over the range.
    Sweep(u32),
    /// Costs alone.
    Evaluate,
    /// The neighbourhoods' planes, and drawn ones.
    Improve(Draw),
}

impl Matcher<'_> {
    /// The best of so many planes that face the camera, for each pixel: a plane sweep.
    pub(super) fn sweep(&self, board: &mut Chequerboard, steps: u32) {
        self.run(board, Task::Sweep(steps));
    }

    /// What the planes that are there cost here.
    pub(super) fn evaluate(&self, board: &mut Chequerboard) {
        self.run(board, Task::Evaluate);
    }

    /// One round over both halves.
    pub(super) fn improve(&self, board: &mut Chequerboard, draw: Draw) {
        self.run(board, Task::Improve(draw));
    }

    fn run(&self, board: &mut Chequerboard, task: Task) {
        let stride = board.stride();
        for colour in 0..2 {
            // Improved from the other half, which stays as it is meanwhile: the order of rows does not count.
            let mut half = std::mem::take(&mut board.halves[colour]);
            let still = &*board;
            half.par_chunks_mut(stride)
                .enumerate()
                .for_each(|(y, row)| {
                    dispatch!(self.level, simd => self.row(simd, still, [colour, y], row, task));
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
        task: Task,
    ) {
        let first = Chequerboard::first(colour, y);
        let columns = (board.width - first.min(board.width)).div_ceil(2);
        for (k, best) in row[..columns].iter_mut().enumerate() {
            let x = first + 2 * k;
            if self.picture.nothing[y * self.picture.width + x] {
                *best = Hypothesis {
                    cost: WORST,
                    ..Hypothesis::default()
                };
                continue;
            }
            let mut pixel = Pixel {
                matcher: self,
                patch: Patch::new(self.picture, x, y),
                at: [x, y],
                best: *best,
            };
            match task {
                Task::Sweep(steps) => pixel.sweep(simd, steps),
                Task::Evaluate => pixel.best.cost = pixel.cost(simd, best),
                Task::Improve(draw) => pixel.improve(simd, board, draw),
            }
            *best = pixel.best;
        }
    }
}

/// A pixel in search of a plane.
struct Pixel<'a> {
    matcher: &'a Matcher<'a>,
    patch: Patch,
    at: [usize; 2],
    best: Hypothesis,
}

impl Pixel<'_> {
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

    fn improve<S: Simd>(&mut self, simd: S, board: &Chequerboard, draw: Draw) {
        let fastest_px = self.fastest_px();
        for place in NEIGHBOURHOODS {
            let found = self.cheapest(board, place);
            if let Some(found) = found.filter(|found| self.best.differs(found, fastest_px)) {
                self.consider(simd, found);
            }
        }
        self.draw(simd, draw);
    }

    /// The plane of the cheapest pixel of a neighbourhood, carried here.
    fn cheapest(&self, board: &Chequerboard, places: &[[i8; 2]]) -> Option<Hypothesis> {
        let [x, y] = self.at.map(|at| at as i32);
        let mut found: Option<(Hypothesis, [i8; 2])> = None;
        for &[dx, dy] in places {
            let (px, py) = (x + i32::from(dx), y + i32::from(dy));
            if px < 0 || py < 0 || px >= board.width as i32 || py >= board.height as i32 {
                continue;
            }
            let there = board.get(px as usize, py as usize);
            if there.inverse_depth > 0.0 && found.is_none_or(|(best, _)| there.cost < best.cost) {
                found = Some((*there, [dx, dy]));
            }
        }
        found.map(|(plane, [dx, dy])| plane.moved(-f32::from(dx), -f32::from(dy)))
    }

    fn draw<S: Simd>(&mut self, simd: S, draw: Draw) {
        let [x, y] = self.at;
        let key = (y * self.matcher.picture.width + x) as u64;
        let mut bits = random::hash(self.matcher.seed ^ random::hash(key ^ draw.round << 40));
        // Uniform in -1..1.
        let mut next = || {
            bits = bits.wrapping_add(0x9E37_79B9_7F4A_7C15);
            (random::hash(bits) >> 40) as f32 / 8_388_608.0 - 1.0
        };
        let reach = draw.motion_px / self.fastest_px().max(1e-9);
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
            let scale = draw.slope * per_slope(best.inverse_depth);
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
        if draw.anywhere {
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

    /// Pixels that this one moves in the picture where it moves most, for an inverse depth of 1/m.
    fn fastest_px(&self) -> f32 {
        let [x, y] = self.at.map(|at| at as f32 + 0.5);
        let others = self.matcher.others.iter();
        others
            .map(|other| other.relative.motion_px(x, y, self.best.inverse_depth))
            .fold(0.0, f32::max)
    }

    fn consider<S: Simd>(&mut self, simd: S, plane: Hypothesis) {
        let [low, high] = self.matcher.range;
        let steepest = STEEPEST * plane.inverse_depth / self.matcher.focal_px;
        let possible = plane.inverse_depth >= low
            && plane.inverse_depth <= high
            && plane.inverse_depth > 0.0
            && plane.slopes.iter().all(|slope| slope.abs() <= steepest);
        if possible {
            let cost = self.cost(simd, &plane);
            if cost < self.best.cost {
                self.best = Hypothesis { cost, ..plane };
            }
        }
    }

    /// The mean over the better half of the other pictures.
    #[inline(always)]
    fn cost<S: Simd>(&self, simd: S, plane: &Hypothesis) -> f32 {
        simd.vectorize(
            #[inline(always)]
            || {
                let [x, y] = self.at.map(|at| at as f32 + 0.5);
                let (mut costs, mut count) = ([WORST; MOST_OTHERS], 0);
                for other in &self.matcher.others {
                    let seen = other
                        .relative
                        .plane(x, y, plane.inverse_depth, plane.slopes);
                    let mut cost = self.patch.cost(simd, &seen, other.picture);
                    if let Some(known) = &other.known {
                        cost += INCONSISTENT * known.returns_px(other, [x, y], plane.inverse_depth);
                    }
                    // Sorted as they come: there are few.
                    let mut at = count;
                    while at > 0 && costs[at - 1] > cost {
                        costs[at] = costs[at - 1];
                        at -= 1;
                    }
                    costs[at] = cost;
                    count += 1;
                }
                let best = agreeing(count);
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
    /// Whether another plane moves anything in a patch to another place, where an inverse depth of 1/m is so many pixels.
    #[inline(always)]
    fn differs(&self, other: &Self, fastest_px: f32) -> bool {
        /// Less is not seen, pixels.
        const SEEN: f32 = 0.02;
        /// From the middle of a patch to its rim.
        const RIM: f32 = 5.0;
        let slopes = (self.slopes[0] - other.slopes[0])
            .abs()
            .max((self.slopes[1] - other.slopes[1]).abs());
        ((self.inverse_depth - other.inverse_depth).abs() + slopes * RIM) * fastest_px > SEEN
    }
}

/// Of so many other pictures, how many need to agree.
pub(super) fn agreeing(others: usize) -> usize {
    others.div_ceil(2).min(3)
}

impl Known {
    /// How many pixels from where it began a position comes back to, by way of what another picture knows there; at most [`MOST_PX`].
    #[inline(always)]
    fn returns_px(&self, other: &Other, [x, y]: [f32; 2], inverse_depth: f32) -> f32 {
        let h = other.relative.at(x, y, inverse_depth);
        let (px, py) = (h.x / h.z, h.y / h.z);
        let (width, height) = (other.picture.width, other.picture.height);
        if !(h.z > 0.0 && px >= 0.0 && py >= 0.0 && px < width as f32 && py < height as f32) {
            return MOST_PX;
        }
        let there = self.inverse_depths[py as usize * width + px as usize];
        if there <= 0.0 {
            return MOST_PX;
        }
        let back = self.back.at(px, py, there);
        let (dx, dy) = (back.x / back.z - x, back.y / back.z - y);
        let distance = (dx * dx + dy * dy).sqrt();
        if back.z > 0.0 && distance < MOST_PX {
            distance
        } else {
            MOST_PX
        }
    }
}

/// Where planes come from: near in a fan, and far along a line, to each of four sides. All are squares of the other colour.
const NEIGHBOURHOODS: [&[[i8; 2]]; 8] = [
    &[[0, -1], [-1, -2], [1, -2], [-2, -3], [2, -3]],
    &[[0, 1], [-1, 2], [1, 2], [-2, 3], [2, 3]],
    &[[-1, 0], [-2, -1], [-2, 1], [-3, -2], [-3, 2]],
    &[[1, 0], [2, -1], [2, 1], [3, -2], [3, 2]],
    &[
        [0, -3],
        [0, -5],
        [0, -7],
        [0, -9],
        [0, -11],
        [0, -15],
        [0, -19],
        [0, -23],
    ],
    &[
        [0, 3],
        [0, 5],
        [0, 7],
        [0, 9],
        [0, 11],
        [0, 15],
        [0, 19],
        [0, 23],
    ],
    &[
        [-3, 0],
        [-5, 0],
        [-7, 0],
        [-9, 0],
        [-11, 0],
        [-15, 0],
        [-19, 0],
        [-23, 0],
    ],
    &[
        [3, 0],
        [5, 0],
        [7, 0],
        [9, 0],
        [11, 0],
        [15, 0],
        [19, 0],
        [23, 0],
    ],
];
