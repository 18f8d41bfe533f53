//! Piecewise constant density over a grid in the unit square.

/// Number of bins along each side.
pub(super) const BINS: usize = 16;

/// Density over the unit square with a mean of 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SquareDensity {
    /// Cumulative distribution of the rows.
    rows: [f32; BINS],
    /// Cumulative distribution of the bins of each row.
    columns: [[f32; BINS]; BINS],
}

/// Returns the bin of a coordinate.
pub(super) fn bin(coordinate: f32) -> usize {
    ((coordinate * BINS as f32) as usize).min(BINS - 1)
}

/// Returns the probability of a bin.
fn share(cumulative: &[f32; BINS], bin: usize) -> f32 {
    cumulative[bin] - if bin == 0 { 0.0 } else { cumulative[bin - 1] }
}

/// Inverts a cumulative distribution at a value: returns the bin and the coordinate.
fn invert_cdf(cumulative: &[f32; BINS], value: f32) -> (usize, f32) {
    let bin = cumulative
        .partition_point(|&share| share <= value)
        .min(BINS - 1);
    let below = if bin == 0 { 0.0 } else { cumulative[bin - 1] };
    // The largest fraction whose sum with a bin's index does not round to the next bin.
    const BELOW_NEXT: f32 = 1.0 - BINS as f32 * f32::EPSILON;
    let inside = ((value - below) / share(cumulative, bin)).clamp(0.0, BELOW_NEXT);
    (bin, (bin as f32 + inside) / BINS as f32)
}

impl SquareDensity {
    /// Creates a density proportional to `weights`, row by row, none of them zero.
    pub(crate) fn new(weights: &[f32; BINS * BINS]) -> Self {
        let (mut rows, mut columns) = ([0.0; BINS], [[0.0; BINS]; BINS]);
        let mut all = 0.0;
        for (row, weights) in weights.chunks_exact(BINS).enumerate() {
            let mut sum = 0.0;
            for (column, weight) in weights.iter().enumerate() {
                sum += weight;
                columns[row][column] = sum;
            }
            columns[row].iter_mut().for_each(|share| *share /= sum);
            all += sum;
            rows[row] = all;
        }
        rows.iter_mut().for_each(|share| *share /= all);
        Self { rows, columns }
    }

    /// Warps a uniform point to one distributed by the density; stratification is preserved.
    pub(super) fn warp(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let (row, y) = invert_cdf(&self.rows, v);
        let (_, x) = invert_cdf(&self.columns[row], u);
        [x, y]
    }

    /// Returns the density at a point.
    pub(crate) fn density(&self, [x, y]: [f32; 2]) -> f32 {
        let row = bin(y);
        share(&self.rows, row) * share(&self.columns[row], bin(x)) * (BINS * BINS) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::{random4, unit_float};

    /// Uneven by three orders of magnitude.
    fn weights() -> [f32; BINS * BINS] {
        std::array::from_fn(|i| unit_float(random4([i as u32, 3, 1, 4])[0]).powi(6) + 1e-3)
    }

    #[test]
    fn warped_points_follow_density() {
        const SIDE: usize = 1024;
        let (weights, density) = (weights(), SquareDensity::new(&weights()));
        let mut counts = [0_u32; BINS * BINS];
        for i in 0..SIDE * SIDE {
            let [x, y] = density.warp([i % SIDE, i / SIDE].map(|c| (c as f32 + 0.5) / SIDE as f32));
            assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
            counts[bin(y) * BINS + bin(x)] += 1;
        }
        let all: f64 = weights.iter().copied().map(f64::from).sum();
        for (i, (&count, &weight)) in counts.iter().zip(&weights).enumerate() {
            let (drawn, expected) = (
                f64::from(count) / (SIDE * SIDE) as f64,
                f64::from(weight) / all,
            );
            let row: f64 = weights[i / BINS * BINS..][..BINS]
                .iter()
                .copied()
                .map(f64::from)
                .sum();
            // Rounding of a bin's extent to rows and columns of the grid, up to one.
            let (high, wide) = (row / all, f64::from(weight) / row);
            let tolerance = (high + wide) / SIDE as f64 + 1.0 / (SIDE * SIDE) as f64;
            assert!(
                (drawn - expected).abs() <= 1.01 * tolerance,
                "bin {i}: {drawn}, not {expected} +- {tolerance}"
            );
            let middle = [i % BINS, i / BINS].map(|c| (c as f32 + 0.5) / BINS as f32);
            let at = f64::from(density.density(middle));
            let tolerance = 1e-5 * (BINS * BINS) as f64; // sums of shares up to 1 in f32
            assert!(
                (at - expected * (BINS * BINS) as f64).abs() < tolerance,
                "bin {i}: {at}"
            );
        }
    }

    #[test]
    fn warp_stays_in_bin() {
        for heavy in [1, 8, 15] {
            let mut weights = [1e-3; BINS * BINS];
            weights[heavy * BINS] = 1e3;
            let density = SquareDensity::new(&weights);
            // The last number before the end of the dominant row, where few numbers are left.
            let (row, y) = invert_cdf(&density.rows, density.rows[heavy].next_down());
            assert!(
                row == heavy && bin(y) == heavy && y < 1.0,
                "{heavy}: {row}, {y}"
            );
        }
    }

    #[test]
    fn uniform_density_is_identity() {
        let density = SquareDensity::new(&[2.5; BINS * BINS]);
        for point in [
            [0.0, 0.0],
            [0.999_999, 0.5],
            [0.25, 0.125],
            [0.7, 0.999_999],
        ] {
            let [x, y] = density.warp(point);
            assert!(
                (x - point[0]).abs() < 1e-5 && (y - point[1]).abs() < 1e-5,
                "{point:?}: {x}, {y}"
            );
            assert!((density.density(point) - 1.0).abs() < 1e-4);
        }
    }
}
