//! Crop of the canvas: removes margins that other frames hardly cover.

use super::PlanarLayers;
use super::canvas::Canvas;
use headbox_core::camera::Camera;
use image::imageops;

/// Minimum known fraction of a row or column of the margin together with its mirror image.
const MIN_KNOWN: f64 = 0.4;

/// Removes mostly unknown margins from layers symmetrically, so that the principal point stays
/// centred.
pub(super) fn crop(layers: PlanarLayers, canvas: &Canvas) -> PlanarLayers {
    let is_known = |pixel: usize| {
        layers
            .layers
            .iter()
            .any(|layer| !layer.depth[pixel].is_nan())
    };
    let known: Vec<bool> = (0..layers.labels.len()).map(is_known).collect();
    let width = canvas.width;
    let height = canvas.height;
    let column = |x: usize| (0..height).map(move |y| y * width + x);
    let row = |y: usize| (0..width).map(move |x| y * width + x);
    // True if two lines that mirror each other can be removed.
    let is_removable = |lines: [Vec<usize>; 2]| {
        let pixels = || lines.iter().flatten();
        let share = pixels().filter(|p| known[**p]).count() as f64 / pixels().count().max(1) as f64;
        pixels().all(|p| !canvas.inside[*p]) && share < MIN_KNOWN
    };
    let left = (0..width / 2)
        .take_while(|&x| is_removable([column(x).collect(), column(width - 1 - x).collect()]))
        .count();
    let top = (0..height / 2)
        .take_while(|&y| is_removable([row(y).collect(), row(height - 1 - y).collect()]))
        .count();
    let [w, h] = [width - 2 * left, height - 2 * top].map(|side| side as u32);
    let camera = &layers.camera;
    let Ok(camera) = Camera::from_parts(
        camera.eye(),
        camera.world_from_eye(),
        camera.focal_px(),
        w,
        h,
    ) else {
        return layers; // no pixels
    };
    let rect = CropRect {
        left,
        top,
        stride: width,
        width: w as usize,
        height: h as usize,
    };
    let mut cropped = layers.layers;
    for layer in &mut cropped {
        layer.color = imageops::crop_imm(&layer.color, left as u32, top as u32, w, h).to_image();
        layer.depth = rect.crop(&layer.depth);
    }
    PlanarLayers {
        camera,
        layers: cropped,
        labels: rect.crop(&layers.labels),
        plane_depth: rect.crop(&layers.plane_depth),
        matched_depth: rect.crop(&layers.matched_depth),
        used: layers.used,
    }
}

/// A rectangle of an image.
struct CropRect {
    left: usize,
    top: usize,
    stride: usize,
    width: usize,
    height: usize,
}

impl CropRect {
    fn crop<T: Copy>(&self, values: &[T]) -> Vec<T> {
        let row = |y: usize| (self.top + y) * self.stride + self.left;
        (0..self.height)
            .flat_map(|y| values[row(y)..row(y) + self.width].iter().copied())
            .collect()
    }
}
