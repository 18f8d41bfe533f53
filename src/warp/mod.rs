//! From a packed cube LDI to a frame: six faces and two segments in occlusion-compatible order, the incremental warp,
//! splats, and the environment under what they leave open (inventory S17 to S23, C3, C3b, C8 to C10, C12).
//!
//! One traversal (`traverse`) yields depth pixels in drawing order, in batches of one row; a warp kernel (`scalar`)
//! makes splats of a batch; a canvas ([`crate::splat`]) draws them. Each can be exchanged without the others.

pub mod oracle;
pub(crate) mod order;
pub(crate) mod scalar;
pub(crate) mod transfer;
pub(crate) mod traverse;

pub(crate) use traverse::BATCH_CAPACITY;

use crate::capture::Camera;
use crate::frame::{Coverage, Frame};
use crate::ldi::MAX_FACE_SIZE_PX;
use crate::ldi::accumulate::DepthBins;
use crate::packed::{PackedCube, PackedSegment};
use crate::splat::linear::LinearLight;
use crate::splat::over::OverCanvas;
use crate::splat::size::{PaperSize, Size, TangentSize};
use crate::splat::surface::SurfaceCanvas;
use crate::splat::{Canvas, SplatKernel, Splats};
use order::EyeInFace;
use scalar::SegmentWarp;
use serde::Serialize;
use std::time::Instant;
use transfer::Transfer;
use traverse::Batch;

/// How frames are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RenderSettings {
    /// The footprints.
    pub kernel: SplatKernel,
    /// Colour of holes, sRGB.
    pub hole_color_srgb: [u8; 3],
}

/// What a frame took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FrameStats {
    /// Depth pixels that reached the inner loop.
    pub depth_pixels_in: u64,
    /// Of these, behind the eye or outside the frame.
    pub behind_or_outside: u64,
    /// Of these, drawn.
    pub splatted: u64,
    /// Drawn with footprints of about 1, 3, 5, and 7 or more pixels.
    pub by_footprint: [u64; 4],
    /// Pixels of which nothing is known.
    pub hole_pixels: u64,
    /// Clearing, ms.
    pub clear_ms: f64,
    /// Drawing order, tables, warp and splats, ms.
    pub warp_ms: f64,
    /// Canvas to frame, with the environment, ms.
    pub finish_ms: f64,
}

/// Draws frames; owns its buffers, and allocates only when a frame is larger than all before it or uses another kernel.
pub struct Renderer {
    frame: Frame,
    stats: FrameStats,
    order: Vec<usize>,
    batch: Box<Batch>,
    splats: Box<Splats>,
    over: OverCanvas,
    surfaces: SurfaceCanvas,
    paper_size: PaperSize,
    tangent_size: TangentSize,
}

impl Default for Renderer {
    fn default() -> Self {
        Self::new()
    }
}

impl Renderer {
    /// A renderer that has drawn nothing yet.
    pub fn new() -> Self {
        Self {
            frame: Frame::default(),
            stats: FrameStats::default(),
            order: Vec::new(),
            batch: Box::new(Batch::new()),
            splats: Box::new(Splats::new()),
            over: OverCanvas::default(),
            surfaces: SurfaceCanvas::default(),
            paper_size: PaperSize::new(),
            tangent_size: TangentSize::new(),
        }
    }

    /// Draws what `camera` sees. The cube should be valid ([`PackedCube::validate`]); of one that is not, rows whose
    /// tables point nowhere are left out.
    pub fn render(&mut self, cube: &PackedCube, camera: &Camera, settings: &RenderSettings) -> (&Frame, &FrameStats) {
        self.stats = FrameStats::default();
        let (width, height) = (camera.width(), camera.height());
        let started = Instant::now();
        self.frame.reset(width, height, settings.hole_color_srgb);
        match settings.kernel {
            SplatKernel::Tent => self.surfaces.clear(width, height),
            SplatKernel::Paper | SplatKernel::Opaque => self.over.clear(width, height),
        }
        let cleared = Instant::now();
        order::segment_order(&cube.segments, camera.eye() - cube.info.centre, &mut self.order);
        self.draw(cube, camera, settings.kernel);
        let drawn = Instant::now();
        match settings.kernel {
            SplatKernel::Tent => finish(&mut self.frame, &self.surfaces, cube, camera),
            SplatKernel::Paper | SplatKernel::Opaque => finish(&mut self.frame, &self.over, cube, camera),
        }
        self.stats.hole_pixels = self.frame.hole_count();
        self.stats.clear_ms = (cleared - started).as_secs_f64() * 1e3;
        self.stats.warp_ms = (drawn - cleared).as_secs_f64() * 1e3;
        self.stats.finish_ms = drawn.elapsed().as_secs_f64() * 1e3;
        (&self.frame, &self.stats)
    }

    /// Draws all segments on the canvas of the kernel.
    fn draw(&mut self, cube: &PackedCube, camera: &Camera, kernel: SplatKernel) {
        let face_px = cube.face_size_px.min(MAX_FACE_SIZE_PX);
        let eye_from_centre = camera.eye() - cube.info.centre;
        match kernel {
            SplatKernel::Tent => {
                self.surfaces.tolerance = SurfaceCanvas::tolerance(face_px);
                self.surfaces.bin = DepthBins::new(cube.info.half_size_m, face_px).inverse_depth(1.0) as f32;
                self.tangent_size.refill(cube.layout, face_px, 1.0, TENT_MIN_RADIUS_PX);
            }
            // A rectangle is as wide as the spacing; 15 % more closes the cracks that quantised normals open.
            SplatKernel::Opaque => self.tangent_size.refill(cube.layout, face_px, 0.575, 0.5),
            SplatKernel::Paper => {}
        }
        self.over.soft = kernel == SplatKernel::Paper;
        for &i in &self.order {
            let segment = &cube.segments[i];
            let transfer = Transfer::new(camera, eye_from_centre, segment.face, face_px);
            let mut pass = SegmentPass {
                segment,
                face_px,
                eye: EyeInFace::new(eye_from_centre, segment.face, face_px),
                warp: SegmentWarp::new(&transfer, segment, camera.width(), camera.height()),
                batch: &mut self.batch,
                splats: &mut self.splats,
                stats: &mut self.stats,
            };
            match kernel {
                SplatKernel::Tent => {
                    self.tangent_size.set_transfer(&transfer);
                    pass.draw(&self.tangent_size, &mut self.surfaces);
                }
                SplatKernel::Opaque => {
                    self.tangent_size.set_transfer(&transfer);
                    pass.draw(&self.tangent_size, &mut self.over);
                }
                SplatKernel::Paper => {
                    self.paper_size.refill(camera, segment, cube.layout, face_px);
                    pass.draw(&self.paper_size, &mut self.over);
                }
            }
        }
    }
}

/// The least radius of a tent, px: of 0.5, 0.6, 0.75 and 1, the best off the centre of `builtin:tree` and
/// `builtin:interior` (0.6: up to 0.4 and 0.7 dB less; 1 lost 0.7 dB to blur at f2/f1 = 0.5).
const TENT_MIN_RADIUS_PX: f32 = 0.75;

/// One segment on its way to a canvas.
struct SegmentPass<'a> {
    segment: &'a PackedSegment,
    face_px: u32,
    eye: EyeInFace,
    warp: SegmentWarp<'a>,
    batch: &'a mut Batch,
    splats: &'a mut Splats,
    stats: &'a mut FrameStats,
}

impl SegmentPass<'_> {
    fn draw(&mut self, size: &impl Size, canvas: &mut impl Canvas) {
        let Self { segment, face_px, eye, warp, batch, splats, stats } = self;
        traverse::traverse(segment, *face_px, eye, batch, &mut |batch| {
            warp.warp(batch, size, splats);
            canvas.draw(splats);
            stats.depth_pixels_in += batch.len as u64;
            stats.splatted += splats.len as u64;
            stats.behind_or_outside += (batch.len - splats.len) as u64;
            for footprint in &splats.footprint[..splats.len] {
                stats.by_footprint[footprint.class()] += 1;
            }
        });
    }
}

/// Writes the canvas to the frame, over the environment where it shows.
fn finish(frame: &mut Frame, canvas: &impl Canvas, cube: &PackedCube, camera: &Camera) {
    let width = camera.width() as usize;
    for (i, (color, coverage)) in frame.color.iter_mut().zip(&mut frame.coverage).enumerate() {
        let ([r, g, b], share) = canvas.pixel(i);
        if share == 255 {
            (*color, *coverage) = ([r, g, b, 255], Coverage::FULL);
            continue;
        }
        let environment = (cube.environment.size_px > 0).then(|| {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            cube.environment.sample(camera.direction(x, y).as_vec3())
        });
        match (environment.flatten(), share) {
            (None, 0) => {}
            (None, _) => (*color, *coverage) = ([r, g, b, 255], Coverage::of_splats(share)),
            (Some([er, eg, eb]), 0) => (*color, *coverage) = ([er, eg, eb, 255], Coverage::ENVIRONMENT),
            (Some([er, eg, eb]), _) => {
                let shares = [u32::from(share), u32::from(255 - share)];
                let [r, g, b] = LinearLight::tables().mix([[r, g, b], [er, eg, eb]], shares);
                (*color, *coverage) = ([r, g, b, 255], Coverage::of_splats(share));
            }
        }
    }
}
