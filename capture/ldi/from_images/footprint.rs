//! Warps a depth image into a cube: a pixel fills the face pixels that its patch of surface covers
//! (S12).
//!
//! The size of a pixel's footprint on a face follows from the ratio of resolutions there, tilt
//! included: two steps on the surface, to the next pixel to the right and to the one below, are two
//! vectors on the face. If both are shorter than a face pixel, the image is minified: the sample
//! counts for the one pixel that it falls into, weighted by the area that it covers, and several
//! are averaged. Otherwise the image is magnified: the parallelogram of the two vectors is filled,
//! so that neighbours leave no gap, and each face pixel gets the depth of the plane and the colour
//! of the image at its own position. Sixteen pixels of a row are processed together.

use super::color_queue::ColorQueue;
use super::depth_rows::{DepthRows, LANES, SurfacePatches, encode_normals};
use super::face_patches::{FacePatches, home_faces};
use super::row_samples::{ImageSample, RowSamplePool, RowSamples};
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16, i32x16, u32x16};
use glam::DVec3;
use headbox_cube::model::samples::EncodedNormal;
use headbox_images::LoadedView;
use rayon::prelude::*;
use std::ops::Range;

/// A cube that images are warped into.
#[derive(Clone, Copy, Debug)]
pub(super) struct WarpTarget {
    /// World metres.
    pub(super) centre: DVec3,
    pub(super) face_px: u32,
    /// Difference of inverse depths that counts as similar, 1/m. Moving a sample to the middle of
    /// its pixel changes its inverse depth by at most half of it.
    pub(super) tolerance: f32,
    /// Standard deviation of the images' inverse depths, 1/m.
    pub(super) noise: f32,
    pub(super) level: Level,
}

/// Number of rows of an image that are warped together.
const ROWS: u32 = 32;

/// Maximum reach of a footprint, face pixels. Surfaces magnified more are seen from much nearer
/// than they were recorded.
pub(super) const MAX_REACH_PX: f32 = 24.0;

/// Enlargement of parallelograms, so that those of neighbours overlap slightly.
pub(super) const OVERLAP: f32 = 1.02;

/// Maximum reach of footprints of minified images: if one contains the middle of a pixel, its
/// sample is within half a pixel of that middle and falls into that pixel, so that no pixel is left
/// out.
pub(super) const POINT_PX: f32 = 0.5 * OVERLAP;

/// Sixteen pixels of an image that are being warped.
struct PixelBlock {
    /// Column of the first pixel.
    x: u32,
    y: u32,
    /// Encoded normals.
    normals: [u32; LANES],
    weights: [f32; LANES],
    areas: [f32; LANES],
}

impl WarpTarget {
    /// Warps an image. Returns the samples of every few rows.
    pub(super) fn warp(
        &self,
        view: &LoadedView,
        image: u32,
        pool: &RowSamplePool,
    ) -> Vec<RowSamples> {
        let height = view.size_px[1];
        let starts = (0..height).into_par_iter().step_by(ROWS as usize);
        starts
            .map(|start| {
                let mut samples = pool.take(self.face_px, image);
                let rows = start..(start + ROWS).min(height);
                dispatch!(self.level, simd => self.warp_rows(simd, view, rows, &mut samples));
                samples
            })
            .collect()
    }

    #[inline(always)]
    fn warp_rows<S: Simd>(
        &self,
        simd: S,
        view: &LoadedView,
        rows: Range<u32>,
        samples: &mut RowSamples,
    ) {
        let mut depth_rows = DepthRows::new(view, rows.clone(), self.centre, self.noise);
        let mut queue = ColorQueue::new(view, samples);
        for y in rows.clone() {
            if y > rows.start {
                depth_rows.next_row(y);
            }
            for x in (0..view.size_px[0]).step_by(LANES) {
                if let Some(patches) = depth_rows.patches(simd, x, y) {
                    self.add(simd, &patches, [x, y], &mut queue);
                }
            }
        }
        queue.flush(simd);
    }

    /// Adds the samples of sixteen pixels from (x, y) on.
    #[inline(always)]
    fn add<S: Simd>(
        &self,
        simd: S,
        patches: &SurfacePatches<S>,
        [x, y]: [u32; 2],
        queue: &mut ColorQueue<'_>,
    ) {
        let block = PixelBlock {
            x,
            y,
            normals: encode_normals(patches.normal).to_array(),
            weights: patches.weight.to_array(),
            areas: patches.area.to_array(),
        };
        let homes = home_faces(patches.point);
        let mut left = patches.known;
        while left != 0 {
            let home = homes.to_array()[left.trailing_zeros() as usize % LANES];
            let here = homes.simd_eq(home).to_bitmask() & left;
            left &= !here;
            let on_face = FacePatches::new(simd, home, patches, self.face_px);
            let here = here & on_face.ahead;
            let reach = on_face.reach(OVERLAP);
            let points = reach[0].max(reach[1]).simd_le(POINT_PX).to_bitmask() & here;
            self.add_points(simd, &on_face, points, &block, queue);
            let filled = here & !points;
            if filled == 0 {
                continue;
            }
            self.fill(simd, &on_face, filled, &block, queue);
            // Footprints over the edge of their face are drawn on its neighbours as well.
            let overlapping = on_face.reaching_over(reach, self.face_px) & filled;
            if overlapping != 0 {
                for face in (0..6).filter(|face| face / 2 != home / 2) {
                    let on_face = FacePatches::new(simd, face, patches, self.face_px);
                    self.fill(simd, &on_face, overlapping & on_face.ahead, &block, queue);
                }
            }
        }
    }

    /// Adds minified samples, each to the one pixel that it falls into.
    #[inline(always)]
    fn add_points<S: Simd>(
        &self,
        simd: S,
        on_face: &FacePatches<S>,
        mut lanes: u64,
        block: &PixelBlock,
        queue: &mut ColorQueue<'_>,
    ) {
        if lanes == 0 {
            return;
        }
        let last = (self.face_px - 1) as f32;
        let zero = f32x16::splat(simd, 0.0);
        let [column, row] = [
            u32x16::truncate_from(on_face.position[0].max(0.0).min(last)),
            u32x16::truncate_from(on_face.position[1].max(0.0).min(last)),
        ];
        let offset = [
            f32x16::float_from(column) + 0.5 - on_face.position[0],
            f32x16::float_from(row) + 0.5 - on_face.position[1],
        ];
        let own = on_face.inverse_depth;
        let most = (own * 0.5).min(self.tolerance / 2.0);
        let shift = on_face.inverse_depth_change(on_face.steps_to(offset));
        // Patches without area are not moved.
        let shift = on_face.regular.select(shift, zero).max(-most).min(most);
        let inverse_depth = (own + shift).to_array();
        let share = on_face.determinant.abs().max(1e-3).min(1.0).to_array();
        let (column, row) = (column.to_array(), row.to_array());
        while lanes != 0 {
            let i = lanes.trailing_zeros() as usize % LANES;
            lanes &= lanes - 1;
            let sample = block.sample(i, column[i], inverse_depth[i]);
            let sample = ImageSample {
                weight: sample.weight * share[i],
                ..sample
            };
            let row = on_face.face * self.face_px + row[i];
            queue.add(
                simd,
                row,
                sample,
                [(block.x + i as u32) as f32, block.y as f32],
            );
        }
    }

    /// Adds magnified samples, each to every pixel whose middle its parallelogram contains.
    fn fill<S: Simd>(
        &self,
        simd: S,
        on_face: &FacePatches<S>,
        lanes: u64,
        block: &PixelBlock,
        queue: &mut ColorQueue<'_>,
    ) {
        simd.vectorize(
            #[inline(always)]
            || self.fill_inlined(simd, on_face, lanes, block, queue),
        );
    }

    #[inline(always)]
    fn fill_inlined<S: Simd>(
        &self,
        simd: S,
        on_face: &FacePatches<S>,
        lanes: u64,
        block: &PixelBlock,
        queue: &mut ColorQueue<'_>,
    ) {
        let lanes = lanes & on_face.regular.to_bitmask();
        let reach = on_face.reach(OVERLAP);
        let columns = PixelSpan::new(
            on_face.position[0],
            reach[0].min(MAX_REACH_PX),
            self.face_px,
        );
        let rows = PixelSpan::new(
            on_face.position[1],
            reach[1].min(MAX_REACH_PX),
            self.face_px,
        );
        let most_columns = columns.longest(lanes);
        let most_rows = rows.longest(lanes);
        for down in 0..most_rows {
            let row = rows.first + down;
            let offset_down = f32x16::float_from(row) + 0.5 - on_face.position[1];
            for across in 0..most_columns {
                let column = columns.first + across;
                let within = on_face.steps_to([
                    f32x16::float_from(column) + 0.5 - on_face.position[0],
                    offset_down,
                ]);
                let inverse_depth = on_face.inverse_depth + on_face.inverse_depth_change(within);
                let inside = within[0].abs().max(within[1].abs()).simd_le(0.5 * OVERLAP)
                    & inverse_depth.simd_gt(0.0)
                    & column.simd_lt(columns.end)
                    & row.simd_lt(rows.end);
                let mut inside = inside.to_bitmask() & lanes;
                if inside == 0 {
                    continue;
                }
                let [x, y] = [within[0].to_array(), within[1].to_array()];
                let (row, column) = (row.to_array(), column.to_array());
                let inverse_depth = inverse_depth.to_array();
                while inside != 0 {
                    let i = inside.trailing_zeros() as usize % LANES;
                    inside &= inside - 1;
                    let sample = block.sample(i, column[i] as u32, inverse_depth[i]);
                    let row = on_face.face * self.face_px + row[i] as u32;
                    let position = [(block.x + i as u32) as f32 + x[i], block.y as f32 + y[i]];
                    queue.add(simd, row, sample, position);
                }
            }
        }
    }
}

impl PixelBlock {
    /// A sample of pixel `i`, without its colour.
    #[inline(always)]
    fn sample(&self, i: usize, column: u32, inverse_depth: f32) -> ImageSample {
        let normal = EncodedNormal::from_bits(self.normals[i]);
        ImageSample {
            column: column as u16,
            inverse_depth,
            normal,
            weight: self.weights[i],
            area: self.areas[i],
            ..ImageSample::NONE
        }
    }
}

/// Pixels along an axis of a face whose middles lie within the reach of footprints.
struct PixelSpan<S: Simd> {
    first: i32x16<S>,
    end: i32x16<S>,
}

impl<S: Simd> PixelSpan<S> {
    #[inline(always)]
    fn new(middle: f32x16<S>, reach: f32x16<S>, face_px: u32) -> Self {
        Self {
            first: first_middle(middle - reach, face_px),
            end: first_middle(middle + reach, face_px),
        }
    }

    /// Maximum number of pixels in some lanes.
    #[inline(always)]
    fn longest(&self, lanes: u64) -> i32 {
        let counts = (self.end - self.first).to_array();
        let mut longest = 0;
        let mut left = lanes;
        while left != 0 {
            longest = longest.max(counts[left.trailing_zeros() as usize % LANES]);
            left &= left - 1;
        }
        longest
    }
}

/// The first pixel of a face whose middle is not before a position.
#[inline(always)]
fn first_middle<S: Simd>(position: f32x16<S>, face_px: u32) -> i32x16<S> {
    let first = (position - 0.5).ceil();
    // False for NaN.
    let first = first
        .simd_gt(0.0)
        .select(first, f32x16::splat(first.token(), 0.0));
    i32x16::truncate_from(first.min(face_px as f32))
}
