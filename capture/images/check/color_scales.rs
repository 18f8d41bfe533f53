//! Unit of depth by colours: cameras that move sideways along a wall see the same depth in any
//! unit, but not the same colours.

use crate::depth_evidence::{FLOAT_FACTORS, INTEGER_FACTORS};
use crate::views::seen_points::{SeenPoints, sampling_step};
use crate::views::view::LoadedView;
use rayon::prelude::*;

/// Number of factors on either side of 1.
const SIDE: usize = 48;

/// Factors in each doubling.
const PER_DOUBLING: f64 = 8.0;

/// Number of sampled columns and rows of a view.
const SAMPLES: u32 = 64;

/// Colour difference above which views disagree, levels of 255.
const MAX_LEVELS: f64 = 6.0;

/// Colour difference above which views disagree even if no factor on depth explains it.
const MAX_UNEXPLAINED: f64 = 48.0;

/// Factor by which the difference shrinks with the right unit.
const IMPROVEMENT: f64 = 0.4;

/// Share of the sampled points that both views see, at least.
const OVERLAP: f64 = 0.3;

/// Relative depth difference above which a point is hidden.
const HIDDEN: f64 = 0.05;

/// Colour differences of neighbours for factors on depth.
#[derive(Default)]
pub(super) struct ColorScales {
    /// For each pair, the mean difference of each factor, levels; NaN without overlap.
    pairs: Vec<Vec<f64>>,
}

/// Doubt about depth, from colours.
pub(super) struct ColorDoubt {
    pub(super) sentence: String,
    /// True if another unit explains the colours.
    pub(super) is_of_unit: bool,
}

impl ColorScales {
    /// Compares the points of `a` with the colours of `b` where they project to.
    pub(super) fn add(&mut self, a: &LoadedView, b: &LoadedView) {
        let factors = (0..=2 * SIDE).into_par_iter();
        let levels = factors.map(|i| mean_levels(a, b, factor(i)));
        self.pairs.push(levels.collect());
    }

    /// Returns a doubt if colours agree only with another unit, or with none.
    pub(super) fn doubt(&self) -> Option<ColorDoubt> {
        let means: Vec<f64> = (0..=2 * SIDE)
            .map(|i| {
                let known = self
                    .pairs
                    .iter()
                    .map(|pair| pair[i])
                    .filter(|it| !it.is_nan());
                let known: Vec<f64> = known.collect();
                // Factors for which few pairs overlap are no evidence.
                if known.len() * 2 > self.pairs.len() {
                    known.iter().sum::<f64>() / known.len() as f64
                } else {
                    f64::NAN
                }
            })
            .collect();
        let given = means.get(SIDE).copied().filter(|it| *it > MAX_LEVELS)?;
        let smallest = means.iter().copied().fold(f64::INFINITY, f64::min);
        // Repeated textures agree for several factors: the one nearest to 1 is taken.
        let limit = 1.5 * smallest + 1.0;
        let good = (0..means.len()).filter(|&i| means[i] <= limit);
        let mut best = good.min_by_key(|i| i.abs_diff(SIDE))?;
        while let Some(lower) = [best.wrapping_sub(1), best + 1]
            .into_iter()
            .find(|&i| means.get(i).is_some_and(|it| *it < means[best]))
        {
            best = lower;
        }
        let levels = means[best];
        if levels < IMPROVEMENT * given && best.abs_diff(SIDE) > 1 {
            let sentence = format!(
                "colours of the same points differ by {given:.0} levels of 255, but only by {levels:.0} if depth is multiplied by \
                 the factor {:.3}: the unit of depth or of the poses may be wrong",
                usual_factor(factor(best))
            );
            return Some(ColorDoubt {
                sentence,
                is_of_unit: true,
            });
        }
        (given > MAX_UNEXPLAINED).then(|| ColorDoubt {
            sentence: format!(
                "colours of the same points differ by {given:.0} levels of 255 on average: the poses, the unit of depth or its \
                 kind may be wrong, or exposures differ"
            ),
            is_of_unit: false,
        })
    }
}

fn factor(index: usize) -> f64 {
    ((index as f64 - SIDE as f64) / PER_DOUBLING).exp2()
}

/// Returns the ratio of two usual units nearest to a factor, or the factor itself if it is far from
/// all: the factors that are tried are a tenth apart.
fn usual_factor(factor: f64) -> f64 {
    const NEAR: f64 = 0.06;
    let units = INTEGER_FACTORS.into_iter().chain(FLOAT_FACTORS);
    let factors = units.flat_map(|unit| [unit, 1.0 / unit]);
    let distance = |usual: &f64| (usual / factor).ln().abs();
    factors
        .filter(|usual| distance(usual) < NEAR)
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(factor)
}

/// Returns the mean colour difference of the points that both see, with depth times `factor`; NaN
/// if they are few.
fn mean_levels(a: &LoadedView, b: &LoadedView, factor: f64) -> f64 {
    let points = SeenPoints::new(a, b, sampling_step(a.size_px, SAMPLES), factor, false);
    let unhidden = points.seen.iter();
    let unhidden = unhidden.filter(|point| (point.depth_ratio - 1.0).abs() <= HIDDEN);
    let levels: Vec<f64> = unhidden
        .filter_map(|point| point.color_levels(a, b))
        .collect();
    if levels.len() as f64 > OVERLAP * points.points.max(1) as f64 {
        levels.iter().sum::<f64>() / levels.len() as f64
    } else {
        f64::NAN
    }
}
