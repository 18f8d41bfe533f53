//! A picture as the camera at its place in a grid would have taken it.
//!
//! From one place every ray of the grid's image is a ray of the picture: a homography, and exact. A
//! camera that is a little off its place is taken to look at what lies at the grid's convergence,
//! which is exact for that.

use super::raw::{RawPicture, SAME_SURFACE};
use crate::CameraGrid;
use glam::DVec3;
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use headbox_images::LoadedView;

/// The picture as the image of a place of the grid.
pub(super) fn reproject(view: &LoadedView, grid: &CameraGrid, place: usize) -> RawPicture {
    let columns = grid.columns().len();
    let camera = grid.camera(place % columns, place / columns);
    let eye_from_world = view.pose.world_from_eye.transpose();
    let forward = -grid.world_from_eye().z_axis;
    let source = Source {
        view,
        forward: eye_from_world * forward,
        behind: (view.pose.eye - grid.origin()).dot(forward),
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

struct Source<'a> {
    view: &'a LoadedView,
    /// The plane's normal in the view's eye space.
    forward: DVec3,
    /// Distance of the view's eye in front of the plane, metres.
    behind: f64,
}

impl Source<'_> {
    /// Colour and disparity at a position: of the nearest pixel's surface, bilinear over those
    /// pixels about it that show the same. Beyond the picture nothing is known.
    fn pixel(&self, at: [f64; 2]) -> ([u8; 3], f32) {
        let [width, height] = self.view.size_px;
        let within = |at: f64, side: u32| (at.max(0.0) as u32).min(side - 1);
        let nearest = [within(at[0], width), within(at[1], height)];
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
            let place = |at: f64| within(at, side);
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
                    (0..3)
                        .for_each(|c| light[c] += weight * f64::from(linear_from_srgb8(color[c])));
                    disparity += weight * found;
                    total += weight;
                }
            }
        }
        // The nearest pixel has a quarter at least.
        (
            light.map(|c| srgb8_from_linear((c / total) as f32)),
            (disparity / total) as f32,
        )
    }

    fn color(&self, [x, y]: [u32; 2]) -> [u8; 4] {
        self.view.color[y as usize * self.view.size_px[0] as usize + x as usize]
    }

    /// 1 / distance from the grid's plane, 1/m; 0 for what is infinitely far, NaN where nothing is
    /// known, or what is behind the plane.
    fn disparity(&self, [x, y]: [u32; 2]) -> f64 {
        let i = y as usize * self.view.size_px[0] as usize + x as usize;
        let depth = self
            .view
            .depth
            .get(i)
            .map_or(f64::NAN, |depth| f64::from(*depth));
        let ray = self
            .view
            .lens
            .ray([f64::from(x) + 0.5, f64::from(y) + 0.5], self.view.size_px);
        let distance = self.behind + depth * ray.dot(self.forward);
        let is_known = self.view.color[i][3] > 0 && distance > 0.0;
        if is_known { 1.0 / distance } else { f64::NAN }
    }
}
