//! From a packed cube LDI to a frame: six faces and two segments in occlusion-compatible order, the incremental warp,
//! splats, and the environment under what they leave open (inventory S17 to S23, C3, C3b, C8 to C10, C12, C15, C17).
//!
//! A frame is drawn in bands of rows ([`band`]), each by one thread, from first to last: clipped segments and blocks
//! (`clip`), one traversal that yields depth pixels in drawing order, in batches of one row (`traverse`), a warp kernel that makes
//! splats of a batch (`kernel`), a canvas ([`crate::splat`]) that draws them, the environment. A band's canvas stays in the
//! cache, no thread waits for another, and every pixel sees the same splats in the same order whatever the bands are: any
//! number of threads gives the same frame, bit for bit. The price is that a depth pixel near the border of two bands is
//! warped for both.

mod band;
mod clip;
pub(crate) mod inspect;
mod kernel;
pub mod oracle;
pub(crate) mod order;
pub(crate) mod transfer;
pub(crate) mod traverse;

pub(crate) use traverse::BATCH_CAPACITY;

use crate::capture::Camera;
use crate::frame::Frame;
use crate::ldi::MAX_FACE_SIZE_PX;
use crate::ldi::accumulate::DepthBins;
use crate::packed::PackedCube;
use crate::splat::SplatKernel;
use crate::splat::size::{PaperSize, TangentTable};
use crate::splat::surface::SurfaceCanvas;
use band::{BandPixels, Worker};
use clip::Band;
use fearless_simd::Level;
use order::{EyeInFace, LayerOrder};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use transfer::Transfer;

/// How frames are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RenderSettings {
    /// The footprints.
    pub kernel: SplatKernel,
    /// Colour of holes, sRGB.
    pub hole_color_srgb: [u8; 3],
    /// Warps every depth pixel, also those that clipping knows to be outside: the same frame, slower. For tests and reports.
    pub unclipped: bool,
    /// Rows of a band, or 0 for the default. Any number gives the same frame.
    pub band_rows: u32,
    /// Fills [`Frame::depth_m`].
    pub depth: bool,
}

/// What a frame took. Times of the stages are summed over threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FrameStats {
    /// Depth pixels that reached the inner loop, once for each band that they might have touched.
    pub depth_pixels_in: u64,
    /// Of these, behind the eye or outside the band.
    pub behind_or_outside: u64,
    /// Of these, drawn.
    pub splatted: u64,
    /// Drawn with footprints of about 1, 3, 5, and 7 or more pixels.
    pub by_footprint: [u64; 4],
    /// Pixels of which nothing is known.
    pub hole_pixels: u64,
    /// Whole frame, by the clock, ms.
    pub frame_ms: f64,
    /// Drawing order, tables, clipping and clearing, ms.
    pub clear_ms: f64,
    /// Warp and splats, ms.
    pub warp_ms: f64,
    /// Canvas to frame, with the environment, ms.
    pub finish_ms: f64,
    /// Time of the slowest thread over the mean of those that took part.
    pub imbalance: f64,
}

impl FrameStats {
    /// Adds what one thread did.
    fn absorb(&mut self, other: &Self) {
        self.depth_pixels_in += other.depth_pixels_in;
        self.behind_or_outside += other.behind_or_outside;
        self.splatted += other.splatted;
        self.by_footprint.iter_mut().zip(other.by_footprint).for_each(|(sum, count)| *sum += count);
        self.hole_pixels += other.hole_pixels;
        self.clear_ms += other.clear_ms;
        self.warp_ms += other.warp_ms;
        self.finish_ms += other.finish_ms;
    }

    fn busy_ms(&self) -> f64 {
        self.clear_ms + self.warp_ms + self.finish_ms
    }
}

/// Rows of a band unless the settings say otherwise: 640 to 2,048 pixels of 16 bytes wide, a band stays in the level 2 cache.
/// Half as many warp more depth pixels twice, twice as many leave threads idle at the end of a frame.
const BAND_ROWS: u32 = 48;

/// Draws frames; owns its buffers, and allocates only when a frame is larger than all before it or uses another kernel.
pub struct Renderer {
    frame: Frame,
    stats: FrameStats,
    order: Vec<usize>,
    plan: FramePlan,
    workers: Vec<Mutex<Worker>>,
}

impl Default for Renderer {
    fn default() -> Self {
        Self::with_level(Level::new())
    }
}

/// What all bands of a frame share.
pub(crate) struct FramePlan {
    level: Level,
    kernel: SplatKernel,
    unclipped: bool,
    face_px: u32,
    /// In drawing order.
    segments: Vec<SegmentPlan>,
    /// One for each of `segments`, if the kernel is the paper's.
    paper_sizes: Vec<PaperSize>,
    tangent_table: TangentTable,
    tolerance: f32,
    bin: f32,
}

/// A segment, as the frame's camera sees it.
pub(crate) struct SegmentPlan {
    /// Which of the cube's.
    index: usize,
    transfer: Transfer,
    eye: EyeInFace,
    layers: LayerOrder,
}

impl Renderer {
    /// A renderer that has drawn nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// A renderer that uses one SIMD level of this machine. All give the same frame.
    pub fn with_level(level: Level) -> Self {
        Self {
            frame: Frame::default(),
            stats: FrameStats::default(),
            order: Vec::new(),
            plan: FramePlan::new(level),
            workers: Vec::new(),
        }
    }

    /// The last frame that was drawn.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Draws what `camera` sees, on the current rayon thread pool. The cube should be valid ([`PackedCube::validate`]); of
    /// one that is not, rows whose tables point nowhere are left out.
    pub fn render(&mut self, cube: &PackedCube, camera: &Camera, settings: &RenderSettings) -> (&Frame, &FrameStats) {
        let started = Instant::now();
        let (width, height) = (camera.width(), camera.height());
        self.frame.reset(width, height, settings.hole_color_srgb);
        order::segment_order(&cube.segments, camera.eye() - cube.info.centre, &mut self.order);
        self.plan.prepare(cube, camera, settings, &self.order);
        let threads = rayon::current_num_threads();
        self.workers.resize_with(threads.max(self.workers.len()), Mutex::default);
        for worker in &mut self.workers {
            worker.get_mut().unwrap_or_else(PoisonError::into_inner).stats = FrameStats::default();
        }
        let prepared_ms = started.elapsed().as_secs_f64() * 1e3;

        let (plan, workers) = (&self.plan, &self.workers);
        let rows = if settings.band_rows > 0 { settings.band_rows } else { BAND_ROWS };
        let pixels = width as usize * rows.min(height) as usize;
        let draw_band = |i: usize, pixels: BandPixels| {
            let start = i as u32 * rows;
            let principal_px = camera.principal_px();
            let band = Band { width, height, principal_px, rows: start..start.saturating_add(rows).min(height) };
            // No other thread of the pool uses this one's worker, so that the lock is free.
            let worker = &workers[rayon::current_thread_index().unwrap_or(0) % workers.len()];
            worker.lock().unwrap_or_else(PoisonError::into_inner).draw(plan, cube, camera, &band, pixels);
        };
        let Frame { color, coverage, depth_m, .. } = &mut self.frame;
        let bands = color.par_chunks_mut(pixels).zip(coverage.par_chunks_mut(pixels));
        if settings.depth {
            depth_m.resize(width as usize * height as usize, f32::INFINITY);
            let bands = bands.zip(depth_m.par_chunks_mut(pixels)).enumerate().with_max_len(1);
            bands.for_each(|(i, ((colors, coverages), depths_m))| {
                draw_band(i, BandPixels { colors, coverages, depths_m });
            });
        } else {
            bands.enumerate().with_max_len(1).for_each(|(i, (colors, coverages))| {
                draw_band(i, BandPixels { colors, coverages, depths_m: &mut [] });
            });
        }

        self.stats = FrameStats { clear_ms: prepared_ms, ..FrameStats::default() };
        let (mut slowest, mut sum, mut busy) = (0.0f64, 0.0, 0);
        for worker in &mut self.workers {
            let of_worker = &worker.get_mut().unwrap_or_else(PoisonError::into_inner).stats;
            self.stats.absorb(of_worker);
            slowest = slowest.max(of_worker.busy_ms());
            sum += of_worker.busy_ms();
            busy += u32::from(of_worker.busy_ms() > 0.0);
        }
        self.stats.imbalance = if sum > 0.0 { slowest * f64::from(busy) / sum } else { 1.0 };
        self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, &self.stats)
    }
}

impl FramePlan {
    fn new(level: Level) -> Self {
        Self {
            level,
            kernel: SplatKernel::default(),
            unclipped: false,
            face_px: 0,
            segments: Vec::new(),
            paper_sizes: Vec::new(),
            tangent_table: TangentTable::default(),
            tolerance: 0.0,
            bin: 0.0,
        }
    }

    fn prepare(&mut self, cube: &PackedCube, camera: &Camera, settings: &RenderSettings, order: &[usize]) {
        let face_px = cube.face_size_px.min(MAX_FACE_SIZE_PX);
        let eye_from_centre = camera.eye() - cube.info.centre;
        (self.kernel, self.unclipped, self.face_px) = (settings.kernel, settings.unclipped, face_px);
        self.segments.clear();
        self.segments.extend(order.iter().map(|&index| {
            let segment = &cube.segments[index];
            let eye = EyeInFace::new(eye_from_centre, segment.face, face_px);
            let transfer = Transfer::new(camera, eye_from_centre, segment.face, face_px);
            SegmentPlan { index, transfer, layers: eye.layer_order(segment), eye }
        }));
        match settings.kernel {
            SplatKernel::Tent => {
                self.tolerance = SurfaceCanvas::tolerance(face_px);
                self.bin = DepthBins::new(cube.info.half_size_m, face_px).inverse_depth(1.0) as f32;
                self.tangent_table.refill(cube.layout, face_px, 1.0, TENT_MIN_RADIUS_PX);
            }
            // A rectangle is as wide as the spacing; 15 % more closes the cracks that quantised normals open.
            SplatKernel::Plus | SplatKernel::Square2 | SplatKernel::Square3 => {}
            SplatKernel::Opaque => self.tangent_table.refill(cube.layout, face_px, 0.575, 0.5),
            SplatKernel::Paper => {
                self.paper_sizes.resize_with(order.len().max(self.paper_sizes.len()), PaperSize::new);
                for (&index, size) in order.iter().zip(&mut self.paper_sizes) {
                    size.refill(camera, &cube.segments[index], cube.layout, face_px);
                }
            }
        }
    }
}

/// The least radius of a tent, px: of 0.5, 0.6, 0.75 and 1, the best off the centre of `builtin:tree` and
/// `builtin:interior` (0.6: up to 0.4 and 0.7 dB less; 1 lost 0.7 dB to blur at f2/f1 = 0.5).
const TENT_MIN_RADIUS_PX: f32 = 0.75;
