//! Reprojection of an image to its position in a grid.
//!
//! From the same eye position each ray of the grid's image is a ray of the source image: an exact
//! homography. For a camera slightly off its grid position surfaces are assumed at the grid's
//! convergence, which is exact at that depth.

use super::raw::{RawPicture, SAME_SURFACE};
use crate::CameraGrid;
use glam::DVec3;
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use headbox_images::LoadedView;

/// Reprojects an image to a position of the grid (row by row from the lowest).
pub(super) fn reproject(view: &LoadedView, grid: &CameraGrid, place: usize) -> RawPicture {
    let columns = grid.columns().len();
    let camera = grid.camera(place % columns, place / columns);
    let eye_from_world = view.pose.world_from_eye.transpose();
    let forward = -grid.world_from_eye().z_axis;
    let source = Source {
        view,
        forward: eye_from_world * forward,
        in_front: (view.pose.eye - grid.origin()).dot(forward),
    };
    let off = (camera.eye() - view.pose.eye) * grid.convergence();
    let [width, height] = grid.size_px();
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x, y]));
    let (color, disparity) = pixels
        .map(|[x, y]| {
            let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let at = view
                .lens
                .project(eye_from_world * (direction + off), view.size_px);
            at.map_or(([0; 3], f32::NAN), |[x, y, _]| source.pixel([x, y]))
        })
        .unzip();
    RawPicture { color, disparity }
}

/// Source image of a reprojection.
struct Source<'a> {
    view: &'a LoadedView,
    /// The plane's normal in the view's eye space.
    forward: DVec3,
    /// Distance of the view's eye in front of the plane, metres.
    in_front: f64,
}

impl Source<'_> {
    /// Samples colour and disparity at a position: bilinear over those adjacent pixels that show
    /// the surface of the nearest pixel. Unknown outside the image.
    fn pixel(&self, at: [f64; 2]) -> ([u8; 3], f32) {
        let [width, height] = self.view.size_px;
        let clamp_index = |at: f64, side: u32| (at.max(0.0) as u32).min(side - 1);
        let nearest = [clamp_index(at[0], width), clamp_index(at[1], height)];
        let is_inside =
            at[0] >= 0.0 && at[1] >= 0.0 && at[0] < f64::from(width) && at[1] < f64::from(height);
        let own = if is_inside {
            self.disparity(nearest)
        } else {
            f64::NAN
        };
        if own.is_nan() {
            let [r, g, b, _] = self.color(nearest);
            return ([r, g, b], f32::NAN);
        }
        let sides = |at: f64, side: u32| {
            let low = (at - 0.5).floor();
            let place = |at: f64| clamp_index(at, side);
            [
                (place(low), low + 1.5 - at),
                (place(low + 1.0), at - 0.5 - low),
            ]
        };
        let (mut light, mut disparity, mut total) = ([0.0; 3], 0.0, 0.0);
        for (y, down) in sides(at[1], height) {
            for (x, across) in sides(at[0], width) {
                let (weight, found) = (across * down, self.disparity([x, y]));
                if weight > 0.0 && (found - own).abs() <= f64::from(SAME_SURFACE) * own {
                    let color = self.color([x, y]);
                    for c in 0..3 {
                        light[c] += weight * f64::from(linear_from_srgb8(color[c]));
                    }
                    disparity += weight * found;
                    total += weight;
                }
            }
        }
        // The nearest pixel has a weight of at least a quarter.
        (
            light.map(|c| srgb8_from_linear((c / total) as f32)),
            (disparity / total) as f32,
        )
    }

    fn color(&self, [x, y]: [u32; 2]) -> [u8; 4] {
        self.view.color[y as usize * self.view.size_px[0] as usize + x as usize]
    }

    /// Returns 1 / distance from the grid's plane, 1/m; 0 at infinity, NaN if unknown or behind the
    /// plane.
    fn disparity(&self, [x, y]: [u32; 2]) -> f64 {
        let i = y as usize * self.view.size_px[0] as usize + x as usize;
        let view = self.view;
        let depth = view
            .depth
            .get(i)
            .map_or(f64::NAN, |depth| f64::from(*depth));
        let pixel = [x, y].map(|at| f64::from(at) + 0.5);
        let ray = view.lens.ray(pixel, view.size_px);
        let distance = self.in_front + depth * ray.dot(self.forward);
        let is_known = view.color[i][3] > 0 && distance > 0.0;
        if is_known { 1.0 / distance } else { f64::NAN }
    }
}
