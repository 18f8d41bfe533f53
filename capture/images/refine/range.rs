//! A view's depth, small: inverse depths of square cells of pixels, each the mean of one surface.
//!
//! On a plane inverse depth is affine in a picture's pixels: its mean over a cell is that of the cell's middle to the last digit, with
//! a fraction of a sensor's noise.

use super::super::view::FARTHEST_M;
use super::super::{Lens, LoadedView};
use glam::DVec3;
use headbox_core::statistics::median;

/// Cells from left to right at most.
const COLUMNS: u32 = 128;

/// Inverse depths of one surface part by no more than this share within a cell, and from cell to cell.
const ONE_SURFACE: f32 = 0.05;

/// Inverse depths of a plane rise evenly: steps from cell to cell differ by no more than this share of them. Creases, where a plane through the
/// neighbours would be neither surface's, part by more.
const FLAT: f32 = 0.004;

/// Surfaces seen at a cosine below this are left out: their depth errs most, and says least of where they are.
const LEAST_COSINE: f64 = 0.2;

/// A view's depth and its levels in cells.
pub(super) struct RangeGrid {
    /// Cells from left to right and from top to bottom.
    pub(super) size: [u32; 2],
    /// Pixels a side of a cell.
    cell_px: u32,
    size_px: [u32; 2],
    lens: Lens,
    /// Radians a pixel, near the middle.
    pub(super) pixel_rad: f64,
    /// Multiples of the rays through the cells' middles, 1/m; NaN where no one surface is.
    inverse_depths: Vec<f32>,
    /// Mean levels of the cells, of red, green and blue together.
    levels: Vec<u8>,
}

/// A piece of surface, in the axes of its camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    pub(super) point: DVec3,
    /// Unit, toward the eye.
    pub(super) normal: DVec3,
    /// Its depth as a multiple of its ray, metres.
    pub(super) depth: f64,
}

impl RangeGrid {
    /// Of a view.
    pub(super) fn of(view: &LoadedView) -> Self {
        let [width, height] = view.size_px;
        let cell_px = width.div_ceil(COLUMNS).max(1);
        let size = [width / cell_px, height / cell_px];
        let cells = || (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| [column, row]));
        let inverse_depths = cells()
            .map(|cell| mean_of_cell(view, cell, cell_px))
            .collect();
        let levels = cells()
            .map(|cell| level_of_cell(view, cell, cell_px))
            .collect();
        let pixel_rad = 1.0 / view.lens.pixels_per_radian(view.size_px);
        Self {
            size,
            cell_px,
            size_px: view.size_px,
            lens: view.lens,
            pixel_rad,
            inverse_depths,
            levels,
        }
    }

    fn inverse_depth(&self, column: u32, row: u32) -> f32 {
        self.inverse_depths[(row * self.size[0] + column) as usize]
    }

    /// The level of a cell.
    pub(super) fn level(&self, [column, row]: [u32; 2]) -> f64 {
        f64::from(self.levels[(row * self.size[0] + column) as usize])
    }

    /// The level where a point in the camera's axes is seen, bilinear between cells; `None` at the border.
    pub(super) fn level_at(&self, point: DVec3) -> Option<f64> {
        let [x, y, _] = self.lens.project(point, self.size_px)?;
        let [x, y] = [x, y].map(|at| at / f64::from(self.cell_px) - 0.5);
        if !(x >= 0.0
            && y >= 0.0
            && x < f64::from(self.size[0]) - 1.0
            && y < f64::from(self.size[1]) - 1.0)
        {
            return None;
        }
        let (column, row) = (x as u32, y as u32);
        let across = |row: u32| {
            let [left, right] = [column, column + 1].map(|column| self.level([column, row]));
            left + (right - left) * x.fract()
        };
        Some(across(row) + (across(row + 1) - across(row)) * y.fract())
    }

    fn point(&self, column: u32, row: u32, inverse_depth: f32) -> DVec3 {
        let middle = [column, row].map(|cell| (f64::from(cell) + 0.5) * f64::from(self.cell_px));
        self.lens.ray(middle, self.size_px) / f64::from(inverse_depth)
    }

    /// The surface in a cell, if it and the four around it are of one that is not seen along itself.
    pub(super) fn facet(&self, column: u32, row: u32) -> Option<Facet> {
        if column == 0 || row == 0 || column + 1 >= self.size[0] || row + 1 >= self.size[1] {
            return None;
        }
        let own = self.inverse_depth(column, row);
        let pair = |[a, b]: [[u32; 2]; 2]| {
            let [of_a, of_b] = [a, b].map(|[column, row]| self.inverse_depth(column, row));
            // Not so of NaN.
            let on_one = (of_a - own).abs() <= ONE_SURFACE * own
                && (of_a + of_b - 2.0 * own).abs() <= FLAT * own;
            on_one.then(|| [self.point(a[0], a[1], of_a), self.point(b[0], b[1], of_b)])
        };
        let [left, right] = pair([[column - 1, row], [column + 1, row]])?;
        let [above, below] = pair([[column, row - 1], [column, row + 1]])?;
        // Right and down, so that their product looks at the eye.
        let normal = (below - above).cross(right - left).try_normalize()?;
        let point = self.point(column, row, own);
        let cosine = -normal.dot(point.normalize());
        (cosine >= LEAST_COSINE).then_some(Facet {
            point,
            normal,
            depth: 1.0 / f64::from(own),
        })
    }

    /// The surface where a point in the camera's axes would be seen, and the point's own depth.
    pub(super) fn seen_at(&self, point: DVec3) -> Option<(Facet, f64)> {
        let [x, y, depth] = self.lens.project(point, self.size_px)?;
        if !(x >= 0.0
            && y >= 0.0
            && x < f64::from(self.size_px[0])
            && y < f64::from(self.size_px[1]))
        {
            return None;
        }
        let [column, row] = [x, y].map(|at| at as u32 / self.cell_px);
        Some((self.facet(column, row)?, depth))
    }
}

/// The pixels of a cell.
fn pixels([column, row]: [u32; 2], cell_px: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..cell_px)
        .flat_map(move |y| (0..cell_px).map(move |x| (column * cell_px + x, row * cell_px + y)))
}

fn level_of_cell(view: &LoadedView, cell: [u32; 2], cell_px: u32) -> u8 {
    let of_pixel = |(x, y): (u32, u32)| {
        let [r, g, b, _] = view.color[(y * view.size_px[0] + x) as usize];
        u32::from(r) + u32::from(g) + u32::from(b)
    };
    let count = 3 * cell_px * cell_px;
    ((pixels(cell, cell_px).map(of_pixel).sum::<u32>() + count / 2) / count) as u8
}

/// The mean inverse depth of a cell; NaN unless all of its pixels are of one surface.
fn mean_of_cell(view: &LoadedView, cell: [u32; 2], cell_px: u32) -> f32 {
    let (mut sum, mut low, mut high) = (0.0, f32::INFINITY, 0.0f32);
    for (x, y) in pixels(cell, cell_px) {
        let Some(depth) = view.depth_at(x, y).filter(|depth| *depth < FARTHEST_M) else {
            return f32::NAN;
        };
        let inverse = 1.0 / depth;
        sum += f64::from(inverse);
        (low, high) = (low.min(inverse), high.max(inverse));
    }
    let mean = (sum / f64::from(cell_px * cell_px)) as f32;
    if high - low <= ONE_SURFACE * mean {
        mean
    } else {
        f32::NAN
    }
}

/// How far views see, metres: the median of their medians; `None` if none sees a surface.
pub(super) fn median_depth(grids: &[RangeGrid]) -> Option<f64> {
    let known = |grid: &RangeGrid| {
        median(
            grid.inverse_depths
                .iter()
                .filter(|inverse| !inverse.is_nan())
                .map(|inverse| 1.0 / f64::from(*inverse)),
        )
    };
    median(grids.iter().filter_map(known))
}
