//! Frames of several light slabs: one or two are drawn, and blended pixel by pixel in linear light.

use crate::make::slabs::{SlabShare, Slabs};
use crate::oracle;
use crate::{LumigraphRenderer, LumigraphSettings, LumigraphStats};
use headbox_core::camera::Camera;
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use headbox_core::frame::{Coverage, Frame};
use headbox_cube::render::canvas::linear::LinearLight;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::time::Instant;

/// Denominator of the shares of a pixel.
const SHARE_ONE: u32 = 255;

/// Share from which a slab is opaque in pixels that the other does not cover: pixels of the best
/// slab are always opaque, and those that only the second covers fade in and out with it.
const OPAQUE_SHARE: f64 = 0.5;

/// Renderer of slabs; reuses its buffers from frame to frame.
#[derive(Default)]
pub struct SlabsRenderer {
    /// Renderer of each slab; its merged layers are the initial guess of its next frame.
    renderers: Vec<LumigraphRenderer>,
    frame: Frame,
    stats: LumigraphStats,
}

impl SlabsRenderer {
    /// Creates a renderer.
    pub fn new() -> Self {
        Self::default()
    }

    /// Renders a frame for `camera`, on the current rayon thread pool.
    pub fn render(
        &mut self,
        slabs: &Slabs,
        camera: &Camera,
        settings: &LumigraphSettings,
    ) -> (&Frame, &LumigraphStats) {
        let started = Instant::now();
        self.renderers
            .resize_with(slabs.all().len(), LumigraphRenderer::new);
        let shares = slabs.shares(camera);
        self.stats = LumigraphStats::default();
        for SlabShare { slab, .. } in &shares {
            let (_, stats) = self.renderers[*slab].render(&slabs.all()[*slab], camera, settings);
            self.stats.layers += stats.layers;
            self.stats.layer_pixels += stats.layer_pixels;
            self.stats.hole_pixels = stats.hole_pixels;
            self.stats.plan_ms += stats.plan_ms;
        }
        let [best, others @ ..] = &shares[..] else {
            return (&self.frame, &self.stats);
        };
        let Some(second) = others.first() else {
            self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
            return (self.renderers[best.slab].frame(), &self.stats);
        };
        let frames = [best.slab, second.slab].map(|slab| self.renderers[slab].frame());
        blend(frames, second.share, &mut self.frame);
        self.stats.hole_pixels = self.frame.hole_count();
        self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, &self.stats)
    }
}

/// Returns the second slab's share of a pixel, by the coverage ranks of the two slabs there: 0 for
/// a hole, 1 for the environment, 2 for a surface.
fn second_share(ranks: [u8; 2], share: f64) -> f64 {
    match ranks[0].cmp(&ranks[1]) {
        Ordering::Equal => share,
        Ordering::Less => (share / OPAQUE_SHARE).min(1.0),
        Ordering::Greater => 1.0 - ((1.0 - share) / OPAQUE_SHARE).min(1.0),
    }
}

/// Ranks the coverage of a pixel for [`second_share`].
fn coverage_rank(coverage: Coverage) -> u8 {
    if coverage.is_hole() {
        0
    } else {
        1 + u8::from(coverage.splat_share() > 0)
    }
}

/// Blends two frames; the coverage of a pixel is that of the higher rank.
fn blend(frames: [&Frame; 2], share: f64, to: &mut Frame) {
    to.resize(frames[0].width, frames[0].height, false);
    let whole = |share: f64| (share * f64::from(SHARE_ONE)).round() as u32;
    let shares =
        [0, 1, 2].map(|first| [0, 1, 2].map(|second| whole(second_share([first, second], share))));
    let tables = LinearLight::tables();
    let pixels = to
        .color
        .par_iter_mut()
        .zip(to.coverage.par_iter_mut())
        .enumerate()
        .with_min_len(4096);
    pixels.for_each(|(i, (color, coverage))| {
        let ranks = frames.map(|frame| coverage_rank(frame.coverage[i]));
        let share = shares[usize::from(ranks[0])][usize::from(ranks[1])];
        let colors = frames.map(|frame| [frame.color[i][0], frame.color[i][1], frame.color[i][2]]);
        let [r, g, b] = tables.mix(colors, [SHARE_ONE - share, share]);
        *color = [r, g, b, 255];
        *coverage = frames[usize::from(ranks[1] > ranks[0])].coverage[i];
    });
}

/// Renders the same frame as [`SlabsRenderer::render`], ray by ray and in `f64`.
pub fn render_slabs_by_rays(slabs: &Slabs, camera: &Camera, settings: &LumigraphSettings) -> Frame {
    let drawn: Vec<(Frame, f64)> = slabs
        .shares(camera)
        .into_iter()
        .map(|SlabShare { slab, share }| {
            (oracle::render(&slabs.all()[slab], camera, settings), share)
        })
        .collect();
    let [(first, _), others @ ..] = &drawn[..] else {
        return Frame::default();
    };
    let Some((second, share)) = others.first() else {
        return first.clone();
    };
    let mut frame = first.clone();
    let linear = |color: [u8; 4], c: usize| f64::from(linear_from_srgb8(color[c]));
    for (i, color) in frame.color.iter_mut().enumerate() {
        let ranks = [first, second].map(|frame| coverage_rank(frame.coverage[i]));
        let share = second_share(ranks, *share);
        for c in 0..3 {
            let sum =
                (1.0 - share) * linear(first.color[i], c) + share * linear(second.color[i], c);
            color[c] = srgb8_from_linear(sum as f32);
        }
        frame.coverage[i] = [first, second][usize::from(ranks[1] > ranks[0])].coverage[i];
    }
    frame
}
