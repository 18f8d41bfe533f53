//! What a pixel of a depth image knows of its surface: how it is tilted, and whether it lies on one at all.

use crate::capture::images::{Lens, LoadedView};
use glam::{DVec3, Vec3};
use std::ops::Range;

/// The surface at a pixel, relative to the cube's centre, metres, world axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// The point that the pixel sees.
    pub(super) point: Vec3,
    /// What a step of one pixel to the right adds to it.
    pub(super) across: Vec3,
    /// What a step of one pixel down adds to it.
    pub(super) down: Vec3,
    /// Unit normal, toward the eye.
    pub(super) normal: Vec3,
}

/// A few rows of a depth image as points.
pub(super) struct Surfaces {
    /// The eye, relative to the cube's centre.
    eye: Vec3,
    /// The first of the rows.
    first: u32,
    width: usize,
    /// Of the pixels of these rows and of one below, and of one more on the right: their rays, world axes.
    rays: Vec<Vec3>,
    /// Of the pixels of these rows and of one around: inverse depths as multiples of the rays, NaN if unknown or outside.
    inverse_depths: Vec<f32>,
    /// Inverse depths of one surface part by no more than this from pixel to pixel, relative to a fronto-parallel plane: by
    /// noise of the sensor, in 1/m, and by a share of the inverse depth.
    tolerance: [f32; 2],
    has_noise: bool,
}

/// The steepest surface that counts as one: its inverse depth may change by this share from a pixel to the next for each
/// radian of a pixel's width.
const STEEPEST: f32 = 12.0;

/// A pixel with fewer neighbours than this (of eight) on its own surface is a flying one: a mixture of what lies before and
/// behind an edge.
const LEAST_NEIGHBORS: u32 = 3;

impl Surfaces {
    /// Of some rows. `noise`: standard deviation of inverse depth, 1/m.
    pub(super) fn new(view: &LoadedView, rows: Range<u32>, centre: DVec3, noise: f32) -> Self {
        let [width, height] = view.size_px;
        let mut inverse_depths = vec![f32::NAN; (rows.len() + 2) * (width as usize + 2)];
        for (y, row) in (i64::from(rows.start) - 1..).zip(inverse_depths.chunks_exact_mut(width as usize + 2)) {
            if (0..i64::from(height)).contains(&y) {
                for (x, inverse_depth) in (0..width).zip(&mut row[1..]) {
                    *inverse_depth = view.depth_at(x, y as u32).map_or(f32::NAN, |depth| 1.0 / depth);
                }
            }
        }
        let pixel = 1.0 / view.lens.pixels_per_radian(view.size_px) as f32;
        Self {
            eye: (view.pose.eye - centre).as_vec3(),
            first: rows.start,
            width: width as usize,
            rays: rays(view, rows),
            inverse_depths,
            tolerance: [3.0 * noise, STEEPEST * pixel],
            has_noise: noise > 0.0,
        }
    }

    /// The surface of a pixel, or `None` if its depth is unknown or no surface's.
    pub(super) fn patch(&self, x: u32, y: u32) -> Option<Patch> {
        let (column, row) = (x as usize, (y - self.first) as usize);
        let stride = self.width + 2;
        let here = (row + 1) * stride + column + 1;
        let own = self.inverse_depths[here];
        if own.is_nan() {
            return None;
        }
        let tolerance = self.tolerance[0] + self.tolerance[1] * own;
        let same = |offset: isize| {
            let other = self.inverse_depths[here.wrapping_add_signed(offset)];
            // Not so of NaN.
            ((other - own).abs() <= tolerance).then_some(other)
        };
        let down = stride as isize;
        let around = [-down - 1, -down, -down + 1, -1, 1, down - 1, down, down + 1];
        let on_surface = || around.iter().filter(|&&offset| same(offset).is_some()).count() as u32;
        // Rendered depth is of one surface in each pixel.
        if self.has_noise && on_surface() < LEAST_NEIGHBORS {
            return None;
        }
        // Of inverse depth from pixel to pixel, from the neighbours on both sides if they are of this surface.
        let slope = |before: Option<f32>, after: Option<f32>| match (before, after) {
            (Some(before), Some(after)) => (after - before) / 2.0,
            (None, Some(after)) => after - own,
            (Some(before), None) => own - before,
            (None, None) => 0.0,
        };
        let slopes = [slope(same(-1), same(1)), slope(same(-down), same(down))];
        let at = row * (self.width + 1) + column;
        let ray = self.rays[at];
        let [right, below] = [self.rays[at + 1] - ray, self.rays[at + self.width + 1] - ray];
        let depth = 1.0 / own;
        // Of point = ray / q: d point = (d ray - ray dq / q) / q.
        let step = |change: Vec3, slope: f32| (change - ray * (slope * depth)) * depth;
        let (across, down) = (step(right, slopes[0]), step(below, slopes[1]));
        let normal = down.cross(across).try_normalize()?;
        let normal = if normal.dot(ray) > 0.0 { -normal } else { normal };
        Some(Patch { point: ray * depth + self.eye, across, down, normal })
    }
}

/// Rays through the pixels of some rows and of one below, and of one more on the right, world axes. Those of a pinhole are affine in the pixel.
fn rays(view: &LoadedView, rows: Range<u32>) -> Vec<Vec3> {
    let ray = |x: u32, y: u32| {
        view.pose.world_from_eye * view.lens.ray([f64::from(x) + 0.5, f64::from(y) + 0.5], view.size_px)
    };
    let columns = 0..view.size_px[0] + 1;
    let mut rays = Vec::with_capacity((rows.len() + 1) * columns.len());
    let step = ray(1, 0) - ray(0, 0);
    for y in rows.start..=rows.end {
        match view.lens {
            Lens::Pinhole(_) => {
                let start = ray(0, y);
                rays.extend(columns.clone().map(|x| (start + step * f64::from(x)).as_vec3()));
            }
            Lens::Equirectangular => rays.extend(columns.clone().map(|x| ray(x, y).as_vec3())),
        }
    }
    rays
}
