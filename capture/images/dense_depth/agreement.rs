//! How well depth that was found agrees with depth that is known.

/// Shares of depth by which they may differ.
pub const TOLERANCES: [f32; 3] = [0.01, 0.02, 0.05];

/// Errors are told apart up to so many [`STEP`]s.
const STEPS: usize = 1000;

/// The share of depth by which errors are told apart.
const STEP: f64 = 1e-4;

/// Pixels counted over any number of pictures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Agreement {
    /// All pixels.
    pub pixels: u64,
    /// Those whose depth was found.
    pub found: u64,
    /// Those whose depth is known.
    pub known: u64,
    /// Those of which both is so.
    pub both: u64,
    /// How many of these differ by so many steps, the last by more.
    errors: Vec<u64>,
}

impl Default for Agreement {
    fn default() -> Self {
        Self {
            pixels: 0,
            found: 0,
            known: 0,
            both: 0,
            errors: vec![0; STEPS + 1],
        }
    }
}

impl Agreement {
    /// Counts a picture: eye depths, NaN where not found, or not known; `known` may be empty.
    pub fn add(&mut self, found: &[f32], known: &[f32]) {
        self.pixels += found.len() as u64;
        for (i, found) in found.iter().enumerate() {
            let known = known.get(i).copied().unwrap_or(f32::NAN);
            self.found += u64::from(found.is_finite());
            self.known += u64::from(known.is_finite());
            let error = (f64::from(*found) / f64::from(known) - 1.0).abs();
            if known.is_finite() && error.is_finite() {
                self.both += 1;
                self.errors[((error / STEP) as usize).min(STEPS)] += 1;
            }
        }
    }

    /// Share of all pixels whose depth was found.
    pub fn found_share(&self) -> f64 {
        self.found as f64 / self.pixels.max(1) as f64
    }

    /// Share of the known pixels that were found as well.
    pub fn covered(&self) -> f64 {
        self.both as f64 / self.known.max(1) as f64
    }

    /// Of the pixels that are known and found, the shares that differ by less than each of [`TOLERANCES`].
    pub fn shares_within(&self) -> [f64; 3] {
        TOLERANCES.map(|tolerance| {
            let steps = (f64::from(tolerance) / STEP).round() as usize;
            self.errors[..steps].iter().sum::<u64>() as f64 / self.both.max(1) as f64
        })
    }

    /// The share of its depth by which the middle one of the pixels that are known and found errs, to a hundredth of a percent upward;
    /// infinite beyond a tenth, NaN without any.
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
    fn pixels_are_counted_as_one_would_by_hand() {
        let nan = f32::NAN;
        let mut agreement = Agreement::default();
        agreement.add(&[1.0, 2.03, 3.0, nan, 5.0], &[1.0, 2.0, 2.0, 4.0, nan]);
        agreement.add(&[1.0003, nan], &[]);
        agreement.add(&[4.001, 1.0], &[4.0, f32::INFINITY]);
        assert_eq!(
            [
                agreement.pixels,
                agreement.found,
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
            (agreement.covered() - 0.8).abs() < 1e-12
                && (agreement.found_share() - 7.0 / 9.0).abs() < 1e-12
        );
    }

    #[test]
    fn nothing_counted_has_no_median_and_large_errors_an_infinite_one() {
        let mut agreement = Agreement::default();
        assert!(agreement.median_error().is_nan() && agreement.shares_within() == [0.0; 3]);
        agreement.add(&[2.0], &[1.0]);
        assert!(agreement.median_error().is_infinite());
    }
}
