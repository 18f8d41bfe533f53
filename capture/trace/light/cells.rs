//! Cells of surface points: hash keys by position and normal.

use super::LitPoint;
use super::pilot::percentile;
use headbox_scene::material::floor;
use rayon::prelude::*;

/// Grid of cells whose width grows with the distance from the local origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct CellGrid {
    /// Minimum width of a cell as a fraction of its distance from the local origin; the maximum is
    /// twice that.
    share: f32,
    /// Minimum width of a cell, metres.
    min_width_m: f32,
}

impl CellGrid {
    /// Creates the grid for `points`; cells are at least half as wide as they would be at the
    /// median distance of all points.
    pub(super) fn new(points: &[LitPoint], share: f32) -> Self {
        let mut distances: Vec<f32> = points
            .iter()
            .map(|point| point.position.abs().max_element())
            .collect();
        Self {
            share,
            min_width_m: percentile(&mut distances, 0.5) * (share / 2.0),
        }
    }

    /// Returns the key of a point's cell.
    pub(super) fn key(&self, point: &LitPoint) -> u64 {
        let min_width_m = (point.position.abs().max_element() * self.share).max(self.min_width_m);
        let (exponent, width_m) = power_of_two_above(min_width_m);
        let [x, y, z] = (point.position / width_m)
            .to_array()
            .map(|c| u64::from(floor(c) as i32 as u8));
        x | y << 8 | z << 16 | u64::from(exponent) << 24 | point.quantised_normal() << 32
    }
}

/// Returns the points with the keys of their cells, cell by cell; the points of a cell are shuffled
/// by a fixed order that is independent of position.
pub(super) fn by_cell(grid: &CellGrid, points: &[LitPoint]) -> Vec<CellPoint> {
    let keyed =
        |(i, point): (u32, &LitPoint)| (grid.key(point), i.wrapping_mul(0x9e37_79b9), *point);
    let mut sorted: Vec<CellPoint> = (0..).zip(points).map(keyed).collect();
    sorted.par_sort_unstable_by_key(|&(cell, order, _)| (cell, order));
    sorted
}

/// Point with the key of its cell and its position in a shuffled order.
pub(super) type CellPoint = (u64, u32, LitPoint);

/// Returns the exponent (modulo 256) and the value of the least power of two that is at least
/// `length`.
pub(super) fn power_of_two_above(length: f32) -> (u8, f32) {
    // Adding the full mantissa carries into the exponent unless the mantissa is zero.
    const MANTISSA: u32 = (1 << 23) - 1;
    // NaN is treated as small.
    let length = if length > 1e-30 {
        length.min(1e30)
    } else {
        1e-30
    };
    let power = (length.to_bits() + MANTISSA) & !MANTISSA;
    (
        ((power >> 23) as u8).wrapping_sub(127),
        f32::from_bits(power),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_of_two_is_least_upper_bound() {
        for (length, expected) in [
            (1.0, 1.0),
            (1.000_000_1, 2.0),
            (0.75, 1.0),
            (5.0, 8.0),
            (0.25, 0.25),
            (3e-9, 2f32.powi(-28)),
        ] {
            let (exponent, power) = power_of_two_above(length);
            assert_eq!(
                (power, exponent),
                (expected, expected.log2() as i32 as u8),
                "{length}"
            );
        }
        for length in [0.0, -1.0, f32::INFINITY, f32::NAN, -f32::NAN] {
            assert!(power_of_two_above(length).1.is_normal(), "{length}");
        }
    }
}
