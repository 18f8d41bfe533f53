//! Grid of displacements: a sprite's own, or the output of the first pass.

use super::cell::Coding;
use super::first_pass::patches::{Patches, UnpackedField};
use crate::{Displacement, DisplacementFormat, Sprite};
use image::RgbaImage;
use rayon::prelude::*;

/// A grid of cells.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Field {
    /// Column of the sprite's displacement grid at which column 0 lies; zero or negative.
    pub x0: i32,
    /// The same for rows.
    pub y0: i32,
    pub width: u32,
    pub height: u32,
    /// Row-major.
    pub cells: Vec<u32>,
    pub coding: Coding,
    /// Smallest and largest displacement, extended to include 0; only in a sprite's own field.
    pub range: [f32; 2],
    /// The displacements as planar patches; only in a sprite's own field.
    pub patches: Patches,
}

impl Field {
    /// Creates a field without cells.
    pub(super) fn empty() -> Self {
        let coding = Coding::new(0.0, 0.0, 0.0, 1.0);
        Self {
            x0: 0,
            y0: 0,
            width: 0,
            height: 0,
            cells: Vec::new(),
            coding,
            range: [0.0; 2],
            patches: Patches::default(),
        }
    }

    /// Creates the field of a sprite's own displacements (d1), with slopes that do not extend
    /// across edges.
    pub(super) fn from_sprite(sprite: &Sprite, displacement: &Displacement) -> Self {
        let (width, height) = displacement.size();
        let values = smooth(displacement);
        let (low, high) = values.iter().fold((f32::MAX, f32::MIN), |(low, high), &v| {
            (low.min(v), high.max(v))
        });
        let at = |x: u32, y: u32| values[y as usize * width as usize + x as usize];
        let slope = |x: u32, y: u32| {
            let neighbor = |inside: bool, x: u32, y: u32| inside.then(|| at(x, y));
            let here = at(x, y);
            let before = [
                neighbor(x > 0, x.wrapping_sub(1), y),
                neighbor(y > 0, x, y.wrapping_sub(1)),
            ];
            let after = [
                neighbor(x + 1 < width, x + 1, y),
                neighbor(y + 1 < height, x, y + 1),
            ];
            [0, 1].map(|axis| limited_slope(before[axis], here, after[axis]))
        };
        let pixels = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let steepest = pixels()
            .flat_map(|(x, y)| slope(x, y))
            .fold(0.0f32, |max, s| max.max(s.abs()));
        let coding = Coding::new(low, high, steepest, 1.0);
        let visible = visible_cells(sprite.color(), width, height);
        let cells: Vec<u32> = pixels()
            .zip(visible)
            .map(|((x, y), visible)| coding.pack(visible, at(x, y), slope(x, y)))
            .collect();
        let step = if displacement.format() == DisplacementFormat::F32 {
            0.0
        } else {
            displacement.scale()
        };
        let unpacked = UnpackedField {
            width,
            height,
            values: &values,
            cells: &cells,
        };
        Self {
            x0: 0,
            y0: 0,
            width,
            height,
            coding,
            range: [low.min(0.0), high.max(0.0)],
            patches: Patches::new(&unpacked, step),
            cells,
        }
    }
}

/// Number of smoothing rounds: steps up to about twice as many cells wide become ramps.
pub const SMOOTHING_ROUNDS: usize = 16;

/// Decodes displacements and smooths the quantisation steps of 8-bit storage. In each round a value
/// moves half-way to the mean of its two neighbours along the row and along the column, but stays
/// within half a step of the stored value, so that it still rounds to it. Rounding bends a straight
/// ramp, however steep, by less than two steps: a larger second difference of the stored values is
/// an edge or a crease, and that direction is left out. Other formats are fine enough without
/// smoothing.
fn smooth(displacement: &Displacement) -> Vec<f32> {
    let stored = displacement.to_f32();
    if displacement.format() != DisplacementFormat::I8 {
        return stored;
    }
    let (width, height) = displacement.size();
    let [width, height] = [width, height].map(|side| side as usize);
    let step = displacement.scale();
    let mut values = stored.clone();
    for _ in 0..SMOOTHING_ROUNDS {
        let row = |y: usize| {
            let values = &values;
            let stored = &stored;
            (0..width).map(move |x| {
                let index = y * width + x;
                let (mut sum, mut count) = (0.0, 0.0);
                for (inside, stride) in [
                    (x > 0 && x + 1 < width, 1),
                    (y > 0 && y + 1 < height, width),
                ] {
                    if !inside {
                        continue;
                    }
                    let (before, after) = (index - stride, index + stride);
                    if (stored[before] + stored[after] - 2.0 * stored[index]).abs() < 1.5 * step {
                        sum += values[before] + values[after];
                        count += 2.0;
                    }
                }
                let mean = if count > 0.0 {
                    sum / count
                } else {
                    values[index]
                };
                let moved = 0.5 * (values[index] + mean);
                moved.clamp(stored[index] - 0.5 * step, stored[index] + 0.5 * step)
            })
        };
        values = (0..height).into_par_iter().flat_map_iter(row).collect();
    }
    values
}

/// Returns the slope at the middle of three neighbours by the monotonised central limiter: the
/// central difference, but 0 at an extremum and at most twice the smaller one-sided difference
/// beside an edge. One-sided at the border.
fn limited_slope(before: Option<f32>, here: f32, after: Option<f32>) -> f32 {
    let (left, right) = match (before, after) {
        (Some(before), Some(after)) => (here - before, after - here),
        (Some(before), None) => return here - before,
        (None, Some(after)) => return after - here,
        (None, None) => return 0.0,
    };
    let central = 0.5 * (left + right);
    let limit = 2.0 * left.abs().min(right.abs());
    if left * right > 0.0 {
        central.clamp(-limit, limit)
    } else {
        0.0
    }
}

/// For each cell, row by row: true if a pixel under it or next to it is not fully transparent.
fn visible_cells(color: &RgbaImage, width: u32, height: u32) -> impl Iterator<Item = bool> {
    let range = |i: u32, all: u32, count: u32| {
        let edge = |i: u64| i * u64::from(all) / u64::from(count);
        let last = edge(u64::from(i) + 1) + 1;
        (
            edge(u64::from(i)).saturating_sub(1) as u32,
            (last as u32).min(all),
        )
    };
    (0..height).flat_map(move |y| {
        let (y0, y1) = range(y, color.height(), height);
        (0..width).map(move |x| {
            let (x0, x1) = range(x, color.width(), width);
            (y0..y1).any(|y| (x0..x1).any(|x| color.get_pixel(x, y).0[3] > 0))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_is_exact_and_order_follows_nearness() {
        for side in [1.0, -1.0] {
            let coding = Coding::new(-0.013, 0.041, 0.002, side);
            let zero = coding.pack(true, 0.0, [0.0; 2]);
            assert_eq!(coding.displacement(zero, 0.3, -0.2), 0.0);
            let (near, far) = (
                coding.pack(true, 0.02 * side, [0.0; 2]),
                coding.pack(true, -0.01 * side, [0.0; 2]),
            );
            assert!(near > zero && zero > far && far > coding.pack(false, 0.04, [0.0; 2]));
            assert!(
                coding.pack(false, -1.0, [0.0; 2]) > 0,
                "an empty cell is unlike any other"
            );
        }
        let flat = Coding::new(0.0, 0.0, 0.0, 1.0);
        assert_eq!(
            flat.displacement(flat.pack(true, 0.0, [0.0; 2]), 0.5, 0.5),
            0.0
        );
    }

    #[test]
    fn values_and_slopes_come_back_to_half_a_unit() {
        let coding = Coding::new(-0.02, 0.03, 0.001, 1.0);
        for i in 0..50 {
            let (d, slope) = (
                -0.02 + 0.001 * i as f32,
                [0.0009 * (i as f32).sin(), -0.0005],
            );
            let cell = coding.pack(true, d, slope);
            let want = d + slope[0] * 0.5 + slope[1] * -0.5;
            let tolerance = 0.51 * coding.scale + 0.51 * coding.slope_scale;
            assert!((coding.displacement(cell, 0.5, -0.5) - want).abs() < tolerance);
        }
    }

    #[test]
    fn smoothing_removes_stairs_keeps_edges() {
        // Two ramps, of 0.3 to 3.5 steps a cell, and a cliff of 40 steps between them.
        const WIDTH: u32 = 60;
        for slope in [0.3f32, 1.5, 3.5] {
            let exact = |x: u32| {
                let cliff = if x < WIDTH / 2 { -20.0 } else { 20.0 };
                (x as f32 - 29.5) / 30.0 * 0.5 * slope * 29.5 + cliff
            };
            let scale = (0..WIDTH).map(|x| exact(x).abs()).fold(0.0, f32::max) / 127.0;
            let values: Vec<f32> = (0..WIDTH * 5).map(|i| exact(i % WIDTH)).collect();
            let stored =
                Displacement::new(WIDTH, 5, &values, DisplacementFormat::I8).expect("finite");
            let error = |found: &[f32]| {
                // The ends of a ramp have one side only.
                let inner =
                    (0..WIDTH as usize).filter(|x| (4..26).contains(x) || (34..56).contains(x));
                let squares: Vec<f32> = inner
                    .map(|x| (found[2 * WIDTH as usize + x] - exact(x as u32)).powi(2))
                    .collect();
                (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
            };
            let (before, after) = (error(&stored.to_f32()), error(&smooth(&stored)));
            assert!(after < 0.6 * before, "{slope}: {before} {after}");
            let jump = smooth(&stored)[30] - smooth(&stored)[29];
            assert!(
                (jump - (exact(30) - exact(29))).abs() < 2.0 * scale,
                "the cliff stays"
            );
        }
    }

    #[test]
    fn slopes_do_not_cross_edges() {
        let limited = |before, here, after| limited_slope(Some(before), here, Some(after));
        assert_eq!(limited(0.0, 1.0, 2.0), 1.0);
        assert_eq!(limited(0.0, 0.0, 5.0), 0.0);
        assert_eq!(limited(0.0, 0.1, 5.0), 0.2);
        assert_eq!(limited(1.0, 0.0, 1.0), 0.0);
        assert_eq!(limited_slope(None, 1.0, Some(3.0)), 2.0);
    }
}
