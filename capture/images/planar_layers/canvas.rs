//! What layers are made on: the middle frame's picture, wider all round, its pixels square and its principal point in the middle.

use super::frames::{Frame, Frames};
use crate::Lens;
use glam::DVec3;
use headbox_core::camera::Camera;
use rayon::prelude::*;

/// What is added at each side, as a share of the picture's side: other frames see beyond its rim.
const MARGIN: f64 = 0.125;

/// Pixels of parallax by which a point may be off a plane and still lie on it, at least: matching errs by some tenths.
const ON_PLANE_PX: f64 = 1.0;

/// The same, standard deviations of what was found.
const ON_PLANE_DEVIATIONS: f64 = 3.0;

/// The canvas. All values row-major, one a pixel.
pub(super) struct Canvas {
    pub(super) camera: Camera,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Whether it lies within the middle frame's picture.
    pub(super) inside: Vec<bool>,
    /// Whether the middle frame shows something there that is not masked out.
    pub(super) shown: Vec<bool>,
    /// sRGB levels.
    pub(super) color: Vec<[f32; 3]>,
    /// 1/m; 0 where unknown.
    pub(super) inverse_depth: Vec<f32>,
    /// Pixels of parallax for an inverse depth of 1/m.
    pub(super) px_per_inverse_depth: f64,
    /// Pixels of parallax within which a point is on a plane.
    pub(super) on_plane_px: f64,
}

impl Canvas {
    pub(super) fn new(frames: &Frames, longest_px: u32) -> Self {
        let camera = camera(frames.middle(), longest_px);
        let (width, height) = (camera.width() as usize, camera.height() as usize);
        let samples = samples(frames.middle(), &camera);
        let px_per_inverse_depth = camera.focal_px() * frames.baseline_m;
        let deviation_px = f64::from(frames.deviation) * px_per_inverse_depth;
        Self {
            camera,
            width,
            height,
            inside: samples.iter().map(|sample| sample.inside).collect(),
            shown: samples
                .iter()
                .map(|sample| sample.color.is_some())
                .collect(),
            color: samples
                .iter()
                .map(|sample| sample.color.unwrap_or_default())
                .collect(),
            inverse_depth: samples.iter().map(|sample| sample.inverse_depth).collect(),
            px_per_inverse_depth,
            on_plane_px: (ON_PLANE_DEVIATIONS * deviation_px).max(ON_PLANE_PX),
        }
    }

    /// The middle of a pixel.
    pub(super) fn center(&self, pixel: usize) -> [f64; 2] {
        [
            (pixel % self.width) as f64 + 0.5,
            (pixel / self.width) as f64 + 0.5,
        ]
    }

    /// The point at an inverse depth, 1/m, that a pixel shows.
    pub(super) fn point(&self, pixel: usize, inverse_depth: f64) -> DVec3 {
        let [x, y] = self.center(pixel);
        self.camera.eye() + self.camera.direction(x, y) / inverse_depth
    }

    /// The pixels around one, itself among them, within a square of `2 radius + 1`.
    pub(super) fn around(
        &self,
        pixel: usize,
        radius: usize,
    ) -> impl Iterator<Item = usize> + use<> {
        let (x, y, width) = (pixel % self.width, pixel / self.width, self.width);
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(self.width);
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(self.height);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }
}

/// The canvas' camera: about as wide as the picture and its margins, so that a pixel of the picture is a pixel of the canvas where that is possible.
fn camera(middle: &Frame, longest_px: u32) -> Camera {
    let view = &middle.view;
    let (focal, principal) = match view.lens {
        Lens::Pinhole(pinhole) => (pinhole.focal_px[1], pinhole.principal_px),
        // Frames are perspective.
        Lens::Equirectangular => (1.0, view.size_px.map(|side| f64::from(side) / 2.0)),
    };
    let squash = match view.lens {
        Lens::Pinhole(pinhole) => pinhole.focal_px[1] / pinhole.focal_px[0],
        Lens::Equirectangular => 1.0,
    };
    let reach = |axis: usize| {
        let side = f64::from(view.size_px[axis]);
        principal[axis].max(side - principal[axis]) + MARGIN * side
    };
    let half = [reach(0) * squash, reach(1)];
    let scale = (f64::from(longest_px.max(2)) / (2.0 * half[0].max(half[1]))).min(1.0);
    let side = |axis: usize| {
        let wanted = 2.0 * half[axis] * scale;
        // Half of a side has the fraction of the principal point, as near as halves come.
        let fraction = ((principal[axis] * 2.0).round() as i64).rem_euclid(2);
        let whole = wanted.round() as i64;
        (whole + (whole - fraction).rem_euclid(2)).clamp(1, i64::from(Camera::MAX_SIDE_PX)) as u32
    };
    let (eye, turn) = (view.pose.eye, view.pose.world_from_eye);
    let of = |width: u32, height: u32| Camera::from_parts(eye, turn, focal * scale, width, height);
    // Sides are within bounds by the clamp; one pixel always is a camera.
    of(side(0), side(1)).unwrap_or_else(|_| of(1, 1).expect("a camera of one pixel"))
}

struct Sample {
    inside: bool,
    pub color: Option<[f32; 3]>,
    pub inverse_depth: f32,
}

/// What the middle frame shows of each pixel.
fn samples(middle: &Frame, camera: &Camera) -> Vec<Sample> {
    let view = &middle.view;
    let scale = view.lens.pixels_per_radian(view.size_px) / camera.focal_px();
    // Pixels of a smaller canvas are means of several of the picture's.
    let across = (scale.ceil() as u32).max(1);
    let sample = |pixel: usize| {
        let (x, y) = (
            (pixel % camera.width() as usize) as f64,
            (pixel / camera.width() as usize) as f64,
        );
        let place = |u: f64, v: f64| {
            let ahead = camera.eye() + camera.direction(x + u, y + v);
            middle.place(ahead)
        };
        let part = |k: u32| (f64::from(k) + 0.5) / f64::from(across);
        let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
        for k in 0..across * across {
            let Some([px, py, _]) = place(part(k % across), part(k / across)) else {
                continue;
            };
            let visible = view.color[py as usize * view.size_px[0] as usize + px as usize][3] > 0;
            if let Some(color) = view.color_at([px, py]).filter(|_| visible) {
                (0..3).for_each(|c| sum[c] += color[c] as f32);
                count += 1.0;
            }
        }
        let color = (2.0 * count >= (across * across) as f32).then(|| sum.map(|c| c / count));
        let middle = place(0.5, 0.5);
        let depth = middle.and_then(|[px, py, _]| view.depth_at(px as u32, py as u32));
        let inverse_depth = depth
            .filter(|_| color.is_some())
            .map_or(0.0, |depth| 1.0 / depth);
        Sample {
            inside: middle.is_some(),
            color,
            inverse_depth,
        }
    };
    (0..camera.width() as usize * camera.height() as usize)
        .into_par_iter()
        .map(sample)
        .collect()
}
