//! Relative exposure of the views, channel by channel: automatic exposure and white balance, and
//! stray light.
//!
//! A power law turns a factor of light into a factor of levels, whatever its exponent. So the
//! logarithms of the views' gains differ by the median logarithm of the ratio of the levels at
//! common points. Stray light from lamps and windows in the picture raises all levels, so that two
//! views are related by a line. Its slope is the ratio of the deviations of their levels: a
//! regression of one on the other would be too flat. Lines are taken if they explain the levels
//! clearly better. Differences are solved by least squares over all pairs, with a mean of 0 and a
//! weak prior for views without pairs.

use super::Exposure;
use super::calibration::Calibration;
use super::photometric::{PhotometricProblem, ViewPair};
use rayon::prelude::*;

/// Usable levels: darker ones are coarsely rounded, brighter ones clipped.
const USED: std::ops::RangeInclusive<u8> = 16..=240;

/// Minimum number of points of a pair.
const MIN_POINTS: usize = 60;

/// Weight of the prior, in pairs.
const PRIOR_WEIGHT: f64 = 0.01;

/// Maximum logarithm of gains that are treated as 1.
const NEGLIGIBLE: f64 = 0.01;

/// Number of Gauss-Seidel sweeps.
const SWEEPS: usize = 2000;

/// Maximum mean difference of levels with lines, as a share of that with gains alone.
const CLEARLY_BETTER: f64 = 0.95;

/// Number of times that a line is fitted to the points near the line before.
const FITS: usize = 4;

/// Maximum distance of these points from the line, levels.
const NEAR_LEVELS: f64 = 12.0;

/// Levels of the common points of two views.
struct CommonLevels {
    views: [usize; 2],
    levels: Vec<[[u8; 3]; 2]>,
}

/// The line `slope * level + offset` from levels of the second view to those of the first.
#[derive(Clone, Copy)]
struct Line {
    slope: f64,
    offset: f64,
}

/// For each view, the other views with which it has points in common, and the differences of its
/// values from theirs.
struct Differences(Vec<Vec<(usize, [f64; 3])>>);

/// Returns the exposures of all views.
pub(super) fn estimate(problem: &PhotometricProblem, calibration: &Calibration) -> Vec<Exposure> {
    let common: Vec<CommonLevels> = problem
        .pairs
        .par_iter()
        .filter_map(|pair| CommonLevels::new(problem, calibration, pair))
        .collect();
    let count = problem.views.len();
    let ratios: Vec<[Line; 3]> = common.par_iter().map(CommonLevels::ratios).collect();
    let gains = solve_gains(count, &common, &ratios);
    let lines: Vec<[Line; 3]> = common
        .par_iter()
        .zip(&ratios)
        .map(|(common, ratios)| [0, 1, 2].map(|c| common.line(c, ratios[c])))
        .collect();
    let with_offsets = solve_offsets(&common, &lines, &solve_gains(count, &common, &lines));
    let of_gains: Vec<Exposure> = gains
        .into_iter()
        .map(|gain| Exposure {
            gain,
            ..Exposure::EVEN
        })
        .collect();
    if mean_difference(&common, &with_offsets)
        < CLEARLY_BETTER * mean_difference(&common, &of_gains)
    {
        with_offsets
    } else {
        of_gains
    }
}

/// Gains whose ratios are the slopes of lines between views.
fn solve_gains(count: usize, common: &[CommonLevels], lines: &[[Line; 3]]) -> Vec<[f32; 3]> {
    let mut differences = Differences(vec![Vec::new(); count]);
    for (common, lines) in common.iter().zip(lines) {
        differences.add(common.views, lines.map(|line| line.slope.ln()));
    }
    let mut logs = differences.solve();
    // Equally exposed images stay unchanged to the last level.
    if logs.iter().flatten().all(|log| log.abs() < NEGLIGIBLE) {
        logs.fill([0.0; 3]);
    }
    logs.into_iter()
        .map(|log| log.map(|log| log.exp() as f32))
        .collect()
}

/// Exposures with these gains, and the offsets of lines between views.
fn solve_offsets(
    common: &[CommonLevels],
    lines: &[[Line; 3]],
    gains: &[[f32; 3]],
) -> Vec<Exposure> {
    // A point of level x in the set has a = g_a x + o_a in one view and b = g_b x + o_b in the
    // other, so that o_a / g_a - o_b / g_b = a / g_a - b / g_b. The mean point is used.
    let mut differences = Differences(vec![Vec::new(); gains.len()]);
    for (common, lines) in common.iter().zip(lines) {
        let [a, b] = common.views;
        let difference = |c: usize| {
            let [mean_a, mean_b] = common.means(c, lines[c]);
            mean_a / f64::from(gains[a][c]) - mean_b / f64::from(gains[b][c])
        };
        differences.add(common.views, [0, 1, 2].map(difference));
    }
    let offsets = differences.solve();
    gains
        .iter()
        .zip(offsets)
        .map(|(&gain, offset)| Exposure {
            gain,
            offset: [0, 1, 2].map(|c| offset[c] as f32 * gain[c]),
        })
        .collect()
}

/// Mean difference between the levels of common points after their exposures are evened out.
fn mean_difference(common: &[CommonLevels], exposures: &[Exposure]) -> f64 {
    let even = |view: usize, c: usize, level: u8| {
        let Exposure { gain, offset } = exposures[view];
        (f32::from(level) - offset[c]) / gain[c]
    };
    let mut sum = 0.0;
    let mut count = 0usize;
    for CommonLevels {
        views: [a, b],
        levels,
    } in common
    {
        for [of_a, of_b] in levels {
            for c in 0..3 {
                sum += f64::from((even(*a, c, of_a[c]) - even(*b, c, of_b[c])).abs());
            }
        }
        count += 3 * levels.len();
    }
    sum / count.max(1) as f64
}

impl CommonLevels {
    /// The usable levels of a pair; `None` if there are too few.
    fn new(
        problem: &PhotometricProblem,
        calibration: &Calibration,
        pair: &ViewPair,
    ) -> Option<Self> {
        let is_used = |levels: &[[u8; 3]; 2]| levels.iter().flatten().all(|it| USED.contains(it));
        let mut levels = problem.colors(calibration, pair);
        levels.retain(is_used);
        (levels.len() >= MIN_POINTS).then_some(Self {
            views: pair.views,
            levels,
        })
    }

    /// Lines through black: the median ratio of each channel.
    fn ratios(&self) -> [Line; 3] {
        [0, 1, 2].map(|c| {
            let mut logs: Vec<f64> = self
                .levels
                .iter()
                .map(|[a, b]| (f64::from(a[c]) / f64::from(b[c])).ln())
                .collect();
            let middle = logs.len() / 2;
            Line {
                slope: logs.select_nth_unstable_by(middle, f64::total_cmp).1.exp(),
                offset: 0.0,
            }
        })
    }

    /// Levels of a channel near a line.
    fn near(&self, c: usize, line: Line) -> impl Iterator<Item = [f64; 2]> {
        self.levels
            .iter()
            .map(move |levels| levels.map(|level| f64::from(level[c])))
            .filter(move |[a, b]| (a - line.slope * b - line.offset).abs() < NEAR_LEVELS)
    }

    /// Mean levels of both views near a line.
    fn means(&self, c: usize, line: Line) -> [f64; 2] {
        let mut sums = [0.0; 2];
        let mut count = 0;
        for [a, b] in self.near(c, line) {
            sums[0] += a;
            sums[1] += b;
            count += 1;
        }
        sums.map(|sum| sum / f64::from(count.max(1)))
    }

    /// The line of a channel, starting from `line`.
    fn line(&self, c: usize, mut line: Line) -> Line {
        for _ in 0..FITS {
            let [mean_a, mean_b] = self.means(c, line);
            let mut squares = [0.0; 2];
            let mut count = 0;
            for [a, b] in self.near(c, line) {
                squares[0] += (a - mean_a).powi(2);
                squares[1] += (b - mean_b).powi(2);
                count += 1;
            }
            let [of_a, of_b] = squares;
            if count < MIN_POINTS || of_a <= 0.0 || of_b <= 0.0 {
                break;
            }
            let slope = (of_a / of_b).sqrt();
            line = Line {
                slope,
                offset: mean_a - slope * mean_b,
            };
        }
        line
    }
}

impl Differences {
    fn add(&mut self, [a, b]: [usize; 2], difference: [f64; 3]) {
        self.0[a].push((b, difference));
        self.0[b].push((a, difference.map(|value| -value)));
    }

    /// The values of all views by least squares.
    fn solve(&self) -> Vec<[f64; 3]> {
        let mut values = vec![[0.0f64; 3]; self.0.len()];
        for _ in 0..SWEEPS {
            for (i, others) in self.0.iter().enumerate() {
                for c in 0..3 {
                    let sum: f64 = others.iter().map(|(j, by)| values[*j][c] + by[c]).sum();
                    values[i][c] = sum / (others.len() as f64 + PRIOR_WEIGHT);
                }
            }
        }
        values
    }
}
