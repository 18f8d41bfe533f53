//! Frame rendering, in bands on threads (L9, L11; C21).
//!
//! The paper draws layers from back to front. Since a layer is opaque in a pixel if one of the four
//! cameras of the ray's cell sees it there, front to back with an early exit gives the same image,
//! and most pixels then test one or two layers. Where cameras disagree about a surface,
//! [`Blend::Shared`](crate::Blend::Shared) continues behind it.

use super::cells::Batch;
use super::kernel::{FrameBlock, HIDDEN, Pass};
use super::lanes::taps::LANES;
use super::merge::Merger;
use super::plan::{LumigraphPlan, SEARCH_RADIUS};
use crate::Lumigraph;
use crate::render::kernel;
use crate::settings::{LumigraphSettings, LumigraphStats};
use fearless_simd::Level as SimdLevel;
use headbox_core::camera::Camera;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::simd;
use headbox_cube::render::resolve::composite_environment::{EnvironmentBackground, Pixels};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Width of a block of the frame, pixels: visible layers are determined per block.
const BLOCK_COLUMNS: usize = 2 * LANES;
/// Height of a block, pixels.
const BLOCK_ROWS: usize = 16;

/// Renderer of lumigraphs; reuses its buffers from frame to frame.
pub struct LumigraphRenderer {
    frame: Frame,
    stats: LumigraphStats,
    merger: Merger,
    level: SimdLevel,
}

impl Default for LumigraphRenderer {
    fn default() -> Self {
        Self::with_level(simd::level())
    }
}

impl LumigraphRenderer {
    /// Creates a renderer for the best SIMD level of the CPU.
    pub fn new() -> Self {
        Self::default()
    }

    /// Creates a renderer for a given SIMD level. All levels give the same frame.
    pub fn with_level(level: SimdLevel) -> Self {
        Self {
            frame: Frame::default(),
            stats: LumigraphStats::default(),
            merger: Merger::default(),
            level,
        }
    }

    /// Renders a frame for `camera`, on the current rayon thread pool.
    pub fn render(
        &mut self,
        lumigraph: &Lumigraph,
        camera: &Camera,
        settings: &LumigraphSettings,
    ) -> (&Frame, &LumigraphStats) {
        let started = Instant::now();
        let plan = LumigraphPlan::new(lumigraph, camera, settings, &mut self.merger);
        let plan_ms = started.elapsed().as_secs_f64() * 1e3;
        self.frame.resize(camera.width(), camera.height(), false);
        let background = EnvironmentBackground {
            environment: &lumigraph.environment,
            camera,
            hole_color_srgb: settings.hole_color_srgb,
            level: self.level,
        };
        let width = camera.width() as usize;
        let (holes, layer_pixels) = (AtomicU64::new(0), AtomicU64::new(0));
        let Frame {
            color, coverage, ..
        } = &mut self.frame;
        let bands = color
            .par_chunks_mut(width * BLOCK_ROWS)
            .zip(coverage.par_chunks_mut(width * BLOCK_ROWS));
        bands
            .enumerate()
            .with_max_len(1)
            .for_each(|(band, (colors, coverages))| {
                let rows = band * BLOCK_ROWS..band * BLOCK_ROWS + colors.len() / width;
                layer_pixels.fetch_add(
                    draw_band(&plan, lumigraph, &rows, width, colors, self.level),
                    Ordering::Relaxed,
                );
                for ((y, colors), coverages) in rows
                    .zip(colors.chunks_mut(width))
                    .zip(coverages.chunks_mut(width))
                {
                    let row_holes = resolve_row(&background, y as u32, colors, coverages);
                    holes.fetch_add(row_holes, Ordering::Relaxed);
                }
            });
        self.stats = LumigraphStats {
            layers: plan.layers.len() as u64,
            layer_pixels: layer_pixels.into_inner(),
            hole_pixels: holes.into_inner(),
            plan_ms,
            frame_ms: started.elapsed().as_secs_f64() * 1e3,
        };
        (&self.frame, &self.stats)
    }

    /// The last frame.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }
}

/// Composites the environment behind a row. Hidden pixels become holes instead. Returns the number
/// of holes.
fn resolve_row(
    background: &EnvironmentBackground,
    y: u32,
    colors: &mut [[u8; 4]],
    coverages: &mut [Coverage],
) -> u64 {
    let hidden: Vec<usize> = (0..colors.len())
        .filter(|x| colors[*x][3] == HIDDEN)
        .collect();
    for &x in &hidden {
        colors[x][3] = 0;
    }
    let pixels = Pixels {
        colors: &mut *colors,
        coverages: &mut *coverages,
        depths_m: &mut [],
        inverse_depths: &mut [],
    };
    let mut holes = background.composite_row(y, pixels);
    let [r, g, b] = background.hole_color_srgb;
    for x in hidden {
        holes += u64::from(!coverages[x].is_hole());
        (colors[x], coverages[x]) = ([r, g, b, 255], Coverage::HOLE);
    }
    holes
}

/// Draws some rows of a frame: straight colours, with alpha 255 in covered pixels and [`HIDDEN`] in
/// hidden ones. Returns the number of layers times pixels.
fn draw_band(
    plan: &LumigraphPlan,
    lumigraph: &Lumigraph,
    rows: &Range<usize>,
    width: usize,
    colors: &mut [[u8; 4]],
    level: SimdLevel,
) -> u64 {
    let mut layer_pixels = 0;
    for start in (0..width).step_by(BLOCK_COLUMNS) {
        let columns = start..(start + BLOCK_COLUMNS).min(width);
        let batches =
            |radius: usize| plan.visible_layers(&lumigraph.cells, &columns, rows, radius, level);
        let mut draw = |batches: &[Batch], pass: Pass| {
            let block = FrameBlock {
                lumigraph,
                plan,
                batches,
                columns: columns.clone(),
                rows: rows.clone(),
                width,
            };
            kernel::draw(&block, pass, colors, level)
        };
        let cell_layers = batches(0);
        let layers: usize = cell_layers.iter().map(|batch| batch.layers.len()).sum();
        layer_pixels += (layers * columns.len() * rows.len()) as u64;
        if draw(&cell_layers, Pass::First) {
            draw(
                &batches(SEARCH_RADIUS as usize),
                Pass::OtherCells(&plan.steps),
            );
        }
    }
    layer_pixels
}
