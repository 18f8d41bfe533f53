//! How a frame is made, for overlays that show it: what happens at each pixel, and what clipping leaves out. A second, slow
//! pass over the same plan as the frame's; the renderer itself knows nothing of it.

use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::pack::{PackedCube, PackedDepthPixel, PackedSegment};
use crate::render::canvas::touched::{Touched, touch};
use crate::render::footprint::size::Size;
use crate::render::footprint::splat::Splats;
use crate::render::parallel::band::{Clipped, ForSegment, Scope};
use crate::render::setup::clip::{Band, BlockClip};
use crate::render::setup::order;
use crate::render::traverse::batches;
use crate::render::traverse::batches::{Batch, SegmentPart, Uncut};
use crate::render::traverse::format::Format;
use crate::render::warp::batch::SegmentWarp;
use crate::render::{FramePlan, RenderSettings, Renderer, SegmentPlan};
use headbox_core::camera::Camera;
use rayon::prelude::*;
use std::ops::Range;

/// What clipping leaves of a segment for a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept {
    /// Which of the cube's segments.
    pub segment: usize,
    /// Columns and rows of the face that the planes of the view leave; empty if they leave nothing.
    rectangle: [Range<u32>; 2],
    /// Of each block that the rectangle touches, row-major, whether it is drawn.
    visible: Vec<bool>,
}

/// What becomes of a pixel of a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// Its samples are drawn.
    Drawn,
    /// It lies outside of the rectangle that the planes of the view cut out of its segment (C15).
    OutsideRectangle,
    /// It lies in a block that is wholly outside of the view (C17).
    HiddenBlock,
}

impl Kept {
    /// What becomes of the pixel in column `x` and row `y` of the face.
    pub fn fate(&self, x: u32, y: u32) -> Fate {
        let [columns, rows] = &self.rectangle;
        if !columns.contains(&x) || !rows.contains(&y) {
            return Fate::OutsideRectangle;
        }
        let first = columns.start / BLOCK_COLUMNS;
        let blocks = columns.end.div_ceil(BLOCK_COLUMNS) - first;
        let block = (y / BLOCK_ROWS - rows.start / BLOCK_ROWS) * blocks + x / BLOCK_COLUMNS - first;
        if self
            .visible
            .get(block as usize)
            .is_some_and(|visible| *visible)
        {
            Fate::Drawn
        } else {
            Fate::HiddenBlock
        }
    }

    /// Calls `visit` for each run of the segment's columns in a row that share a fate: with their fate, and their columns
    /// counted from the segment's first.
    pub fn for_each_run(
        &self,
        segment: &PackedSegment,
        y: u32,
        mut visit: impl FnMut(Fate, Range<u32>),
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
            visit(self.fate(x, y), x - segment.x0..next - segment.x0);
            x = next;
        }
    }
}

/// Rows of a band, the work of one thread at a time. Any number counts the same.
const BAND_ROWS: u32 = 48;

impl Renderer {
    /// What happens at each pixel, row by row, when a camera looks at a cube; drawn on the current rayon thread pool.
    pub fn touched(
        &mut self,
        cube: &PackedCube,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> Vec<Touched> {
        self.plan_for(cube, camera, settings);
        let (plan, [width, height]) = (&self.plan, [camera.width(), camera.height()]);
        let mut touched = vec![Touched::default(); width as usize * height as usize];
        let bands = touched
            .par_chunks_mut(width as usize * BAND_ROWS as usize)
            .enumerate()
            .with_max_len(1);
        bands.for_each(|(i, pixels)| {
            let start = i as u32 * BAND_ROWS;
            let band = band_of(camera, start..start.saturating_add(BAND_ROWS).min(height));
            let (batch, splats) = (Box::new(Batch::new()), Box::new(Splats::new()));
            plan.for_each_segment(
                cube,
                &mut Touching {
                    plan,
                    band: &band,
                    pixels,
                    batch,
                    splats,
                },
            );
        });
        touched
    }

    /// What clipping leaves of each segment when a camera looks at a cube.
    pub fn kept(
        &mut self,
        cube: &PackedCube,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> Vec<Kept> {
        self.plan_for(cube, camera, settings);
        let band = band_of(camera, 0..camera.height());
        let mut keeping = Keeping {
            plan: &self.plan,
            band: &band,
            kept: Vec::new(),
        };
        self.plan.for_each_segment(cube, &mut keeping);
        keeping.kept
    }

    fn plan_for(&mut self, cube: &PackedCube, camera: &Camera, settings: &RenderSettings) {
        order::segment_order(
            &cube.segments,
            camera.eye() - cube.info.centre,
            &mut self.order,
        );
        self.plan.prepare(cube, camera, settings, &self.order);
    }
}

fn band_of(camera: &Camera, rows: Range<u32>) -> Band {
    Band {
        width: camera.width(),
        height: camera.height(),
        principal_px: camera.principal_px(),
        rows,
    }
}

/// What clipping leaves of a segment in a band.
fn keep<S: Size>(
    plan: &FramePlan,
    band: &Band,
    of_frame: &SegmentPlan,
    segment: &PackedSegment,
    size: &S,
) -> Kept {
    let clip = BlockClip {
        transfer: &of_frame.transfer,
        segment,
        band,
        face_px: plan.face_px,
    };
    let mut visible = Vec::new();
    let rectangle = Clipped {
        unclipped: plan.unclipped,
    }
    .part(0, &clip, size, &mut visible);
    let rectangle = rectangle.unwrap_or([segment.x0..segment.x0, segment.y0..segment.y0]);
    Kept {
        segment: of_frame.index,
        rectangle,
        visible,
    }
}

/// Collects what is kept of all segments.
struct Keeping<'a> {
    plan: &'a FramePlan,
    band: &'a Band,
    kept: Vec<Kept>,
}

impl ForSegment for Keeping<'_> {
    fn segment<S: Size>(
        &mut self,
        _: usize,
        of_frame: &SegmentPlan,
        segment: &PackedSegment,
        size: &S,
    ) {
        self.kept
            .push(keep(self.plan, self.band, of_frame, segment, size));
    }
}

/// Counts the footprints of all segments in a band.
struct Touching<'a> {
    plan: &'a FramePlan,
    band: &'a Band,
    pixels: &'a mut [Touched],
    batch: Box<Batch<PackedDepthPixel>>,
    splats: Box<Splats>,
}

impl ForSegment for Touching<'_> {
    fn segment<S: Size>(
        &mut self,
        _: usize,
        of_frame: &SegmentPlan,
        segment: &PackedSegment,
        size: &S,
    ) {
        let Self {
            plan,
            band,
            pixels,
            batch,
            splats,
        } = self;
        let Kept {
            rectangle: [columns, rows],
            visible,
            ..
        } = keep(plan, band, of_frame, segment, size);
        if visible.is_empty() {
            return;
        }
        let part = SegmentPart {
            segment,
            depth_pixels: &segment.depth_pixels,
            columns,
            rows,
            visible: &visible,
        };
        let warp = SegmentWarp::new(
            &of_frame.transfer,
            PackedDepthPixel::scale(segment),
            band,
            plan.level,
        );
        let own = plan.kernel.own_share();
        batches::traverse(
            &part,
            &Uncut,
            &of_frame.eye,
            of_frame.layers,
            batch,
            &mut |batch| {
                warp.warp(batch, size, splats);
                touch(pixels, band.width, &band.rows, splats, own);
            },
        );
    }
}

#[cfg(test)]
mod tests {
    //! What overlays tell of a frame, against the frame itself and what clipping counts.

    use super::*;
    use crate::render::tests::{cameras, cube};
    use crate::render::{RenderSettings, SplatKernel};

    /// Samples of a segment's pixel (x, y) of the face.
    fn samples(segment: &PackedSegment, x: u32, y: u32) -> u64 {
        segment.pixel(x - segment.x0, y - segment.y0).len() as u64
    }

    #[test]
    fn a_pixels_fate_is_that_of_its_block_within_the_rectangle() {
        // Three blocks across from the second on, two down from the second on.
        let visible = vec![true, false, true, false, true, false];
        let kept = Kept {
            segment: 0,
            rectangle: [70..200, 20..40],
            visible,
        };
        let (drawn, outside, hidden) = (Fate::Drawn, Fate::OutsideRectangle, Fate::HiddenBlock);
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
        for ([x, y], fate) in expected {
            assert_eq!(kept.fate(x, y), fate, "pixel {x}, {y}");
        }
    }

    #[test]
    fn what_is_kept_is_what_clipping_counts_and_runs_say_the_same() {
        let (cube, mut renderer) = (cube(), Renderer::new());
        let settings = RenderSettings {
            band_rows: 37,
            ..RenderSettings::default()
        };
        for camera in cameras() {
            let counts = renderer.clip_counts(&cube, &camera, &settings);
            let mut found = [0u64; 2];
            for kept in renderer.kept(&cube, &camera, &settings) {
                let segment = &cube.segments[kept.segment];
                for y in segment.y0..segment.y0 + segment.height {
                    let mut next = 0;
                    kept.for_each_run(segment, y, |fate, columns| {
                        assert_eq!(columns.start, next, "runs follow each other");
                        assert!(!columns.is_empty() && columns.end <= segment.width);
                        next = columns.end;
                        for x in columns.map(|column| segment.x0 + column) {
                            assert_eq!(kept.fate(x, y), fate, "pixel {x}, {y}");
                            found[usize::from(fate == Fate::Drawn)] += samples(segment, x, y);
                        }
                    });
                    assert_eq!(next, segment.width, "no column is left out");
                }
            }
            let [left_out, drawn] = found;
            assert!(left_out > 0 && drawn > 0);
            // What lies in segments that nothing of is kept is not among the kept.
            assert_eq!(drawn, counts.kept);
            assert!(left_out <= counts.culled + counts.clipped);
        }
    }

    #[test]
    fn footprints_are_counted_wherever_rectangles_are_drawn_in_any_band() {
        let (cube, mut renderer) = (cube(), Renderer::new());
        let settings = RenderSettings {
            kernel: SplatKernel::Opaque,
            keep_holes: true,
            ..RenderSettings::default()
        };
        let mut counted = 0;
        for camera in cameras() {
            // Three bands, the last of them lower.
            let (eye, turn, focal_px) = (camera.eye(), camera.world_from_eye(), camera.focal_px());
            let camera =
                Camera::from_parts(eye, turn, focal_px, 61, 2 * BAND_ROWS + 11).expect("valid");
            let touched = renderer.touched(&cube, &camera, &settings);
            let frame = renderer.render(&cube, &camera, &settings);
            assert_eq!(touched.len(), frame.color.len());
            for (i, (touched, coverage)) in touched.iter().zip(&frame.coverage).enumerate() {
                let place = (i % 61, i / 61);
                // A sample of hardly any alpha has a footprint, and leaves nothing.
                assert!(
                    touched.footprints > 0 || coverage.splat_share() == 0,
                    "pixel {place:?}"
                );
                assert_eq!(
                    touched.footprints > 0,
                    touched.width_px > 0.0,
                    "pixel {place:?}"
                );
                counted += touched.footprints;
            }
            // Bands of another frame lie elsewhere.
            let rows = 29..2 * BAND_ROWS + 5;
            let cropped = camera.cropped(0..61, rows.clone()).expect("valid");
            let part = &touched[29 * 61..(2 * BAND_ROWS as usize + 5) * 61];
            let alone = renderer.touched(&cube, &cropped, &settings);
            // Positions are rounded from another corner, so that a rare footprint ends a pixel farther.
            let others = alone
                .iter()
                .zip(part)
                .filter(|(alone, part)| alone != part)
                .count();
            assert!(
                alone.len() == part.len() && others <= part.len() / 50,
                "rows {rows:?} alone: {others} differ"
            );
        }
        assert!(counted > 1000, "{counted}");
    }

    #[test]
    fn overlays_are_the_same_wherever_the_cube_stands() {
        let (here, mut renderer, settings) = (cube(), Renderer::new(), RenderSettings::default());
        let (mut there, moved) = (here.clone(), glam::DVec3::new(4.0, -2.0, 8.0));
        there.info.centre = moved;
        for camera in cameras() {
            let beside = camera.with_eye(camera.eye() + moved);
            assert_eq!(
                renderer.touched(&here, &camera, &settings),
                renderer.touched(&there, &beside, &settings)
            );
            assert_eq!(
                renderer.kept(&here, &camera, &settings),
                renderer.kept(&there, &beside, &settings)
            );
        }
    }
}
