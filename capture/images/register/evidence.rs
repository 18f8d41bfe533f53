//! What alignment needs of a view: a small picture, and points of its depth image.

use super::{LoadedView, Pinhole, Pose};
use glam::{DVec3, dvec3};

/// A small picture of a view, and points that it sees.
pub(super) struct Evidence {
    /// Full-size pixels a side of one of the small picture's.
    pub(super) reduced: u32,
    /// Size of the small picture.
    pub(super) size: [usize; 2],
    /// Its levels, a plane of each channel.
    pub(super) planes: [Vec<u8>; 3],
    /// Mean of the three.
    pub(super) grey: Vec<u8>,
    /// Points of the world, metres; every [`UNSEEN`]-th is kept from the estimate, for judging it.
    pub(super) points: Vec<DVec3>,
    /// Depths of every so many-th of its pixels ([`DEPTH_STEP`]), NaN where they are unknown.
    depths: Vec<f32>,
    /// Of the depth image.
    pub(super) pose: Pose,
    /// Median depth of the points, metres.
    pub(super) depth_m: f64,
}

/// Points are taken from so many columns at most.
pub(super) const COLUMNS: u32 = 56;

/// The small picture's width at most.
const WIDTH: u32 = 320;

/// One point in so many judges the estimate from the others.
pub(super) const UNSEEN: usize = 4;

/// Points whose neighbours' inverse depths differ by a larger share lie at an edge.
const AT_EDGE: f32 = 0.02;

/// Pixels of the small picture from one depth that is remembered to the next.
const DEPTH_STEP: u32 = 2;

/// A point is what a depth image shows if their depths differ by less than this share: poses drift by a few hundredths, and what hides
/// something is nearer by more.
const SAME_SURFACE: f64 = 0.05;

impl Evidence {
    /// Of a view, its points from so many columns at most.
    pub(super) fn of(view: &LoadedView, columns: u32) -> Self {
        let [width, height] = view.size_px;
        let reduced = width.div_ceil(WIDTH).max(1);
        let size = [width / reduced, height / reduced].map(|side| side as usize);
        let mean = |channel: usize, i: usize| {
            let (x, y) = (
                (i % size[0]) as u32 * reduced,
                (i / size[0]) as u32 * reduced,
            );
            let at = |k: u32| ((y + k / reduced) * width + x + k % reduced) as usize;
            let sum: u32 = (0..reduced * reduced)
                .map(|k| u32::from(view.color[at(k)][channel]))
                .sum();
            ((sum + reduced * reduced / 2) / (reduced * reduced)) as u8
        };
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
                let around = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
                let Some(depth) = view.depth_at(x, y) else {
                    continue;
                };
                let smooth = |&(x, y): &(u32, u32)| {
                    view.depth_at(x, y)
                        .is_some_and(|d| (d / depth - 1.0).abs() < AT_EDGE)
                };
                if around.iter().all(smooth) {
                    points.extend(view.point_at(x, y));
                    depths.push(f64::from(depth));
                }
            }
        }
        depths.sort_by(f64::total_cmp);
        let depth_m = depths.get(depths.len() / 2).copied().unwrap_or(1.0);
        let apart = reduced * DEPTH_STEP;
        let place = |number: u32, side: u32| (number * apart + apart / 2).min(side - 1);
        let [columns, rows] = size.map(|side| (side as u32).div_ceil(DEPTH_STEP));
        let depth = |(x, y)| {
            view.depth_at(place(x, width), place(y, height))
                .unwrap_or(f32::NAN)
        };
        let depths = (0..rows)
            .flat_map(|y| (0..columns).map(move |x| (x, y)))
            .map(depth)
            .collect();
        Self {
            reduced,
            size,
            planes,
            grey,
            points,
            depths,
            pose: view.pose,
            depth_m,
        }
    }

    /// Whether the depth camera, through its lens, sees a point of the world: its depth image, if it knows, shows nothing else there.
    pub(super) fn sees(&self, lens: &Pinhole, point: DVec3) -> bool {
        let eye = self.pose.to_eye(point);
        let depth = -eye.z;
        if depth < 1e-3 {
            return false;
        }
        let apart = f64::from(self.reduced * DEPTH_STEP);
        let x = (lens.principal_px[0] + lens.focal_px[0] * eye.x / depth) / apart;
        let y = (lens.principal_px[1] - lens.focal_px[1] * eye.y / depth) / apart;
        let [columns, rows] = self.size.map(|side| side.div_ceil(DEPTH_STEP as usize));
        if !(x >= 0.0 && y >= 0.0 && x < columns as f64 && y < rows as f64) {
            return false;
        }
        let shown = f64::from(self.depths[y as usize * columns + x as usize]);
        shown.is_nan() || (shown / depth - 1.0).abs() < SAME_SURFACE
    }
}

/// A grey picture, blurred, that answers with its level and slopes between pixels.
pub(super) struct Smooth {
    size: [usize; 2],
    levels: Vec<u8>,
}

impl Smooth {
    /// Blurred `rounds` times by (1 2 1) / 4 both ways.
    pub(super) fn new(grey: &[u8], size: [usize; 2], rounds: u32) -> Self {
        let mut levels: Vec<f32> = grey.iter().map(|&level| f32::from(level)).collect();
        let mut between = vec![0.0; levels.len()];
        for _ in 0..rounds {
            blur_rows(&levels, &mut between, size[0]);
            blur_columns(&between, &mut levels, size[0]);
        }
        Self {
            size,
            levels: levels
                .into_iter()
                .map(|level| (level + 0.5) as u8)
                .collect(),
        }
    }

    /// Level, and its slopes to the right and down, at a position in pixels; `None` at the border.
    #[inline]
    pub(super) fn at(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let [width, height] = self.size;
        let (x, y) = (x - 0.5, y - 0.5);
        if !(x >= 1.0 && y >= 1.0 && x < width as f64 - 2.0 && y < height as f64 - 2.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f64, y - row as f64);
        let level =
            |dx: usize, dy: usize| f64::from(self.levels[(row + dy - 1) * width + column + dx - 1]);
        let mix = |a: f64, b: f64, f: f64| a + (b - a) * f;
        let across = |dy: usize| mix(level(1, dy), level(2, dy), fx);
        // Differences over two pixels, mixed like the levels: smoother than the bilinear patch's own.
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

/// Each value with its neighbours to the left and right; beyond the ends lies what is at them.
fn blur_rows(from: &[f32], to: &mut [f32], width: usize) {
    for (from, to) in from.chunks_exact(width).zip(to.chunks_exact_mut(width)) {
        for (to, around) in to[1..].iter_mut().zip(from.windows(3)) {
            *to = mixed(around[0], around[1], around[2]);
        }
        let last = width - 1;
        to[0] = mixed(from[0], from[0], from[1.min(last)]);
        to[last] = mixed(from[last.saturating_sub(1)], from[last], from[last]);
    }
}

/// Each value with its neighbours above and below.
fn blur_columns(from: &[f32], to: &mut [f32], width: usize) {
    let last = (from.len() / width).saturating_sub(1);
    let row = |number: usize| &from[number * width..(number + 1) * width];
    for (number, to) in to.chunks_exact_mut(width).enumerate() {
        let (above, here, below) = (
            row(number.saturating_sub(1)),
            row(number),
            row((number + 1).min(last)),
        );
        for (to, ((above, here), below)) in to.iter_mut().zip(above.iter().zip(here).zip(below)) {
            *to = mixed(*above, *here, *below);
        }
    }
}

#[inline(always)]
fn mixed(before: f32, here: f32, after: f32) -> f32 {
    (before + 2.0 * here + after) / 4.0
}

/// A point in axes X right, Y down, Z forward, in which lenses are written.
pub(super) fn camera_axes(p: DVec3) -> DVec3 {
    dvec3(p.x, -p.y, -p.z)
}
