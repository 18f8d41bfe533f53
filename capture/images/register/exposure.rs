//! How much brighter a view is than the others, channel by channel: automatic exposure and white balance.
//!
//! A power law turns a factor of light into a factor of levels, whatever its exponent. So the logarithms of the views' gains differ
//! by the median logarithm of the ratio of the levels in which they see the same points; least squares over all pairs,
//! gains of mean 0, with a weak prior that holds views without pairs.

use super::photometric::{Pair, Problem};
use super::state::State;
use rayon::prelude::*;

/// Levels outside tell little: dark ones are rounded, bright ones clipped.
const USED: std::ops::RangeInclusive<u8> = 16..=240;

/// Pairs with fewer points are left out.
const LEAST_POINTS: usize = 60;

/// The prior's weight, in pairs.
const PRIOR: f64 = 0.01;

/// Gains that are all nearer to one than this are none.
const ALIKE: f64 = 0.01;

/// Sweeps of Gauss-Seidel.
const SWEEPS: usize = 2000;

/// Gains of all views: levels divided by them are those of one exposure.
pub(super) fn estimate(problem: &Problem, state: &State) -> Vec<[f32; 3]> {
    let ratios: Vec<Option<[f64; 3]>> = problem
        .pairs()
        .par_iter()
        .map(|pair| log_ratios(problem, state, pair))
        .collect();
    let mut pairs_of = vec![Vec::new(); problem.evidence.len()];
    for (pair, ratio) in problem.pairs().iter().zip(&ratios) {
        let [i, j] = pair.views;
        if let Some(ratio) = ratio {
            pairs_of[i].push((j, *ratio));
            pairs_of[j].push((i, ratio.map(|r| -r)));
        }
    }
    let mut logs = vec![[0.0f64; 3]; pairs_of.len()];
    for _ in 0..SWEEPS {
        for (i, pairs) in pairs_of.iter().enumerate() {
            for c in 0..3 {
                let sum: f64 = pairs.iter().map(|(j, ratio)| logs[*j][c] + ratio[c]).sum();
                logs[i][c] = sum / (pairs.len() as f64 + PRIOR);
            }
        }
    }
    // Of pictures that were exposed alike not a level changes.
    if logs.iter().flatten().all(|log| log.abs() < ALIKE) {
        logs.fill([0.0; 3]);
    }
    logs.into_iter()
        .map(|log| log.map(|log| log.exp() as f32))
        .collect()
}

fn log_ratios(problem: &Problem, state: &State, pair: &Pair) -> Option<[f64; 3]> {
    let used = |colors: &[[u8; 3]; 2]| colors.iter().flatten().all(|level| USED.contains(level));
    let colors: Vec<[[u8; 3]; 2]> = problem
        .colors(state, pair)
        .into_iter()
        .filter(used)
        .collect();
    (colors.len() >= LEAST_POINTS).then(|| {
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
