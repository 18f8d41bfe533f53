//! What other frames see of each layer where the middle one does not: behind what stands before it, and beyond the picture's rim.

use super::canvas::Canvas;
use super::frames::{Frame, Frames};
use super::labels::NONE;
use super::planes::Affine;
use rayon::prelude::*;

/// What other frames see of a layer: for each pixel sums of colour and inverse depth off the plane (1/m), and of weights.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    sums: Vec<[f32; 5]>,
}

/// A point that is farther off every plane than this many times what lies on one belongs to no layer.
const FARTHEST: f64 = 4.0;

/// Pixels around a layer's own in which other frames are asked though it is not hidden there: edges are found to within some.
const RIM: usize = 3;

/// The weight from which on a pixel is seen: one frame, about its own pixel.
const LEAST_WEIGHT: f32 = 0.35;

/// Rounds in which pixels between seen ones are closed, and how many of the eight around must be seen.
const CLOSING: usize = 2;
const CLOSE: usize = 5;

impl Seen {
    /// Colour and inverse depth off the plane of a pixel.
    pub(super) fn at(&self, pixel: usize) -> Option<([f32; 3], f32)> {
        let [r, g, b, off, weight] = self.sums[pixel];
        (weight >= LEAST_WEIGHT).then(|| ([r / weight, g / weight, b / weight], off / weight))
    }

    fn add(&mut self, canvas: &Canvas, [x, y]: [f64; 2], color: [f32; 3], off: f32) {
        let (column, row) = ((x - 0.5).floor(), (y - 0.5).floor());
        let (u, v) = ((x - 0.5 - column) as f32, (y - 0.5 - row) as f32);
        for (dx, dy, weight) in [
            (0.0, 0.0, (1.0 - u) * (1.0 - v)),
            (1.0, 0.0, u * (1.0 - v)),
            (0.0, 1.0, (1.0 - u) * v),
            (1.0, 1.0, u * v),
        ] {
            let (x, y) = (column + dx, row + dy);
            if x >= 0.0 && y >= 0.0 && x < canvas.width as f64 && y < canvas.height as f64 {
                let sum = &mut self.sums[y as usize * canvas.width + x as usize];
                let values = [color[0], color[1], color[2], off, 1.0];
                (0..5).for_each(|k| sum[k] += weight * values[k]);
            }
        }
    }

    /// Closes pixels between seen ones: a frame from farther away leaves some out.
    fn close(&mut self, canvas: &Canvas) {
        for _ in 0..CLOSING {
            let closed = (0..self.sums.len()).into_par_iter().filter_map(|pixel| {
                if self.at(pixel).is_some() {
                    return None;
                }
                let near: Vec<([f32; 3], f32)> = canvas
                    .around(pixel, 1)
                    .filter_map(|near| self.at(near))
                    .collect();
                let mean = |of: fn(&([f32; 3], f32)) -> f32| {
                    near.iter().map(of).sum::<f32>() / near.len() as f32
                };
                let values = || {
                    [
                        mean(|n| n.0[0]),
                        mean(|n| n.0[1]),
                        mean(|n| n.0[2]),
                        mean(|n| n.1),
                        1.0,
                    ]
                };
                (near.len() >= CLOSE).then(|| (pixel, values()))
            });
            let closed: Vec<(usize, [f32; 5])> = closed.collect();
            closed
                .into_iter()
                .for_each(|(pixel, sums)| self.sums[pixel] = sums);
        }
    }
}

/// What other frames see of each layer.
pub(super) fn see(canvas: &Canvas, frames: &Frames, planes: &[Affine], labels: &[u8]) -> Vec<Seen> {
    let near = near_own(canvas, labels);
    let of_layer = |label: usize| {
        let mut seen = Seen {
            sums: vec![[0.0; 5]; labels.len()],
        };
        let view = Looking {
            canvas,
            planes,
            labels,
            near: &near,
        };
        for frame in frames.others() {
            view.add(frame, label, &mut seen);
        }
        seen.close(canvas);
        seen
    };
    (0..planes.len()).into_par_iter().map(of_layer).collect()
}

/// Of each pixel, which layers have pixels of their own near it, a bit each.
fn near_own(canvas: &Canvas, labels: &[u8]) -> Vec<u64> {
    let bits = |pixel: usize| {
        canvas
            .around(pixel, RIM)
            .map(|near| labels[near])
            .filter(|label| *label != NONE)
            .fold(0, |bits, l| bits | 1 << l)
    };
    (0..labels.len()).into_par_iter().map(bits).collect()
}

/// What is looked at.
struct Looking<'a> {
    canvas: &'a Canvas,
    planes: &'a [Affine],
    labels: &'a [u8],
    near: &'a [u64],
}

impl Looking<'_> {
    /// Adds what a frame sees of a layer.
    fn add(&self, frame: &Frame, label: usize, seen: &mut Seen) {
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
                    && self.belongs([cx, cy], inverse_depth) == Some(label)
                    && self.is_open(pixel, label, inverse_depth)
                {
                    let level = view.color[(y * width + x) as usize];
                    let color = [0, 1, 2].map(|c| f32::from(level[c]) * frame.gain[c]);
                    let off = inverse_depth - self.planes[label].at([cx, cy]);
                    seen.add(self.canvas, [cx, cy], color, off as f32);
                }
            }
        }
    }

    /// The plane nearest to a point, if it is near.
    fn belongs(&self, at: [f64; 2], inverse_depth: f64) -> Option<usize> {
        let off = |plane: &Affine| {
            (plane.at(at) - inverse_depth).abs() * self.canvas.px_per_inverse_depth
        };
        let offs = self.planes.iter().map(off).enumerate();
        let nearest = offs.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 <= FARTHEST * self.canvas.on_plane_px).then_some(nearest.0)
    }

    /// Whether the middle frame leaves open what a layer shows at a pixel: something nearer hides it there, an edge is near, or the picture has ended.
    fn is_open(&self, pixel: usize, label: usize, inverse_depth: f64) -> bool {
        let own = self.labels[pixel];
        if own == NONE {
            return !self.canvas.inside[pixel];
        }
        let front = &self.planes[usize::from(own)];
        let hidden =
            -front.off_px(self.canvas, pixel, inverse_depth as f32) > self.canvas.on_plane_px;
        usize::from(own) != label && (hidden || self.near[pixel] >> label & 1 == 1)
    }
}
