//! What of the canvas is kept: the picture, and of its margins as much as other frames show.

use super::PlanarLayers;
use super::canvas::Canvas;
use headbox_core::camera::Camera;
use image::imageops;

/// A row or column beyond the picture is kept if, with its mirror image, it is known to this share.
const LEAST_KNOWN: f64 = 0.4;

/// The layers without margins of which little is known; the principal point stays in the middle.
pub(super) fn crop(layers: PlanarLayers, canvas: &Canvas) -> PlanarLayers {
    let known = |pixel: usize| {
        layers
            .layers
            .iter()
            .any(|layer| !layer.depth[pixel].is_nan())
    };
    let known: Vec<bool> = (0..layers.labels.len()).map(known).collect();
    let (width, height) = (canvas.width, canvas.height);
    let column = |x: usize| (0..height).map(move |y| y * width + x);
    let row = |y: usize| (0..width).map(move |x| y * width + x);
    // Whether two lines that mirror each other may go.
    let goes = |lines: [Vec<usize>; 2]| {
        let pixels = || lines.iter().flatten();
        let share = pixels().filter(|p| known[**p]).count() as f64 / pixels().count().max(1) as f64;
        pixels().all(|p| !canvas.inside[*p]) && share < LEAST_KNOWN
    };
    let left = (0..width / 2)
        .take_while(|&x| goes([column(x).collect(), column(width - 1 - x).collect()]))
        .count();
    let top = (0..height / 2)
        .take_while(|&y| goes([row(y).collect(), row(height - 1 - y).collect()]))
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
        return layers; // of no pixels
    };
    let part = Part {
        left,
        top,
        stride: width,
        width: w as usize,
        height: h as usize,
    };
    let mut kept = layers.layers;
    for layer in &mut kept {
        layer.color = imageops::crop_imm(&layer.color, left as u32, top as u32, w, h).to_image();
        layer.depth = part.of(&layer.depth);
    }
    PlanarLayers {
        camera,
        layers: kept,
        labels: part.of(&layers.labels),
        plane_depth: part.of(&layers.plane_depth),
        matched_depth: part.of(&layers.matched_depth),
        used: layers.used,
    }
}

/// A rectangle of a picture.
struct Part {
    left: usize,
    top: usize,
    stride: usize,
    width: usize,
    height: usize,
}

impl Part {
    fn of<T: Copy>(&self, values: &[T]) -> Vec<T> {
        let row = |y: usize| (self.top + y) * self.stride + self.left;
        (0..self.height)
            .flat_map(|y| values[row(y)..row(y) + self.width].iter().copied())
            .collect()
    }
}
