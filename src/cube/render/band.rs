//! Rendering of one band of a frame by one thread, from its first splat to its last pixel.

use crate::pack::{CubeLdi, PackedDepthPixel, UnquantisedDepthPixel};
use crate::render::canvas;
use crate::render::canvas::Canvas;
use crate::render::canvas::depth::DepthCanvas;
use crate::render::footprint::splat::{SplatKernel, Splats};
use crate::render::planes::ROWS_AROUND;
use crate::render::renderer::Source;
use crate::render::resolve::composite_environment::{EnvironmentBackground, Pixels};
use crate::render::resolve::holes;
use crate::render::settings::FrameStats;
use crate::render::setup::clip::Band;
use crate::render::setup::plan::FramePlan;
use crate::render::traverse::batches::{Batch, SegmentPart, traverse};
use crate::render::traverse::format::Format;
use crate::render::warp::SegmentWarp;
use headbox_core::camera::Camera;
use std::ops::Range;
use std::time::Instant;

/// Renders bands on one thread; owns the buffers.
///
/// Calls of a band, in order: [`Self::begin`], [`Self::draw_part`] in drawing order,
/// [`Self::flush`], then [`Self::resolve`].
pub struct BandRenderer {
    /// Sums over all bands since it was last reset.
    pub stats: FrameStats,
    target: SplatTarget,
    batch: Box<Batch<PackedDepthPixel>>,
    /// Allocated on first use.
    exact_batch: Option<Box<Batch<UnquantisedDepthPixel>>>,
    visible: Vec<bool>,
}

/// A rectangle of face pixels, without the blocks that clipping culled.
pub struct FacePart<'a> {
    /// Columns of the face.
    pub columns: Range<u32>,
    /// Rows of the face.
    pub rows: Range<u32>,
    /// Visibility of each block that the rectangle touches, row-major.
    pub visible: &'a [bool],
}

/// The canvases of a band, and the splats on their way to them.
struct SplatTarget {
    band: Band,
    kernel: SplatKernel,
    canvas: Box<dyn Canvas>,
    depth: DepthCanvas,
    splats: Box<Splats>,
}

impl Default for BandRenderer {
    fn default() -> Self {
        let kernel = SplatKernel::default();
        Self {
            stats: FrameStats::default(),
            target: SplatTarget {
                band: Band::default(),
                kernel,
                canvas: canvas::create(kernel),
                depth: DepthCanvas::default(),
                splats: Box::new(Splats::new()),
            },
            batch: Box::new(Batch::new()),
            exact_batch: None,
            visible: Vec::new(),
        }
    }
}

impl BandRenderer {
    /// Renders a band to its pixels.
    pub(super) fn render(
        &mut self,
        plan: &FramePlan,
        source: Source,
        camera: &Camera,
        band: &Band,
        mut pixels: Pixels,
    ) {
        let started = Instant::now();
        self.begin(plan, band);
        if plan.planes.len() > 0 || source.inserted.is_some() {
            self.target.draw_background(plan, source);
        }
        let cleared = Instant::now();
        for i in 0..plan.segments().len() {
            self.draw_segment(plan, source, i);
        }
        if plan.settings.kernel.compares_depths() {
            self.target.canvas.add_rims(plan.level);
        }
        self.flush(plan);
        if plan.settings.depth {
            let rims = self.target.canvas.background().rims();
            self.target.depth.add_rims(rims);
        }
        let drawn = Instant::now();
        let background = EnvironmentBackground::new(plan, source.cube, camera);
        let inverse_depths = std::mem::take(&mut pixels.inverse_depths);
        let mut holes = 0;
        for (row, (y, mut pixels)) in band.rows.clone().zip(pixels.rows(band.width)).enumerate() {
            self.resolve(plan, row, 0, &mut pixels);
            holes += background.composite_row(y, pixels);
        }
        let has_holes = holes > 0 || plan.reads_all_depths;
        holes::read_depths_near_holes(inverse_depths, band, has_holes, |row, to| {
            self.target.canvas.read_depths(row, 0, to);
        });
        self.stats.hole_pixels += holes;
        self.stats.clear_ms += (cleared - started).as_secs_f64() * 1e3;
        self.stats.warp_ms += (drawn - cleared).as_secs_f64() * 1e3;
        self.stats.finish_ms += drawn.elapsed().as_secs_f64() * 1e3;
    }

    /// Clears the canvases for a band.
    pub fn begin(&mut self, plan: &FramePlan, band: &Band) {
        self.target.begin(plan, band);
    }

    /// Draws the `i`th segment in drawing order, clipped to the band.
    fn draw_segment(&mut self, plan: &FramePlan, source: Source, i: usize) {
        let mut visible = std::mem::take(&mut self.visible);
        let clip = plan.clip(source.cube, i, &self.target.band);
        if let Some([columns, rows]) = clip.clip(&mut visible) {
            let part = FacePart {
                columns,
                rows,
                visible: &visible,
            };
            match source.exact {
                None => self.draw_part(plan, source.cube, i, part),
                Some(exact) => self.draw_exact_part(plan, source.cube, exact, i, part),
            }
        }
        self.visible = visible;
    }

    /// Draws a part of the `i`th segment in drawing order. Draws neither plane textures nor
    /// inserted content.
    pub fn draw_part(&mut self, plan: &FramePlan, cube: &CubeLdi, i: usize, part: FacePart) {
        let segment = &cube.segments[plan.segments()[i].index];
        let part = SegmentPart {
            segment,
            depth_pixels: &segment.depth_pixels,
            columns: part.columns,
            rows: part.rows,
            visible: part.visible,
        };
        self.target
            .draw(plan, i, &part, &mut self.batch, &mut self.stats);
    }

    /// Same as [`Self::draw_part`], from unquantised depth pixels.
    fn draw_exact_part(
        &mut self,
        plan: &FramePlan,
        cube: &CubeLdi,
        exact: &[Vec<UnquantisedDepthPixel>],
        i: usize,
        part: FacePart,
    ) {
        let index = plan.segments()[i].index;
        let part = SegmentPart {
            segment: &cube.segments[index],
            depth_pixels: exact.get(index).map_or(&[][..], Vec::as_slice),
            columns: part.columns,
            rows: part.rows,
            visible: part.visible,
        };
        let batch = self
            .exact_batch
            .get_or_insert_with(|| Box::new(Batch::new()));
        self.target.draw(plan, i, &part, batch, &mut self.stats);
    }

    /// Completes the pixels after the last splat.
    pub fn flush(&mut self, plan: &FramePlan) {
        self.target.canvas.flush(plan.level);
    }

    /// Writes colours, depths and inverse depths of a row, counted from the band's first, from a
    /// column on; see [`Canvas`].
    pub fn resolve(&self, plan: &FramePlan, row: usize, column: usize, pixels: &mut Pixels) {
        let SplatTarget { canvas, depth, .. } = &self.target;
        canvas.resolve(row, column, pixels.colors, plan.level);
        if !pixels.inverse_depths.is_empty() {
            canvas.read_depths(row, column, pixels.inverse_depths);
        }
        depth.resolve(row, column, pixels.depths_m);
    }
}

impl SplatTarget {
    fn begin(&mut self, plan: &FramePlan, band: &Band) {
        let kernel = plan.settings.kernel;
        if self.kernel != kernel {
            self.canvas = canvas::create(kernel);
            self.kernel = kernel;
        }
        self.band.clone_from(band);
        self.canvas
            .clear(band.width, band.rows.clone(), plan.tolerance);
        self.canvas.background_mut().clear();
        if plan.settings.depth {
            self.depth.clear(band.width, band.rows.clone());
        }
    }

    /// Draws plane textures and inserted content, and initialises the canvases from them.
    fn draw_background(&mut self, plan: &FramePlan, source: Source) {
        let compares_depths = plan.settings.kernel.compares_depths();
        let rows_around = if plan.settings.depth || !compares_depths {
            ROWS_AROUND
        } else {
            0
        };
        self.canvas.background_mut().draw(
            &source.cube.planes,
            &plan.planes,
            source.inserted,
            (self.band.rows.clone(), rows_around),
            plan.tolerance.relative,
            plan.level,
        );
        self.canvas.set_background();
        if plan.settings.depth {
            self.depth.set_background(self.canvas.background());
        }
        if !compares_depths {
            self.canvas.add_rims(plan.level);
        }
    }

    /// Draws a part of the `i`th segment in drawing order. The canvas is called once per batch,
    /// which hides the cost of the dynamic call.
    fn draw<P: Format>(
        &mut self,
        plan: &FramePlan,
        i: usize,
        part: &SegmentPart<P>,
        batch: &mut Batch<P>,
        stats: &mut FrameStats,
    ) {
        let Self {
            band,
            kernel,
            canvas,
            depth,
            splats,
        } = self;
        let planned = &plan.segments()[i];
        let size = plan.segment_size(i);
        let warp = SegmentWarp::new(&planned.transfer, P::scale(part.segment), band, plan.level);
        let mut draw = |batch: &Batch<P>| {
            warp.warp(batch, &size, splats);
            let compares_depths = kernel.compares_depths();
            if !compares_depths {
                splats.cull_hidden(canvas.background());
            }
            canvas.draw(splats, plan.level);
            if plan.settings.depth {
                if compares_depths {
                    splats.cull_hidden(canvas.background());
                }
                depth.draw(splats, kernel.core_fraction(), canvas.background());
            }
            stats.depth_pixels_in += batch.len as u64;
            stats.splatted += splats.len as u64;
            stats.behind_or_outside += (batch.len - splats.len) as u64;
            stats
                .by_footprint
                .iter_mut()
                .zip(splats.by_footprint)
                .for_each(|(sum, count)| *sum += count);
        };
        traverse(part, &planned.eye, planned.layers, batch, &mut draw);
    }
}
