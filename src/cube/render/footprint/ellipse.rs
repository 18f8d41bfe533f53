//! Elliptical Gaussians, averaged per surface in floating point, to measure the integer kernels against.
//!
//! The rules are those of [`crate::render::canvas::surface`]; what differs is that nothing is rounded. Footprints are ellipses whose weights
//! add up to 1 on a surface, colours are kept in linear light, and sums are `f32`.

use crate::render::planes::PlaneCanvas;
use super::size::EllipseSize;
use crate::render::footprint::splat;
use super::splat::{Canvas, Splats, covered};
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use crate::render::Spans;
use fearless_simd::{Level, Simd, dispatch};
use std::ops::Range;
use std::sync::LazyLock;

/// Weight at which a surface hides wholly what is behind it: cut off Gaussians add up to 4 % less than 1, and ripple.
const OPAQUE: f32 = 0.92;

/// The least part of a pixel that a surface has where it has any.
const MIN_SHARE: f32 = 0.05;

/// Correlations are at most this, so that no ellipse is thinner than a twentieth of its length.
const MAX_CORRELATION: f32 = 0.995;

/// A splat weighs at least this in the middle, however small its sample is.
const MIN_PEAK: f32 = 0.036;

static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|c| linear_from_srgb8(c as u8)));

/// One pixel.
#[derive(Clone, Copy, Default)]
struct Cell {
    /// Of the front surface: linear light times weight.
    sum: [f32; 3],
    weight: f32,
    /// 1 / eye depth of the front surface, 1/m: the largest in the mean.
    inverse_depth: f32,
    /// What is behind it: linear light times share, and the share of the pixel that is covered.
    behind: [f32; 4],
}

impl Cell {
    /// The front surface over what is behind it, in linear light times share, and share.
    fn flattened(&self) -> [f32; 4] {
        if self.weight <= 0.0 {
            return self.behind;
        }
        let share = (self.weight / OPAQUE).clamp(MIN_SHARE, 1.0);
        let front = self.sum.map(|s| s / self.weight * share);
        let [r, g, b, behind] = self.behind;
        // What is behind goes on behind the front, as in `crate::render::canvas::surface`.
        let filled = (behind / (1.0 - share).max(f32::EPSILON)).min(1.0);
        let rest = if behind > 0.0 { (1.0 - share) * filled / behind } else { 0.0 };
        [front[0] + r * rest, front[1] + g * rest, front[2] + b * rest, share + (1.0 - share) * filled]
    }

    /// Adds a splat.
    fn add(&mut self, color: [f32; 3], weight: f32, inverse_depth: f32, apart: f32) {
        if self.inverse_depth < inverse_depth - apart {
            self.behind = self.flattened();
            (self.sum, self.weight, self.inverse_depth) = (color.map(|c| c * weight), weight, inverse_depth);
        } else if self.inverse_depth <= inverse_depth + apart {
            self.sum.iter_mut().zip(color).for_each(|(sum, c)| *sum += c * weight);
            self.weight += weight;
            self.inverse_depth = self.inverse_depth.max(inverse_depth);
        } else if self.weight < OPAQUE {
            let share = weight.min(1.0);
            let over = |c: f32, behind: f32| c * share + behind * (1.0 - share);
            let [r, g, b, behind] = self.behind;
            self.behind = [over(color[0], r), over(color[1], g), over(color[2], b), over(1.0, behind)];
        }
    }
}

/// An image of surfaces, in floating point.
#[derive(Default)]
pub(crate) struct EllipseCanvas {
    width: u32,
    /// Rows of the frame that it holds.
    rows: Range<u32>,
    cells: Vec<Cell>,
    ground: PlaneCanvas,
    /// As in [`crate::render::canvas::surface::SurfaceCanvas`].
    pub(crate) tolerance: f32,
    /// As in [`crate::render::canvas::surface::SurfaceCanvas`].
    pub(crate) bin: f32,
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
        let [left, right] = covered(splats.x[i], splats.radius_x[i], [0.0, self.width as f32]);
        let [top, bottom] = covered(splats.y[i], splats.radius_y[i], bounds);
        let [r, g, b, alpha] = splats.color[i].to_ne_bytes();
        let color = [r, g, b].map(|c| LINEAR[usize::from(c)]);
        let correlation = splats.correlation[i].clamp(-MAX_CORRELATION, MAX_CORRELATION);
        let uncorrelated = 1.0 - correlation * correlation;
        // A Gaussian of volume `area`, of which the splat's weight is the part of its bounds.
        let peak = splats.weight[i] * EllipseSize::DEVIATIONS.powi(2) / (std::f32::consts::TAU * uncorrelated.sqrt());
        let peak = peak.max(MIN_PEAK) * f32::from(alpha) / 255.0;
        let inverse_depth = splats.inverse_depth[i];
        let apart = (inverse_depth * self.tolerance).max(self.bin);
        let scale = [splats.radius_x[i], splats.radius_y[i]].map(|radius| EllipseSize::DEVIATIONS / radius);
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
    fn clear(&mut self, width: u32, rows: Range<u32>) {
        self.width = width;
        self.rows = rows;
        self.cells.clear();
        self.cells.resize(width as usize * self.rows.len(), Cell::default());
    }

    fn clear_spans(&mut self, [width, height]: [u32; 2], spans: &dyn Fn(u32) -> Spans) {
        if (self.width, &self.rows) != (width, &(0..height)) {
            self.clear(width, 0..height);
        }
        splat::clear_spans(&mut self.cells, width as usize, 0, Cell::default(), spans);
    }

    fn ground(&self) -> &PlaneCanvas {
        &self.ground
    }

    fn ground_mut(&mut self) -> &mut PlaneCanvas {
        &mut self.ground
    }

    fn lay(&mut self) {
        for (cells, (colors, inverse_depths)) in self.cells.chunks_mut(self.width as usize).zip(self.ground.rows()) {
            for ((cell, [r, g, b, share]), inverse_depth) in cells.iter_mut().zip(colors).zip(inverse_depths) {
                if *share == 255 {
                    (cell.sum, cell.weight) = ([*r, *g, *b].map(|c| LINEAR[usize::from(c)]), 1.0);
                    cell.inverse_depth = inverse_depth.max(0.0);
                }
            }
        }
    }

    fn add_rims(&mut self, _: Level) {
        for rim in self.ground.rims() {
            let q = rim.inverse_depth.max(0.0);
            let apart = (q * self.tolerance).max(self.bin);
            let ([r, g, b, share], [column, row]) = (rim.color, rim.pixel.map(|v| v as usize));
            if let Some(cell) = self.cells.get_mut(row * self.width as usize + column) {
                cell.add([r, g, b].map(|c| LINEAR[usize::from(c)]), f32::from(share) / 255.0, q, apart);
            }
        }
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => self.draw_all(simd, splats));
    }

    fn tell_depths(&self, row: usize, column: usize, to: &mut [f32]) {
        let start = row * self.width as usize + column;
        let from = self.cells.get(start..start + to.len()).unwrap_or(&[]);
        to.iter_mut().zip(from).for_each(|(to, cell)| *to = cell.inverse_depth);
    }

    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], _: Level) {
        let start = row * self.width as usize + column;
        let from = self.cells.get(start..start + to.len()).unwrap_or(&[]);
        for (to, cell) in to.iter_mut().zip(from) {
            let [r, g, b, share] = cell.flattened();
            let [r, g, b] = [r, g, b].map(|c| srgb8_from_linear(c / share.max(f32::MIN_POSITIVE)));
            *to = [r, g, b, (share.min(1.0) * 255.0 + 0.5) as u8];
        }
    }
}

#[cfg(test)]
mod tests;
