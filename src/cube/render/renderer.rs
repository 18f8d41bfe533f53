//! Rendering of frames in bands of rows, on all threads (docs/decisions/0053).

use crate::pack::{CubeLdi, UnquantisedCube, UnquantisedDepthPixel};
use crate::render::band::BandRenderer;
use crate::render::planes::DepthLayer;
use crate::render::resolve::composite_environment::{Pixels, depth_chunks};
use crate::render::resolve::holes::HoleFiller;
use crate::render::settings::{FrameStats, Imbalance, RenderSettings};
use crate::render::setup::clip::Band;
use crate::render::setup::plan::FramePlan;
use fearless_simd::Level;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::simd;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Returns the default rows of a band: [`BANDS_PER_THREAD`] bands per thread, at most 192 rows.
/// Samples that touch two bands are warped twice (docs/decisions/0053).
pub(super) fn default_band_rows(height: u32, threads: usize) -> u32 {
    let bands = BANDS_PER_THREAD
        .saturating_mul(u32::try_from(threads).unwrap_or(u32::MAX))
        .max(1);
    height.div_ceil(bands).next_multiple_of(16).min(192)
}

/// Bands per thread; with fewer, threads are idle at the end of a frame.
const BANDS_PER_THREAD: u32 = 4;

/// Renders frames; owns its buffers, and allocates only when a frame is larger than all before it
/// or uses another kernel.
pub struct Renderer {
    frame: Frame,
    stats: FrameStats,
    pub(super) plan: FramePlan,
    /// One for each thread.
    bands: Vec<Mutex<BandRenderer>>,
    filler: HoleFiller,
}

impl Default for Renderer {
    fn default() -> Self {
        Self::with_level(simd::level())
    }
}

/// Input of a frame: packed cube, optional unquantised samples, optional inserted content.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) cube: &'a CubeLdi,
    /// Depth pixels of each segment that replace the packed ones.
    pub(super) exact: Option<&'a [Vec<UnquantisedDepthPixel>]>,
    pub(super) inserted: Option<&'a DepthLayer<'a>>,
}

impl<'a> Source<'a> {
    fn from_cube(cube: &'a CubeLdi) -> Self {
        Self {
            cube,
            exact: None,
            inserted: None,
        }
    }
}

impl Renderer {
    /// Creates a renderer.
    pub fn new() -> Self {
        Self::default()
    }

    /// Creates a renderer that uses a SIMD level of this machine. All levels give the same frame.
    pub fn with_level(level: Level) -> Self {
        Self {
            frame: Frame::default(),
            stats: FrameStats::default(),
            plan: FramePlan::with_level(level),
            bands: Vec::new(),
            filler: HoleFiller::default(),
        }
    }

    /// Returns the last frame.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Renders a frame of `camera`, on the current rayon thread pool. The cube should be valid
    /// ([`CubeLdi::validate`]); rows with damaged tables are skipped.
    pub fn render(&mut self, cube: &CubeLdi, camera: &Camera, settings: &RenderSettings) -> &Frame {
        self.render_with_stats(cube, camera, settings).0
    }

    /// Renders a frame and returns its statistics.
    pub fn render_with_stats(
        &mut self,
        cube: &CubeLdi,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, &FrameStats) {
        self.render_source(Source::from_cube(cube), camera, settings)
    }

    /// Renders a frame with default settings, and returns 1 / eye depth of each pixel's front
    /// surface, 1/m, however little of the pixel it covers; 0 where there is none.
    pub fn render_with_fronts(&mut self, cube: &CubeLdi, camera: &Camera) -> (&Frame, &[f32]) {
        self.plan.reads_all_depths = true;
        self.render_source(Source::from_cube(cube), camera, &RenderSettings::default());
        self.plan.reads_all_depths = false;
        (&self.frame, self.filler.inverse_depths())
    }

    /// Renders a frame with inserted content, composited by the depth of every pixel: samples and
    /// plane textures hide it and are hidden, and blend with it where they cover a pixel partly.
    /// With kernels that do not compare depths, samples blend with it only where they are in front.
    pub fn render_with_layer(
        &mut self,
        cube: &CubeLdi,
        inserted: &DepthLayer,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, &FrameStats) {
        let source = Source {
            inserted: Some(inserted),
            ..Source::from_cube(cube)
        };
        self.render_source(source, camera, settings)
    }

    /// Renders a frame from unquantised depth pixels, to measure the effects of packing.
    pub fn render_exact(
        &mut self,
        exact: &UnquantisedCube,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, &FrameStats) {
        let source = Source {
            exact: Some(&exact.depth_pixels),
            ..Source::from_cube(&exact.cube)
        };
        self.render_source(source, camera, settings)
    }

    fn render_source(
        &mut self,
        source: Source,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, &FrameStats) {
        let started = Instant::now();
        self.frame
            .resize(camera.width(), camera.height(), settings.depth);
        self.plan.prepare(source.cube, camera, settings);
        let prepared_ms = started.elapsed().as_secs_f64() * 1e3;
        let fills_holes = !settings.keep_holes && settings.kernel.compares_depths();
        self.filler.prepare(if fills_holes {
            self.frame.color.len()
        } else {
            0
        });
        self.stats = self.render_bands(source, camera);
        if fills_holes && self.stats.hole_pixels > 0 {
            let started = Instant::now();
            self.filler.fill(&mut self.frame);
            self.stats.finish_ms += started.elapsed().as_secs_f64() * 1e3;
        }
        self.stats.clear_ms += prepared_ms;
        self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, &self.stats)
    }

    fn render_bands(&mut self, source: Source, camera: &Camera) -> FrameStats {
        let width = camera.width();
        let height = camera.height();
        let threads = rayon::current_num_threads();
        self.bands
            .resize_with(threads.max(self.bands.len()), Mutex::default);
        for band in &mut self.bands {
            band.get_mut().unwrap_or_else(PoisonError::into_inner).stats = FrameStats::default();
        }
        let plan = &self.plan;
        let renderers = &self.bands;
        let rows = match plan.settings.band_rows {
            0 => default_band_rows(height, threads),
            rows => rows,
        };
        let band_pixels = width as usize * rows.min(height) as usize;
        let render_band = |i: usize, pixels: Pixels| {
            let start = i as u32 * rows;
            let band = Band::new(camera, start..start.saturating_add(rows).min(height));
            // No other thread of the pool uses this one's renderer, so that the lock is free.
            let index = rayon::current_thread_index().unwrap_or(0) % renderers.len();
            renderers[index]
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .render(plan, source, camera, &band, pixels);
        };
        let Frame {
            color,
            coverage,
            depth_m,
            ..
        } = &mut self.frame;
        let count = color.len().div_ceil(band_pixels);
        let inverse_depths = depth_chunks(self.filler.inverse_depths(), band_pixels, count);
        let depths = depth_chunks(depth_m, band_pixels, count).zip(inverse_depths);
        color
            .par_chunks_mut(band_pixels)
            .zip(coverage.par_chunks_mut(band_pixels))
            .zip(depths)
            .enumerate()
            .with_max_len(1)
            .for_each(|(i, ((colors, coverages), (depths_m, inverse_depths)))| {
                render_band(
                    i,
                    Pixels {
                        colors,
                        coverages,
                        depths_m,
                        inverse_depths,
                    },
                );
            });

        let mut stats = FrameStats::default();
        let mut imbalance = Imbalance::default();
        for band in &mut self.bands {
            let band = band.get_mut().unwrap_or_else(PoisonError::into_inner);
            stats.add(&band.stats);
            imbalance.add(band.stats.busy_ms());
        }
        stats.imbalance = imbalance.ratio();
        stats
    }
}
