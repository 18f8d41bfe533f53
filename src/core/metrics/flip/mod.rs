//! LDR-FLIP: the visibility of differences to a viewer who flips between two images.
//!
//! P. Andersson, J. Nilsson, T. Akenine-Moller, M. Oskarsson, K. Astrom, M. Fairchild, "FLIP: A
//! Difference Evaluator for Alternating Images", HPG 2020. Implemented from the paper's definition,
//! with the separation of its filters into rows and columns of the authors' note on separated
//! convolutions; checked against their evaluator in `tests/library/metrics/flip.rs`.
//!
//! The pipeline of a pixel: sRGB -> linear opponent color -> [`weights`] blur like the eye at this
//! distance -> [`color`] difference; in parallel, luminance -> edges and points -> feature
//! difference; error = color difference ^ (1 - feature difference). Images are processed in bands
//! of rows, each with a short ring buffer of rows that are filtered across and not yet down, so
//! that the working set stays in the cache of one core.

mod color;
mod math;
mod weights;

use ::image::RgbImage;
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

use self::color::{ColorSpace, FilteredRow, row_errors};
use self::weights::FilterWeights;
use super::comparable::{MAX_PIXELS_PER_DEGREE, MIN_PIXELS_PER_DEGREE, MetricError, check_sizes};
use super::rows::{RowRing, across, derive, padded_len, smooth};
use crate::metrics::magma;
use crate::simd;

/// Default viewing condition: a display 3840 pixels and 0.7 m wide, seen from 0.7 m:
/// `3840 pi / 180` pixels per degree.
pub const DEFAULT_PIXELS_PER_DEGREE: f32 = 67.020_64;

/// FLIP error of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct FlipMap {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Errors in 0 (equal) ..=1, row by row from the top.
    pub errors: Vec<f32>,
    /// Mean of the errors.
    pub mean: f64,
}

impl FlipMap {
    /// Converts the map to an image in the magma color map, as the authors show it: black 0, pale
    /// yellow 1.
    pub fn to_magma(&self) -> RgbImage {
        RgbImage::from_fn(self.width, self.height, |x, y| {
            magma::color(self.errors[y as usize * self.width as usize + x as usize])
        })
    }
}

/// Computes the per-pixel LDR-FLIP of two images seen at `pixels_per_degree` of visual angle.
///
/// # Errors
/// If the sizes differ, the images have no pixels, or `pixels_per_degree` is outside
/// [`MIN_PIXELS_PER_DEGREE`]..=[`MAX_PIXELS_PER_DEGREE`].
pub fn flip_map(
    reference: &RgbImage,
    test: &RgbImage,
    pixels_per_degree: f32,
) -> Result<FlipMap, MetricError> {
    check_sizes(reference, test)?;
    if !(MIN_PIXELS_PER_DEGREE..=MAX_PIXELS_PER_DEGREE).contains(&pixels_per_degree) {
        return Err(MetricError::PixelsPerDegree(pixels_per_degree));
    }
    Ok(flip_map_at(
        simd::level(),
        reference,
        test,
        pixels_per_degree,
    ))
}

/// Same as [`flip_map`] for checked arguments at a SIMD level.
fn flip_map_at(
    level: Level,
    reference: &RgbImage,
    test: &RgbImage,
    pixels_per_degree: f32,
) -> FlipMap {
    let (width, height) = reference.dimensions();
    let context = FlipContext {
        level,
        weights: FilterWeights::new(f64::from(pixels_per_degree)),
        space: ColorSpace::new(level),
    };
    let mut errors = vec![0.0; width as usize * height as usize];
    let band_sums: Vec<f64> = errors
        .par_chunks_mut(BAND_ROWS * width as usize)
        .enumerate()
        .map(|(band, errors)| context.band(reference, test, band * BAND_ROWS, errors))
        .collect();
    // Summed in the order of bands of constant height: the mean does not depend on the number of
    // threads.
    let mean = band_sums.iter().sum::<f64>() / errors.len() as f64;
    FlipMap {
        width,
        height,
        errors,
        mean,
    }
}

/// Rows per task. Larger tasks filter fewer rows twice (the halo), smaller tasks keep more threads
/// busy.
const BAND_ROWS: usize = 64;

/// Planes of a [`RowRing`], filtered across and then down.
mod plane {
    /// Luminance and red-green, blurred.
    pub(super) const LUMINANCE: usize = 0;
    pub(super) const RED_GREEN: usize = 1;
    /// Blue-yellow, blurred by either of its two Gaussians.
    pub(super) const BLUE_YELLOW: [usize; 2] = [2, 3];
    /// Luminance through the feature filter's Gaussian and its two derivatives across.
    pub(super) const FEATURE: usize = 4;
    pub(super) const SLOPE: usize = 5;
    pub(super) const CURVATURE: usize = 6;
    pub(super) const COUNT: usize = 7;
}

/// State shared by all bands of a map.
struct FlipContext {
    level: Level,
    weights: FilterWeights,
    space: ColorSpace,
}

impl FlipContext {
    /// Fills the errors of the rows from `first_row` on; returns their sum.
    fn band(
        &self,
        reference: &RgbImage,
        test: &RgbImage,
        first_row: usize,
        errors: &mut [f32],
    ) -> f64 {
        let width = reference.width() as usize;
        let halo = self.weights.radius() as isize;
        let first_row = first_row as isize;
        let mut images = [reference, test].map(|image| BandImage::new(self, image));
        for y in first_row - halo..first_row + halo {
            images
                .iter_mut()
                .for_each(|image| image.filter_across(self, y));
        }
        let mut row = vec![0.0; padded_len(width)];
        let mut sum = 0.0;
        for (y, errors) in (first_row..).zip(errors.chunks_exact_mut(width)) {
            for image in &mut images {
                image.filter_across(self, y + halo);
                image.filter_down(self, y);
            }
            let [reference, test] = [&images[0].filtered, &images[1].filtered];
            dispatch!(self.level, simd => row_errors(simd, &self.space, reference, test, &mut row));
            errors.copy_from_slice(&row[..width]);
            sum += errors.iter().map(|&error| f64::from(error)).sum::<f64>();
        }
        sum
    }
}

/// Filter state of one of the two images within a band.
struct BandImage<'a> {
    image: &'a RgbImage,
    /// Row of linear opponent color, its ends repeated on both sides.
    padded: [Vec<f32>; 3],
    ring: RowRing<f32>,
    /// Row that is filtered in both directions.
    filtered: FilteredRow,
    /// Row for intermediate results.
    scratch: Vec<f32>,
}

impl<'a> BandImage<'a> {
    fn new(context: &FlipContext, image: &'a RgbImage) -> Self {
        let len = padded_len(image.width() as usize);
        let radius = context.weights.radius();
        let row = || vec![0.0; len];
        Self {
            image,
            padded: std::array::from_fn(|_| vec![0.0; len + 2 * radius]),
            ring: RowRing::new(radius, plane::COUNT, len),
            filtered: FilteredRow {
                opponent: [row(), row(), row()],
                slope: [row(), row()],
                curvature: [row(), row()],
            },
            scratch: row(),
        }
    }

    /// Fills row `y` of the ring. Outside of the image its border repeats, as in the authors'
    /// evaluators.
    fn filter_across(&mut self, context: &FlipContext, y: isize) {
        let FlipContext { level, weights, .. } = context;
        let len = padded_len(self.image.width() as usize);
        self.load(context, len, y);

        let [luminance, red_green, blue_yellow] = &self.padded;
        let blurs = [
            (&weights.luminance, luminance),
            (&weights.red_green, red_green),
            (&weights.blue_yellow[0], blue_yellow),
            (&weights.blue_yellow[1], blue_yellow),
            (&weights.feature, luminance),
        ];
        let mut planes = self.ring.row_mut(y);
        for ((taps, source), out) in blurs.into_iter().zip(&mut planes) {
            smooth(*level, taps, &across(source, taps.len() - 1, len), out);
        }
        if let (Some(slope), Some(curvature)) = (planes.next(), planes.next()) {
            let neighbors = across(luminance, weights.slope.len() - 1, len);
            derive(
                *level,
                [&weights.slope, &weights.curvature],
                &neighbors,
                [slope, curvature],
            );
        }
    }

    /// Loads row `y` as opponent color into the padded planes and repeats its ends.
    fn load(&mut self, context: &FlipContext, len: usize, y: isize) {
        let width = self.image.width() as usize;
        let radius = context.weights.radius();
        let y = y.clamp(0, self.image.height() as isize - 1) as usize;
        let pixels = &self.image.as_raw()[3 * width * y..3 * width * (y + 1)];
        for (channel, plane) in self.padded.iter_mut().enumerate() {
            for (value, pixel) in plane[radius..].iter_mut().zip(pixels.chunks_exact(3)) {
                *value = context.space.linear_from_srgb8[usize::from(pixel[channel])];
            }
        }
        let planes = self
            .padded
            .each_mut()
            .map(|plane| &mut plane[radius..radius + len]);
        dispatch!(context.level, simd => context.space.rows_to_opponent(simd, planes));
        for plane in &mut self.padded {
            let (first, last) = (plane[radius], plane[radius + width - 1]);
            plane[..radius].fill(first);
            plane[radius + width..].fill(last);
        }
    }

    /// Filters the ring down around row `y`, into [`BandImage::filtered`].
    fn filter_down(&mut self, context: &FlipContext, y: isize) {
        let FlipContext { level, weights, .. } = context;
        let FilteredRow {
            opponent: [luminance, red_green, blue_yellow],
            slope,
            curvature,
        } = &mut self.filtered;
        let ring = &self.ring;
        let blur = |taps: &[f32], plane, out: &mut [f32]| {
            smooth(*level, taps, &ring.down(y, taps.len() - 1, plane), out);
        };

        blur(&weights.luminance, plane::LUMINANCE, luminance);
        blur(&weights.red_green, plane::RED_GREEN, red_green);
        blur(&weights.blue_yellow[0], plane::BLUE_YELLOW[0], blue_yellow);
        blur(
            &weights.blue_yellow[1],
            plane::BLUE_YELLOW[1],
            &mut self.scratch,
        );
        blue_yellow
            .iter_mut()
            .zip(&self.scratch)
            .for_each(|(sum, second)| *sum += second);

        let [slope_across, slope_down] = slope;
        let [curvature_across, curvature_down] = curvature;
        blur(&weights.feature, plane::SLOPE, slope_across);
        blur(&weights.feature, plane::CURVATURE, curvature_across);
        let neighbors = ring.down(y, weights.slope.len() - 1, plane::FEATURE);
        derive(
            *level,
            [&weights.slope, &weights.curvature],
            &neighbors,
            [slope_down, curvature_down],
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::rows::tests::{levels, noise};

    #[test]
    fn no_simd_level_changes_a_bit() {
        let [a, b] = [1, 2].map(|seed| noise(77, 41, seed));
        let maps: Vec<FlipMap> = levels()
            .into_iter()
            .map(|level| flip_map_at(level, &a, &b, DEFAULT_PIXELS_PER_DEGREE))
            .collect();
        assert!(maps[0].mean > 0.1 && maps.windows(2).all(|pair| pair[0] == pair[1]));
    }
}
