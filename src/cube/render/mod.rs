//! From a packed cube LDI to a frame: six faces and two segments in occlusion-compatible order, the incremental warp,
//! splats, and the environment under what they leave open (S17 to S23, C3, C3b, C8 to C10, C12, C15, C17).
//!
//! A frame is drawn in bands of rows ([`band`]), each by one thread, from first to last: clipped segments and blocks
//! (`clip`), one traversal that yields depth pixels in drawing order, in batches of one row (`traverse`), a warp kernel that makes
//! splats of a batch (`kernel`), a canvas ([`splat`]) that draws them, the environment (`finish`). A band's canvas stays in the
//! cache, no thread waits for another, and every pixel sees the same splats in the same order whatever the bands are (of
//! tents, of which no order shows, in that of memory): any number of threads gives the same frame, bit for bit. The price is that a depth pixel near the border of two bands is
//! warped for both.
//!
//! The papers' way to use many threads, fragments between epipolar lines, is there too ([`Parallel::Fragments`],
//! `epipolar`, `fragments` and `assemble`); it gives the same bits.
//!
//! From a warped depth pixel to frame pixels:
//!
//! * [`splat`]: which footprints there are, splats on their way to a canvas.
//! * `size`: the two ways to know a footprint's size, the paper's table and the tangent plane.
//! * `over`: the canvas of the kernels that blend each footprint *over* what is there.
//! * `tent`: what splats weigh in the pixels around them.
//! * `surface`: the canvas that averages the footprints of one surface before it blends surfaces.
//! * `ellipse`: the same with elliptical Gaussians in floating point.
//! * `linear`: blending in linear light.
//! * `depth`: beside any canvas, how far what it shows is.
//! * `touched`: instead of a canvas, how often and how large pixels are drawn.

pub mod canvas;
pub mod footprint;
mod parallel;
pub(crate) mod planes;
pub mod reference;
pub mod resolve;
pub mod setup;
#[cfg(test)]
mod tests;
mod traverse;
mod warp;

pub(crate) use crate::render::parallel::epipolar::Spans;
pub use crate::render::parallel::fragments::MAX_FRAGMENTS;
pub use crate::render::reference::count::ClipCounts;
pub(crate) use crate::render::traverse::batches::BATCH_CAPACITY;

use crate::model::depth_bins::DepthBins;
use crate::model::validate::MAX_FACE_SIZE_PX;
use crate::pack::{ExactCube, ExactDepthPixel, PackedCube};
use crate::render::canvas::surface::SurfaceCanvas;
use crate::render::footprint::size::{EllipseSize, PaperSize, TangentTable};
use crate::render::footprint::splat::SplatKernel;
use crate::render::parallel::band::Worker;
use crate::render::parallel::fragments::Fragments;
use crate::render::resolve::fill::Filler;
use crate::render::resolve::finish::{Pixels, depth_pieces};
use crate::render::setup::clip::Band;
use crate::render::setup::order::{EyeInFace, LayerOrder};
use crate::render::setup::transfer::Transfer;
use fearless_simd::Level;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::simd;
use planes::PlanesInView;
pub use planes::Standing;
use rayon::prelude::*;
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

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
    /// How threads share a frame. Every way gives the same frame.
    pub parallel: Parallel,
    /// Leaves small holes open that are otherwise filled from what lies behind their rims (but not by kernels that blend without
    /// depths: [`SplatKernel::Paper`] and its like).
    pub keep_holes: bool,
}

/// How threads share the work of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Parallel {
    /// Bands of rows of the frame.
    #[default]
    Bands,
    /// As many fragments of the LDI between epipolar lines, at most [`MAX_FRAGMENTS`], or 0 for one a thread (P5,
    /// P6, C16); see there for what it costs.
    Fragments(u32),
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
    /// Pixels of which nothing is known, filled or not.
    pub hole_pixels: u64,
    /// Whole frame, by the clock, ms.
    pub frame_ms: f64,
    /// Drawing order, tables, clipping and clearing, ms.
    pub clear_ms: f64,
    /// Warp and splats, ms.
    pub warp_ms: f64,
    /// Canvas to frame, with the environment, ms.
    pub finish_ms: f64,
    /// Time of the slowest thread over the mean of those that took part; with [`Parallel::Fragments`], of the slowest
    /// fragment over the mean, without the strips between them.
    pub imbalance: f64,
    /// With [`Parallel::Fragments`], pixels near a boundary, drawn in the second pass; else 0.
    pub redone_pixels: u64,
    /// Depth pixels of the second pass, in the extended buffer zones; also in [`Self::depth_pixels_in`].
    pub redone_depth_pixels: u64,
    /// With [`Parallel::Fragments`], depth pixels of the largest fragment; else 0.
    pub largest_fragment: u64,
}

impl FrameStats {
    /// Adds what one thread did.
    fn absorb(&mut self, other: &Self) {
        self.depth_pixels_in += other.depth_pixels_in;
        self.behind_or_outside += other.behind_or_outside;
        self.splatted += other.splatted;
        self.by_footprint
            .iter_mut()
            .zip(other.by_footprint)
            .for_each(|(sum, count)| *sum += count);
        self.hole_pixels += other.hole_pixels;
        self.clear_ms += other.clear_ms;
        self.warp_ms += other.warp_ms;
        self.finish_ms += other.finish_ms;
        self.redone_pixels += other.redone_pixels;
        self.redone_depth_pixels += other.redone_depth_pixels;
    }

    fn busy_ms(&self) -> f64 {
        self.clear_ms + self.warp_ms + self.finish_ms
    }
}

/// Rows of a band unless the settings say otherwise: so many that each thread has [`BANDS_A_THREAD`] to even out, but at most
/// 192. What reaches into two bands is warped twice (docs/decisions/0053).
fn default_band_rows(height: u32, threads: usize) -> u32 {
    let bands = BANDS_A_THREAD
        .saturating_mul(u32::try_from(threads).unwrap_or(u32::MAX))
        .max(1);
    height.div_ceil(bands).next_multiple_of(16).min(192)
}

/// With fewer, threads are idle at the end of a frame.
const BANDS_A_THREAD: u32 = 4;

/// Draws frames; owns its buffers, and allocates only when a frame is larger than all before it or uses another kernel.
pub struct Renderer {
    frame: Frame,
    stats: FrameStats,
    order: Vec<usize>,
    plan: FramePlan,
    workers: Vec<Mutex<Worker>>,
    fragments: Fragments,
    filler: Filler,
}

impl Default for Renderer {
    fn default() -> Self {
        Self::with_level(simd::level())
    }
}

/// What all bands of a frame share.
pub(crate) struct FramePlan {
    level: Level,
    kernel: SplatKernel,
    unclipped: bool,
    depth: bool,
    hole_color_srgb: [u8; 3],
    /// Whether inverse depths are told of all pixels, and not only of those that holes may be near.
    tells_all: bool,
    face_px: u32,
    /// In drawing order.
    segments: Vec<SegmentPlan>,
    /// One for each of `segments`, if the kernel is the paper's.
    paper_sizes: Vec<PaperSize>,
    tangent_table: TangentTable,
    tolerance: f32,
    bin: f32,
    planes: PlanesInView,
}

/// What is drawn.
#[derive(Clone, Copy)]
struct Source<'a> {
    cube: &'a PackedCube,
    /// Depth pixels to draw instead of the packed ones, for each segment.
    exact: Option<&'a [Vec<ExactDepthPixel>]>,
    /// What else stands in the frame.
    standing: Option<&'a Standing<'a>>,
}

impl<'a> Source<'a> {
    fn of(cube: &'a PackedCube) -> Self {
        Self {
            cube,
            exact: None,
            standing: None,
        }
    }
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
            fragments: Fragments::default(),
            filler: Filler::default(),
        }
    }

    /// The last frame that was drawn.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Draws a frame as by default, and tells 1 / eye depth of what is in front in each pixel, however little of it shows there; 0
    /// where there is nothing.
    pub fn render_with_fronts(&mut self, cube: &PackedCube, camera: &Camera) -> (&Frame, &[f32]) {
        self.plan.tells_all = true;
        self.render_source(Source::of(cube), camera, &RenderSettings::default());
        self.plan.tells_all = false;
        (&self.frame, self.filler.inverse_depths())
    }

    /// Draws what `camera` sees, on the current rayon thread pool. The cube should be valid ([`PackedCube::validate`]); of
    /// one that is not, rows whose tables point nowhere are left out.
    pub fn render(
        &mut self,
        cube: &PackedCube,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> &Frame {
        self.render_with_stats(cube, camera, settings).0
    }

    /// The same, with what the frame took.
    pub fn render_with_stats(
        &mut self,
        cube: &PackedCube,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, &FrameStats) {
        self.render_source(Source::of(cube), camera, settings)
    }

    /// The same with what else stands in the frame, by the depth of every pixel: samples and pictures on planes hide it and are hidden, and
    /// blend with it where they cover a pixel in part. Kernels that do not compare depths have it behind the samples in front of it alone.
    pub fn render_among(
        &mut self,
        cube: &PackedCube,
        standing: &Standing,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, &FrameStats) {
        self.render_source(
            Source {
                standing: Some(standing),
                ..Source::of(cube)
            },
            camera,
            settings,
        )
    }

    /// The same from depth pixels that are not packed, to see what packing costs and gains.
    pub fn render_exact(
        &mut self,
        exact: &ExactCube,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, &FrameStats) {
        self.render_source(
            Source {
                exact: Some(&exact.depth_pixels),
                ..Source::of(&exact.cube)
            },
            camera,
            settings,
        )
    }

    fn render_source(
        &mut self,
        source: Source,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, &FrameStats) {
        let (started, cube) = (Instant::now(), source.cube);
        self.frame
            .resize(camera.width(), camera.height(), settings.depth);
        setup::order::segment_order(
            &cube.segments,
            camera.eye() - cube.info.centre,
            &mut self.order,
        );
        self.plan.prepare(cube, camera, settings, &self.order);
        let prepared_ms = started.elapsed().as_secs_f64() * 1e3;
        let fills = !settings.keep_holes && self.plan.kernel.knows_depths();
        self.filler
            .prepare(if fills { self.frame.color.len() } else { 0 });
        self.stats = match settings.parallel {
            // Pictures on planes do not belong to fragments, nor does what stands in the frame.
            _ if self.plan.planes.len() > 0 || source.standing.is_some() => {
                self.draw_bands(source, camera, settings.band_rows)
            }
            Parallel::Bands => self.draw_bands(source, camera, settings.band_rows),
            Parallel::Fragments(count) => {
                let frame = (&mut self.frame, self.filler.inverse_depths());
                self.fragments
                    .draw(&self.plan, source, camera, count, frame)
            }
        };
        if fills && self.stats.hole_pixels > 0 {
            let started = Instant::now();
            self.filler.fill(&mut self.frame);
            self.stats.finish_ms += started.elapsed().as_secs_f64() * 1e3;
        }
        self.stats.clear_ms += prepared_ms;
        self.stats.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, &self.stats)
    }

    fn draw_bands(&mut self, source: Source, camera: &Camera, band_rows: u32) -> FrameStats {
        let (width, height) = (camera.width(), camera.height());
        let threads = rayon::current_num_threads();
        self.workers
            .resize_with(threads.max(self.workers.len()), Mutex::default);
        for worker in &mut self.workers {
            worker
                .get_mut()
                .unwrap_or_else(PoisonError::into_inner)
                .stats = FrameStats::default();
        }
        let (plan, workers) = (&self.plan, &self.workers);
        let rows = if band_rows > 0 {
            band_rows
        } else {
            default_band_rows(height, threads)
        };
        let pixels = width as usize * rows.min(height) as usize;
        let draw_band = |i: usize, pixels: Pixels| {
            let start = i as u32 * rows;
            let principal_px = camera.principal_px();
            let band = Band {
                width,
                height,
                principal_px,
                rows: start..start.saturating_add(rows).min(height),
            };
            // No other thread of the pool uses this one's worker, so that the lock is free.
            let worker = &workers[rayon::current_thread_index().unwrap_or(0) % workers.len()];
            worker
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .draw(plan, source, camera, &band, pixels);
        };
        let Frame {
            color,
            coverage,
            depth_m,
            ..
        } = &mut self.frame;
        let pieces = color.len().div_ceil(pixels);
        let inverse_depths = depth_pieces(self.filler.inverse_depths(), pixels, pieces);
        let depths = depth_pieces(depth_m, pixels, pieces).zip(inverse_depths);
        let bands = color
            .par_chunks_mut(pixels)
            .zip(coverage.par_chunks_mut(pixels))
            .zip(depths);
        bands.enumerate().with_max_len(1).for_each(
            |(i, ((colors, coverages), (depths_m, inverse_depths)))| {
                draw_band(
                    i,
                    Pixels {
                        colors,
                        coverages,
                        depths_m,
                        inverse_depths,
                    },
                );
            },
        );

        let mut stats = FrameStats::default();
        let mut busy = Imbalance::default();
        for worker in &mut self.workers {
            let of_worker = &worker
                .get_mut()
                .unwrap_or_else(PoisonError::into_inner)
                .stats;
            stats.absorb(of_worker);
            busy.add(of_worker.busy_ms());
        }
        stats.imbalance = busy.ratio();
        stats
    }
}

/// The largest of some times over the mean of those that are not 0.
#[derive(Default)]
struct Imbalance {
    slowest: f64,
    sum: f64,
    count: u32,
}

impl Imbalance {
    fn add(&mut self, ms: f64) {
        self.slowest = self.slowest.max(ms);
        self.sum += ms;
        self.count += u32::from(ms > 0.0);
    }

    fn ratio(&self) -> f64 {
        if self.sum > 0.0 {
            self.slowest * f64::from(self.count) / self.sum
        } else {
            1.0
        }
    }
}

impl FramePlan {
    fn new(level: Level) -> Self {
        Self {
            level,
            kernel: SplatKernel::default(),
            unclipped: false,
            depth: false,
            hole_color_srgb: [0; 3],
            tells_all: false,
            face_px: 0,
            segments: Vec::new(),
            paper_sizes: Vec::new(),
            tangent_table: TangentTable::default(),
            tolerance: 0.0,
            bin: 0.0,
            planes: PlanesInView::default(),
        }
    }

    fn prepare(
        &mut self,
        cube: &PackedCube,
        camera: &Camera,
        settings: &RenderSettings,
        order: &[usize],
    ) {
        let face_px = cube.face_size_px.min(MAX_FACE_SIZE_PX);
        let eye_from_centre = camera.eye() - cube.info.centre;
        let kernel = settings.kernel;
        (self.kernel, self.unclipped, self.face_px) = (kernel, settings.unclipped, face_px);
        (self.depth, self.hole_color_srgb) = (settings.depth, settings.hole_color_srgb);
        self.segments.clear();
        // Seen from the centre, samples are drawn in the order in which they are stored.
        let ordered_for = if kernel.needs_order() || settings.depth {
            eye_from_centre
        } else {
            DVec3::ZERO
        };
        self.segments.extend(order.iter().map(|&index| {
            let segment = &cube.segments[index];
            let eye = EyeInFace::new(ordered_for, segment.face, face_px);
            let transfer = Transfer::new(camera, eye_from_centre, segment.face, face_px);
            SegmentPlan {
                index,
                transfer,
                layers: eye.layer_order(segment),
                eye,
            }
        }));
        self.tolerance = SurfaceCanvas::tolerance(face_px);
        self.bin = DepthBins::new(cube.info.half_size_m, face_px).inverse_depth(1.0) as f32;
        self.planes
            .prepare(&cube.planes, camera, eye_from_centre, face_px);
        match kernel {
            SplatKernel::Tent => {
                self.tangent_table
                    .refill(cube.layout, face_px, 1.0, TENT_MIN_RADIUS_PX)
            }
            SplatKernel::Ellipse => {
                self.tangent_table
                    .refill(cube.layout, face_px, EllipseSize::SCALE, 0.0)
            }
            SplatKernel::Point
            | SplatKernel::Plus
            | SplatKernel::Square2
            | SplatKernel::Square3 => {}
            // A rectangle is as wide as the spacing; 15 % more closes the cracks that quantised normals open.
            SplatKernel::Opaque => self.tangent_table.refill(cube.layout, face_px, 0.575, 0.5),
            SplatKernel::Paper => {
                self.paper_sizes
                    .resize_with(order.len().max(self.paper_sizes.len()), PaperSize::new);
                for (&index, size) in order.iter().zip(&mut self.paper_sizes) {
                    size.refill(camera, &cube.segments[index], cube.layout, face_px);
                }
            }
        }
    }
}

/// The least radius of a tent, px; less and more are both worse (docs/decisions/0048).
pub(crate) const TENT_MIN_RADIUS_PX: f32 = 0.75;
