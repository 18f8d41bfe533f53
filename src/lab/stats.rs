//! Medians, spreads, means of decibels, and what nothing beats.

use headbox_core::statistics::quantile;
use serde::{Deserialize, Serialize};

/// The middle of some values and how far they spread; all 0 of none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// Mean.
    pub mean: f64,
    /// First and third quartile.
    pub quartiles: [f64; 2],
    /// The value that 95 % do not exceed.
    pub p95: f64,
    /// The largest.
    pub worst: f64,
}

impl Spread {
    /// Computes the statistics of values in any order; `None` if there are none.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |share| quantile(&sorted, share);
        let quartiles = [at(0.25)?, at(0.75)?];
        Some(Self {
            median: at(0.5)?,
            mean: mean(values.iter().copied()),
            quartiles,
            p95: at(0.95)?,
            worst: at(1.0)?,
        })
    }
}

/// Mean squared error of values in 0..=1 that a PSNR stands for; 0 for an infinite one.
pub fn mse_of_psnr(psnr_db: f64) -> f64 {
    10f64.powf(-psnr_db / 10.0)
}

/// PSNR of a mean squared error of values in 0..=1, dB.
pub fn psnr_of_mse(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

/// The PSNR of several images taken as one, dB: the mean is over squared errors, not over decibels.
pub fn pooled_psnr_db(psnr_db: impl IntoIterator<Item = f64>) -> f64 {
    psnr_of_mse(mean(psnr_db.into_iter().map(mse_of_psnr)))
}

/// Arithmetic mean; NaN of nothing.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values
        .into_iter()
        .fold((0.0, 0u32), |(sum, count), v| (sum + v, count + 1));
    sum / f64::from(count)
}

/// Pareto front of (cost, error) pairs: those for which no other costs at most as much and errs at
/// most as much, one of the two by less. In order of cost; non-finite pairs are ignored.
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
        assert_eq!(Spread::of(&[]), None);
        let spread = Spread::of(&[4.0, 1.0, 2.0, 13.0]).expect("values");
        assert_eq!((spread.median, spread.mean, spread.worst), (3.0, 5.0, 13.0));
        assert_eq!(spread.quartiles, [1.75, 6.25]);
        assert!((spread.p95 - 11.65).abs() < 1e-12, "{}", spread.p95);
    }

    #[test]
    fn decibels_are_pooled_as_errors() {
        assert!((pooled_psnr_db([20.0, 20.0]) - 20.0).abs() < 1e-12);
        // Half of the squared error of one of two.
        assert!(
            (pooled_psnr_db([20.0, f64::INFINITY]) - (20.0 + 10.0 * 2f64.log10())).abs() < 1e-12
        );
        assert!(
            pooled_psnr_db([30.0, 10.0]) < 13.1,
            "the worse frame decides"
        );
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
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
