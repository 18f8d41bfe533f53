//! Alpha matting at the borders of layers: coverage of the nearer of two layers, from the colours
//! on both sides.

use super::background::LayerBackground;
use super::canvas::Canvas;
use super::labels::NONE;
use super::planes::Affine;
use super::{PlanarLayer, fill};
use image::{Rgba, RgbaImage};
use rayon::prelude::*;

/// Width of the matted band at each side of a border, pixels.
const BAND: usize = 2;

/// Radius of the window that samples each side's colours, pixels.
const WINDOW: usize = 7;

/// Minimum number of pixels of a side for its colour.
const MIN_SIDE_PIXELS: f32 = 6.0;

/// Minimum colour difference of the sides, in levels and in standard deviations.
const MIN_LEVELS: f32 = 24.0;
const MIN_DEVIATIONS: f32 = 2.0;

/// Range of alpha that is kept; values outside are rounded to 0 or 1.
const PARTIAL_ALPHA: std::ops::Range<f32> = 0.06..0.94;

/// Minimum difference of inverse depth at a depth step, in tolerances of points on a plane; less is
/// a crease.
const STEP: f64 = 2.0;

/// Builder of a layer.
pub(super) struct LayerBuilder {
    /// Index of the plane.
    pub(super) label: usize,
    plane: Affine,
    /// Levels and alpha (0..=1).
    color: Vec<[f32; 4]>,
    /// Residual inverse depth from the plane, 1/m, extended to unknown pixels.
    residual: Vec<f32>,
}

impl LayerBuilder {
    /// Combines a layer's pixels of the middle frame with its background from other frames.
    pub(super) fn new(
        canvas: &Canvas,
        planes: &[Affine],
        labels: &[u8],
        label: usize,
        background: &LayerBackground,
    ) -> Self {
        let plane = planes[label];
        let mut color = vec![[0.0; 4]; labels.len()];
        let mut known = vec![None; labels.len()];
        // Pixels of the middle frame without a layer stay empty.
        let is_free = |pixel: usize| labels[pixel] != NONE || !canvas.inside[pixel];
        for pixel in 0..labels.len() {
            if usize::from(labels[pixel]) == label {
                let [r, g, b] = canvas.color[pixel];
                color[pixel] = [r, g, b, 1.0];
                known[pixel] = own_residual(canvas, planes, label, pixel);
            } else if let Some(([r, g, b], residual)) =
                background.get(pixel).filter(|_| is_free(pixel))
            {
                color[pixel] = [r, g, b, 1.0];
                known[pixel] = Some(residual);
            }
        }
        Self {
            label,
            plane,
            color,
            residual: fill::smoothly(&known, canvas.width),
        }
    }

    fn inverse_depth(&self, canvas: &Canvas, pixel: usize) -> f64 {
        self.plane.inverse_depth(canvas.center(pixel)) + f64::from(self.residual[pixel])
    }

    /// Converts the layer to images.
    pub(super) fn finish(self, canvas: &Canvas) -> PlanarLayer {
        let in_front =
            |pixel: usize| self.color[pixel][3] > 0.0 && self.inverse_depth(canvas, pixel) > 0.0;
        let rgba = |pixel: usize| {
            let [r, g, b, alpha] = self.color[pixel];
            [r, g, b, alpha * 255.0].map(|level| (level + 0.5) as u8)
        };
        let color = RgbaImage::from_fn(canvas.width as u32, canvas.height as u32, |x, y| {
            let pixel = y as usize * canvas.width + x as usize;
            Rgba(if in_front(pixel) { rgba(pixel) } else { [0; 4] })
        });
        let depth = |(pixel, color): (usize, &Rgba<u8>)| match color.0[3] {
            0 => f32::NAN,
            _ => (1.0 / self.inverse_depth(canvas, pixel)) as f32,
        };
        let depth = color.pixels().enumerate().map(depth).collect();
        let (normal, offset) = self.plane.to_world(canvas);
        PlanarLayer {
            normal,
            offset,
            color,
            depth,
        }
    }
}

/// Returns the residual inverse depth of a pixel from its layer's plane, 1/m; `None` where unknown
/// or much nearer to another plane.
fn own_residual(canvas: &Canvas, planes: &[Affine], label: usize, pixel: usize) -> Option<f32> {
    let inverse_depth = canvas.inverse_depth[pixel];
    let distance_px = |plane: &Affine| plane.distance_px(canvas, pixel, inverse_depth).abs();
    let nearest = planes.iter().map(distance_px).fold(f64::INFINITY, f64::min);
    let agrees = distance_px(&planes[label]) <= nearest + STEP * canvas.on_plane_px;
    (inverse_depth > 0.0 && agrees).then(|| {
        (f64::from(inverse_depth) - planes[label].inverse_depth(canvas.center(pixel))) as f32
    })
}

/// New colour of a pixel of a layer.
struct PixelUpdate {
    layer: usize,
    pixel: usize,
    color: [f32; 4],
}

/// Mattes the layers at their borders.
pub(super) fn blend(canvas: &Canvas, labels: &[u8], layers: &mut [&mut LayerBuilder]) {
    let band = Band::new(canvas, labels);
    let unmatted: &[&mut LayerBuilder] = layers;
    let updates: Vec<PixelUpdate> = (0..labels.len())
        .into_par_iter()
        .flat_map_iter(|pixel| band.matte(unmatted, pixel))
        .collect();
    for PixelUpdate {
        layer,
        pixel,
        color,
    } in updates
    {
        layers[layer].color[pixel] = color;
    }
}

/// Pixels at borders between layers.
struct Band<'a> {
    canvas: &'a Canvas,
    labels: &'a [u8],
    /// True for pixels outside the band, which show a single layer.
    inside: Vec<bool>,
}

/// Colour statistics of one side of a border.
struct Side {
    mean: [f32; 3],
    deviation: f32,
    count: f32,
}

impl<'a> Band<'a> {
    fn new(canvas: &'a Canvas, labels: &'a [u8]) -> Self {
        let inside = |pixel: usize| {
            canvas
                .around(pixel, BAND)
                .all(|near| labels[near] == labels[pixel])
        };
        let inside = (0..labels.len()).into_par_iter().map(inside).collect();
        Self {
            canvas,
            labels,
            inside,
        }
    }

    /// Mattes a pixel near a border in the two layers that meet there.
    fn matte(&self, layers: &[&mut LayerBuilder], pixel: usize) -> Vec<PixelUpdate> {
        let find_layer = |label: u8| {
            layers
                .iter()
                .position(|layer| layer.label == usize::from(label))
        };
        let Some(own) = find_layer(self.labels[pixel]).filter(|_| !self.inside[pixel]) else {
            return Vec::new();
        };
        let Some(other) = self.main_neighbor(pixel).and_then(find_layer) else {
            return Vec::new();
        };
        let mixed = self.canvas.color[pixel];
        let update = |layer: usize, [r, g, b]: [f32; 3], alpha: f32| PixelUpdate {
            layer,
            pixel,
            color: [r, g, b, alpha],
        };
        let nearer_px = |a: usize, b: usize| {
            let inverse_depth = |layer: usize| layers[layer].inverse_depth(self.canvas, pixel);
            (inverse_depth(a) - inverse_depth(b)) * self.canvas.px_per_inverse_depth
        };
        let step = nearer_px(own, other);
        if step.abs() < STEP * self.canvas.on_plane_px {
            // A crease: both layers overlap, so that no crack opens.
            return vec![update(other, mixed, 1.0)];
        }
        let (front, back) = if step > 0.0 {
            (own, other)
        } else {
            (other, own)
        };
        let [front_side, back_side] =
            [front, back].map(|layer| self.side(layers[layer].label, pixel));
        let behind = layers[back].color[pixel];
        // Other frames are better than a mean; the middle frame's own pixel is a mixture.
        let behind = if own != back && behind[3] != 0.0 {
            [behind[0], behind[1], behind[2]]
        } else if back_side.count >= MIN_SIDE_PIXELS {
            back_side.mean
        } else {
            mixed
        };
        let alpha = estimate_alpha(&mixed, &front_side, &back_side)
            .unwrap_or_else(|| self.coverage(layers[front].label, pixel));
        if alpha >= PARTIAL_ALPHA.end || (own == front && front_side.count < MIN_SIDE_PIXELS) {
            return vec![update(front, mixed, 1.0), update(back, behind, 1.0)];
        }
        if alpha < PARTIAL_ALPHA.start {
            return vec![update(front, [0.0; 3], 0.0), update(back, mixed, 1.0)];
        }
        let unmixed =
            [0, 1, 2].map(|c| ((mixed[c] - (1.0 - alpha) * behind[c]) / alpha).clamp(0.0, 255.0));
        vec![update(front, unmixed, alpha), update(back, behind, 1.0)]
    }

    /// Returns the most frequent other label within the band.
    fn main_neighbor(&self, pixel: usize) -> Option<u8> {
        let mut counts = [0u8; 256];
        for near in self.canvas.around(pixel, BAND) {
            counts[usize::from(self.labels[near])] += 1;
        }
        counts[usize::from(NONE)] = 0;
        counts[usize::from(self.labels[pixel])] = 0;
        let most = (0..256).max_by_key(|label| (counts[*label], std::cmp::Reverse(*label)))?;
        (counts[most] > 0).then_some(most as u8)
    }

    /// Returns the colours of a label near a pixel, outside the band.
    fn side(&self, label: usize, pixel: usize) -> Side {
        let own = |near: &usize| self.inside[*near] && usize::from(self.labels[*near]) == label;
        let mut sum = [0.0f32; 3];
        let mut squares = 0.0f32;
        let mut count = 0.0f32;
        for near in self.canvas.around(pixel, WINDOW).filter(own) {
            let color = self.canvas.color[near];
            (0..3).for_each(|c| sum[c] += color[c]);
            squares += color.iter().map(|level| level * level).sum::<f32>();
            count += 1.0;
        }
        let mean = sum.map(|sum| sum / count.max(1.0));
        let variance =
            squares / count.max(1.0) - mean.iter().map(|level| level * level).sum::<f32>();
        Side {
            mean,
            deviation: variance.max(0.0).sqrt(),
            count,
        }
    }

    /// Returns the fraction of a label in a pixel's neighbourhood: an edge softened by a pixel, for
    /// sides of similar colour.
    fn coverage(&self, label: usize, pixel: usize) -> f32 {
        let around = || self.canvas.around(pixel, 1);
        let own = around().filter(|near| usize::from(self.labels[*near]) == label);
        own.count() as f32 / around().count() as f32
    }
}

/// Estimates the fraction of the front in a mixed colour; `None` if the sides have similar colours.
fn estimate_alpha(color: &[f32; 3], front: &Side, back: &Side) -> Option<f32> {
    let between = [0, 1, 2].map(|c| front.mean[c] - back.mean[c]);
    let squared: f32 = between.iter().map(|d| d * d).sum();
    let min_distance = MIN_LEVELS.max(MIN_DEVIATIONS * front.deviation.max(back.deviation));
    let is_distinct = front.count >= MIN_SIDE_PIXELS
        && back.count >= MIN_SIDE_PIXELS
        && squared >= min_distance * min_distance;
    let along: f32 = (0..3).map(|c| (color[c] - back.mean[c]) * between[c]).sum();
    is_distinct.then(|| (along / squared).clamp(0.0, 1.0))
}
