//! A density over the unit square, constant in each bin of a grid.

/// Bins a side.
pub(super) const BINS: usize = 16;

/// A density over the unit square whose mean is 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SquareDensity {
    /// Share of all that lies in each row and those below it.
    rows: [f32; BINS],
    /// Share of a row that lies in each of its bins and those before it.
    columns: [[f32; BINS]; BINS],
}

/// The bin in which a coordinate lies.
pub(super) fn bin(coordinate: f32) -> usize {
    ((coordinate * BINS as f32) as usize).min(BINS - 1)
}

/// What bin number `bin` adds to the shares below it.
fn share(cumulative: &[f32; BINS], bin: usize) -> f32 {
    cumulative[bin] - if bin == 0 { 0.0 } else { cumulative[bin - 1] }
}

/// The bin in which a share lies, and the coordinate that has so much below it.
fn coordinate_of(cumulative: &[f32; BINS], at: f32) -> (usize, f32) {
    let found = cumulative
        .partition_point(|&share| share <= at)
        .min(BINS - 1);
    let (below, wide) = (
        if found == 0 {
            0.0
        } else {
            cumulative[found - 1]
        },
        share(cumulative, found),
    );
    // So far below 1 that the sum with a bin's number is no next bin, rounded.
    const BELOW_NEXT: f32 = 1.0 - BINS as f32 * f32::EPSILON;
    let inside = ((at - below) / wide).clamp(0.0, BELOW_NEXT);
    (found, (found as f32 + inside) / BINS as f32)
}

impl SquareDensity {
    /// In proportion to `weights`, row after row, none of them zero.
    pub(super) fn new(weights: &[f32; BINS * BINS]) -> Self {
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

    /// A point that is drawn by the density, from one that is drawn evenly: points that are spread
    /// evenly stay so.
    pub(super) fn warp(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let (row, y) = coordinate_of(&self.rows, v);
        let (_, x) = coordinate_of(&self.columns[row], u);
        [x, y]
    }

    /// The density at a point.
    pub(super) fn at(&self, [x, y]: [f32; 2]) -> f32 {
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
    fn points_are_drawn_as_often_as_the_density_says() {
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
            // A bin is so many rows of the grid high and so many columns wide, give or take one.
            let (high, wide) = (row / all, f64::from(weight) / row);
            let tolerance = (high + wide) / SIDE as f64 + 1.0 / (SIDE * SIDE) as f64;
            assert!(
                (drawn - expected).abs() <= 1.01 * tolerance,
                "bin {i}: {drawn}, not {expected} +- {tolerance}"
            );
            let middle = [i % BINS, i / BINS].map(|c| (c as f32 + 0.5) / BINS as f32);
            let at = f64::from(density.at(middle));
            let tolerance = 1e-5 * (BINS * BINS) as f64; // sums of shares up to 1 in f32
            assert!(
                (at - expected * (BINS * BINS) as f64).abs() < tolerance,
                "bin {i}: {at}"
            );
        }
    }

    #[test]
    fn no_point_is_carried_into_the_next_bin() {
        for heavy in [1, 8, 15] {
            let mut weights = [1e-3; BINS * BINS];
            weights[heavy * BINS] = 1e3;
            let density = SquareDensity::new(&weights);
            // The last number before the heavy row is full, of which there are few in a row that is
            // nearly all.
            let (row, y) = coordinate_of(&density.rows, density.rows[heavy].next_down());
            assert!(
                row == heavy && bin(y) == heavy && y < 1.0,
                "{heavy}: {row}, {y}"
            );
        }
    }

    #[test]
    fn an_even_density_changes_nothing() {
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
            assert!((density.at(point) - 1.0).abs() < 1e-4);
        }
    }
}
