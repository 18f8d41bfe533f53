//! Alpha at the borders of layers: how much of a pixel the nearer of two layers covers follows from the colours that each has on its side.

use super::PlanarLayer;
use super::behind::Seen;
use super::canvas::Canvas;
use super::labels::NONE;
use super::planes::Affine;
use crate::planar_layers::fill;
use image::{Rgba, RgbaImage};
use rayon::prelude::*;

/// Pixels to each side of a border whose alpha is in question.
const BAND: usize = 2;

/// Half of the side of the window in which each side's colours are looked at, pixels.
const WINDOW: usize = 7;

/// Fewest pixels of a side that tell its colour.
const LEAST_PIXELS: f32 = 6.0;

/// Levels by which the sides must differ at least, and standard deviations.
const APART_LEVELS: f32 = 24.0;
const APART_DEVIATIONS: f32 = 2.0;

/// Shares of a pixel that count as none and all.
const CLEAR: std::ops::Range<f32> = 0.06..0.94;

/// Inverse depths of two layers that differ by so many times what lies on a plane are a step; less is a crease.
const STEP: f64 = 2.0;

/// A layer in the making.
pub(super) struct Built {
    /// The plane's number.
    pub(super) label: usize,
    plane: Affine,
    /// Levels and alpha (0 to 1).
    color: Vec<[f32; 4]>,
    /// Inverse depth off the plane, 1/m; carried on to pixels where it is unknown.
    off: Vec<f32>,
}

impl Built {
    /// Of a layer's own pixels and of what other frames see of it.
    pub(super) fn new(
        canvas: &Canvas,
        planes: &[Affine],
        labels: &[u8],
        label: usize,
        seen: &Seen,
    ) -> Self {
        let plane = planes[label];
        let (mut color, mut known) = (vec![[0.0; 4]; labels.len()], vec![None; labels.len()]);
        // What the middle frame sees there is no layer's.
        let is_free = |pixel: usize| labels[pixel] != NONE || !canvas.inside[pixel];
        for pixel in 0..labels.len() {
            if usize::from(labels[pixel]) == label {
                let [r, g, b] = canvas.color[pixel];
                color[pixel] = [r, g, b, 1.0];
                known[pixel] = own_residual(canvas, planes, label, pixel);
            } else if let Some(([r, g, b], off)) = seen.at(pixel).filter(|_| is_free(pixel)) {
                color[pixel] = [r, g, b, 1.0];
                known[pixel] = Some(off);
            }
        }
        Self {
            label,
            plane,
            color,
            off: fill::smoothly(&known, canvas.width),
        }
    }

    fn inverse_depth(&self, canvas: &Canvas, pixel: usize) -> f64 {
        self.plane.at(canvas.center(pixel)) + f64::from(self.off[pixel])
    }

    /// As pictures.
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
        let (normal, offset) = self.plane.in_world(canvas);
        PlanarLayer {
            normal,
            offset,
            color,
            depth,
        }
    }
}

/// How far a pixel's depth is off its layer's plane, 1/m; `None` where it is unknown, or another plane's by far.
fn own_residual(canvas: &Canvas, planes: &[Affine], label: usize, pixel: usize) -> Option<f32> {
    let inverse_depth = canvas.inverse_depth[pixel];
    let off = |plane: &Affine| plane.off_px(canvas, pixel, inverse_depth).abs();
    let nearest = planes.iter().map(off).fold(f64::INFINITY, f64::min);
    let agrees = off(&planes[label]) <= nearest + STEP * canvas.on_plane_px;
    (inverse_depth > 0.0 && agrees)
        .then(|| (f64::from(inverse_depth) - planes[label].at(canvas.center(pixel))) as f32)
}

/// What a pixel of a layer becomes.
struct Paint {
    layer: usize,
    pixel: usize,
    color: [f32; 4],
}

/// Blends the layers into each other at their borders.
pub(super) fn blend(canvas: &Canvas, labels: &[u8], layers: &mut [&mut Built]) {
    let band = Band::new(canvas, labels);
    let shown: &[&mut Built] = layers;
    let paints: Vec<Paint> = (0..labels.len())
        .into_par_iter()
        .flat_map_iter(|pixel| band.paint(shown, pixel))
        .collect();
    for Paint {
        layer,
        pixel,
        color,
    } in paints
    {
        layers[layer].color[pixel] = color;
    }
}

/// Borders, and what lies to both sides.
struct Band<'a> {
    canvas: &'a Canvas,
    labels: &'a [u8],
    /// Whether a pixel is so far from all others that it shows its layer alone.
    inside: Vec<bool>,
}

/// Mean and spread of a side's colours.
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

    /// What a pixel near a border becomes in the two layers that meet there.
    fn paint(&self, layers: &[&mut Built], pixel: usize) -> Vec<Paint> {
        let of = |label: u8| {
            layers
                .iter()
                .position(|layer| layer.label == usize::from(label))
        };
        let Some(own) = of(self.labels[pixel]).filter(|_| !self.inside[pixel]) else {
            return Vec::new();
        };
        let Some(other) = self.most_beside(pixel).and_then(of) else {
            return Vec::new();
        };
        let [r, g, b] = self.canvas.color[pixel];
        let nearer_px = |a: usize, b: usize| {
            let inverse_depth = |layer: usize| layers[layer].inverse_depth(self.canvas, pixel);
            (inverse_depth(a) - inverse_depth(b)) * self.canvas.px_per_inverse_depth
        };
        let step = nearer_px(own, other);
        if step.abs() < STEP * self.canvas.on_plane_px {
            // A crease: both reach a little beyond it, so that no crack opens.
            return vec![Paint {
                layer: other,
                pixel,
                color: [r, g, b, 1.0],
            }];
        }
        let (front, back) = if step > 0.0 {
            (own, other)
        } else {
            (other, own)
        };
        let [front_side, back_side] =
            [front, back].map(|layer| self.side(layers[layer].label, pixel));
        let behind = layers[back].color[pixel];
        // What other frames see there is better than a mean; what the middle one sees is mixed.
        let behind = match own == back || behind[3] == 0.0 {
            true if back_side.count >= LEAST_PIXELS => back_side.mean,
            true => [r, g, b],
            false => [behind[0], behind[1], behind[2]],
        };
        let is_front = own == front;
        let alpha = share(&[r, g, b], &front_side, &back_side)
            .unwrap_or_else(|| self.soft(layers[front].label, pixel));
        if alpha >= CLEAR.end || (is_front && front_side.count < LEAST_PIXELS) {
            let [x, y, z] = behind;
            let own = [r, g, b, 1.0];
            return vec![
                Paint {
                    layer: front,
                    pixel,
                    color: own,
                },
                Paint {
                    layer: back,
                    pixel,
                    color: [x, y, z, 1.0],
                },
            ];
        }
        if alpha < CLEAR.start {
            return vec![
                Paint {
                    layer: front,
                    pixel,
                    color: [0.0; 4],
                },
                Paint {
                    layer: back,
                    pixel,
                    color: [r, g, b, 1.0],
                },
            ];
        }
        let mixed = [r, g, b];
        let unmixed =
            [0, 1, 2].map(|c| ((mixed[c] - (1.0 - alpha) * behind[c]) / alpha).clamp(0.0, 255.0));
        vec![
            Paint {
                layer: front,
                pixel,
                color: [unmixed[0], unmixed[1], unmixed[2], alpha],
            },
            Paint {
                layer: back,
                pixel,
                color: [behind[0], behind[1], behind[2], 1.0],
            },
        ]
    }

    /// The other label of which there is most within the band.
    fn most_beside(&self, pixel: usize) -> Option<u8> {
        let mut counts = [0u8; 256];
        for near in self.canvas.around(pixel, BAND) {
            counts[usize::from(self.labels[near])] += 1;
        }
        (
            counts[usize::from(NONE)],
            counts[usize::from(self.labels[pixel])],
        ) = (0, 0);
        let most = (0..256).max_by_key(|label| (counts[*label], std::cmp::Reverse(*label)))?;
        (counts[most] > 0).then_some(most as u8)
    }

    /// The colours of a label near a pixel, away from borders.
    fn side(&self, label: usize, pixel: usize) -> Side {
        let own = |near: &usize| self.inside[*near] && usize::from(self.labels[*near]) == label;
        let (mut sum, mut squares, mut count) = ([0.0f32; 3], 0.0f32, 0.0f32);
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

    /// The share of a label in a pixel's neighbourhood: an edge that is soft by a pixel, where colours do not tell.
    fn soft(&self, label: usize, pixel: usize) -> f32 {
        let (mut own, mut all) = (0.0, 0.0);
        for near in self.canvas.around(pixel, 1) {
            all += 1.0;
            own += if usize::from(self.labels[near]) == label {
                1.0
            } else {
                0.0
            };
        }
        own / all
    }
}

/// Which share of a colour is the front's; `None` where the two sides look too much alike.
fn share(color: &[f32; 3], front: &Side, back: &Side) -> Option<f32> {
    let between = [0, 1, 2].map(|c| front.mean[c] - back.mean[c]);
    let squared: f32 = between.iter().map(|d| d * d).sum();
    let apart = APART_LEVELS.max(APART_DEVIATIONS * front.deviation.max(back.deviation));
    let told =
        front.count >= LEAST_PIXELS && back.count >= LEAST_PIXELS && squared >= apart * apart;
    let along: f32 = (0..3).map(|c| (color[c] - back.mean[c]) * between[c]).sum();
    told.then(|| (along / squared).clamp(0.0, 1.0))
}
