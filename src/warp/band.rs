//! One band of a frame, drawn by one thread from its first splat to its last pixel.

use super::clip::{self, Band, BlockClip};
use super::kernel::SegmentWarp;
use super::traverse::{self, Batch, Part};
use super::{FramePlan, FrameStats, SegmentPlan};
use crate::capture::Camera;
use crate::frame::Coverage;
use crate::ldi::Environment;
use crate::packed::{PackedCube, PackedSegment};
use crate::splat::depth::DepthCanvas;
use crate::splat::linear::LinearLight;
use crate::splat::over::{OverCanvas, Shape};
use crate::splat::size::{FixedSize, Size, TangentSize};
use crate::splat::surface::SurfaceCanvas;
use crate::splat::{Canvas, SplatKernel, Splats};
use fearless_simd::{Level, Simd, dispatch};
use glam::Vec3;
use std::time::Instant;

/// The buffers of a thread.
pub(super) struct Worker {
    pub(super) stats: FrameStats,
    strokes: Strokes,
    over: OverCanvas,
    surfaces: SurfaceCanvas,
}

/// The pixels of a band, row by row.
pub(super) struct BandPixels<'a> {
    /// They hold the hole colour.
    pub(super) colors: &'a mut [[u8; 4]],
    /// They say that all are holes.
    pub(super) coverages: &'a mut [Coverage],
    /// Eye depths, infinite; or none if nobody wants them.
    pub(super) depths_m: &'a mut [f32],
}

/// What lies between the LDI and a canvas.
struct Strokes {
    batch: Box<Batch>,
    splats: Box<Splats>,
    visible: Vec<bool>,
    depth: DepthCanvas,
}

impl Default for Worker {
    fn default() -> Self {
        let strokes = Strokes {
            batch: Box::new(Batch::new()),
            splats: Box::new(Splats::new()),
            visible: Vec::new(),
            depth: DepthCanvas::default(),
        };
        Self { stats: FrameStats::default(), strokes, over: OverCanvas::default(), surfaces: SurfaceCanvas::default() }
    }
}

impl Worker {
    /// Draws a band on its pixels.
    pub(super) fn draw(
        &mut self,
        plan: &FramePlan,
        cube: &PackedCube,
        camera: &Camera,
        band: &Band,
        pixels: BandPixels,
    ) {
        let Self { stats, strokes, over, surfaces } = self;
        let mut pass = Pass { plan, cube, camera, band, stats, strokes, wants_depth: !pixels.depths_m.is_empty() };
        match plan.kernel {
            SplatKernel::Tent => {
                (surfaces.tolerance, surfaces.bin) = (plan.tolerance, plan.bin);
                pass.draw(surfaces, pixels);
            }
            kernel => {
                over.shape = match kernel {
                    SplatKernel::Paper => Shape::Soft,
                    SplatKernel::Plus => Shape::Plus,
                    _ => Shape::Rectangle,
                };
                pass.draw(over, pixels);
            }
        }
    }
}

/// One band on its way to a canvas.
struct Pass<'a> {
    plan: &'a FramePlan,
    cube: &'a PackedCube,
    camera: &'a Camera,
    band: &'a Band,
    stats: &'a mut FrameStats,
    strokes: &'a mut Strokes,
    wants_depth: bool,
}

impl Pass<'_> {
    fn draw(&mut self, canvas: &mut impl Canvas, mut pixels: BandPixels) {
        let started = Instant::now();
        canvas.clear(self.band.width, self.band.rows.clone());
        if self.wants_depth {
            self.strokes.depth.clear(self.band.width, self.band.rows.clone());
        }
        let cleared = Instant::now();
        for (i, of_frame) in self.plan.segments.iter().enumerate() {
            let segment = &self.cube.segments[of_frame.index];
            let paper = self.plan.paper_sizes.get(i).filter(|_| self.plan.kernel == SplatKernel::Paper);
            match (paper, self.plan.kernel.stamp_radius_px()) {
                (Some(size), _) => self.draw_segment(of_frame, segment, size, canvas),
                (None, Some(radius_px)) => self.draw_segment(of_frame, segment, &FixedSize { radius_px }, canvas),
                (None, None) => {
                    let size = TangentSize::new(&self.plan.tangent_table, &of_frame.transfer);
                    self.draw_segment(of_frame, segment, &size, canvas);
                }
            }
        }
        let drawn = Instant::now();
        self.stats.hole_pixels +=
            finish(self.plan.level, canvas, &self.cube.environment, self.camera, self.band, &mut pixels);
        let drawn_depths = pixels.coverages.iter().zip(self.strokes.depth.inverse_depths());
        for (depth_m, (coverage, &inverse_depth)) in pixels.depths_m.iter_mut().zip(drawn_depths) {
            if coverage.splat_share() > 0 && inverse_depth > 0.0 {
                *depth_m = 1.0 / inverse_depth;
            }
        }
        self.stats.clear_ms += (cleared - started).as_secs_f64() * 1e3;
        self.stats.warp_ms += (drawn - cleared).as_secs_f64() * 1e3;
        self.stats.finish_ms += drawn.elapsed().as_secs_f64() * 1e3;
    }

    fn draw_segment<S: Size>(
        &mut self,
        of_frame: &SegmentPlan,
        segment: &PackedSegment,
        size: &S,
        canvas: &mut impl Canvas,
    ) {
        let (band, face_px, transfer) = (self.band, self.plan.face_px, &of_frame.transfer);
        let Strokes { batch, splats, visible, depth } = &mut *self.strokes;
        let whole = Part::whole(segment, face_px);
        let rectangle = match self.plan.unclipped {
            true => Some(whole),
            false => clip::rectangle(transfer, segment, band, f64::from(S::MAX_RADIUS_PX))
                .map(|found| [0, 1].map(|i| found[i].start.min(whole[i].end)..found[i].end.min(whole[i].end))),
        };
        let Some(rectangle) = rectangle else { return };
        if self.plan.unclipped {
            visible.clear();
            visible.resize(Part::block_count(&rectangle), true);
        } else {
            BlockClip { transfer, segment, band, face_px }.blocks(&rectangle, size, visible);
        }
        let [columns, rows] = rectangle;
        let part = Part { segment, columns, rows, visible };
        let warp = SegmentWarp::new(transfer, segment, band, self.plan.level);
        let (stats, level, wants_depth) = (&mut *self.stats, self.plan.level, self.wants_depth);
        let own = self.plan.kernel.own_share();
        traverse::traverse(&part, &of_frame.eye, of_frame.layers, batch, &mut |batch| {
            warp.warp(batch, size, splats);
            canvas.draw(splats, level);
            if wants_depth {
                depth.draw(splats, own);
            }
            stats.depth_pixels_in += batch.len as u64;
            stats.splatted += splats.len as u64;
            stats.behind_or_outside += (batch.len - splats.len) as u64;
            stats.by_footprint.iter_mut().zip(splats.by_footprint).for_each(|(sum, count)| *sum += count);
        });
    }
}

/// Writes a canvas to the band's pixels, over the environment where it shows, and returns how many are holes.
fn finish(
    level: Level,
    canvas: &impl Canvas,
    environment: &Environment,
    camera: &Camera,
    band: &Band,
    pixels: &mut BandPixels,
) -> u64 {
    let width = band.width as usize;
    let rows = pixels.colors.chunks_mut(width).zip(pixels.coverages.chunks_mut(width));
    let mut holes = 0;
    for ((row, y), (colors, coverages)) in band.rows.clone().enumerate().zip(rows) {
        let start = camera.direction(0.5, f64::from(y) + 0.5);
        let step = camera.direction(1.5, f64::from(y) + 0.5) - start;
        let chunks = colors.chunks_mut(CHUNK).zip(coverages.chunks_mut(CHUNK)).zip((0..).step_by(CHUNK));
        for (pixels, first) in chunks {
            let directions = [start + step * first as f64, step].map(|v| v.as_vec3());
            dispatch!(level, simd => {
                holes += finish_chunk(simd, canvas, environment, directions, pixels, [first, row]);
            });
        }
    }
    holes
}

/// Pixels that are finished at a time.
const CHUNK: usize = 16;

/// Finishes the [`CHUNK`] pixels from (column, row) on, or as many as there are.
#[inline(always)]
fn finish_chunk<S: Simd>(
    simd: S,
    canvas: &impl Canvas,
    environment: &Environment,
    [start, step]: [Vec3; 2],
    (colors, coverages): (&mut [[u8; 4]], &mut [Coverage]),
    [column, row]: [usize; 2],
) -> u64 {
    let mut all_share = 255;
    for (i, (color, coverage)) in colors.iter_mut().zip(&mut *coverages).enumerate() {
        let ([r, g, b], share) = canvas.pixel(column + i, row);
        all_share &= share;
        if share > 0 {
            (*color, *coverage) = ([r, g, b, 255], Coverage::of_splats(share));
        }
    }
    if all_share == 255 {
        return 0;
    }
    let (light, mut holes) = (LinearLight::tables(), 0);
    let seen = environment.sample_sixteen(simd, start, step);
    for ((color, coverage), seen) in colors.iter_mut().zip(coverages).zip(seen) {
        let Some(seen) = seen else {
            holes += u64::from(coverage.is_hole());
            continue;
        };
        match coverage.splat_share() {
            255 => {}
            0 => (*color, *coverage) = ([seen[0], seen[1], seen[2], 255], Coverage::ENVIRONMENT),
            share => {
                let [r, g, b, _] = *color;
                let [r, g, b] = light.mix([[r, g, b], seen], [u32::from(share), u32::from(255 - share)]);
                *color = [r, g, b, 255];
            }
        }
    }
    holes
}
