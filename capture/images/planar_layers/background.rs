//! Background of each layer from other frames: pixels that are occluded in the middle frame or
//! outside its image.

use super::canvas::Canvas;
use super::frames::{Frame, Frames};
use super::labels::NONE;
use super::planes::Affine;
use rayon::prelude::*;

/// Pixels of a layer accumulated from other frames: weighted sums of colour and of residual inverse
/// depth (1/m), and of weights.
#[derive(Clone, Debug)]
pub(super) struct LayerBackground {
    sums: Vec<[f32; 5]>,
}

/// Maximum distance of a point from its plane, in tolerances of points on a plane.
const MAX_DISTANCE: f64 = 4.0;

/// Margin around a layer's pixels that is filled although not occluded, pixels: the accuracy of
/// edges.
const MARGIN: usize = 3;

/// Minimum weight of a known pixel: about one sample of one frame.
const MIN_WEIGHT: f32 = 0.35;

/// Number of rounds that close pinholes, and the minimum number of known neighbours of a closed
/// pixel.
const CLOSING_ROUNDS: usize = 2;
const MIN_NEIGHBORS: usize = 5;

impl LayerBackground {
    /// Returns the colour and the residual inverse depth of a pixel, if known.
    pub(super) fn get(&self, pixel: usize) -> Option<([f32; 3], f32)> {
        let [r, g, b, residual, weight] = self.sums[pixel];
        (weight >= MIN_WEIGHT).then(|| ([r / weight, g / weight, b / weight], residual / weight))
    }

    fn add(&mut self, canvas: &Canvas, [x, y]: [f64; 2], color: [f32; 3], residual: f32) {
        let column = (x - 0.5).floor();
        let row = (y - 0.5).floor();
        let u = (x - 0.5 - column) as f32;
        let v = (y - 0.5 - row) as f32;
        for (dx, dy, weight) in [
            (0.0, 0.0, (1.0 - u) * (1.0 - v)),
            (1.0, 0.0, u * (1.0 - v)),
            (0.0, 1.0, (1.0 - u) * v),
            (1.0, 1.0, u * v),
        ] {
            let x = column + dx;
            let y = row + dy;
            if x >= 0.0 && y >= 0.0 && x < canvas.width as f64 && y < canvas.height as f64 {
                let sum = &mut self.sums[y as usize * canvas.width + x as usize];
                let values = [color[0], color[1], color[2], residual, 1.0];
                (0..5).for_each(|k| sum[k] += weight * values[k]);
            }
        }
    }

    /// Fills pinholes between known pixels: frames at a larger distance sample sparsely.
    fn close(&mut self, canvas: &Canvas) {
        for _ in 0..CLOSING_ROUNDS {
            let closed = (0..self.sums.len()).into_par_iter().filter_map(|pixel| {
                if self.get(pixel).is_some() {
                    return None;
                }
                let neighbors: Vec<[f32; 4]> = canvas
                    .around(pixel, 1)
                    .filter_map(|neighbor| self.get(neighbor))
                    .map(|([r, g, b], residual)| [r, g, b, residual])
                    .collect();
                let mean = |k: usize| {
                    neighbors.iter().map(|values| values[k]).sum::<f32>() / neighbors.len() as f32
                };
                (neighbors.len() >= MIN_NEIGHBORS)
                    .then(|| (pixel, [mean(0), mean(1), mean(2), mean(3), 1.0]))
            });
            let closed: Vec<(usize, [f32; 5])> = closed.collect();
            closed
                .into_iter()
                .for_each(|(pixel, sums)| self.sums[pixel] = sums);
        }
    }
}

/// Accumulates the background of each layer from the other frames.
pub(super) fn accumulate(
    canvas: &Canvas,
    frames: &Frames,
    planes: &[Affine],
    labels: &[u8],
) -> Vec<LayerBackground> {
    let nearby = find_nearby_layers(canvas, labels);
    let accumulate_layer = |label: usize| {
        let mut background = LayerBackground {
            sums: vec![[0.0; 5]; labels.len()],
        };
        let reprojection = Reprojection {
            canvas,
            planes,
            labels,
            nearby: &nearby,
        };
        for frame in frames.others() {
            reprojection.add(frame, label, &mut background);
        }
        background.close(canvas);
        background
    };
    (0..planes.len())
        .into_par_iter()
        .map(accumulate_layer)
        .collect()
}

/// Returns for each pixel the layers within the margin, one bit each.
fn find_nearby_layers(canvas: &Canvas, labels: &[u8]) -> Vec<u64> {
    let bits = |pixel: usize| {
        canvas
            .around(pixel, MARGIN)
            .map(|neighbor| labels[neighbor])
            .filter(|label| *label != NONE)
            .fold(0, |bits, l| bits | 1 << l)
    };
    (0..labels.len()).into_par_iter().map(bits).collect()
}

/// Reprojection of frames onto the canvas.
struct Reprojection<'a> {
    canvas: &'a Canvas,
    planes: &'a [Affine],
    labels: &'a [u8],
    nearby: &'a [u64],
}

impl Reprojection<'_> {
    /// Adds a frame's pixels of a layer.
    fn add(&self, frame: &Frame, label: usize, background: &mut LayerBackground) {
        let view = &frame.view;
        let [width, height] = view.size_px;
        for y in 0..height {
            for x in 0..width {
                let point = view.point_at(x, y);
                let Some([cx, cy, depth]) =
                    point.and_then(|point| self.canvas.camera.project(point))
                else {
                    continue;
                };
                let inside = cx >= 0.0
                    && cy >= 0.0
                    && cx < self.canvas.width as f64
                    && cy < self.canvas.height as f64;
                let pixel = cy as usize * self.canvas.width + cx as usize;
                let inverse_depth = 1.0 / depth;
                if inside
                    && self.find_plane([cx, cy], inverse_depth) == Some(label)
                    && self.is_hidden(pixel, label, inverse_depth)
                {
                    let level = view.color[(y * width + x) as usize];
                    let color = [0, 1, 2].map(|c| f32::from(level[c]) * frame.gain[c]);
                    let residual = inverse_depth - self.planes[label].inverse_depth([cx, cy]);
                    background.add(self.canvas, [cx, cy], color, residual as f32);
                }
            }
        }
    }

    /// Returns the plane nearest to a point, if it is near enough.
    fn find_plane(&self, position: [f64; 2], inverse_depth: f64) -> Option<usize> {
        let distance_px = |plane: &Affine| {
            (plane.inverse_depth(position) - inverse_depth).abs() * self.canvas.px_per_inverse_depth
        };
        let distances = self.planes.iter().map(distance_px).enumerate();
        let nearest = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 <= MAX_DISTANCE * self.canvas.on_plane_px).then_some(nearest.0)
    }

    /// Returns true if the middle frame does not show a layer at a pixel: it is occluded there, an
    /// edge is near, or the pixel is outside the image.
    fn is_hidden(&self, pixel: usize, label: usize, inverse_depth: f64) -> bool {
        let own = self.labels[pixel];
        if own == NONE {
            return !self.canvas.inside[pixel];
        }
        let front = &self.planes[usize::from(own)];
        let is_occluded =
            -front.distance_px(self.canvas, pixel, inverse_depth as f32) > self.canvas.on_plane_px;
        usize::from(own) != label && (is_occluded || self.nearby[pixel] >> label & 1 == 1)
    }
}
