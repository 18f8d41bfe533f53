//! Comparison of estimated with known depth.

/// Relative depth errors up to which pixels are counted as equal.
pub const TOLERANCES: [f32; 3] = [0.01, 0.02, 0.05];

/// Number of [`STEP`]s of the error histogram.
const STEPS: usize = 1000;

/// Bin size of the error histogram, relative depth error.
const STEP: f64 = 1e-4;

/// Pixel counts over any number of images.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Agreement {
    /// Number of all pixels.
    pub pixels: u64,
    /// Number of pixels with estimated depth.
    pub estimated: u64,
    /// Number of pixels with known depth.
    pub known: u64,
    /// Number of pixels with both.
    pub both: u64,
    /// Histogram of relative errors; the last bin has all larger ones.
    errors: Vec<u64>,
}

impl Default for Agreement {
    fn default() -> Self {
        Self {
            pixels: 0,
            estimated: 0,
            known: 0,
            both: 0,
            errors: vec![0; STEPS + 1],
        }
    }
}

impl Agreement {
    /// Counts an image: eye depths, NaN where missing; `known` may be empty.
    pub fn add(&mut self, estimated: &[f32], known: &[f32]) {
        self.pixels += estimated.len() as u64;
        for (i, estimated) in estimated.iter().enumerate() {
            let known = known.get(i).copied().unwrap_or(f32::NAN);
            self.estimated += u64::from(estimated.is_finite());
            self.known += u64::from(known.is_finite());
            let error = (f64::from(*estimated) / f64::from(known) - 1.0).abs();
            if known.is_finite() && error.is_finite() {
                self.both += 1;
                self.errors[((error / STEP) as usize).min(STEPS)] += 1;
            }
        }
    }

    /// Returns the fraction of all pixels with estimated depth.
    pub fn estimated_share(&self) -> f64 {
        self.estimated as f64 / self.pixels.max(1) as f64
    }

    /// Returns the fraction of pixels with known depth that have an estimate.
    pub fn covered_share(&self) -> f64 {
        self.both as f64 / self.known.max(1) as f64
    }

    /// Returns the fractions of the pixels with both depths whose error is below each of
    /// [`TOLERANCES`].
    pub fn shares_within(&self) -> [f64; 3] {
        TOLERANCES.map(|tolerance| {
            let steps = (f64::from(tolerance) / STEP).round() as usize;
            self.errors[..steps].iter().sum::<u64>() as f64 / self.both.max(1) as f64
        })
    }

    /// Returns the median relative error of the pixels with both depths, rounded up to a hundredth
    /// of a percent; infinite above a tenth, NaN without any.
    pub fn median_error(&self) -> f64 {
        let mut below = 0;
        let middle = self.errors.iter().position(|count| {
            below += count;
            below * 2 >= self.both && self.both > 0
        });
        middle.map_or(f64::NAN, |step| {
            if step < STEPS {
                (step + 1) as f64 * STEP
            } else {
                f64::INFINITY
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_match_manual_example() {
        let nan = f32::NAN;
        let mut agreement = Agreement::default();
        agreement.add(&[1.0, 2.03, 3.0, nan, 5.0], &[1.0, 2.0, 2.0, 4.0, nan]);
        agreement.add(&[1.0003, nan], &[]);
        agreement.add(&[4.001, 1.0], &[4.0, f32::INFINITY]);
        assert_eq!(
            [
                agreement.pixels,
                agreement.estimated,
                agreement.known,
                agreement.both
            ],
            [9, 7, 5, 4]
        );
        // Errors of 0, 0.00025, 0.015 and 0.5; infinite depth is unknown.
        assert_eq!(agreement.shares_within(), [0.5, 0.75, 0.75]);
        assert!(
            (agreement.median_error() - 0.0003).abs() < 1e-9,
            "{}",
            agreement.median_error()
        );
        assert!(
            (agreement.covered_share() - 0.8).abs() < 1e-12
                && (agreement.estimated_share() - 7.0 / 9.0).abs() < 1e-12
        );
    }

    #[test]
    fn median_error_of_extremes() {
        let mut agreement = Agreement::default();
        assert!(agreement.median_error().is_nan() && agreement.shares_within() == [0.0; 3]);
        agreement.add(&[2.0], &[1.0]);
        assert!(agreement.median_error().is_infinite());
    }
}
