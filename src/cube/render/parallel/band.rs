//! One band of a frame, drawn by one thread from its first splat to its last pixel.

use super::epipolar::Spans;
use crate::pack::{ExactDepthPixel, PackedCube, PackedDepthPixel, PackedSegment};
use crate::render::canvas::depth::DepthCanvas;
use crate::render::canvas::over::{OverCanvas, Shape};
use crate::render::canvas::surface::SurfaceCanvas;
use crate::render::footprint::ellipse::EllipseCanvas;
use crate::render::footprint::size::{EllipseSize, FixedSize, Size, TangentSize};
use crate::render::footprint::splat::{Canvas, SplatKernel, Splats};
use crate::render::planes::ROWS_BESIDE;
use crate::render::resolve::fill;
use crate::render::resolve::finish::{Background, Pixels};
use crate::render::setup::clip;
use crate::render::setup::clip::{Band, BlockClip};
use crate::render::traverse::batches;
use crate::render::traverse::batches::{Batch, Cut, SegmentPart, Uncut};
use crate::render::traverse::format::Format;
use crate::render::warp::batch::SegmentWarp;
use crate::render::{FramePlan, FrameStats, SegmentPlan, Source};
use headbox_core::camera::Camera;
use std::ops::Range;
use std::time::Instant;

/// The buffers of a thread.
pub(crate) struct Worker {
    pub(crate) stats: FrameStats,
    strokes: Strokes,
    pub(super) over: OverCanvas,
    pub(super) surfaces: SurfaceCanvas,
    pub(super) ellipses: EllipseCanvas,
    pub(super) depth: DepthCanvas,
}

/// What lies between the LDI and a canvas.
struct Strokes {
    batch: Box<Batch<PackedDepthPixel>>,
    /// Made when it is used.
    exact_batch: Option<Box<Batch<ExactDepthPixel>>>,
    splats: Box<Splats>,
    visible: Vec<bool>,
}

impl Default for Worker {
    fn default() -> Self {
        let strokes = Strokes {
            batch: Box::new(Batch::new()),
            exact_batch: None,
            splats: Box::new(Splats::new()),
            visible: Vec::new(),
        };
        Self {
            stats: FrameStats::default(),
            strokes,
            over: OverCanvas::default(),
            surfaces: SurfaceCanvas::default(),
            ellipses: EllipseCanvas::default(),
            depth: DepthCanvas::default(),
        }
    }
}

impl Worker {
    /// Draws a band on its pixels.
    pub(crate) fn draw(
        &mut self,
        plan: &FramePlan,
        source: Source,
        camera: &Camera,
        band: &Band,
        pixels: Pixels,
    ) {
        self.prepare(plan);
        let Self {
            stats,
            strokes,
            over,
            surfaces,
            ellipses,
            depth,
        } = self;
        let mut pass = Pass {
            plan,
            source,
            band,
            stats,
            strokes,
            depth,
        };
        match plan.kernel {
            SplatKernel::Tent => pass.draw(surfaces, camera, pixels),
            SplatKernel::Ellipse => pass.draw(ellipses, camera, pixels),
            _ => pass.draw(over, camera, pixels),
        }
    }

    /// Draws what lies in a scope on a canvas of a whole frame (`band`), to be read in the columns `spans` of each row.
    pub(super) fn draw_spans(
        &mut self,
        plan: &FramePlan,
        source: Source,
        band: &Band,
        scope: &impl Scope,
        spans: impl Fn(u32) -> Spans,
    ) {
        self.prepare(plan);
        let Self {
            stats,
            strokes,
            over,
            surfaces,
            ellipses,
            depth,
        } = self;
        let mut pass = Pass {
            plan,
            source,
            band,
            stats,
            strokes,
            depth,
        };
        match plan.kernel {
            SplatKernel::Tent => pass.draw_spans(surfaces, scope, spans),
            SplatKernel::Ellipse => pass.draw_spans(ellipses, scope, spans),
            _ => pass.draw_spans(over, scope, spans),
        }
    }

    /// Sets the canvases up for a frame.
    fn prepare(&mut self, plan: &FramePlan) {
        (self.surfaces.tolerance, self.surfaces.bin) = (plan.tolerance, plan.bin);
        (self.ellipses.tolerance, self.ellipses.bin) = (plan.tolerance, plan.bin);
        self.over.shape = match plan.kernel {
            SplatKernel::Paper => Shape::Soft,
            SplatKernel::Plus => Shape::Plus,
            SplatKernel::Point => Shape::Point,
            _ => Shape::Rectangle,
        };
    }
}

/// Which depth pixels of the segments a pass draws.
pub(crate) trait Scope {
    /// Which pixels of each row.
    type Cut<'a>: Cut
    where
        Self: 'a;

    /// The rectangle of a segment's face pixels, and in `visible` which of the blocks that it touches; `None` for
    /// nothing. `i`: the segment's place in drawing order.
    fn part<S: Size>(
        &self,
        i: usize,
        clip: &BlockClip,
        size: &S,
        visible: &mut Vec<bool>,
    ) -> Option<[Range<u32>; 2]>;

    /// The same segment's cut.
    fn cut<'a>(&'a self, i: usize, clip: BlockClip<'a>) -> Self::Cut<'a>;
}

/// All that a band can show.
pub(crate) struct Clipped {
    /// Or simply all.
    pub(crate) unclipped: bool,
}

impl Scope for Clipped {
    type Cut<'a> = Uncut;

    fn part<S: Size>(
        &self,
        _: usize,
        clip: &BlockClip,
        size: &S,
        visible: &mut Vec<bool>,
    ) -> Option<[Range<u32>; 2]> {
        let whole = batches::whole(clip.segment, clip.face_px);
        if self.unclipped {
            visible.clear();
            visible.resize(batches::block_count(&whole), true);
            return Some(whole);
        }
        let found = clip::rectangle(
            clip.transfer,
            clip.segment,
            clip.band,
            f64::from(S::MAX_RADIUS_PX),
        )?;
        let rectangle =
            [0, 1].map(|i| found[i].start.min(whole[i].end)..found[i].end.min(whole[i].end));
        clip.blocks(&rectangle, size, visible);
        Some(rectangle)
    }

    fn cut<'a>(&'a self, _: usize, _: BlockClip<'a>) -> Uncut {
        Uncut
    }
}

/// One band on its way to a canvas.
struct Pass<'a> {
    plan: &'a FramePlan,
    source: Source<'a>,
    band: &'a Band,
    stats: &'a mut FrameStats,
    strokes: &'a mut Strokes,
    depth: &'a mut DepthCanvas,
}

impl Pass<'_> {
    fn draw(&mut self, canvas: &mut dyn Canvas, camera: &Camera, mut pixels: Pixels) {
        let started = Instant::now();
        let (band, plan) = (self.band, self.plan);
        canvas.clear(band.width, band.rows.clone());
        if plan.depth {
            self.depth.clear(band.width, band.rows.clone());
        }
        canvas.ground_mut().clear();
        if plan.planes.len() > 0 || self.source.standing.is_some() {
            self.draw_ground(canvas);
        }
        let cleared = Instant::now();
        self.draw_segments(
            canvas,
            &Clipped {
                unclipped: plan.unclipped,
            },
        );
        if plan.kernel.compares_depths() {
            canvas.add_rims(plan.level);
        }
        canvas.settle(plan.level);
        if plan.depth {
            self.depth.add_rims(canvas.ground().rims());
        }
        let drawn = Instant::now();
        let background = Background::new(plan, self.source.cube, camera);
        let (inverse_depths, holes_before) = (
            std::mem::take(&mut pixels.inverse_depths),
            self.stats.hole_pixels,
        );
        for (row, (y, pixels)) in band.rows.clone().zip(pixels.rows(band.width)).enumerate() {
            canvas.resolve(row, 0, pixels.colors, plan.level);
            self.depth.resolve(row, 0, pixels.depths_m);
            self.stats.hole_pixels += background.put_under(y, pixels);
        }
        let has_holes = self.stats.hole_pixels > holes_before || plan.tells_all;
        fill::tell_rows(inverse_depths, band, has_holes, |row, to| {
            canvas.tell_depths(row, 0, to)
        });
        self.stats.clear_ms += (cleared - started).as_secs_f64() * 1e3;
        self.stats.warp_ms += (drawn - cleared).as_secs_f64() * 1e3;
        self.stats.finish_ms += drawn.elapsed().as_secs_f64() * 1e3;
    }

    /// Draws the pictures on planes and what stands in the frame, and puts them behind all that is yet to come.
    fn draw_ground(&mut self, canvas: &mut dyn Canvas) {
        let Self {
            plan, band, source, ..
        } = *self;
        let beside = if plan.depth || !plan.kernel.compares_depths() {
            ROWS_BESIDE
        } else {
            0
        };
        let rows = (band.rows.clone(), beside);
        canvas.ground_mut().draw(
            &source.cube.planes,
            &plan.planes,
            source.standing,
            rows,
            plan.tolerance,
            plan.level,
        );
        canvas.lay();
        if plan.depth {
            self.depth.lay(canvas.ground());
        }
        if !plan.kernel.compares_depths() {
            canvas.add_rims(plan.level);
        }
    }

    /// Draws what lies in a scope on a whole frame's canvas that is clean in some columns of each row.
    fn draw_spans(
        &mut self,
        canvas: &mut dyn Canvas,
        scope: &impl Scope,
        spans: impl Fn(u32) -> Spans,
    ) {
        let started = Instant::now();
        canvas.clear_spans([self.band.width, self.band.height], &spans);
        if self.plan.depth {
            self.depth
                .clear_spans([self.band.width, self.band.height], &spans);
        }
        let cleared = Instant::now();
        self.draw_segments(canvas, scope);
        canvas.settle(self.plan.level);
        self.stats.clear_ms += (cleared - started).as_secs_f64() * 1e3;
        self.stats.warp_ms += cleared.elapsed().as_secs_f64() * 1e3;
    }

    fn draw_segments(&mut self, canvas: &mut dyn Canvas, scope: &impl Scope) {
        let (plan, cube) = (self.plan, self.source.cube);
        plan.for_each_segment(
            cube,
            &mut Drawing {
                pass: self,
                canvas,
                scope,
            },
        );
    }
}

/// A pass in whose middle we are. The canvas is called once a batch, so that the call's cost does not count.
struct Drawing<'a, 'b, Sc> {
    pass: &'a mut Pass<'b>,
    canvas: &'a mut dyn Canvas,
    scope: &'a Sc,
}

impl<Sc: Scope> ForSegment for Drawing<'_, '_, Sc> {
    fn segment<S: Size>(
        &mut self,
        i: usize,
        of_frame: &SegmentPlan,
        segment: &PackedSegment,
        size: &S,
    ) {
        let Pass {
            plan, band, source, ..
        } = *self.pass;
        let Strokes {
            batch,
            exact_batch,
            splats,
            visible,
        } = &mut *self.pass.strokes;
        let clip = BlockClip {
            transfer: &of_frame.transfer,
            segment,
            band,
            face_px: plan.face_px,
        };
        let Some([columns, rows]) = self.scope.part(i, &clip, size, visible) else {
            return;
        };
        let (stats, depth, canvas) = (
            &mut *self.pass.stats,
            &mut *self.pass.depth,
            &mut *self.canvas,
        );
        let mut strokes = SegmentStrokes {
            plan,
            band,
            of_frame,
            size,
            splats,
            stats,
            depth,
            canvas,
        };
        let cut = self.scope.cut(i, clip);
        match source.exact {
            None => {
                let depth_pixels = &segment.depth_pixels;
                strokes.draw(
                    &SegmentPart {
                        segment,
                        depth_pixels,
                        columns,
                        rows,
                        visible,
                    },
                    &cut,
                    batch,
                );
            }
            Some(exact) => {
                let depth_pixels = exact.get(of_frame.index).map_or(&[][..], Vec::as_slice);
                let batch = exact_batch.get_or_insert_with(|| Box::new(Batch::new()));
                strokes.draw(
                    &SegmentPart {
                        segment,
                        depth_pixels,
                        columns,
                        rows,
                        visible,
                    },
                    &cut,
                    batch,
                );
            }
        }
    }
}

/// What draws the depth pixels of a segment, in whatever form they are.
struct SegmentStrokes<'a, S> {
    plan: &'a FramePlan,
    band: &'a Band,
    of_frame: &'a SegmentPlan,
    size: &'a S,
    splats: &'a mut Splats,
    stats: &'a mut FrameStats,
    depth: &'a mut DepthCanvas,
    canvas: &'a mut dyn Canvas,
}

impl<S: Size> SegmentStrokes<'_, S> {
    fn draw<P: Format>(&mut self, part: &SegmentPart<P>, cut: &impl Cut, batch: &mut Batch<P>) {
        let Self {
            plan,
            band,
            of_frame,
            size,
            splats,
            stats,
            depth,
            canvas,
        } = self;
        let (level, own) = (plan.level, plan.kernel.own_share());
        let warp = SegmentWarp::new(&of_frame.transfer, P::scale(part.segment), band, level);
        batches::traverse(
            part,
            cut,
            &of_frame.eye,
            of_frame.layers,
            batch,
            &mut |batch| {
                warp.warp(batch, *size, splats);
                let compares = plan.kernel.compares_depths();
                if !compares {
                    splats.retain_in_front(canvas.ground());
                }
                canvas.draw(splats, level);
                if plan.depth {
                    if compares {
                        splats.retain_in_front(canvas.ground());
                    }
                    depth.draw(splats, own, canvas.ground());
                }
                stats.depth_pixels_in += batch.len as u64;
                stats.splatted += splats.len as u64;
                stats.behind_or_outside += (batch.len - splats.len) as u64;
                stats
                    .by_footprint
                    .iter_mut()
                    .zip(splats.by_footprint)
                    .for_each(|(sum, count)| *sum += count);
            },
        );
    }
}

/// Something that is done to every segment, in drawing order, with the kernel's way to know sizes.
pub(crate) trait ForSegment {
    /// Does it to the `i`th.
    fn segment<S: Size>(
        &mut self,
        i: usize,
        of_frame: &SegmentPlan,
        segment: &PackedSegment,
        size: &S,
    );
}

impl FramePlan {
    pub(crate) fn for_each_segment(&self, cube: &PackedCube, visitor: &mut impl ForSegment) {
        for (i, of_frame) in self.segments.iter().enumerate() {
            let segment = &cube.segments[of_frame.index];
            let paper = self
                .paper_sizes
                .get(i)
                .filter(|_| self.kernel == SplatKernel::Paper);
            match (paper, self.kernel.stamp_radius_px()) {
                (Some(size), _) => visitor.segment(i, of_frame, segment, size),
                (None, Some(radius_px)) => {
                    visitor.segment(i, of_frame, segment, &FixedSize { radius_px })
                }
                (None, None) => {
                    let size = TangentSize::new(&self.tangent_table, &of_frame.transfer);
                    match self.kernel {
                        SplatKernel::Ellipse => {
                            visitor.segment(i, of_frame, segment, &EllipseSize(size))
                        }
                        _ => visitor.segment(i, of_frame, segment, &size),
                    }
                }
            }
        }
    }
}
