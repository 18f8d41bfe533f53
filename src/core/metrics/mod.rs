//! Image metrics: FLIP, PSNR, SSIM and the share of differing pixels.
//!
//! All metrics take 8-bit sRGB images of equal size and are deterministic: the same images give the
//! same values on any number of threads and at every SIMD level.
//!
//! ```
//! use image::{Rgb, RgbImage};
//!
//! let truth = RgbImage::from_pixel(16, 16, Rgb([90, 120, 200]));
//! let mut frame = truth.clone();
//! assert!(headbox_core::metrics::compare(&truth, &frame).unwrap().psnr_db.is_infinite());
//! frame.put_pixel(3, 4, Rgb([0, 0, 0]));
//! assert_eq!(headbox_core::metrics::compare(&truth, &frame).unwrap().differing_fraction, 1.0 / 256.0);
//! ```

mod comparable;
mod flip;
mod magma;
mod own_error;
mod rows;
pub mod ssim;

use ::image::RgbImage;
use comparable::{SCAN_BYTES, check_sizes};
use rayon::prelude::*;

pub use comparable::{MAX_PIXELS_PER_DEGREE, MIN_PIXELS_PER_DEGREE, MetricError};
pub use flip::{DEFAULT_PIXELS_PER_DEGREE, FlipMap, flip_map};
pub use own_error::{UnbiasedError, own_error};
pub use ssim::ssim;

/// Metrics of `headbox compare` and of every row of a report.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Comparison {
    /// Mean LDR-FLIP under the default viewing conditions, 0 (equal) to 1.
    pub flip: f64,
    /// Peak signal-to-noise ratio in dB; infinite for equal images, which JSON shows as `null`.
    #[serde(with = "infinite_as_null")]
    pub psnr_db: f64,
    /// Mean structural similarity, 1 for equal images.
    pub ssim: f64,
    /// Share of pixels of which any channel differs, 0..=1.
    pub differing_fraction: f64,
}

/// Serialisation of infinity, which JSON lacks: written as `null` and read back as positive
/// infinity.
pub mod infinite_as_null {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// Writes infinity as null.
    pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        value.is_finite().then_some(*value).serialize(serializer)
    }

    /// Reads null as infinity.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}

/// Computes all metrics of two images of equal size, FLIP under the default viewing conditions.
///
/// # Errors
/// If the sizes differ or the images have no pixels.
pub fn compare(reference: &RgbImage, test: &RgbImage) -> Result<Comparison, MetricError> {
    compare_with_map(reference, test).map(|(comparison, _)| comparison)
}

/// Same as [`compare`]; also returns the FLIP map.
///
/// # Errors
/// If the sizes differ or the images have no pixels.
pub fn compare_with_map(
    reference: &RgbImage,
    test: &RgbImage,
) -> Result<(Comparison, FlipMap), MetricError> {
    let map = flip_map(reference, test, DEFAULT_PIXELS_PER_DEGREE)?;
    let comparison = Comparison {
        flip: map.mean,
        psnr_db: psnr_db(reference, test)?,
        ssim: ssim(reference, test)?,
        differing_fraction: differing_fraction(reference, test)?,
    };
    Ok((comparison, map))
}

/// Peak signal-to-noise ratio over the 8-bit sRGB values of all channels, dB: `10 log10(255^2 /
/// mean squared error)`. Infinite for equal images.
///
/// # Errors
/// If the sizes differ or the images have no pixels.
pub fn psnr_db(reference: &RgbImage, test: &RgbImage) -> Result<f64, MetricError> {
    check_sizes(reference, test)?;
    let squared_error: u64 = reference
        .par_chunks(SCAN_BYTES)
        .zip(test.par_chunks(SCAN_BYTES))
        .map(|(a, b)| {
            a.iter()
                .zip(b)
                .map(|(&a, &b)| u32::from(a.abs_diff(b)).pow(2))
                .sum::<u32>()
        })
        .map(u64::from)
        .sum();
    let mean = squared_error as f64 / reference.len() as f64;
    Ok(10.0 * (255.0 * 255.0 / mean).log10())
}

/// Share of pixels of which any channel differs, 0..=1.
///
/// # Errors
/// If the sizes differ or the images have no pixels.
pub fn differing_fraction(reference: &RgbImage, test: &RgbImage) -> Result<f64, MetricError> {
    check_sizes(reference, test)?;
    let differing: usize = reference
        .par_chunks(SCAN_BYTES)
        .zip(test.par_chunks(SCAN_BYTES))
        .map(|(a, b)| {
            a.chunks_exact(3)
                .zip(b.chunks_exact(3))
                .filter(|(a, b)| a != b)
                .count()
        })
        .sum();
    Ok(differing as f64 / (reference.len() / 3) as f64)
}
