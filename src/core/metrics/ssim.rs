//! Mean structural similarity with Gaussian windows.
//!
//! Z. Wang, A. C. Bovik, H. R. Sheikh, E. P. Simoncelli, "Image Quality Assessment: From Error
//! Visibility to Structural Similarity", 2004, as scikit-image computes it with
//! `gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=255,
//! channel_axis=-1`: windows of 11x11 pixels, the mean over red, green and blue on sRGB values.

use ::image::RgbImage;
use fearless_simd::Level;
use rayon::prelude::*;

use super::comparable::{MetricError, check_sizes};
use super::rows::{RowRing, across, padded_len, smooth};
use crate::simd;

/// Standard deviation of the window, pixels.
const SIGMA: f64 = 1.5;
/// Radius of a window, pixels: 3.5 standard deviations, rounded.
const RADIUS: usize = 5;
/// Constants C1 and C2 that stabilise the quotients, (K L)^2 with K = 0.01 and 0.03, L = 255.
const STABLE_MEAN: f64 = 0.01 * 255.0 * 0.01 * 255.0;
const STABLE_VARIANCE: f64 = 0.03 * 255.0 * 0.03 * 255.0;
/// Rows per task.
const BAND_ROWS: usize = 64;
/// Quantities averaged over windows: both values, the sum of their squares, and their product.
const MOMENTS: usize = 4;

/// Computes the mean structural similarity of two images: 1 for equal ones, possibly negative for
/// opposite ones.
///
/// The mean is taken over the windows that lie inside the image. If the image is smaller than a
/// window in a direction, windows around every pixel are used in that direction, over the image
/// reflected at its borders (scikit-image rejects such images).
///
/// # Errors
/// If the sizes differ or the images have no pixels.
pub fn ssim(reference: &RgbImage, test: &RgbImage) -> Result<f64, MetricError> {
    check_sizes(reference, test)?;
    Ok(ssim_at(simd::level(), reference, test))
}

/// Same as [`ssim`] for checked images at a SIMD level.
fn ssim_at(level: Level, reference: &RgbImage, test: &RgbImage) -> f64 {
    let columns = window_centers(reference.width() as usize);
    let rows = window_centers(reference.height() as usize);
    let tasks: Vec<(usize, usize)> = (0..3)
        .flat_map(|channel| {
            rows.clone()
                .step_by(BAND_ROWS)
                .map(move |row| (channel, row))
        })
        .collect();
    let sums: Vec<f64> = tasks
        .into_par_iter()
        .map(|(channel, row)| {
            let band = row..(row + BAND_ROWS).min(rows.end);
            Channel {
                level,
                taps: taps(),
                images: [reference, test],
                channel,
                columns: columns.clone(),
            }
            .sum(band)
        })
        .collect();
    // Summed in the order of the tasks: the mean does not depend on the number of threads.
    sums.iter().sum::<f64>() / (3 * columns.len() * rows.len()) as f64
}

type Range = std::ops::Range<usize>;

/// Returns the centres of the windows along an axis of the image.
fn window_centers(len: usize) -> Range {
    if len > 2 * RADIUS {
        RADIUS..len - RADIUS
    } else {
        0..len
    }
}

/// Returns half of the taps of the window.
fn taps() -> [f64; RADIUS + 1] {
    let taps = std::array::from_fn::<f64, { RADIUS + 1 }, _>(|k| {
        (-0.5 * (k as f64 / SIGMA).powi(2)).exp()
    });
    let total = taps[0] + 2.0 * taps[1..].iter().sum::<f64>();
    taps.map(|tap| tap / total)
}

/// Color channel of both images.
struct Channel<'a> {
    level: Level,
    taps: [f64; RADIUS + 1],
    images: [&'a RgbImage; 2],
    channel: usize,
    columns: Range,
}

impl Channel<'_> {
    /// Sums the structural similarity over a band of windows.
    fn sum(&self, band: Range) -> f64 {
        let len = padded_len(self.columns.len());
        let radius = RADIUS as isize;
        let mut padded: [Vec<f64>; MOMENTS] = std::array::from_fn(|_| vec![0.0; len + 2 * RADIUS]);
        let mut means: [Vec<f64>; MOMENTS] = std::array::from_fn(|_| vec![0.0; len]);
        let mut ring = RowRing::new(RADIUS, MOMENTS, len);
        let (first, end) = (band.start as isize, band.end as isize);
        for y in first - radius..first + radius {
            self.filter_across(y, &mut padded, &mut ring);
        }
        let mut sum = 0.0;
        for y in first..end {
            self.filter_across(y + radius, &mut padded, &mut ring);
            for (plane, mean) in means.iter_mut().enumerate() {
                smooth(self.level, &self.taps, &ring.down(y, RADIUS, plane), mean);
            }
            let [a, b, squares, products] = &means;
            sum += (0..self.columns.len())
                .map(|i| similarity(a[i], b[i], squares[i], products[i]))
                .sum::<f64>();
        }
        sum
    }

    /// Fills row `y` of the ring with the moments of both images, averaged across.
    fn filter_across(&self, y: isize, padded: &mut [Vec<f64>; MOMENTS], ring: &mut RowRing<f64>) {
        let (width, height) = self.images[0].dimensions();
        let first_byte = reflect(y, height as usize) * width as usize * 3 + self.channel;
        let rows = self.images.map(|image| &image.as_raw()[first_byte..]);
        for i in 0..self.columns.len() + 2 * RADIUS {
            let x = reflect(
                (self.columns.start + i) as isize - RADIUS as isize,
                width as usize,
            );
            let [a, b] = rows.map(|row| f64::from(row[3 * x]));
            for (plane, moment) in padded.iter_mut().zip([a, b, a * a + b * b, a * b]) {
                plane[i] = moment;
            }
        }
        for (source, out) in padded.iter().zip(ring.row_mut(y)) {
            smooth(
                self.level,
                &self.taps,
                &across(source, RADIUS, out.len()),
                out,
            );
        }
    }
}

/// Computes the structural similarity of a window from the means of both values, of the sum of
/// their squares, and of their product.
fn similarity(a: f64, b: f64, squares: f64, products: f64) -> f64 {
    let (mean_product, mean_squares) = (a * b, a * a + b * b);
    let covariance = products - mean_product;
    let variances = squares - mean_squares;
    ((2.0 * mean_product + STABLE_MEAN) * (2.0 * covariance + STABLE_VARIANCE))
        / ((mean_squares + STABLE_MEAN) * (variances + STABLE_VARIANCE))
}

/// Returns the index of `i` after reflection at the borders of 0..len, which repeats the border
/// elements: 1 0 | 0 1 2 | 2 1.
fn reflect(i: isize, len: usize) -> usize {
    let period = 2 * len;
    let i = i.rem_euclid(period as isize) as usize;
    i.min(period - 1 - i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::rows::tests::{levels, noise};

    #[test]
    fn no_simd_level_changes_a_bit() {
        let images = [1, 2].map(|seed| noise(77, 41, seed));
        let figures: Vec<f64> = levels()
            .into_iter()
            .map(|level| ssim_at(level, &images[0], &images[1]))
            .collect();
        assert!(
            figures
                .windows(2)
                .all(|pair| pair[0].to_bits() == pair[1].to_bits()),
            "{figures:?}"
        );
    }

    #[test]
    fn borders_belong_to_the_reflected_image() {
        assert_eq!(
            [-4, -3, -2, -1, 0, 1, 2, 3, 4].map(|i| reflect(i, 3)),
            [2, 2, 1, 0, 0, 1, 2, 2, 1]
        );
        assert!([-5, 0, 7].into_iter().all(|i| reflect(i, 1) == 0));
    }
}
