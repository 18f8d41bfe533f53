//! Error of an image against noisy references.

use super::comparable::{MetricError, SCAN_BYTES, check_sizes};
use ::image::RgbImage;
use rayon::prelude::*;

/// Error of an image, without the noise of the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnbiasedError {
    /// Mean squared error of values in 0..=1; the estimate may be negative.
    pub mse: f64,
    /// Its standard error.
    pub standard_error: f64,
}

/// Estimates the error of an image against the mean of two references with independent noise: the
/// mean product of its differences from both. It is free of their noise, which the mean square of
/// either difference would contain.
///
/// # Errors
/// If the sizes differ or the images have no pixels.
pub fn own_error(
    [first, second]: [&RgbImage; 2],
    test: &RgbImage,
) -> Result<UnbiasedError, MetricError> {
    check_sizes(first, test)?;
    check_sizes(second, test)?;
    let product = |((a, b), t): ((&u8, &u8), &u8)| {
        let [a, b] = [a, b].map(|level| (f64::from(*t) - f64::from(*level)) / 255.0);
        a * b
    };
    let chunks = first
        .par_chunks(SCAN_BYTES)
        .zip(second.par_chunks(SCAN_BYTES))
        .zip(test.par_chunks(SCAN_BYTES));
    let sums = chunks.map(|((a, b), t)| {
        let products = a.iter().zip(b).zip(t).map(product);
        products.fold([0.0, 0.0], |[sum, squares], product| {
            [sum + product, squares + product * product]
        })
    });
    // Collected, so that the order of summation does not depend on the number of threads.
    let sums: Vec<[f64; 2]> = sums.collect();
    let count = test.len() as f64;
    let [mse, square] = [0, 1].map(|i| sums.iter().map(|sum| sum[i]).sum::<f64>() / count);
    Ok(UnbiasedError {
        mse,
        standard_error: ((square - mse * mse).max(0.0) / count).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Rng;
    use ::image::Rgb;

    #[test]
    fn own_error_excludes_reference_noise() {
        let mut rng = Rng::new(7);
        let mut noisy = || {
            RgbImage::from_fn(64, 48, |_, _| {
                Rgb([0; 3].map(|_: u8| 100 + rng.below(61) as u8))
            })
        };
        let [a, b] = &[noisy(), noisy()];
        let off = RgbImage::from_pixel(64, 48, Rgb([136; 3]));
        let own = own_error([a, b], &off).expect("sizes fit");
        // Levels of 100 to 160 are noisy about 130 by 17.6 levels.
        let expected = (6.0f64 / 255.0).powi(2);
        assert!(
            (own.mse - expected).abs() < 3.0 * own.standard_error,
            "{own:?} for {expected}"
        );
        assert!(own.standard_error < 0.2 * expected, "{own:?}");
        let seen = own_error([a, a], &off).expect("sizes fit").mse;
        assert!(
            seen > 8.0 * expected,
            "most of what is seen is noise: {seen}"
        );
        let same = own_error([&off, &off], &off).expect("sizes fit");
        assert_eq!(
            same,
            UnbiasedError {
                mse: 0.0,
                standard_error: 0.0
            }
        );
        assert!(own_error([a, &RgbImage::new(1, 1)], &off).is_err());
    }
}
