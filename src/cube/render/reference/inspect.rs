//! Inspection of a frame for overlays: overdraw of each pixel, and the result of clipping. A
//! second, slow pass over the frame's plan, independent of the renderer.

use super::overdraw::{Overdraw, count_footprints};
use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::pack::{CubeLdi, PackedDepthPixel, PackedSegment};
use crate::render::footprint::splat::Splats;
use crate::render::setup::clip::Band;
use crate::render::setup::plan::FramePlan;
use crate::render::traverse::batches::{Batch, SegmentPart, traverse};
use crate::render::traverse::format::Format;
use crate::render::warp::SegmentWarp;
use crate::render::{RenderSettings, Renderer};
use headbox_core::camera::Camera;
use rayon::prelude::*;
use std::ops::Range;

/// Result of clipping a segment for a view.
#[derive(Clone, Debug, PartialEq)]
pub struct ClippedSegment {
    /// Index in [`CubeLdi::segments`].
    pub segment: usize,
    /// Columns and rows of the face inside the view volume; empty if there are none.
    rectangle: [Range<u32>; 2],
    /// Visibility of each block that the rectangle touches, row-major.
    visible: Vec<bool>,
}

/// Result of clipping for a pixel of a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipOutcome {
    /// Its samples are drawn.
    Drawn,
    /// It lies outside the rectangle that the view volume cuts out of its segment (C15).
    OutsideRectangle,
    /// It lies in a block that is completely outside the view volume (C17).
    HiddenBlock,
}

impl ClippedSegment {
    /// Returns the outcome for the pixel in column `x` and row `y` of the face.
    pub fn outcome(&self, x: u32, y: u32) -> ClipOutcome {
        let [columns, rows] = &self.rectangle;
        if !columns.contains(&x) || !rows.contains(&y) {
            return ClipOutcome::OutsideRectangle;
        }
        let first = columns.start / BLOCK_COLUMNS;
        let blocks = columns.end.div_ceil(BLOCK_COLUMNS) - first;
        let block = (y / BLOCK_ROWS - rows.start / BLOCK_ROWS) * blocks + x / BLOCK_COLUMNS - first;
        if self.visible.get(block as usize) == Some(&true) {
            ClipOutcome::Drawn
        } else {
            ClipOutcome::HiddenBlock
        }
    }

    /// Returns true if the whole segment lies outside the view volume.
    pub(super) fn is_culled(&self) -> bool {
        self.rectangle[0].is_empty()
    }

    /// Counts the depth pixels of the segment by outcome, in the order of [`ClipOutcome`].
    pub fn counts(&self, segment: &PackedSegment) -> [u64; 3] {
        let mut counts = [0; 3];
        for row in 0..segment.height {
            let (_, running_counts) = segment.row(row);
            let before = |column: u32| running_counts.get(column as usize).copied().unwrap_or(0);
            self.for_each_run(segment, segment.y0 + row, |outcome, columns| {
                let count = before(columns.end).saturating_sub(before(columns.start));
                counts[outcome as usize] += u64::from(count);
            });
        }
        counts
    }

    /// Calls `visit` for each run of the segment's columns in a row with the same outcome: with the
    /// outcome, and the columns counted from the segment's first.
    fn for_each_run(
        &self,
        segment: &PackedSegment,
        y: u32,
        mut visit: impl FnMut(ClipOutcome, Range<u32>),
    ) {
        let end = segment.x0.saturating_add(segment.width);
        let mut x = segment.x0;
        while x < end {
            let borders = [
                self.rectangle[0].start,
                self.rectangle[0].end,
                (x / BLOCK_COLUMNS + 1) * BLOCK_COLUMNS,
            ];
            let next = borders
                .into_iter()
                .filter(|border| *border > x)
                .min()
                .unwrap_or(end)
                .min(end);
            visit(self.outcome(x, y), x - segment.x0..next - segment.x0);
            x = next;
        }
    }
}

/// Rows of a band, the work of one thread at a time. The result does not depend on it.
const BAND_ROWS: u32 = 48;

impl Renderer {
    /// Counts the footprints on each pixel of a frame, row by row, on the current rayon thread
    /// pool.
    pub fn overdraw(
        &mut self,
        cube: &CubeLdi,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> Vec<Overdraw> {
        self.plan.prepare(cube, camera, settings);
        let plan = &self.plan;
        let width = camera.width() as usize;
        let height = camera.height();
        let mut overdraw = vec![Overdraw::default(); width * height as usize];
        let bands = overdraw
            .par_chunks_mut(width * BAND_ROWS as usize)
            .enumerate()
            .with_max_len(1);
        bands.for_each(|(i, pixels)| {
            let start = i as u32 * BAND_ROWS;
            let band = Band::new(camera, start..start.saturating_add(BAND_ROWS).min(height));
            count_band(plan, cube, &band, pixels);
        });
        overdraw
    }

    /// Clips each segment against a camera's whole frame.
    pub fn clipped_segments(
        &mut self,
        cube: &CubeLdi,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> Vec<ClippedSegment> {
        self.plan.prepare(cube, camera, settings);
        let frame = Band::new(camera, 0..camera.height());
        let planned = self.plan.segments().iter().enumerate();
        planned
            .map(|(i, planned)| {
                let segment = &cube.segments[planned.index];
                let mut visible = Vec::new();
                let rectangle = self.plan.clip(cube, i, &frame).clip(&mut visible);
                ClippedSegment {
                    segment: planned.index,
                    rectangle: rectangle
                        .unwrap_or([segment.x0..segment.x0, segment.y0..segment.y0]),
                    visible,
                }
            })
            .collect()
    }
}

/// Counts the footprints of all segments on the pixels of a band.
fn count_band(plan: &FramePlan, cube: &CubeLdi, band: &Band, pixels: &mut [Overdraw]) {
    let mut batch = Box::new(Batch::new());
    let mut splats = Box::new(Splats::new());
    let mut visible = Vec::new();
    let core = plan.settings.kernel.core_fraction();
    for (i, planned) in plan.segments().iter().enumerate() {
        let segment = &cube.segments[planned.index];
        let Some([columns, rows]) = plan.clip(cube, i, band).clip(&mut visible) else {
            continue;
        };
        let part = SegmentPart {
            segment,
            depth_pixels: &segment.depth_pixels,
            columns,
            rows,
            visible: &visible,
        };
        let size = plan.segment_size(i);
        let scale = PackedDepthPixel::scale(segment);
        let warp = SegmentWarp::new(&planned.transfer, scale, band, plan.level);
        let mut draw = |batch: &Batch<PackedDepthPixel>| {
            warp.warp(batch, &size, &mut splats);
            count_footprints(pixels, band.width, &band.rows, &splats, core);
        };
        traverse(&part, &planned.eye, planned.layers, &mut batch, &mut draw);
    }
}

#[cfg(test)]
mod tests {
    //! Inspection against the frame itself and the clip counts.

    use super::*;
    use crate::render::footprint::splat::SplatKernel;
    use crate::render::tests::{cameras, cube};

    /// Returns the number of samples in a segment's pixel (x, y) of the face.
    fn sample_count(segment: &PackedSegment, x: u32, y: u32) -> u64 {
        segment.pixel(x - segment.x0, y - segment.y0).len() as u64
    }

    #[test]
    fn outcome_depends_on_rectangle_and_block() {
        // Three blocks across from the second on, two down from the second on.
        let visible = vec![true, false, true, false, true, false];
        let clipped = ClippedSegment {
            segment: 0,
            rectangle: [70..200, 20..40],
            visible,
        };
        let drawn = ClipOutcome::Drawn;
        let outside = ClipOutcome::OutsideRectangle;
        let hidden = ClipOutcome::HiddenBlock;
        let expected = [
            ([69, 25], outside),
            ([70, 19], outside),
            ([70, 20], drawn),
            ([127, 31], drawn),
            ([128, 31], hidden),
            ([192, 20], drawn),
            ([199, 31], drawn),
            ([200, 31], outside),
            ([127, 32], hidden),
            ([191, 39], drawn),
            ([192, 39], hidden),
            ([191, 40], outside),
        ];
        for ([x, y], outcome) in expected {
            assert_eq!(clipped.outcome(x, y), outcome, "pixel {x}, {y}");
        }
    }

    #[test]
    fn clipped_segments_agree_with_clip_counts() {
        let cube = cube();
        let mut renderer = Renderer::new();
        let settings = RenderSettings {
            band_rows: 37,
            ..RenderSettings::default()
        };
        for camera in cameras() {
            let counts = renderer.clip_counts(&cube, &camera, &settings);
            let mut drawn = 0;
            let mut left_out = 0;
            for clipped in renderer.clipped_segments(&cube, &camera, &settings) {
                let segment = &cube.segments[clipped.segment];
                for y in segment.y0..segment.y0 + segment.height {
                    let mut next = 0;
                    clipped.for_each_run(segment, y, |outcome, columns| {
                        assert_eq!(columns.start, next, "runs are consecutive");
                        assert!(!columns.is_empty() && columns.end <= segment.width);
                        next = columns.end;
                        for x in columns.map(|column| segment.x0 + column) {
                            assert_eq!(clipped.outcome(x, y), outcome, "pixel {x}, {y}");
                            let count = sample_count(segment, x, y);
                            if outcome == ClipOutcome::Drawn {
                                drawn += count;
                            } else {
                                left_out += count;
                            }
                        }
                    });
                    assert_eq!(next, segment.width, "no column is left out");
                }
            }
            assert!(left_out > 0 && drawn > 0);
            assert_eq!(drawn, counts.kept);
            assert!(left_out <= counts.culled + counts.clipped);
        }
    }

    #[test]
    fn overdraw_is_positive_where_splats_are_drawn() {
        let cube = cube();
        let mut renderer = Renderer::new();
        let settings = RenderSettings {
            kernel: SplatKernel::Opaque,
            keep_holes: true,
            ..RenderSettings::default()
        };
        let mut counted = 0;
        for camera in cameras() {
            // Three bands, the last one lower.
            let camera = Camera::from_parts(
                camera.eye(),
                camera.world_from_eye(),
                camera.focal_px(),
                61,
                2 * BAND_ROWS + 11,
            )
            .expect("valid");
            let overdraw = renderer.overdraw(&cube, &camera, &settings);
            let frame = renderer.render(&cube, &camera, &settings);
            assert_eq!(overdraw.len(), frame.color.len());
            for (i, (overdraw, coverage)) in overdraw.iter().zip(&frame.coverage).enumerate() {
                let pixel = (i % 61, i / 61);
                // A sample of almost no alpha has a footprint, but no coverage.
                assert!(
                    overdraw.footprints > 0 || coverage.splat_share() == 0,
                    "pixel {pixel:?}"
                );
                assert_eq!(
                    overdraw.footprints > 0,
                    overdraw.width_px > 0.0,
                    "pixel {pixel:?}"
                );
                counted += overdraw.footprints;
            }
            // The bands of a cropped frame begin at other rows.
            let rows = 29..2 * BAND_ROWS + 5;
            let cropped = camera.cropped(0..61, rows.clone()).expect("valid");
            let part = &overdraw[29 * 61..(2 * BAND_ROWS as usize + 5) * 61];
            let alone = renderer.overdraw(&cube, &cropped, &settings);
            // Positions are rounded from another principal point: a few footprints end a pixel
            // farther.
            let differing = alone
                .iter()
                .zip(part)
                .filter(|(alone, part)| alone != part)
                .count();
            assert!(
                alone.len() == part.len() && differing <= part.len() / 50,
                "rows {rows:?} alone: {differing} differ"
            );
        }
        assert!(counted > 1000, "{counted}");
    }

    #[test]
    fn inspection_is_independent_of_cube_position() {
        let mut renderer = Renderer::new();
        let settings = RenderSettings::default();
        let cube = cube();
        let offset = glam::DVec3::new(4.0, -2.0, 8.0);
        let mut moved_cube = cube.clone();
        moved_cube.info.centre = offset;
        for camera in cameras() {
            let moved_camera = camera.with_eye(camera.eye() + offset);
            assert_eq!(
                renderer.overdraw(&cube, &camera, &settings),
                renderer.overdraw(&moved_cube, &moved_camera, &settings)
            );
            assert_eq!(
                renderer.clipped_segments(&cube, &camera, &settings),
                renderer.clipped_segments(&moved_cube, &moved_camera, &settings)
            );
        }
    }
}
