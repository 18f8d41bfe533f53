//! The papers' parallel warp: fragments of the LDI between epipolar lines, and a second pass where they meet (P5,
//! P6, C16).
//!
//! The traversal already goes through each face sheet by sheet (the runs of [`crate::render::setup::order`] are those between the
//! epipole's row and column). Half planes through the baseline cut the sheets of all faces into fragments with equally many depth
//! pixels in view, and by the same lines the frame into sectors: what a fragment shows lies in its sector, but for
//! footprints. A fragment is drawn in drawing order on a canvas of its own, so that there is nothing to race for.
//!
//! Where a footprint reaches over a boundary, splats of two fragments meet, and their order counts:
//! * the *buffer zone* is what lies no farther from a boundary than its footprint reaches;
//! * its *mask* is where buffer zones' footprints may lie: the pixels within the radius of the largest of them;
//! * the *extended buffer zone* is everything whose footprint may touch the mask. It is drawn in drawing order on an empty
//!   canvas, and the mask's pixels are taken from there.
//!
//! The papers leave the buffer zone out of the first pass, since their pixels have areas that a boundary cuts. Here a
//! depth pixel is a point with a stamp and lies on one side; leaving it out would double the mask's width. And as no pass writes
//! where another reads, the second need not wait for the first.
//!
//! Every pixel thus sees the same splats in the same order as on one thread: of the frame no bit differs, whatever the
//! kernel and the number of fragments. What it costs: a whole frame's canvas for each fragment and each boundary (twice
//! the number of fragments times 4 or 16 bytes a pixel), which no cache holds and another thread than the painter's may
//! read, clipping on one thread, and the depth pixels that are drawn twice. So
//! bands are the default (docs/decisions/0053).

use super::assemble::Owners;
use super::band::{Clipped, ForSegment, Scope, Worker};
use super::epipolar::{Boundary, Epipolar, Rays, Spans, Weights, spans};
use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::pack::{PackedCube, PackedSegment};
use crate::render::footprint::size::Size;
use crate::render::footprint::splat::SplatKernel;
use crate::render::resolve::finish::Background;
use crate::render::setup::clip::{Band, BlockClip, W_NEAR};
use crate::render::traverse::batches::Cut;
use crate::render::{FramePlan, FrameStats, Imbalance, SegmentPlan, Source};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use headbox_core::frame::Frame;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// More fragments than this are not made: each needs two canvases of the size of the frame.
pub const MAX_FRAGMENTS: u32 = 16;

/// Positions are off by no more than this at w = 1, px: twice what the test of [`crate::render::setup::transfer`] finds at half of the
/// largest frame.
const POSITION_ERROR_PX: f64 = 5e-3;

/// Masks are at least as wide as this on both sides, px, so that nobody asks on which side of a boundary a pixel lies that
/// lies on it.
const LEAST_RADIUS_PX: f64 = 1.0;

/// Draws frames in fragments; owns the buffers that this takes.
#[derive(Default)]
pub(crate) struct Fragments {
    segments: Vec<SegmentInView>,
    weights: Weights,
    turns: Vec<f64>,
    boundaries: Vec<Boundary>,
    /// One for each fragment, then one for each boundary.
    painters: Vec<Worker>,
    owners: Owners,
}

/// What of a segment the frame can show.
#[derive(Default)]
struct SegmentInView {
    /// Columns and rows of the face.
    rectangle: Option<[Range<u32>; 2]>,
    /// Of the blocks that the rectangle touches, row-major.
    visible: Vec<bool>,
    /// Of the same blocks, how far from its position a depth pixel's footprint may reach, px.
    reach_px: Vec<f64>,
}

impl SegmentInView {
    /// Its blocks: index, column and row.
    fn blocks(&self) -> impl Iterator<Item = (usize, u32, u32)> {
        let [columns, rows] = self.rectangle.clone().unwrap_or([0..0, 0..0]);
        let columns = columns.start / BLOCK_COLUMNS..columns.end.div_ceil(BLOCK_COLUMNS);
        let rows = rows.start / BLOCK_ROWS..rows.end.div_ceil(BLOCK_ROWS);
        rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
            .enumerate()
            .map(|(i, (column, row))| (i, column, row))
    }

    /// Index of the block that holds a face pixel of the rectangle.
    fn block_of(&self, x: u32, y: u32) -> Option<usize> {
        let [columns, rows] = self.rectangle.as_ref()?;
        let first = columns.start / BLOCK_COLUMNS;
        let stride = columns.end.div_ceil(BLOCK_COLUMNS) - first;
        Some(
            ((y / BLOCK_ROWS - rows.start / BLOCK_ROWS) * stride + x / BLOCK_COLUMNS - first)
                as usize,
        )
    }
}

/// Clips the segments, and weighs what is left.
struct Clipping<'a> {
    segments: &'a mut [SegmentInView],
    weights: &'a mut Weights,
    epipolar: &'a Epipolar,
    plan: &'a FramePlan,
    frame: &'a Band,
}

impl ForSegment for Clipping<'_> {
    fn segment<S: Size>(
        &mut self,
        i: usize,
        of_frame: &SegmentPlan,
        segment: &PackedSegment,
        size: &S,
    ) {
        let face_px = self.plan.face_px;
        let clip = BlockClip {
            transfer: &of_frame.transfer,
            segment,
            band: self.frame,
            face_px,
        };
        let view = &mut self.segments[i];
        view.rectangle = Clipped {
            unclipped: self.plan.unclipped,
        }
        .part(i, &clip, size, &mut view.visible);
        let mut reach_px = std::mem::take(&mut view.reach_px);
        reach_px.clear();
        for (block, column, row) in view.blocks() {
            let bounds = clip.bounds(column, row).filter(|_| view.visible[block]);
            reach_px.push(bounds.map_or(0.0, |bounds| {
                let (_, least_w, radius) = clip.corners(&bounds, size);
                radius + POSITION_ERROR_PX / least_w.max(f64::from(W_NEAR))
            }));
        }
        view.reach_px = reach_px;
        self.weigh(i, segment, face_px);
    }
}

impl Clipping<'_> {
    /// Adds the depth pixels in view, counted in every fourth row, in pieces of 16 columns.
    fn weigh(&mut self, i: usize, segment: &PackedSegment, face_px: u32) {
        let view = &self.segments[i];
        let Some([columns, rows]) = &view.rectangle else {
            return;
        };
        for (_, column, row) in view.blocks().filter(|(block, ..)| view.visible[*block]) {
            let clip = |start: u32, length: u32, to: &Range<u32>| {
                start.max(to.start)..(start + length).min(to.end)
            };
            let columns = clip(column * BLOCK_COLUMNS, BLOCK_COLUMNS, columns);
            for y in clip(row * BLOCK_ROWS, BLOCK_ROWS, rows).step_by(4) {
                let rays = face_row(self.epipolar, segment.face, y, face_px);
                let (_, counts) = segment.row(y - segment.y0);
                for x in columns.clone().step_by(16) {
                    let end = (x + 16).min(columns.end);
                    let ends = [x, end]
                        .map(|x| counts.get((x - segment.x0) as usize).copied().unwrap_or(0));
                    let count = u64::from(ends[1].saturating_sub(ends[0]));
                    self.weights.add(rays.at(f64::from(x + end) / 2.0), count);
                }
            }
        }
    }
}

/// The rays of a row of a face.
fn face_row(epipolar: &Epipolar, face: Face, y: u32, face_px: u32) -> Rays {
    let start = face.direction(0.0, f64::from(y) + 0.5, face_px);
    epipolar.row(
        start,
        face.direction(1.0, f64::from(y) + 0.5, face_px) - start,
    )
}

/// The least radii with which the boundaries' masks hold the buffer zones.
struct Widening<'a> {
    segments: &'a [SegmentInView],
    boundaries: &'a mut [Boundary],
    epipolar: &'a Epipolar,
    plan: &'a FramePlan,
    frame: &'a Band,
}

impl ForSegment for Widening<'_> {
    fn segment<S: Size>(
        &mut self,
        i: usize,
        of_frame: &SegmentPlan,
        segment: &PackedSegment,
        _: &S,
    ) {
        let (view, face_px) = (&self.segments[i], self.plan.face_px);
        let clip = BlockClip {
            transfer: &of_frame.transfer,
            segment,
            band: self.frame,
            face_px,
        };
        for (block, column, row) in view.blocks() {
            let Some(bounds) = clip.bounds(column, row).filter(|_| view.visible[block]) else {
                continue;
            };
            for boundary in self
                .boundaries
                .iter_mut()
                .filter(|b| b.radius_px < view.reach_px[block])
            {
                let seen = boundary.see(
                    self.epipolar,
                    segment.face,
                    face_px,
                    &of_frame.transfer,
                    &bounds,
                );
                if boundary.is_near(&seen, view.reach_px[block]) {
                    boundary.radius_px = view.reach_px[block];
                }
            }
        }
    }
}

/// The first pass: one fragment.
struct Fragment<'a> {
    of: &'a Fragments,
    epipolar: &'a Epipolar,
    face_px: u32,
    index: usize,
}

/// A fragment, in one segment.
struct FragmentCut<'a> {
    fragment: &'a Fragment<'a>,
    face: Face,
    columns: Range<u32>,
}

impl Scope for Fragment<'_> {
    type Cut<'a>
        = FragmentCut<'a>
    where
        Self: 'a;

    fn part<S: Size>(
        &self,
        i: usize,
        _: &BlockClip,
        _: &S,
        visible: &mut Vec<bool>,
    ) -> Option<[Range<u32>; 2]> {
        visible.clone_from(&self.of.segments[i].visible);
        self.of.segments[i].rectangle.clone()
    }

    fn cut<'a>(&'a self, i: usize, clip: BlockClip<'a>) -> FragmentCut<'a> {
        let columns = self.of.segments[i]
            .rectangle
            .as_ref()
            .map_or(0..0, |[columns, _]| columns.clone());
        FragmentCut {
            fragment: self,
            face: clip.segment.face,
            columns,
        }
    }
}

impl Cut for FragmentCut<'_> {
    type Row = Spans;

    fn row(&self, y: u32) -> Spans {
        let Fragment {
            of,
            epipolar,
            face_px,
            index,
        } = self.fragment;
        spans(
            &of.boundaries,
            *index,
            &face_row(epipolar, self.face, y, *face_px),
            &self.columns,
        )
    }

    fn within(&self, row: &Spans, _: u32, range: &Range<u32>) -> Spans {
        row.clone().map(|span| {
            let start = span.start.clamp(range.start, range.end);
            start..span.end.clamp(start, range.end)
        })
    }
}

/// The second pass: the extended buffer zone of one boundary.
struct Extended<'a> {
    of: &'a Fragments,
    epipolar: &'a Epipolar,
    boundary: &'a Boundary,
}

/// An extended buffer zone, in one segment.
struct ExtendedCut<'a> {
    zone: &'a Extended<'a>,
    view: &'a SegmentInView,
    clip: BlockClip<'a>,
}

impl Scope for Extended<'_> {
    type Cut<'a>
        = ExtendedCut<'a>
    where
        Self: 'a;

    fn part<S: Size>(
        &self,
        i: usize,
        clip: &BlockClip,
        _: &S,
        visible: &mut Vec<bool>,
    ) -> Option<[Range<u32>; 2]> {
        let view = &self.of.segments[i];
        visible.clear();
        for (block, column, row) in view.blocks() {
            let bounds = clip.bounds(column, row).filter(|_| view.visible[block]);
            visible.push(bounds.is_some_and(|bounds| {
                let seen = self.boundary.see(
                    self.epipolar,
                    clip.segment.face,
                    clip.face_px,
                    clip.transfer,
                    &bounds,
                );
                self.boundary
                    .is_near(&seen, view.reach_px[block] + self.boundary.radius_px)
            }));
        }
        view.rectangle.clone()
    }

    fn cut<'a>(&'a self, i: usize, clip: BlockClip<'a>) -> ExtendedCut<'a> {
        ExtendedCut {
            zone: self,
            view: &self.of.segments[i],
            clip,
        }
    }
}

impl Cut for ExtendedCut<'_> {
    type Row = (Rays, [f64; 2]);

    fn row(&self, y: u32) -> Self::Row {
        let BlockClip {
            transfer,
            segment,
            face_px,
            ..
        } = self.clip;
        let w = [transfer.at(0.0, f64::from(y) + 0.5).z, transfer.x_step.z];
        (face_row(self.zone.epipolar, segment.face, y, face_px), w)
    }

    fn within(&self, (rays, [w, w_step]): &Self::Row, y: u32, range: &Range<u32>) -> Spans {
        let none = range.end..range.end;
        let bounds = self
            .clip
            .bounds(range.start / BLOCK_COLUMNS, y / BLOCK_ROWS);
        let block = self.view.block_of(range.start, y);
        let Some(([.., q], block)) = bounds.zip(block) else {
            return [none.clone(), none.clone(), none];
        };
        let per_q = self.clip.transfer.inverse_depth.z;
        let w = w + (q[0] * per_q).max(q[1] * per_q);
        let found =
            self.zone
                .boundary
                .extended(rays, [w, *w_step], self.view.reach_px[block], range);
        [found, none.clone(), none]
    }
}

impl Fragments {
    /// Draws on a frame that holds the hole colour, and says what it took.
    pub(crate) fn draw(
        &mut self,
        plan: &FramePlan,
        source: Source,
        camera: &Camera,
        count: u32,
        (frame, inverse_depths): (&mut Frame, &mut [f32]),
    ) -> FrameStats {
        let (started, cube) = (Instant::now(), source.cube);
        let count = if count > 0 {
            count as usize
        } else {
            rayon::current_num_threads()
        };
        let principal_px = camera.principal_px();
        let band = Band {
            width: frame.width,
            height: frame.height,
            principal_px,
            rows: 0..frame.height,
        };
        let epipolar = Epipolar::new(camera.eye() - cube.info.centre);
        self.prepare(
            plan,
            cube,
            camera,
            count.min(MAX_FRAGMENTS as usize),
            &epipolar,
            &band,
        );
        let prepared_ms = started.elapsed().as_secs_f64() * 1e3;

        let cuts = self.boundaries.len();
        let (first_pass, passes) = (cuts.max(1), cuts.max(1) + cuts);
        let mut painters = std::mem::take(&mut self.painters);
        painters.resize_with(passes.max(painters.len()), Worker::default);
        painters[..passes]
            .par_iter_mut()
            .enumerate()
            .with_max_len(1)
            .for_each(|(i, painter)| {
                painter.stats = FrameStats::default();
                let whole_row = 0..band.width;
                match i.checked_sub(first_pass) {
                    None => {
                        let fragment = Fragment {
                            of: self,
                            epipolar: &epipolar,
                            face_px: plan.face_px,
                            index: i,
                        };
                        let sector = |y| {
                            spans(
                                &self.boundaries,
                                i,
                                &epipolar.frame_row(camera, y),
                                &whole_row,
                            )
                        };
                        painter.draw_spans(plan, source, &band, &fragment, sector);
                    }
                    Some(k) => {
                        let boundary = &self.boundaries[k];
                        let zone = Extended {
                            of: self,
                            epipolar: &epipolar,
                            boundary,
                        };
                        let mask = |y| {
                            [
                                boundary.mask(&epipolar.frame_row(camera, y), band.width),
                                0..0,
                                0..0,
                            ]
                        };
                        painter.draw_spans(plan, source, &band, &zone, mask);
                    }
                }
            });

        let mut stats = FrameStats::default();
        let mut busy = Imbalance::default();
        for (i, painter) in painters[..passes].iter().enumerate() {
            stats.absorb(&painter.stats);
            if i < first_pass {
                busy.add(painter.stats.busy_ms());
                stats.largest_fragment = stats.largest_fragment.max(painter.stats.depth_pixels_in);
            } else {
                stats.redone_depth_pixels += painter.stats.depth_pixels_in;
            }
        }
        stats.imbalance = busy.ratio();
        stats.clear_ms += prepared_ms;
        let background = Background::new(plan, cube, camera);
        let rays = |y| epipolar.frame_row(camera, y);
        let Self {
            owners, boundaries, ..
        } = self;
        let finished = match plan.kernel {
            SplatKernel::Tent => owners.assemble(
                plan,
                boundaries,
                &background,
                (frame, inverse_depths),
                rays,
                |i| {
                    let Worker {
                        surfaces, depth, ..
                    } = &painters[i];
                    (surfaces, depth)
                },
            ),
            SplatKernel::Ellipse => owners.assemble(
                plan,
                boundaries,
                &background,
                (frame, inverse_depths),
                rays,
                |i| {
                    let Worker {
                        ellipses, depth, ..
                    } = &painters[i];
                    (ellipses, depth)
                },
            ),
            _ => owners.assemble(
                plan,
                boundaries,
                &background,
                (frame, inverse_depths),
                rays,
                |i| {
                    let Worker { over, depth, .. } = &painters[i];
                    (over, depth)
                },
            ),
        };
        self.painters = painters;
        stats.absorb(&finished);
        stats
    }

    /// Clips the segments, and cuts what is left of them.
    fn prepare(
        &mut self,
        plan: &FramePlan,
        cube: &PackedCube,
        camera: &Camera,
        count: usize,
        epipolar: &Epipolar,
        frame: &Band,
    ) {
        let Self {
            segments,
            weights,
            turns,
            boundaries,
            ..
        } = self;
        weights.clear();
        segments.resize_with(
            plan.segments.len().max(segments.len()),
            SegmentInView::default,
        );
        plan.for_each_segment(
            cube,
            &mut Clipping {
                segments,
                weights,
                epipolar,
                plan,
                frame,
            },
        );
        weights.cut(count, turns);
        boundaries.clear();
        boundaries.extend(
            turns
                .iter()
                .map(|turn| Boundary::new(*turn, epipolar, camera, LEAST_RADIUS_PX)),
        );
        plan.for_each_segment(
            cube,
            &mut Widening {
                segments,
                boundaries,
                epipolar,
                plan,
                frame,
            },
        );
    }
}
