//! Parallel warp of the papers: fragments of the LDI between epipolar lines, and a second pass
//! where they meet (P5, P6, C16).
//!
//! The traversal already visits each face sheet by sheet (the runs of
//! [`headbox_cube::render::setup::order`] are those between the epipole's row and column). Half
//! planes through the baseline divide the sheets of all faces into fragments with equally many
//! depth pixels in view, and by the same lines the frame into sectors: except for footprints, the
//! image of a fragment lies in its sector. A fragment is drawn in drawing order on its own canvas,
//! without synchronisation.
//!
//! Where a footprint reaches across a boundary, splats of two fragments overlap, and their order
//! matters:
//! * the *buffer zone* contains the samples within the reach of their footprint from a boundary;
//! * its *mask* contains the pixels that footprints of the buffer zone may touch: those within the
//!   largest of their radii;
//! * the *extended buffer zone* contains all samples whose footprint may touch the mask. It is
//!   drawn in drawing order on an empty canvas, from which the mask's pixels are taken.
//!
//! The papers leave the buffer zone out of the first pass, since their pixels have areas that a
//! boundary cuts. Here a depth pixel is a point with a footprint and lies on one side; leaving it
//! out would double the mask's width. Since no pass writes what another reads, the second need not
//! wait for the first.
//!
//! Every pixel thus receives the same splats in the same order as on one thread: the frame has the
//! same bits, for all kernels and numbers of fragments. The cost is a canvas of the whole frame for
//! each fragment and each boundary (4 or 16 bytes per pixel), which exceeds the cache and may be
//! read by another thread than its writer; clipping on one thread; and depth pixels that are drawn
//! twice. The product therefore uses bands (docs/decisions/0053).

use super::assemble::{Assembly, RowOwners};
use super::epipolar::{AngleHistogram, Baseline, Boundary, Rays, RowDivision, RowPart};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::frame::Frame;
use headbox_cube::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use headbox_cube::pack::{CubeLdi, PackedSegment};
use headbox_cube::render::band::{BandRenderer, FacePart};
use headbox_cube::render::footprint::rules::W_NEAR;
use headbox_cube::render::resolve::composite_environment::EnvironmentBackground;
use headbox_cube::render::resolve::holes::HoleFiller;
use headbox_cube::render::settings::Imbalance;
use headbox_cube::render::setup::clip::{Band, SegmentClip};
use headbox_cube::render::setup::order::Run;
use headbox_cube::render::setup::plan::{FramePlan, SegmentPlan};
use headbox_cube::render::{FrameStats, RenderSettings, Renderer};
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;
use std::time::Instant;

/// Largest number of fragments: each needs two canvases of the size of the frame.
pub const MAX_FRAGMENTS: u32 = 16;

/// Bound of position errors at w = 1, px: twice the error that the tests of the transfer measure at
/// half of the largest frame.
const POSITION_ERROR_PX: f64 = 5e-3;

/// Least half width of masks, px, so that pixels on a boundary lie in its mask.
const LEAST_RADIUS_PX: f64 = 1.0;

/// Statistics of a frame in fragments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FragmentStats {
    /// Statistics as for a frame in bands; `imbalance` is that of the fragments, without the second
    /// pass.
    #[serde(flatten)]
    pub frame: FrameStats,
    /// Pixels in masks, drawn in the second pass.
    pub redone_pixels: u64,
    /// Depth pixels of the second pass, in extended buffer zones; included in
    /// [`FrameStats::depth_pixels_in`].
    pub redone_depth_pixels: u64,
    /// Depth pixels of the largest fragment.
    pub largest_fragment: u64,
}

/// Renderer of frames in fragments, with its buffers.
#[derive(Default)]
pub struct FragmentRenderer {
    plan: FramePlan,
    division: Division,
    /// A canvas for each fragment, then one for each boundary.
    canvases: Vec<BandRenderer>,
    owners: RowOwners,
    filler: HoleFiller,
    frame: Frame,
    /// Renders cubes with plane textures, which belong to no fragment.
    bands: Renderer,
    is_in_bands: bool,
}

impl FragmentRenderer {
    /// Returns the last frame.
    pub fn frame(&self) -> &Frame {
        if self.is_in_bands {
            self.bands.frame()
        } else {
            &self.frame
        }
    }

    /// Renders a frame in `count` fragments, at most [`MAX_FRAGMENTS`], 0 for one per thread, on
    /// the current rayon thread pool. Cubes with plane textures are rendered in bands.
    pub fn render(
        &mut self,
        cube: &CubeLdi,
        camera: &Camera,
        settings: &RenderSettings,
        count: u32,
    ) -> (&Frame, FragmentStats) {
        self.is_in_bands = !cube.planes.tiles.is_empty();
        if self.is_in_bands {
            let (frame, stats) = self.bands.render_with_stats(cube, camera, settings);
            let stats = FragmentStats {
                frame: *stats,
                ..FragmentStats::default()
            };
            return (frame, stats);
        }
        let started = Instant::now();
        self.frame
            .resize(camera.width(), camera.height(), settings.depth);
        self.plan.prepare(cube, camera, settings);
        let fills_holes = !settings.keep_holes && self.plan.compares_depths();
        self.filler.prepare(if fills_holes {
            self.frame.color.len()
        } else {
            0
        });
        let count = if count > 0 {
            count as usize
        } else {
            rayon::current_num_threads()
        };
        let whole_frame = Band::new(camera, 0..camera.height());
        let count = count.min(MAX_FRAGMENTS as usize);
        self.division
            .prepare(&self.plan, cube, camera, count, &whole_frame);
        let prepared_ms = started.elapsed().as_secs_f64() * 1e3;
        let mut stats = self.draw(cube, &whole_frame);
        self.assemble(cube, camera, &mut stats);
        if fills_holes && stats.frame.hole_pixels > 0 {
            let started = Instant::now();
            self.filler.fill(&mut self.frame);
            stats.frame.finish_ms += started.elapsed().as_secs_f64() * 1e3;
        }
        stats.frame.clear_ms += prepared_ms;
        stats.frame.frame_ms = started.elapsed().as_secs_f64() * 1e3;
        (&self.frame, stats)
    }

    /// Draws both passes, each fragment and each extended buffer zone on a canvas of its own.
    fn draw(&mut self, cube: &CubeLdi, whole_frame: &Band) -> FragmentStats {
        let Self {
            plan,
            division,
            canvases,
            ..
        } = self;
        let boundaries = division.boundaries.len();
        let fragments = boundaries.max(1);
        let passes = fragments + boundaries;
        canvases.resize_with(passes.max(canvases.len()), BandRenderer::default);
        let canvases = &mut canvases[..passes];
        canvases
            .par_iter_mut()
            .enumerate()
            .with_max_len(1)
            .for_each(|(i, canvas)| {
                canvas.stats = FrameStats::default();
                let started = Instant::now();
                canvas.begin(plan, whole_frame);
                let cleared = Instant::now();
                match i.checked_sub(fragments) {
                    None => division.draw_fragment(plan, cube, i, canvas),
                    Some(k) => division.draw_extended_zone(plan, cube, whole_frame, k, canvas),
                }
                canvas.flush(plan);
                canvas.stats.clear_ms = (cleared - started).as_secs_f64() * 1e3;
                canvas.stats.warp_ms = cleared.elapsed().as_secs_f64() * 1e3;
            });

        let mut stats = FragmentStats::default();
        let mut imbalance = Imbalance::default();
        for (i, canvas) in canvases.iter().enumerate() {
            stats.frame.add(&canvas.stats);
            if i < fragments {
                imbalance.add(canvas.stats.busy_ms());
                stats.largest_fragment = stats.largest_fragment.max(canvas.stats.depth_pixels_in);
            } else {
                stats.redone_depth_pixels += canvas.stats.depth_pixels_in;
            }
        }
        stats.frame.imbalance = imbalance.ratio();
        stats
    }

    fn assemble(&mut self, cube: &CubeLdi, camera: &Camera, stats: &mut FragmentStats) {
        let assembly = Assembly {
            plan: &self.plan,
            boundaries: &self.division.boundaries,
            canvases: &self.canvases,
            background: EnvironmentBackground::new(&self.plan, cube, camera),
        };
        let baseline = self.division.baseline;
        let (assembled, masked) = self.owners.assemble(
            &assembly,
            &mut self.frame,
            self.filler.inverse_depths(),
            |y| baseline.project_frame_row(camera, y),
        );
        stats.frame.add(&assembled);
        stats.redone_pixels = masked;
    }
}

/// The visible part of a segment.
#[derive(Default)]
struct SegmentView {
    /// Columns and rows of the face.
    rectangle: Option<[Range<u32>; 2]>,
    /// Visibility of each block that the rectangle touches, row-major.
    visible: Vec<bool>,
    /// Reach of the footprints of the same blocks, px: bound of their radii, of the border of their
    /// depths and of position errors.
    reach_px: Vec<f64>,
}

impl SegmentView {
    /// Returns the blocks of the rectangle: index, column and row.
    fn blocks(&self) -> impl Iterator<Item = (usize, u32, u32)> {
        let [columns, rows] = self.rectangle.clone().unwrap_or([0..0, 0..0]);
        let columns = columns.start / BLOCK_COLUMNS..columns.end.div_ceil(BLOCK_COLUMNS);
        let rows = rows.start / BLOCK_ROWS..rows.end.div_ceil(BLOCK_ROWS);
        rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
            .enumerate()
            .map(|(i, (column, row))| (i, column, row))
    }

    /// Returns the range of block indices that columns of a row of the rectangle touch.
    fn block_range([columns, rows]: &[Range<u32>; 2], part: &Range<u32>, y: u32) -> Range<usize> {
        let first = columns.start / BLOCK_COLUMNS;
        let stride = columns.end.div_ceil(BLOCK_COLUMNS) - first;
        let start = (y / BLOCK_ROWS - rows.start / BLOCK_ROWS) * stride;
        let column = |block: u32| (start + block - first) as usize;
        column(part.start / BLOCK_COLUMNS)..column(part.end.div_ceil(BLOCK_COLUMNS))
    }
}

/// Division of a frame's segments into fragments.
#[derive(Default)]
struct Division {
    baseline: Baseline,
    /// Visible parts of the segments in drawing order.
    segments: Vec<SegmentView>,
    histogram: AngleHistogram,
    angles: Vec<f64>,
    boundaries: Vec<Boundary>,
}

impl Division {
    /// Clips the segments, divides the samples in view into `count` fragments, and sizes the masks.
    fn prepare(
        &mut self,
        plan: &FramePlan,
        cube: &CubeLdi,
        camera: &Camera,
        count: usize,
        whole_frame: &Band,
    ) {
        self.baseline = Baseline::new(camera.eye() - cube.info.centre);
        self.histogram.clear();
        let segments = plan.segments();
        self.segments.resize_with(
            segments.len().max(self.segments.len()),
            SegmentView::default,
        );
        for (i, planned) in segments.iter().enumerate() {
            let border_px = plan.depth_border_px();
            self.clip(i, &plan.clip(cube, i, whole_frame), border_px);
            self.count_samples(i, &cube.segments[planned.index], plan.face_px());
        }
        self.histogram.divide(count, &mut self.angles);
        self.boundaries.clear();
        self.boundaries.extend(
            self.angles
                .iter()
                .map(|angle| Boundary::new(*angle, &self.baseline, camera, LEAST_RADIUS_PX)),
        );
        for (i, planned) in segments.iter().enumerate() {
            let clip = plan.clip(cube, i, whole_frame);
            let face = cube.segments[planned.index].face;
            self.widen_masks(i, planned, &clip, face, plan.face_px());
        }
    }

    /// Clips segment `i`, and bounds the reach of its visible blocks.
    fn clip(&mut self, i: usize, clip: &SegmentClip, border_px: f64) {
        let view = &mut self.segments[i];
        view.rectangle = clip.clip(&mut view.visible);
        let mut reach_px = std::mem::take(&mut view.reach_px);
        reach_px.clear();
        for (block, column, row) in view.blocks() {
            let bounds = clip
                .block_bounds(column, row)
                .filter(|_| view.visible[block]);
            reach_px.push(bounds.map_or(0.0, |bounds| {
                let (_, least_w, radius_px) = clip.project_block(&bounds);
                radius_px + border_px + POSITION_ERROR_PX / least_w.max(f64::from(W_NEAR))
            }));
        }
        view.reach_px = reach_px;
    }

    /// Adds the depth pixels in view to the histogram: those of every fourth row, in runs of 16
    /// columns.
    fn count_samples(&mut self, i: usize, segment: &PackedSegment, face_px: u32) {
        let view = &self.segments[i];
        let Some([columns, rows]) = &view.rectangle else {
            return;
        };
        for (_, column, row) in view.blocks().filter(|(block, ..)| view.visible[*block]) {
            let clamp = |start: u32, length: u32, to: &Range<u32>| {
                start.max(to.start)..(start + length).min(to.end)
            };
            let columns = clamp(column * BLOCK_COLUMNS, BLOCK_COLUMNS, columns);
            for y in clamp(row * BLOCK_ROWS, BLOCK_ROWS, rows).step_by(4) {
                let rays = project_face_row(&self.baseline, segment.face, y, face_px);
                let (_, counts) = segment.row(y - segment.y0);
                for x in columns.clone().step_by(16) {
                    let end = (x + 16).min(columns.end);
                    let ends = [x, end]
                        .map(|x| counts.get((x - segment.x0) as usize).copied().unwrap_or(0));
                    let count = u64::from(ends[1].saturating_sub(ends[0]));
                    self.histogram
                        .add(rays.evaluate(f64::from(x + end) / 2.0), count);
                }
            }
        }
    }

    /// Widens the masks to contain the footprints of the segment's buffer zones.
    fn widen_masks(
        &mut self,
        i: usize,
        planned: &SegmentPlan,
        clip: &SegmentClip,
        face: Face,
        face_px: u32,
    ) {
        let view = &self.segments[i];
        for (block, column, row) in view.blocks() {
            let Some(bounds) = clip
                .block_bounds(column, row)
                .filter(|_| view.visible[block])
            else {
                continue;
            };
            let reach_px = view.reach_px[block];
            for boundary in self
                .boundaries
                .iter_mut()
                .filter(|boundary| boundary.radius_px < reach_px)
            {
                let transfer = &planned.transfer;
                let bounds =
                    boundary.transform_box(&self.baseline, face, face_px, transfer, &bounds);
                if boundary.is_near(&bounds, reach_px) {
                    boundary.radius_px = reach_px;
                }
            }
        }
    }

    /// Draws one fragment: the first pass.
    fn draw_fragment(
        &self,
        plan: &FramePlan,
        cube: &CubeLdi,
        index: usize,
        canvas: &mut BandRenderer,
    ) {
        let mut division = RowDivision::default();
        for (i, planned) in plan.segments().iter().enumerate() {
            let view = &self.segments[i];
            let Some(rectangle @ [columns, rows]) = &view.rectangle else {
                continue;
            };
            let face = cube.segments[planned.index].face;
            let runs = planned.eye.column_runs(columns.clone());
            for_each_row(planned, rows, |y| {
                let row_blocks = SegmentView::block_range(rectangle, columns, y);
                if !view.visible[row_blocks].contains(&true) {
                    return;
                }
                let rays = project_face_row(&self.baseline, face, y, plan.face_px());
                let parts = division.divide(&self.boundaries, &rays, columns);
                for run in &runs {
                    let mut draw = |part: &RowPart| {
                        let part = intersect(&part.columns, &run.range);
                        if part.is_empty() {
                            return;
                        }
                        let blocks = SegmentView::block_range(rectangle, &part, y);
                        let part = FacePart {
                            columns: part,
                            rows: y..y + 1,
                            visible: &view.visible[blocks],
                        };
                        canvas.draw_part(plan, cube, i, part);
                    };
                    let own = parts.iter().filter(|part| part.fragment == index);
                    if run.descending {
                        own.rev().for_each(&mut draw);
                    } else {
                        own.for_each(&mut draw);
                    }
                }
            });
        }
    }

    /// Draws the extended buffer zone of boundary `k`: the second pass.
    fn draw_extended_zone(
        &self,
        plan: &FramePlan,
        cube: &CubeLdi,
        whole_frame: &Band,
        k: usize,
        canvas: &mut BandRenderer,
    ) {
        let boundary = &self.boundaries[k];
        let mut near = Vec::new();
        for (i, planned) in plan.segments().iter().enumerate() {
            let view = &self.segments[i];
            let Some(rectangle @ [columns, rows]) = &view.rectangle else {
                continue;
            };
            let clip = plan.clip(cube, i, whole_frame);
            let transfer = &planned.transfer;
            let face = cube.segments[planned.index].face;
            near.clear();
            near.extend(view.blocks().map(|(block, column, row)| {
                let bounds = clip
                    .block_bounds(column, row)
                    .filter(|_| view.visible[block])?;
                let transformed =
                    boundary.transform_box(&self.baseline, face, plan.face_px(), transfer, &bounds);
                let reach_px = view.reach_px[block] + boundary.radius_px;
                boundary.is_near(&transformed, reach_px).then_some(bounds)
            }));
            let runs = planned.eye.column_runs(columns.clone());
            for_each_row(planned, rows, |y| {
                let rays = project_face_row(&self.baseline, face, y, plan.face_px());
                let row_w = transfer.map_infinite(0.0, f64::from(y) + 0.5).z;
                let mut draw_block = |run: Run| {
                    let block = SegmentView::block_range(rectangle, &run.range, y).start;
                    let Some([.., q]) = near[block] else {
                        return;
                    };
                    let per_q = transfer.inverse_depth.z;
                    let w = row_w + (q[0] * per_q).max(q[1] * per_q);
                    let part = boundary.extended_zone(
                        &rays,
                        [w, transfer.x_step.z],
                        view.reach_px[block],
                        &run.range,
                    );
                    if !part.is_empty() {
                        let part = FacePart {
                            columns: part,
                            rows: y..y + 1,
                            visible: &[true],
                        };
                        canvas.draw_part(plan, cube, i, part);
                    }
                };
                for run in &runs {
                    run.for_each_block(&mut draw_block);
                }
            });
        }
    }
}

/// Calls `visit` for each row of a segment in drawing order.
fn for_each_row(planned: &SegmentPlan, rows: &Range<u32>, mut visit: impl FnMut(u32)) {
    for run in planned.eye.row_runs(rows.clone()) {
        run.for_each(&mut visit);
    }
}

/// Projects the rays of a row of a face.
fn project_face_row(baseline: &Baseline, face: Face, y: u32, face_px: u32) -> Rays {
    let start = face.direction(0.0, f64::from(y) + 0.5, face_px);
    let step = face.direction(1.0, f64::from(y) + 0.5, face_px) - start;
    baseline.project_row(start, step)
}

fn intersect(a: &Range<u32>, b: &Range<u32>) -> Range<u32> {
    a.start.max(b.start)..a.end.min(b.end)
}
