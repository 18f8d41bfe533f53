//! Filters of FLIP, as halves of their taps (see [`super::super::rows`]).

use std::f64::consts::PI;

/// Amplitude and squared scale (degrees squared) of a Gaussian `a sqrt(pi / b) exp(-pi^2 x^2 / b)`
/// of the contrast sensitivity functions; the paper's table 1.
type Gaussian = (f64, f64);
const LUMINANCE: Gaussian = (1.0, 0.0047);
const RED_GREEN: Gaussian = (1.0, 0.0053);
const BLUE_YELLOW: [Gaussian; 2] = [(34.1, 0.04), (13.5, 0.025)];

/// Width of the feature detectors, degrees (w in the paper); their standard deviation is half of
/// it.
const FEATURE_WIDTH_DEG: f64 = 0.082;

/// All filters for a number of pixels per degree.
pub(super) struct FilterWeights {
    /// Blur of luminance; its taps, both sides counted, sum to 1.
    pub(super) luminance: Vec<f32>,
    /// Blur of red-green; sums to 1.
    pub(super) red_green: Vec<f32>,
    /// Blur of blue-yellow, the sum of two Gaussians: each alone is separable, and the two results
    /// are added.
    pub(super) blue_yellow: [Vec<f32>; 2],
    /// Gaussian of the feature detectors; sums to 1.
    pub(super) feature: Vec<f32>,
    /// First derivative of `feature`; each side sums to 1 in magnitude. The centre is 0.
    pub(super) slope: Vec<f32>,
    /// Second derivative of `feature`; positive taps sum to 1, negative ones to -1. The centre is
    /// minus twice the sum of the others, which `rows::derive` relies on.
    pub(super) curvature: Vec<f32>,
}

impl FilterWeights {
    pub(super) fn new(pixels_per_degree: f64) -> Self {
        // All contrast filters have a radius of three standard deviations of the widest Gaussian.
        let widest = BLUE_YELLOW[0].1.max(BLUE_YELLOW[1].1);
        let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as usize;
        let half = |scale: f64, amplitude: f64| -> Vec<f64> {
            (0..=radius)
                .map(|k| k as f64 / pixels_per_degree)
                .map(|degrees| amplitude * (-PI * PI * degrees * degrees / scale).exp())
                .collect()
        };
        // A plane is filtered by the same taps across and down, so each direction gets the root of
        // the amplitude.
        let [wide, narrow] = BLUE_YELLOW.map(|(a, b)| half(b, (a * (PI / b).sqrt()).sqrt()));
        let blue_yellow_total = (total(&wide).powi(2) + total(&narrow).powi(2)).sqrt();
        let unit = |taps: Vec<f64>| divide(&taps, total(&taps));

        let sigma = 0.5 * FEATURE_WIDTH_DEG * pixels_per_degree;
        let feature: Vec<f64> = (0..=(3.0 * sigma).ceil() as usize)
            .map(|k| k as f64)
            .map(|x| (-x * x / (2.0 * sigma * sigma)).exp())
            .collect();
        let times = |factor: &dyn Fn(f64) -> f64| -> Vec<f64> {
            feature
                .iter()
                .enumerate()
                .map(|(k, g)| factor(k as f64) * g)
                .collect()
        };
        Self {
            luminance: unit(half(LUMINANCE.1, 1.0)),
            red_green: unit(half(RED_GREEN.1, 1.0)),
            blue_yellow: [
                divide(&wide, blue_yellow_total),
                divide(&narrow, blue_yellow_total),
            ],
            slope: normalise_sides(&times(&|x| x)),
            curvature: normalise_signs(&times(&|x| x * x / (sigma * sigma) - 1.0)),
            feature: unit(feature),
        }
    }

    /// Returns the largest radius, pixels.
    pub(super) fn radius(&self) -> usize {
        self.luminance.len().max(self.feature.len()) - 1
    }
}

/// Sums a whole filter, given half of its taps.
fn total(half: &[f64]) -> f64 {
    half[0] + 2.0 * half[1..].iter().sum::<f64>()
}

fn divide(taps: &[f64], divisor: f64) -> Vec<f32> {
    taps.iter().map(|tap| (tap / divisor) as f32).collect()
}

/// Scales an antisymmetric filter so that each side sums to 1 in magnitude.
fn normalise_sides(half: &[f64]) -> Vec<f32> {
    divide(half, half.iter().sum())
}

/// Scales a symmetric filter so that its positive taps sum to 1 and the negative ones to -1.
fn normalise_signs(half: &[f64]) -> Vec<f32> {
    let part = |keep: fn(f64) -> bool| -> f64 {
        total(
            &half
                .iter()
                .map(|&tap| if keep(tap) { tap } else { 0.0 })
                .collect::<Vec<_>>(),
        )
        .abs()
    };
    let (positive, negative) = (part(|tap| tap > 0.0), part(|tap| tap < 0.0));
    half.iter()
        .map(|&tap| (tap / if tap > 0.0 { positive } else { negative }) as f32)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::{DEFAULT_PIXELS_PER_DEGREE, MAX_PIXELS_PER_DEGREE, MIN_PIXELS_PER_DEGREE};

    #[test]
    fn filters_normalised_for_all_viewing_conditions() {
        /// Taps are rounded to f32 one by one: at most 2^-24 of their sum, which is 1.
        const ROUNDING: f64 = 1e-7;
        for ppd in [
            MIN_PIXELS_PER_DEGREE,
            5.5,
            DEFAULT_PIXELS_PER_DEGREE,
            MAX_PIXELS_PER_DEGREE,
        ] {
            let weights = FilterWeights::new(f64::from(ppd));
            let sum =
                |taps: &[f32]| total(&taps.iter().map(|&tap| f64::from(tap)).collect::<Vec<_>>());
            for taps in [&weights.luminance, &weights.red_green, &weights.feature] {
                assert!((sum(taps) - 1.0).abs() < ROUNDING);
            }
            let [wide, narrow] = &weights.blue_yellow;
            assert!((sum(wide).powi(2) + sum(narrow).powi(2) - 1.0).abs() < 2.0 * ROUNDING);
            assert!(
                (weights.slope.iter().map(|&tap| f64::from(tap)).sum::<f64>() - 1.0).abs()
                    < ROUNDING
            );
            assert!(sum(&weights.curvature).abs() < ROUNDING);
            assert!(weights.curvature.iter().all(|tap| tap.is_finite()));
        }
    }

    #[test]
    fn default_radii_match_reference_evaluator() {
        let weights = FilterWeights::new(f64::from(DEFAULT_PIXELS_PER_DEGREE));
        assert_eq!((weights.luminance.len(), weights.feature.len()), (11, 10));
    }
}
