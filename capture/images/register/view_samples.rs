//! Data of a view for registration: a small image, and points of its depth image.

use super::{LoadedView, Pinhole, Pose};
use glam::DVec3;

/// Small image of a view, and points of its depth image.
pub(super) struct ViewSamples {
    /// Reduction factor of the small image.
    pub(super) reduction: u32,
    /// Size of the small image.
    pub(super) size: [usize; 2],
    /// Levels of the small image, one plane per channel.
    pub(super) planes: [Vec<u8>; 3],
    /// Mean of the three planes.
    grey: Vec<u8>,
    /// True at pixels of the small image that are opaque: neither masked nor outside of a distorted
    /// photograph.
    pub(super) is_opaque: Vec<bool>,
    /// Points of the world, metres; every [`VALIDATION_STRIDE`]-th is excluded from the estimate
    /// for validation.
    pub(super) points: Vec<DVec3>,
    /// Depth of every [`DEPTH_STEP`]-th pixel of the small image, NaN where unknown.
    depths: Vec<f32>,
    /// Pose of the depth image.
    pub(super) pose: Pose,
    /// Median depth of the points, metres.
    pub(super) depth_m: f64,
}

/// Maximum number of columns of points.
pub(super) const MAX_COLUMNS: u32 = 56;

/// Maximum width of the small image, pixels.
const MAX_WIDTH: u32 = 320;

/// One in this number of points is excluded from the estimate, for validation.
pub(super) const VALIDATION_STRIDE: usize = 4;

/// Relative depth difference between neighbouring pixels above which there is an edge.
const EDGE_DIFFERENCE: f32 = 0.02;

/// Distance of stored depths, pixels of the small image.
const DEPTH_STEP: u32 = 2;

/// Maximum relative depth difference of a point from the surface of a depth image: poses drift by a
/// few hundredths, and occluders are nearer by more.
const SAME_SURFACE: f64 = 0.05;

impl ViewSamples {
    /// Samples a view with at most `columns` columns of points.
    pub(super) fn new(view: &LoadedView, columns: u32) -> Self {
        let [width, height] = view.size_px;
        let reduction = width.div_ceil(MAX_WIDTH).max(1);
        let size = [width / reduction, height / reduction].map(|side| side as usize);
        let block = |i: usize| {
            let x = (i % size[0]) as u32 * reduction;
            let y = (i / size[0]) as u32 * reduction;
            let index = move |k: u32| ((y + k / reduction) * width + x + k % reduction) as usize;
            (0..reduction * reduction).map(move |k| view.color[index(k)])
        };
        let mean = |channel: usize, i: usize| {
            let sum: u32 = block(i).map(|pixel| u32::from(pixel[channel])).sum();
            ((sum + reduction * reduction / 2) / (reduction * reduction)) as u8
        };
        let is_opaque = (0..size[0] * size[1])
            .map(|i| block(i).all(|pixel| pixel[3] > 0))
            .collect();
        let planes = [0, 1, 2].map(|channel| {
            (0..size[0] * size[1])
                .map(|i| mean(channel, i))
                .collect::<Vec<u8>>()
        });
        let grey = (0..size[0] * size[1])
            .map(|i| ((0..3).map(|c| u32::from(planes[c][i])).sum::<u32>() / 3) as u8);
        let grey = grey.collect();
        let step = (width / columns.max(1)).max(1);
        let mut points = Vec::new();
        let mut depths = Vec::new();
        for y in (step / 2 + 1..height.saturating_sub(1)).step_by(step as usize) {
            for x in (step / 2 + 1..width.saturating_sub(1)).step_by(step as usize) {
                let neighbors = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
                let Some(depth) = view.depth_at(x, y) else {
                    continue;
                };
                let is_smooth = |&(x, y): &(u32, u32)| {
                    view.depth_at(x, y)
                        .is_some_and(|d| (d / depth - 1.0).abs() < EDGE_DIFFERENCE)
                };
                if neighbors.iter().all(is_smooth) {
                    points.extend(view.point_at(x, y));
                    depths.push(f64::from(depth));
                }
            }
        }
        depths.sort_by(f64::total_cmp);
        let depth_m = depths.get(depths.len() / 2).copied().unwrap_or(1.0);
        let stride = reduction * DEPTH_STEP;
        let center = |index: u32, side: u32| (index * stride + stride / 2).min(side - 1);
        let [columns, rows] = size.map(|side| (side as u32).div_ceil(DEPTH_STEP));
        let depth = |(x, y)| {
            view.depth_at(center(x, width), center(y, height))
                .unwrap_or(f32::NAN)
        };
        let depths = (0..rows)
            .flat_map(|y| (0..columns).map(move |x| (x, y)))
            .map(depth)
            .collect();
        Self {
            reduction,
            size,
            planes,
            grey,
            is_opaque,
            points,
            depths,
            pose: view.pose,
            depth_m,
        }
    }

    /// Returns true if a point of the world is visible to the depth camera: inside the image, and
    /// at the depth image's surface if that is known.
    pub(super) fn is_visible(&self, lens: &Pinhole, point: DVec3) -> bool {
        let eye = self.pose.to_eye(point);
        let depth = -eye.z;
        if depth < 1e-3 {
            return false;
        }
        let stride = f64::from(self.reduction * DEPTH_STEP);
        let x = (lens.principal_px[0] + lens.focal_px[0] * eye.x / depth) / stride;
        let y = (lens.principal_px[1] - lens.focal_px[1] * eye.y / depth) / stride;
        let [columns, rows] = self.size.map(|side| side.div_ceil(DEPTH_STEP as usize));
        if !(x >= 0.0 && y >= 0.0 && x < columns as f64 && y < rows as f64) {
            return false;
        }
        let surface = f64::from(self.depths[y as usize * columns + x as usize]);
        surface.is_nan() || (surface / depth - 1.0).abs() < SAME_SURFACE
    }
}

/// Blurred grey image, sampled with its slopes.
pub(super) struct BlurredImage {
    size: [usize; 2],
    levels: Vec<u8>,
    /// True where the pixel and all that are interpolated with it are opaque; `None` if all are.
    is_sampled: Option<Vec<bool>>,
}

impl BlurredImage {
    /// Blurs the grey image `rounds` times by (1 2 1) / 4 in both directions; transparent pixels do
    /// not take part.
    pub(super) fn new(view: &ViewSamples, rounds: u32) -> Self {
        let [width, height] = view.size;
        let levels = view.grey.iter().zip(&view.is_opaque);
        let levels = levels.map(|(&level, &opaque)| if opaque { f32::from(level) } else { 0.0 });
        let mut levels = blurred(levels.collect(), width, rounds);
        let is_all_opaque = view.is_opaque.iter().all(|opaque| *opaque);
        if !is_all_opaque {
            let weights = view.is_opaque.iter().map(|&opaque| f32::from(opaque));
            let weights = blurred(weights.collect(), width, rounds);
            for (level, weight) in levels.iter_mut().zip(weights) {
                *level /= weight.max(f32::MIN_POSITIVE);
            }
        }
        let is_sampled = |i: usize| {
            let rows = (i / width).saturating_sub(1)..(i / width + 3).min(height);
            let columns = (i % width).saturating_sub(1)..(i % width + 3).min(width);
            let mut rows = rows.map(|row| &view.is_opaque[row * width..][columns.clone()]);
            rows.all(|row| row.iter().all(|opaque| *opaque))
        };
        Self {
            size: view.size,
            levels: levels
                .into_iter()
                .map(|level| (level + 0.5) as u8)
                .collect(),
            is_sampled: (!is_all_opaque).then(|| (0..width * height).map(is_sampled).collect()),
        }
    }

    /// Samples the level and its slopes to the right and down at a position in pixels; `None` at
    /// the border and beside transparent pixels.
    #[inline]
    pub(super) fn sample(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let [width, height] = self.size;
        let x = x - 0.5;
        let y = y - 0.5;
        if !(x >= 1.0 && y >= 1.0 && x < width as f64 - 2.0 && y < height as f64 - 2.0) {
            return None;
        }
        let column = x as usize;
        let row = y as usize;
        if let Some(is_sampled) = &self.is_sampled
            && !is_sampled[row * width + column]
        {
            return None;
        }
        let fx = x - column as f64;
        let fy = y - row as f64;
        let level =
            |dx: usize, dy: usize| f64::from(self.levels[(row + dy - 1) * width + column + dx - 1]);
        let mix = |a: f64, b: f64, f: f64| a + (b - a) * f;
        let across = |dy: usize| mix(level(1, dy), level(2, dy), fx);
        // Differences over two pixels, interpolated like the levels: smoother than the slopes of
        // the bilinear patch.
        let slope_x =
            |dy: usize| mix(level(2, dy) - level(0, dy), level(3, dy) - level(1, dy), fx) / 2.0;
        let slope_y = mix(across(2) - across(0), across(3) - across(1), fy) / 2.0;
        Some([
            mix(across(1), across(2), fy),
            mix(slope_x(1), slope_x(2), fy),
            slope_y,
        ])
    }
}

/// Blurs values in rows of `width`, `rounds` times in both directions.
fn blurred(mut values: Vec<f32>, width: usize, rounds: u32) -> Vec<f32> {
    let mut blurred_rows = vec![0.0; values.len()];
    for _ in 0..rounds {
        blur_rows(&values, &mut blurred_rows, width);
        blur_columns(&blurred_rows, &mut values, width);
    }
    values
}

/// Blurs each value with its neighbours to the left and right, clamped at the ends.
fn blur_rows(from: &[f32], to: &mut [f32], width: usize) {
    for (from, to) in from.chunks_exact(width).zip(to.chunks_exact_mut(width)) {
        for (to, window) in to[1..].iter_mut().zip(from.windows(3)) {
            *to = blur(window[0], window[1], window[2]);
        }
        let last = width - 1;
        to[0] = blur(from[0], from[0], from[1.min(last)]);
        to[last] = blur(from[last.saturating_sub(1)], from[last], from[last]);
    }
}

/// Blurs each value with its neighbours above and below, clamped at the ends.
fn blur_columns(from: &[f32], to: &mut [f32], width: usize) {
    let last = (from.len() / width).saturating_sub(1);
    let row = |index: usize| &from[index * width..(index + 1) * width];
    for (index, to) in to.chunks_exact_mut(width).enumerate() {
        let above = row(index.saturating_sub(1));
        let here = row(index);
        let below = row((index + 1).min(last));
        for (to, ((above, here), below)) in to.iter_mut().zip(above.iter().zip(here).zip(below)) {
            *to = blur(*above, *here, *below);
        }
    }
}

#[inline(always)]
fn blur(before: f32, here: f32, after: f32) -> f32 {
    (before + 2.0 * here + after) / 4.0
}
