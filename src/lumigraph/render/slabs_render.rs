//! Frames of several light slabs: one or two are drawn, and mixed pixel by pixel in linear light.

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

/// Shares of a pixel are whole numbers of this many.
const SHARES: u32 = 255;

/// The share of a slab from which on what its cameras see is shown alone where those of the other
/// look nowhere: what the best slab sees is always there, and what only the second sees comes and
/// goes with it.
const FILLS: f64 = 0.5;

/// Draws frames of slabs; owns its buffers.
#[derive(Default)]
pub struct SlabsRenderer {
    /// Renderer of each slab; the layers that one merged are the start of its next frame.
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
        mix(frames, second.share, &mut self.frame);
        self.stats.hole_pixels = self.frame.hole_count();
        self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, &self.stats)
    }
}

/// The second's share of a pixel, as cameras of the first and the second see something there or
/// not: 0 for a hole, 1 for what is only known to lie behind all, 2 for what is seen.
fn share_of_second(known: [u8; 2], of_second: f64) -> f64 {
    match known[0].cmp(&known[1]) {
        Ordering::Equal => of_second,
        Ordering::Less => (of_second / FILLS).min(1.0),
        Ordering::Greater => 1.0 - ((1.0 - of_second) / FILLS).min(1.0),
    }
}

/// Encodes the coverage of a pixel for [`share_of_second`].
fn known(coverage: Coverage) -> u8 {
    if coverage.is_hole() {
        0
    } else {
        1 + u8::from(coverage.splat_share() > 0)
    }
}

/// Two frames in one; the coverage of a pixel is that of which more is known.
fn mix(frames: [&Frame; 2], of_second: f64, to: &mut Frame) {
    to.resize(frames[0].width, frames[0].height, false);
    let whole = |share: f64| (share * f64::from(SHARES)).round() as u32;
    let shares = [0, 1, 2]
        .map(|first| [0, 1, 2].map(|second| whole(share_of_second([first, second], of_second))));
    let tables = LinearLight::tables();
    let pixels = to
        .color
        .par_iter_mut()
        .zip(to.coverage.par_iter_mut())
        .enumerate()
        .with_min_len(4096);
    pixels.for_each(|(i, (color, coverage))| {
        let known = frames.map(|frame| known(frame.coverage[i]));
        let share = shares[usize::from(known[0])][usize::from(known[1])];
        let colors = frames.map(|frame| [frame.color[i][0], frame.color[i][1], frame.color[i][2]]);
        let [r, g, b] = tables.mix(colors, [SHARES - share, share]);
        *color = [r, g, b, 255];
        *coverage = frames[usize::from(known[1] > known[0])].coverage[i];
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
        let known = [first, second].map(|frame| known(frame.coverage[i]));
        let share = share_of_second(known, *share);
        for c in 0..3 {
            let sum =
                (1.0 - share) * linear(first.color[i], c) + share * linear(second.color[i], c);
            color[c] = srgb8_from_linear(sum as f32);
        }
        frame.coverage[i] = [first, second][usize::from(known[1] > known[0])].coverage[i];
    }
    frame
}
