//! Canvas of the layers: the middle frame's image, extended on all sides, with square pixels and a
//! centred principal point.

use super::frames::{Frame, Frames};
use crate::Lens;
use glam::DVec3;
use headbox_core::camera::Camera;
use rayon::prelude::*;

/// Margin at each side relative to the image's side: other frames see beyond its border.
const MARGIN: f64 = 0.125;

/// Minimum tolerance of points on a plane, pixels of parallax: matching has an error of a few
/// tenths of a pixel.
const ON_PLANE_PX: f64 = 1.0;

/// Tolerance of points on a plane, standard deviations of depth.
const ON_PLANE_DEVIATIONS: f64 = 3.0;

/// Canvas with row-major values of all pixels.
pub(super) struct Canvas {
    pub(super) camera: Camera,
    pub(super) width: usize,
    pub(super) height: usize,
    /// True within the middle frame's image.
    pub(super) inside: Vec<bool>,
    /// True where the middle frame is not masked out.
    pub(super) shown: Vec<bool>,
    /// sRGB levels.
    pub(super) color: Vec<[f32; 3]>,
    /// 1/m; 0 where unknown.
    pub(super) inverse_depth: Vec<f32>,
    /// Pixels of parallax for an inverse depth of 1/m.
    pub(super) px_per_inverse_depth: f64,
    /// Tolerance of points on a plane, pixels of parallax.
    pub(super) on_plane_px: f64,
}

impl Canvas {
    pub(super) fn new(frames: &Frames, longest_px: u32) -> Self {
        let camera = create_camera(frames.middle(), longest_px);
        let width = camera.width() as usize;
        let height = camera.height() as usize;
        let samples = resample(frames.middle(), &camera);
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

    /// Returns the centre of a pixel.
    pub(super) fn center(&self, pixel: usize) -> [f64; 2] {
        [
            (pixel % self.width) as f64 + 0.5,
            (pixel / self.width) as f64 + 0.5,
        ]
    }

    /// Returns the world point of a pixel at an inverse depth, 1/m.
    pub(super) fn point(&self, pixel: usize, inverse_depth: f64) -> DVec3 {
        let [x, y] = self.center(pixel);
        self.camera.eye() + self.camera.direction(x, y) / inverse_depth
    }

    /// Returns the pixels of a window of side `2 radius + 1` around a pixel, including itself.
    pub(super) fn around(
        &self,
        pixel: usize,
        radius: usize,
    ) -> impl Iterator<Item = usize> + use<> {
        let width = self.width;
        let x = pixel % width;
        let y = pixel / width;
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(self.width);
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(self.height);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }
}

/// Creates the canvas' camera: about as large as the image and its margins, with pixels that
/// coincide with the image's where possible.
fn create_camera(middle: &Frame, longest_px: u32) -> Camera {
    let view = &middle.view;
    let ([focal_x, focal], principal) = match view.lens {
        Lens::Pinhole(pinhole) => (pinhole.focal_px, pinhole.principal_px),
        // Unreachable: frames are perspective.
        Lens::Equirectangular => ([1.0; 2], view.size_px.map(|side| f64::from(side) / 2.0)),
    };
    let squash = focal / focal_x;
    let reach = |axis: usize| {
        let side = f64::from(view.size_px[axis]);
        principal[axis].max(side - principal[axis]) + MARGIN * side
    };
    let half = [reach(0) * squash, reach(1)];
    let scale = (f64::from(longest_px.max(2)) / (2.0 * half[0].max(half[1]))).min(1.0);
    let side = |axis: usize| {
        let exact = 2.0 * half[axis] * scale;
        // Half of a side has the fraction of the principal point, rounded to halves.
        let fraction = ((principal[axis] * 2.0).round() as i64).rem_euclid(2);
        let whole = exact.round() as i64;
        (whole + (whole - fraction).rem_euclid(2)).clamp(1, i64::from(Camera::MAX_SIDE_PX)) as u32
    };
    let eye = view.pose.eye;
    let turn = view.pose.world_from_eye;
    let create =
        |width: u32, height: u32| Camera::from_parts(eye, turn, focal * scale, width, height);
    // The clamp keeps sides within bounds; a camera of one pixel is always valid.
    create(side(0), side(1)).unwrap_or_else(|_| create(1, 1).expect("a camera of one pixel"))
}

struct CanvasSample {
    inside: bool,
    color: Option<[f32; 3]>,
    inverse_depth: f32,
}

/// Resamples the middle frame to the canvas.
fn resample(middle: &Frame, camera: &Camera) -> Vec<CanvasSample> {
    let view = &middle.view;
    let scale = view.lens.pixels_per_radian(view.size_px) / camera.focal_px();
    // Pixels of a smaller canvas are means of several image pixels.
    let across = (scale.ceil() as u32).max(1);
    let sample = |pixel: usize| {
        let x = (pixel % camera.width() as usize) as f64;
        let y = (pixel / camera.width() as usize) as f64;
        let project = |u: f64, v: f64| {
            let ahead = camera.eye() + camera.direction(x + u, y + v);
            middle.project(ahead)
        };
        let fraction = |k: u32| (f64::from(k) + 0.5) / f64::from(across);
        let mut sum = [0.0f32; 3];
        let mut count = 0.0f32;
        for k in 0..across * across {
            let Some([px, py, _]) = project(fraction(k % across), fraction(k / across)) else {
                continue;
            };
            let visible = view.color[py as usize * view.size_px[0] as usize + px as usize][3] > 0;
            if let Some(color) = view.color_at([px, py]).filter(|_| visible) {
                (0..3).for_each(|c| sum[c] += color[c] as f32);
                count += 1.0;
            }
        }
        let color = (2.0 * count >= (across * across) as f32).then(|| sum.map(|c| c / count));
        let center = project(0.5, 0.5);
        let depth = center.and_then(|[px, py, _]| view.depth_at(px as u32, py as u32));
        let inverse_depth = depth
            .filter(|_| color.is_some())
            .map_or(0.0, |depth| 1.0 / depth);
        CanvasSample {
            inside: center.is_some(),
            color,
            inverse_depth,
        }
    };
    (0..camera.width() as usize * camera.height() as usize)
        .into_par_iter()
        .map(sample)
        .collect()
}
