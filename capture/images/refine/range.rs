//! Small depth image of a view: mean inverse depths of square cells of pixels, each of one surface.
//!
//! On a plane inverse depth is affine in the image's pixels: the mean over a cell is the value at
//! the cell's centre to the last digit, with a fraction of a sensor's noise.

use super::super::views::view::MAX_DEPTH_M;
use super::super::{Lens, LoadedView};
use glam::DVec3;
use headbox_core::statistics::median;

/// Maximum number of columns of cells.
const MAX_COLUMNS: u32 = 128;

/// Maximum relative difference of inverse depth within a cell and between neighbouring cells of one
/// surface.
const ONE_SURFACE: f32 = 0.05;

/// Maximum relative deviation from equal steps of inverse depth between cells on a plane. Creases,
/// where a plane through the neighbours would belong to neither surface, deviate more.
const FLAT: f32 = 0.004;

/// Minimum cosine between normal and line of sight: depth is least accurate and least constraining
/// at grazing angles.
const MIN_COSINE: f64 = 0.2;

/// Depth and grey levels of a view in cells.
pub(super) struct RangeGrid {
    /// Numbers of columns and rows of cells.
    pub(super) size: [u32; 2],
    /// Side of a cell, pixels.
    cell_px: u32,
    size_px: [u32; 2],
    lens: Lens,
    /// Size of a pixel at the image's centre, radians.
    pub(super) pixel_rad: f64,
    /// Inverse depths as multiples of the rays through the cells' centres, 1/m; NaN without a
    /// single surface.
    inverse_depths: Vec<f32>,
    /// Mean levels of the cells over all three channels.
    levels: Vec<u8>,
}

/// A surface element in the axes of its camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    pub(super) point: DVec3,
    /// Unit normal toward the eye.
    pub(super) normal: DVec3,
    /// Depth as a multiple of its ray, metres.
    pub(super) depth: f64,
}

impl RangeGrid {
    /// Reduces a view to cells.
    pub(super) fn new(view: &LoadedView) -> Self {
        let [width, height] = view.size_px;
        let cell_px = width.div_ceil(MAX_COLUMNS).max(1);
        let size = [width / cell_px, height / cell_px];
        let cells = || (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| [column, row]));
        let inverse_depths = cells()
            .map(|cell| mean_inverse_depth(view, cell, cell_px))
            .collect();
        let levels = cells()
            .map(|cell| mean_level(view, cell, cell_px))
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

    /// Returns the grey level of a cell.
    pub(super) fn level(&self, [column, row]: [u32; 2]) -> f64 {
        f64::from(self.levels[(row * self.size[0] + column) as usize])
    }

    /// Samples the grey level at the projection of a point in the camera's axes, bilinearly between
    /// cells; `None` at the border.
    pub(super) fn level_at(&self, point: DVec3) -> Option<f64> {
        let [x, y, _] = self.lens.project(point, self.size_px)?;
        let [x, y] = [x, y].map(|pixel| pixel / f64::from(self.cell_px) - 0.5);
        if !(x >= 0.0
            && y >= 0.0
            && x < f64::from(self.size[0]) - 1.0
            && y < f64::from(self.size[1]) - 1.0)
        {
            return None;
        }
        let column = x as u32;
        let row = y as u32;
        let across = |row: u32| {
            let [left, right] = [column, column + 1].map(|column| self.level([column, row]));
            left + (right - left) * x.fract()
        };
        Some(across(row) + (across(row + 1) - across(row)) * y.fract())
    }

    fn point(&self, column: u32, row: u32, inverse_depth: f32) -> DVec3 {
        let centre = [column, row].map(|cell| (f64::from(cell) + 0.5) * f64::from(self.cell_px));
        self.lens.ray(centre, self.size_px) / f64::from(inverse_depth)
    }

    /// Returns the surface in a cell, if the cell and its four neighbours are on one plane that is
    /// not seen at a grazing angle.
    pub(super) fn facet(&self, column: u32, row: u32) -> Option<Facet> {
        if column == 0 || row == 0 || column + 1 >= self.size[0] || row + 1 >= self.size[1] {
            return None;
        }
        let own = self.inverse_depth(column, row);
        let pair = |[a, b]: [[u32; 2]; 2]| {
            let [depth_a, depth_b] = [a, b].map(|[column, row]| self.inverse_depth(column, row));
            // False for NaN.
            let is_flat = (depth_a - own).abs() <= ONE_SURFACE * own
                && (depth_a + depth_b - 2.0 * own).abs() <= FLAT * own;
            is_flat.then(|| {
                [
                    self.point(a[0], a[1], depth_a),
                    self.point(b[0], b[1], depth_b),
                ]
            })
        };
        let [left, right] = pair([[column - 1, row], [column + 1, row]])?;
        let [above, below] = pair([[column, row - 1], [column, row + 1]])?;
        // Down times right, so that the normal points to the eye.
        let normal = (below - above).cross(right - left).try_normalize()?;
        let point = self.point(column, row, own);
        let cosine = -normal.dot(point.normalize());
        (cosine >= MIN_COSINE).then_some(Facet {
            point,
            normal,
            depth: 1.0 / f64::from(own),
        })
    }

    /// Returns the surface at the projection of a point in the camera's axes, and the point's own
    /// depth.
    pub(super) fn project(&self, point: DVec3) -> Option<(Facet, f64)> {
        let [x, y, depth] = self.lens.project(point, self.size_px)?;
        if !(x >= 0.0
            && y >= 0.0
            && x < f64::from(self.size_px[0])
            && y < f64::from(self.size_px[1]))
        {
            return None;
        }
        let [column, row] = [x, y].map(|pixel| pixel as u32 / self.cell_px);
        Some((self.facet(column, row)?, depth))
    }
}

/// Returns the pixels of a cell.
fn pixels([column, row]: [u32; 2], cell_px: u32) -> impl Iterator<Item = (u32, u32)> {
    (0..cell_px)
        .flat_map(move |y| (0..cell_px).map(move |x| (column * cell_px + x, row * cell_px + y)))
}

/// Returns the mean level of a cell over its pixels and channels, rounded.
fn mean_level(view: &LoadedView, cell: [u32; 2], cell_px: u32) -> u8 {
    let sum_channels = |(x, y): (u32, u32)| {
        let [r, g, b, _] = view.color[(y * view.size_px[0] + x) as usize];
        u32::from(r) + u32::from(g) + u32::from(b)
    };
    let count = 3 * cell_px * cell_px;
    ((pixels(cell, cell_px).map(sum_channels).sum::<u32>() + count / 2) / count) as u8
}

/// Returns the mean inverse depth of a cell; NaN unless all of its pixels are on one surface.
fn mean_inverse_depth(view: &LoadedView, cell: [u32; 2], cell_px: u32) -> f32 {
    let mut sum = 0.0;
    let mut low = f32::INFINITY;
    let mut high = 0.0f32;
    for (x, y) in pixels(cell, cell_px) {
        let Some(depth) = view.depth_at(x, y).filter(|depth| *depth < MAX_DEPTH_M) else {
            return f32::NAN;
        };
        let inverse = 1.0 / depth;
        sum += f64::from(inverse);
        low = low.min(inverse);
        high = high.max(inverse);
    }
    let mean = (sum / f64::from(cell_px * cell_px)) as f32;
    if high - low <= ONE_SURFACE * mean {
        mean
    } else {
        f32::NAN
    }
}

/// Returns the median over views of their median depths, metres; `None` without any surface.
pub(super) fn median_depth(grids: &[RangeGrid]) -> Option<f64> {
    let view_median = |grid: &RangeGrid| {
        median(
            grid.inverse_depths
                .iter()
                .filter(|inverse| !inverse.is_nan())
                .map(|inverse| 1.0 / f64::from(*inverse)),
        )
    };
    median(grids.iter().filter_map(view_median))
}
