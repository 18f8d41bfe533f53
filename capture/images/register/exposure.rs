//! Relative exposure of the views, channel by channel: automatic exposure and white balance.
//!
//! A power law turns a factor of light into a factor of levels, whatever its exponent. So the
//! logarithms of the views' gains differ by the median logarithm of the ratio of the levels at
//! common points. They are solved by least squares over all pairs, with a mean of 0 and a weak
//! prior for views without pairs.

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

/// Returns the gains of all views: levels divided by them have equal exposure.
pub(super) fn estimate(problem: &PhotometricProblem, calibration: &Calibration) -> Vec<[f32; 3]> {
    let ratios: Vec<Option<[f64; 3]>> = problem
        .pairs
        .par_iter()
        .map(|pair| log_ratios(problem, calibration, pair))
        .collect();
    let mut view_pairs = vec![Vec::new(); problem.views.len()];
    for (pair, ratio) in problem.pairs.iter().zip(&ratios) {
        let [i, j] = pair.views;
        if let Some(ratio) = ratio {
            view_pairs[i].push((j, *ratio));
            view_pairs[j].push((i, ratio.map(|r| -r)));
        }
    }
    let mut logs = vec![[0.0f64; 3]; view_pairs.len()];
    for _ in 0..SWEEPS {
        for (i, pairs) in view_pairs.iter().enumerate() {
            for c in 0..3 {
                let sum: f64 = pairs.iter().map(|(j, ratio)| logs[*j][c] + ratio[c]).sum();
                logs[i][c] = sum / (pairs.len() as f64 + PRIOR_WEIGHT);
            }
        }
    }
    // Equally exposed images stay unchanged to the last level.
    if logs.iter().flatten().all(|log| log.abs() < NEGLIGIBLE) {
        logs.fill([0.0; 3]);
    }
    logs.into_iter()
        .map(|log| log.map(|log| log.exp() as f32))
        .collect()
}

fn log_ratios(
    problem: &PhotometricProblem,
    calibration: &Calibration,
    pair: &ViewPair,
) -> Option<[f64; 3]> {
    let used = |colors: &[[u8; 3]; 2]| colors.iter().flatten().all(|level| USED.contains(level));
    let colors: Vec<[[u8; 3]; 2]> = problem
        .colors(calibration, pair)
        .into_iter()
        .filter(used)
        .collect();
    (colors.len() >= MIN_POINTS).then(|| {
        [0, 1, 2].map(|c| {
            let mut logs: Vec<f64> = colors
                .iter()
                .map(|[a, b]| (f64::from(a[c]) / f64::from(b[c])).ln())
                .collect();
            let middle = logs.len() / 2;
            *logs.select_nth_unstable_by(middle, f64::total_cmp).1
        })
    })
}
