//! Canvas of elliptical Gaussians, averaged per surface in floating point: the reference for the
//! integer kernels.
//!
//! The rules are those of [`super::surface_canvas`], without rounding. Footprints are ellipses
//! whose weights add up to 1 on a surface, colours are kept in linear light, and sums are `f32`.

use super::{Canvas, Tolerance, surface_canvas};
use crate::render::footprint::size::EllipseSize;
use crate::render::footprint::splat::{Splats, covered_pixels};
use crate::render::footprint::tent;
use crate::render::planes::PlaneLayer;
use fearless_simd::{Level, Simd, dispatch};
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use std::ops::Range;
use std::sync::LazyLock;

/// Weight at which a surface is opaque: truncated Gaussians add up to 4 % less than 1, and ripple.
const OPAQUE: f32 = 0.92;

/// Weight up to which coverage equals weight; above it coverage rises faster, to 1 at [`OPAQUE`].
const RAMP_START: f32 = surface_canvas::RAMP_START as f32 / tent::ONE as f32;

/// Upper bound of correlations, so that no ellipse is thinner than a twentieth of its length.
const MAX_CORRELATION: f32 = 0.995;

/// Least weight at the centre of a splat.
const MIN_PEAK: f32 = 0.036;

static LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|c| linear_from_srgb8(c as u8)));

/// One pixel of the canvas.
#[derive(Clone, Copy, Default)]
struct Cell {
    /// Sum of linear light times weight on the front surface.
    sum: [f32; 3],
    /// Sum of weights on the front surface.
    weight: f32,
    /// Largest 1 / eye depth on the front surface, 1/m.
    inverse_depth: f32,
    /// Surfaces behind it: linear light times share, and the share of the pixel that they cover.
    behind: [f32; 4],
}

impl Cell {
    /// Composites the front surface over those behind it: linear light times share, and share.
    fn flatten(&self) -> [f32; 4] {
        if self.weight <= 0.0 {
            return self.behind;
        }
        let ramp = 1.0 - (OPAQUE - self.weight) * (1.0 - RAMP_START) / (OPAQUE - RAMP_START);
        let share = self.weight.max(ramp).min(1.0);
        let front = self.sum.map(|s| s / self.weight * share);
        let [r, g, b, behind] = self.behind;
        // Surfaces behind extend behind the front one, as in `blend_surfaces` of the surface
        // canvas.
        let filled = (behind / (1.0 - share).max(f32::EPSILON)).min(1.0);
        let rest = if behind > 0.0 {
            (1.0 - share) * filled / behind
        } else {
            0.0
        };
        [
            front[0] + r * rest,
            front[1] + g * rest,
            front[2] + b * rest,
            share + (1.0 - share) * filled,
        ]
    }

    /// Adds a splat. `apart`: tolerated difference of inverse depth, 1/m.
    fn add(&mut self, color: [f32; 3], weight: f32, inverse_depth: f32, apart: f32) {
        if self.inverse_depth < inverse_depth - apart {
            self.behind = self.flatten();
            self.sum = color.map(|c| c * weight);
            self.weight = weight;
            self.inverse_depth = inverse_depth;
        } else if self.inverse_depth <= inverse_depth + apart {
            self.sum
                .iter_mut()
                .zip(color)
                .for_each(|(sum, c)| *sum += c * weight);
            self.weight += weight;
            self.inverse_depth = self.inverse_depth.max(inverse_depth);
        } else if self.weight < OPAQUE {
            let share = weight.min(1.0);
            let over = |c: f32, behind: f32| c * share + behind * (1.0 - share);
            let [r, g, b, behind] = self.behind;
            self.behind = [
                over(color[0], r),
                over(color[1], g),
                over(color[2], b),
                over(1.0, behind),
            ];
        }
    }
}

/// Canvas of elliptical Gaussians, averaged per surface.
#[derive(Default)]
pub(crate) struct EllipseCanvas {
    width: u32,
    /// Rows of the frame.
    rows: Range<u32>,
    cells: Vec<Cell>,
    background: PlaneLayer,
    tolerance: Tolerance,
}

impl EllipseCanvas {
    #[inline(always)]
    fn draw_all<S: Simd>(&mut self, _: S, splats: &Splats) {
        for i in 0..splats.count() {
            self.draw_splat(splats, i);
        }
    }

    #[inline(always)]
    fn draw_splat(&mut self, splats: &Splats, i: usize) {
        let bounds = [self.rows.start as f32, self.rows.end as f32];
        let [left, right] =
            covered_pixels(splats.x[i], splats.radius_x[i], [0.0, self.width as f32]);
        let [top, bottom] = covered_pixels(splats.y[i], splats.radius_y[i], bounds);
        let [r, g, b, alpha] = splats.color[i].to_ne_bytes();
        let color = [r, g, b].map(|c| LINEAR[usize::from(c)]);
        let correlation = splats.correlation[i].clamp(-MAX_CORRELATION, MAX_CORRELATION);
        let uncorrelated = 1.0 - correlation * correlation;
        // A Gaussian whose volume is the splat's weight times the area of its bounds.
        let peak = splats.weight[i] * EllipseSize::DEVIATIONS.powi(2)
            / (std::f32::consts::TAU * uncorrelated.sqrt());
        let peak = peak.max(MIN_PEAK) * f32::from(alpha) / 255.0;
        let inverse_depth = splats.inverse_depth[i];
        let apart = self.tolerance.difference(inverse_depth);
        let scale =
            [splats.radius_x[i], splats.radius_y[i]].map(|radius| EllipseSize::DEVIATIONS / radius);
        for row in top..bottom {
            let v = (row as f32 + 0.5 - splats.y[i]) * scale[1];
            let start = (row - self.rows.start.cast_signed()) as usize * self.width as usize;
            let cells = &mut self.cells[start + left as usize..start + right as usize];
            for (cell, column) in cells.iter_mut().zip(left..) {
                let u = (column as f32 + 0.5 - splats.x[i]) * scale[0];
                let distance = (u * u + v * v - 2.0 * correlation * u * v) / uncorrelated;
                if distance < EllipseSize::DEVIATIONS.powi(2) {
                    cell.add(color, peak * (-0.5 * distance).exp(), inverse_depth, apart);
                }
            }
        }
    }
}

impl Canvas for EllipseCanvas {
    fn clear(&mut self, width: u32, rows: Range<u32>, tolerance: Tolerance) {
        self.width = width;
        self.rows = rows;
        self.tolerance = tolerance;
        self.cells.clear();
        self.cells
            .resize(width as usize * self.rows.len(), Cell::default());
    }

    fn background(&self) -> &PlaneLayer {
        &self.background
    }

    fn background_mut(&mut self) -> &mut PlaneLayer {
        &mut self.background
    }

    fn set_background(&mut self) {
        for (cells, (colors, inverse_depths)) in self
            .cells
            .chunks_mut(self.width as usize)
            .zip(self.background.visible_rows())
        {
            for ((cell, [r, g, b, share]), inverse_depth) in
                cells.iter_mut().zip(colors).zip(inverse_depths)
            {
                if *share == 255 {
                    cell.sum = [*r, *g, *b].map(|c| LINEAR[usize::from(c)]);
                    cell.weight = 1.0;
                    cell.inverse_depth = inverse_depth.max(0.0);
                }
            }
        }
    }

    fn add_rims(&mut self, _: Level) {
        for rim in self.background.rims() {
            let q = rim.inverse_depth.max(0.0);
            let apart = self.tolerance.difference(q);
            let [r, g, b, share] = rim.color;
            let [column, row] = rim.pixel.map(|v| v as usize);
            if let Some(cell) = self.cells.get_mut(row * self.width as usize + column) {
                cell.add(
                    [r, g, b].map(|c| LINEAR[usize::from(c)]),
                    f32::from(share) / 255.0,
                    q,
                    apart,
                );
            }
        }
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => self.draw_all(simd, splats));
    }

    fn read_depths(&self, row: usize, column: usize, to: &mut [f32]) {
        let start = row * self.width as usize + column;
        let from = self.cells.get(start..start + to.len()).unwrap_or(&[]);
        to.iter_mut()
            .zip(from)
            .for_each(|(to, cell)| *to = cell.inverse_depth);
    }

    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], _: Level) {
        let start = row * self.width as usize + column;
        let from = self.cells.get(start..start + to.len()).unwrap_or(&[]);
        for (to, cell) in to.iter_mut().zip(from) {
            let [r, g, b, share] = cell.flatten();
            let [r, g, b] = [r, g, b].map(|c| srgb8_from_linear(c / share.max(f32::MIN_POSITIVE)));
            *to = [r, g, b, (share.min(1.0) * 255.0 + 0.5) as u8];
        }
    }
}

#[cfg(test)]
mod tests {
    //! Gaussians and the rules of averaging against formulas.

    use super::*;
    use headbox_core::simd;

    /// Tolerated error of tables and rounding, levels of sRGB.
    const LEVELS: u8 = 1;

    fn canvas() -> EllipseCanvas {
        let mut canvas = EllipseCanvas::default();
        let tolerance = Tolerance {
            relative: 0.01,
            least: 0.001,
        };
        canvas.clear(20, 4..16, tolerance);
        canvas
    }

    fn one_splat(color: [u8; 4], weight: f32, correlation: f32) -> Box<Splats> {
        let mut splats = Box::new(Splats::new());
        splats.len = 1;
        splats.x[0] = 9.3;
        splats.y[0] = 9.8;
        splats.radius_x[0] = 6.0;
        splats.radius_y[0] = 4.0;
        splats.weight[0] = weight;
        splats.correlation[0] = correlation;
        splats.inverse_depth[0] = 0.5;
        splats.color[0] = u32::from_ne_bytes(color);
        splats
    }

    #[test]
    fn splat_is_gaussian_with_volume_of_its_weight() {
        for (weight, correlation, alpha) in [
            (0.4, 0.0, 255),
            (0.7, 0.6, 255),
            (0.5, -0.8, 100),
            (1e-4, 0.0, 255),
        ] {
            for level in simd::levels() {
                let mut canvas = canvas();
                canvas.draw(&one_splat([9, 9, 9, alpha], weight, correlation), level);
                let mut sum = 0.0;
                for (i, cell) in canvas.cells.iter().enumerate() {
                    // 2.5 deviations to the border.
                    let u = ((i % 20) as f32 + 0.5 - 9.3) / 2.4;
                    let v = ((i / 20) as f32 + 4.5 - 9.8) / 1.6;
                    let rest = 1.0 - correlation * correlation;
                    let squared = (u * u + v * v - 2.0 * correlation * u * v) / rest;
                    // The weight times the area of the bounds of one deviation, over the Gaussian's
                    // volume, in sample spacings.
                    let peak = (weight * 6.25 / (std::f32::consts::TAU * rest.sqrt())).max(0.036);
                    let expected = if squared < 6.25 {
                        peak * f32::from(alpha) / 255.0 * (-0.5 * squared).exp()
                    } else {
                        0.0
                    };
                    assert!(
                        (cell.weight - expected).abs() < 1e-5,
                        "{u} {v}: {} {expected}",
                        cell.weight
                    );
                    assert!((cell.sum[0] - expected * LINEAR[9]).abs() < 1e-6);
                    sum += cell.weight;
                }
                // Truncation at 2.5 deviations removes exp(-3.125), 4.4 %.
                if weight > 0.1 {
                    let volume = weight * 24.0 * f32::from(alpha) / 255.0;
                    assert!(
                        (sum / volume / (1.0 - (-3.125f32).exp()) - 1.0).abs() < 0.03,
                        "{sum} {volume}"
                    );
                }
            }
        }
    }

    #[test]
    fn correlations_are_clamped_below_one() {
        for (correlation, largest) in [(1.5, MAX_CORRELATION), (-1.5, -MAX_CORRELATION)] {
            let weights = |correlation| {
                let mut canvas = canvas();
                canvas.draw(&one_splat([9, 9, 9, 255], 0.5, correlation), Level::new());
                canvas
                    .cells
                    .iter()
                    .map(|cell| cell.weight)
                    .collect::<Vec<_>>()
            };
            let clamped = weights(correlation);
            assert_eq!(clamped, weights(largest));
            assert!(clamped.iter().any(|weight| *weight > 0.0));
        }
    }

    #[test]
    fn surfaces_are_separated_by_tolerance_and_bin() {
        // 1 % of 0.5 is 0.005; 1 % of 0.05 is less than a bin of 0.001.
        for (q, nearer, is_one) in [
            (0.5, 0.504, true),
            (0.5, 0.506, false),
            (0.05, 0.0508, true),
            (0.05, 0.0512, false),
        ] {
            let mut canvas = canvas();
            let mut splats = one_splat([9, 9, 9, 255], 0.5, 0.0);
            for q in [nearer, q] {
                splats.inverse_depth[0] = q;
                canvas.draw(&splats, Level::new());
            }
            let cell = canvas
                .cells
                .iter()
                .max_by(|a, b| a.weight.total_cmp(&b.weight))
                .expect("some");
            assert_eq!(
                (cell.behind == [0.0; 4], cell.inverse_depth),
                (is_one, nearer),
                "{q} and {nearer}"
            );
        }
    }

    #[test]
    fn surfaces_are_averaged_and_composited() {
        let assert_near = |actual: [f32; 4], expected: [f32; 4]| {
            assert!(
                actual
                    .iter()
                    .zip(expected)
                    .all(|(a, b)| (a - b).abs() < 1e-5),
                "{actual:?}, not {expected:?}"
            );
        };
        let red = [1.0, 0.0, 0.0];
        let blue = [0.0, 0.0, 1.0];
        let mut cell = Cell::default();
        assert_near(cell.flatten(), [0.0; 4]);
        cell.add(red, 0.5, 0.5, 0.01);
        assert_near(cell.flatten(), [0.5, 0.0, 0.0, 0.5]);
        // The same surface, slightly nearer and farther: weighted means.
        cell.add(blue, 0.25, 0.505, 0.01);
        assert_near(cell.flatten(), [0.5, 0.0, 0.25, 0.75]);
        cell.add(blue, 0.25, 0.495, 0.01);
        assert_near(cell.flatten(), [0.5, 0.0, 0.5, 1.0]);
        assert_eq!(cell.inverse_depth, 0.505);
        // Far behind an opaque surface: no change.
        cell.add([9.0; 3], 0.9, 0.1, 0.01);
        assert_near(cell.flatten(), [0.5, 0.0, 0.5, 1.0]);
        // A nearer surface over it, which remains visible where that is open.
        cell.add(red, 0.25, 0.9, 0.01);
        assert_near(cell.flatten(), [0.25 + 0.75 * 0.5, 0.0, 0.75 * 0.5, 1.0]);
        // Half of the way from the start of the ramp to opaque.
        let mut nearly_opaque = Cell::default();
        nearly_opaque.add(red, 0.835, 0.5, 0.01);
        assert_near(nearly_opaque.flatten(), [0.875, 0.0, 0.0, 0.875]);
        let mut heavy = Cell::default();
        heavy.add(red, 2.5, 0.5, 0.01);
        assert_near(heavy.flatten(), [1.0, 0.0, 0.0, 1.0]);
        // A difference equal to the tolerance is one surface.
        heavy.add(red, 1.0, 0.75, 0.25);
        assert_eq!((heavy.weight, heavy.behind), (3.5, [0.0; 4]));
        let mut thin = Cell::default();
        thin.add(blue, 1e-3, 0.5, 0.01);
        assert_near(thin.flatten(), [0.0, 0.0, 1e-3, 1e-3]);
        // Splats behind an open front: composited over each other by share; the result extends
        // behind the front.
        let mut open = Cell::default();
        open.add(red, 0.5, 0.5, 0.01);
        open.add(blue, 0.25, 0.1, 0.01);
        assert_near(open.flatten(), [0.5, 0.0, 0.25, 0.75]);
        open.add(red, 0.5, 0.1, 0.01);
        assert_near(
            open.flatten(),
            [0.5 + 0.5 * 0.5 / 0.625, 0.0, 0.5 * 0.125 / 0.625, 1.0],
        );
        let mut green = Cell::default();
        green.add([0.0, 1.0, 0.0], 0.5, 0.5, 0.01);
        green.add([0.0, 0.5, 0.0], 0.25, 0.1, 0.01);
        assert_near(green.flatten(), [0.0, 0.5 + 0.25 * 0.5, 0.0, 0.75]);
    }

    #[test]
    fn pixels_resolve_to_straight_colours_and_shares() {
        let mut canvas = canvas();
        canvas.cells[5 * 20 + 7].add([LINEAR[180], LINEAR[90], LINEAR[20]], 0.5, 0.5, 0.01);
        let mut colors = [[0; 4]; 3];
        let mut depths = [9.0; 3];
        canvas.resolve(5, 6, &mut colors, Level::new());
        canvas.read_depths(5, 6, &mut depths);
        assert_eq!(
            (colors[0], colors[2], depths),
            ([0; 4], [0; 4], [0.0, 0.5, 0.0])
        );
        assert!(
            colors[1]
                .iter()
                .zip([180, 90, 20, 128])
                .all(|(a, b)| a.abs_diff(b) <= LEVELS),
            "{:?}",
            colors[1]
        );
        assert_eq!(colors[1][3], 128, "127.5, rounded");
    }
}
