//! Statistics: median and spread, pooled PSNR, Pareto front.

use headbox_core::statistics::quantile;
use serde::{Deserialize, Serialize};

/// Location and spread of a set of values; the default is 0 throughout.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// Mean.
    pub mean: f64,
    /// First and third quartile.
    pub quartiles: [f64; 2],
    /// 95th percentile.
    pub p95: f64,
    /// Maximum.
    pub worst: f64,
}

impl Spread {
    /// Computes the statistics of values in any order; `None` without values.
    pub fn from_values(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let quantile = |share| quantile(&sorted, share);
        Some(Self {
            median: quantile(0.5)?,
            mean: mean(values.iter().copied()),
            quartiles: [quantile(0.25)?, quantile(0.75)?],
            p95: quantile(0.95)?,
            worst: quantile(1.0)?,
        })
    }
}

/// Returns the mean squared error (values in 0..=1) of a PSNR in dB; 0 for an infinite one.
pub fn mse_from_psnr(psnr_db: f64) -> f64 {
    10f64.powf(-psnr_db / 10.0)
}

/// Returns the PSNR in dB of a mean squared error (values in 0..=1).
pub fn psnr_from_mse(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

/// Returns the PSNR of several images taken as one, dB: squared errors are averaged, not decibels.
pub fn pooled_psnr_db(psnr_db: impl IntoIterator<Item = f64>) -> f64 {
    psnr_from_mse(mean(psnr_db.into_iter().map(mse_from_psnr)))
}

/// Returns the arithmetic mean, NaN without values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values
        .into_iter()
        .fold((0.0, 0u32), |(sum, count), v| (sum + v, count + 1));
    sum / f64::from(count)
}

/// Returns the indices of the Pareto front of (cost, error) pairs in order of cost: the pairs that
/// no other pair dominates. Non-finite pairs are ignored.
pub fn pareto_front(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|&i| points[i].iter().all(|c| c.is_finite()))
        .collect();
    order.sort_by(|&a, &b| {
        points[a][0]
            .total_cmp(&points[b][0])
            .then(points[a][1].total_cmp(&points[b][1]))
    });
    let mut least_error = f64::INFINITY;
    let mut last = [f64::NAN; 2];
    order.retain(|&i| {
        let better = points[i][1] < least_error || points[i] == last;
        least_error = least_error.min(points[i][1]);
        if better {
            last = points[i];
        }
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_describes_values() {
        assert_eq!(Spread::from_values(&[]), None);
        let spread = Spread::from_values(&[4.0, 1.0, 2.0, 13.0]).expect("values");
        assert_eq!((spread.median, spread.mean, spread.worst), (3.0, 5.0, 13.0));
        assert_eq!(spread.quartiles, [1.75, 6.25]);
        assert!((spread.p95 - 11.65).abs() < 1e-12, "{}", spread.p95);
    }

    #[test]
    fn decibels_are_pooled_as_errors() {
        assert!((pooled_psnr_db([20.0, 20.0]) - 20.0).abs() < 1e-12);
        // The mean of a squared error and 0.
        assert!(
            (pooled_psnr_db([20.0, f64::INFINITY]) - (20.0 + 10.0 * 2f64.log10())).abs() < 1e-12
        );
        assert!(
            pooled_psnr_db([30.0, 10.0]) < 13.1,
            "the worse frame decides"
        );
    }

    #[test]
    fn pareto_front_has_no_dominated_points() {
        let points = [
            [1.0, 0.5],
            [2.0, 0.3],
            [3.0, 0.4],
            [2.0, 0.9],
            [9.0, 0.1],
            [0.5, f64::NAN],
            [1.0, 0.5],
        ];
        assert_eq!(
            pareto_front(&points),
            [0, 6, 1, 4],
            "equals belong together"
        );
        for (i, p) in points.iter().enumerate().filter(|(_, p)| p[1].is_finite()) {
            let beats = |q: &[f64; 2]| q[0] <= p[0] && q[1] <= p[1] && q != p;
            assert_eq!(
                pareto_front(&points).contains(&i),
                !points.iter().any(beats),
                "{p:?}"
            );
        }
        assert!(pareto_front(&[]).is_empty());
    }
}
