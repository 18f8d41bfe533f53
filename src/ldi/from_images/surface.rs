//! What a pixel of a depth image knows of its surface: how it is tilted, and whether it lies on one at all.

use crate::capture::images::LoadedView;
use glam::{DMat3, DVec3, Vec3};

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

/// A depth image as points, a few rows at a time.
pub(super) struct Surfaces<'a> {
    view: &'a LoadedView,
    /// Rotation from eye space to the world.
    rotation: DMat3,
    /// The eye, relative to the cube's centre.
    eye: DVec3,
    /// Inverse depths of one surface part by no more than this from pixel to pixel, relative to a fronto-parallel plane: in
    /// 1/m, noise of the sensor, and as a share of the inverse depth.
    noise: f32,
}

/// The steepest surface that counts as one: its inverse depth may change by this share from a pixel to the next for each
/// radian of a pixel's width.
const STEEPEST: f32 = 12.0;

/// A pixel with fewer neighbours than this (of eight) on its own surface is a flying one: a mixture of what lies before and
/// behind an edge.
const LEAST_NEIGHBORS: u32 = 3;

impl<'a> Surfaces<'a> {
    /// `noise`: standard deviation of inverse depth, 1/m.
    pub(super) fn new(view: &'a LoadedView, centre: DVec3, noise: f32) -> Self {
        Self { view, rotation: view.pose.world_from_eye, eye: view.pose.eye - centre, noise }
    }

    /// How much inverse depths of neighbours may differ on one surface.
    fn tolerance(&self, inverse_depth: f32) -> f32 {
        let pixel = 1.0 / self.view.lens.pixels_per_radian(self.view.size_px) as f32;
        3.0 * self.noise + STEEPEST * pixel * inverse_depth
    }

    /// The ray of a pixel, world axes.
    fn ray(&self, x: u32, y: u32) -> Vec3 {
        let position = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        (self.rotation * self.view.lens.ray(position, self.view.size_px)).as_vec3()
    }

    /// Inverse depth of a pixel, as a multiple of its ray; `None` if unknown or outside.
    fn inverse_depth(&self, x: i64, y: i64) -> Option<f32> {
        let [width, height] = self.view.size_px.map(i64::from);
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        inside.then(|| self.view.depth_at(x as u32, y as u32)).flatten().map(|depth| 1.0 / depth)
    }

    /// The surface of a pixel, or `None` if its depth is unknown or no surface's.
    pub(super) fn patch(&self, x: u32, y: u32) -> Option<Patch> {
        let (column, row) = (i64::from(x), i64::from(y));
        let own = self.inverse_depth(column, row)?;
        let tolerance = self.tolerance(own);
        let same = |dx: i64, dy: i64| {
            self.inverse_depth(column + dx, row + dy).filter(|other| (other - own).abs() <= tolerance)
        };
        let around = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
        let on_surface = around.iter().filter(|&&(dx, dy)| same(dx, dy).is_some()).count() as u32;
        // Rendered depth is of one surface in each pixel.
        if self.noise > 0.0 && on_surface < LEAST_NEIGHBORS {
            return None;
        }
        // Of inverse depth from pixel to pixel, from the neighbours on both sides if they are of this surface.
        let slope = |before: Option<f32>, after: Option<f32>| match (before, after) {
            (Some(before), Some(after)) => (after - before) / 2.0,
            (None, Some(after)) => after - own,
            (Some(before), None) => own - before,
            (None, None) => 0.0,
        };
        let slopes = [slope(same(-1, 0), same(1, 0)), slope(same(0, -1), same(0, 1))];
        let ray = self.ray(x, y);
        let [right, below] = [self.ray(x + 1, y) - ray, self.ray(x, y + 1) - ray];
        let depth = 1.0 / own;
        // Of point = ray / q: d point = (d ray - ray dq / q) / q.
        let step = |change: Vec3, slope: f32| (change - ray * (slope * depth)) * depth;
        let (across, down) = (step(right, slopes[0]), step(below, slopes[1]));
        let normal = down.cross(across).try_normalize()?;
        let normal = if normal.dot(ray) > 0.0 { -normal } else { normal };
        Some(Patch { point: ray * depth + self.eye.as_vec3(), across, down, normal })
    }
}
