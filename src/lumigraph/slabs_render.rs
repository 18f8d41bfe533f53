//! Frames of several light slabs: one or two are drawn, and mixed pixel by pixel in linear light.

use super::oracle;
use super::slabs::{SlabShare, Slabs};
use super::{LumigraphRenderer, LumigraphSettings, LumigraphStats};
use crate::capture::{Camera, linear_from_srgb8, srgb8_from_linear};
use crate::frame::Frame;
use crate::render::linear::LinearLight;
use rayon::prelude::*;
use std::time::Instant;

/// Shares of a pixel are whole numbers of this many.
const SHARES: u32 = 255;

/// The share of the other slab from which on it fills what one does not know wholly: holes fade before a slab goes.
const FILLS: f64 = 0.2;

/// Draws frames of slabs; owns its buffers.
#[derive(Default)]
pub struct SlabsRenderer {
    /// Of each slab; the layers that one merged are where its next frame begins.
    renderers: Vec<LumigraphRenderer>,
    frame: Frame,
    stats: LumigraphStats,
}

impl SlabsRenderer {
    /// A renderer that has drawn nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Draws what `camera` sees, on the current rayon thread pool.
    pub fn render(
        &mut self,
        slabs: &Slabs,
        camera: &Camera,
        settings: &LumigraphSettings,
    ) -> (&Frame, &LumigraphStats) {
        let started = Instant::now();
        self.renderers.resize_with(slabs.all().len(), LumigraphRenderer::new);
        let shares = slabs.shares(camera);
        self.stats = LumigraphStats::default();
        for SlabShare { slab, .. } in &shares {
            let (_, stats) = self.renderers[*slab].render(&slabs.all()[*slab], camera, settings);
            self.stats.layers += stats.layers;
            self.stats.layer_pixels += stats.layer_pixels;
            self.stats.hole_pixels = stats.hole_pixels;
            self.stats.plan_ms += stats.plan_ms;
        }
        let [best, others @ ..] = &shares[..] else { return (&self.frame, &self.stats) };
        let Some(second) = others.first() else {
            self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
            return (self.renderers[best.slab].frame(), &self.stats);
        };
        let frames = [best.slab, second.slab].map(|slab| self.renderers[slab].frame());
        mix(frames, second.share, &mut self.frame, settings.hole_color_srgb);
        self.stats.hole_pixels = self.frame.hole_count();
        self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, &self.stats)
    }
}

/// Shares of two pixels and of the colour of holes, which add up to 1, as they are or are not known.
fn shares_of(known: [bool; 2], of_second: f64) -> [f64; 3] {
    let of = [1.0 - of_second, of_second];
    let filled = |by: usize| {
        let share = (of[by] / FILLS).min(1.0);
        let mut shares = [0.0, 0.0, of[1 - by] * (1.0 - share)];
        shares[by] = 1.0 - shares[2];
        shares
    };
    match known {
        [true, true] => [of[0], of[1], 0.0],
        [true, false] => filled(0),
        [false, true] => filled(1),
        [false, false] => [0.0, 0.0, 1.0],
    }
}

/// Two frames in one; the coverage of a pixel is that of the larger share of what is known.
fn mix(frames: [&Frame; 2], of_second: f64, to: &mut Frame, hole_color_srgb: [u8; 3]) {
    let (width, height) = (frames[0].width, frames[0].height);
    to.resize(width, height, false);
    let shares = [[false, false], [true, false], [false, true], [true, true]]
        .map(|known| shares_of(known, of_second).map(|share| (share * f64::from(SHARES)).round() as u32));
    let tables = LinearLight::tables();
    let rgb = |[r, g, b, _]: [u8; 4]| [r, g, b];
    let pixels = to.color.par_iter_mut().zip(to.coverage.par_iter_mut()).enumerate().with_min_len(4096);
    pixels.for_each(|(i, (color, coverage))| {
        let known = frames.map(|frame| !frame.coverage[i].is_hole());
        let [_, b, hole] = shares[usize::from(known[0]) + 2 * usize::from(known[1])];
        let [r, g, b] = match known {
            [true, true] => tables.mix(frames.map(|frame| rgb(frame.color[i])), [SHARES - b, b]),
            [false, false] => hole_color_srgb,
            [first, _] => tables.mix([rgb(frames[usize::from(!first)].color[i]), hole_color_srgb], [SHARES - hole, hole]),
        };
        *color = [r, g, b, 255];
        let from = if known[1] && (of_second >= 0.5 || !known[0]) { 1 } else { 0 };
        *coverage = frames[from].coverage[i];
    });
}

/// What [`SlabsRenderer::render`] draws, ray by ray and in `f64`.
pub fn render_slabs_by_rays(slabs: &Slabs, camera: &Camera, settings: &LumigraphSettings) -> Frame {
    let drawn: Vec<(Frame, f64)> = slabs
        .shares(camera)
        .into_iter()
        .map(|SlabShare { slab, share }| (oracle::render(&slabs.all()[slab], camera, settings), share))
        .collect();
    let [(first, _), others @ ..] = &drawn[..] else { return Frame::default() };
    let Some((second, share)) = others.first() else { return first.clone() };
    let mut frame = first.clone();
    let linear = |color: [u8; 4], c: usize| f64::from(linear_from_srgb8(color[c]));
    let [r, g, b] = settings.hole_color_srgb;
    for (i, color) in frame.color.iter_mut().enumerate() {
        let known = [first, second].map(|frame| !frame.coverage[i].is_hole());
        let shares = shares_of(known, *share);
        let colors = [first.color[i], second.color[i], [r, g, b, 255]];
        for c in 0..3 {
            let sum: f64 = (0..3).map(|k| shares[k] * linear(colors[k], c)).sum();
            color[c] = srgb8_from_linear(sum as f32);
        }
        if !known[0] {
            frame.coverage[i] = second.coverage[i];
        }
    }
    frame
}
