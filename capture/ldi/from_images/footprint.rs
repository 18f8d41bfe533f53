//! One depth image, warped into a cube: every pixel covers the face pixels that its patch of surface covers (S12).
//!
//! The size of a pixel's footprint on a face follows from the ratio of resolutions there, tilt included: two steps on the
//! surface, to the next pixel to the right and to the one below, are two vectors on the face. If both are shorter than a
//! face pixel, the image is minified: the sample counts for the one pixel that it falls into, with the area that it covers
//! as its weight, and several are averaged. Otherwise the image is magnified: the parallelogram of the two vectors is filled,
//! so that neighbours leave no gap, and each face pixel gets the depth of the plane and the colour of the image at its own
//! position. Sixteen pixels of a row go together.

use super::on_face::{OnFace, home_faces};
use super::piles::{RowSamples, Sample, SparePiles};
use super::queue::Queue;
use super::surface::{LANES, Patches, Surfaces, encoded};
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
    /// The difference of inverse depths that counts as similar, 1/m: a sample is moved to the middle of its pixel by no more
    /// than half of it.
    pub(super) tolerance: f32,
    /// Standard deviation of the images' inverse depths, 1/m.
    pub(super) noise: f32,
    pub(super) level: Level,
}

/// Rows of an image that are warped together.
const ROWS: u32 = 32;

/// The widest footprint, face pixels: what is magnified more is seen from much nearer than it was recorded.
pub(super) const MAX_REACH_PX: f32 = 24.0;

/// Parallelograms are this much larger than half of a step to every side: those of neighbours overlap by a hair.
pub(super) const OVERLAP: f32 = 1.02;

/// Footprints that reach no farther from their middle than this are those of minified images: the middle of a pixel that one of them holds
/// is then within half a pixel of its sample, which falls into that pixel, so that no pixel is left out.
pub(super) const POINT_PX: f32 = 0.5 * OVERLAP;

/// Sixteen pixels of an image on their way.
struct Block {
    /// The first of them.
    x: u32,
    y: u32,
    /// What their samples have in common, wherever they fall.
    normals: [u32; LANES],
    weights: [f32; LANES],
    areas: [f32; LANES],
}

impl WarpTarget {
    /// Samples of an image, in piles of a few rows each.
    pub(super) fn warp(
        &self,
        view: &LoadedView,
        image: u32,
        spare: &SparePiles,
    ) -> Vec<RowSamples> {
        let height = view.size_px[1];
        let starts = (0..height).into_par_iter().step_by(ROWS as usize);
        starts
            .map(|start| {
                let mut pile = spare.pile(self.face_px, image);
                let rows = start..(start + ROWS).min(height);
                dispatch!(self.level, simd => self.warp_rows(simd, view, rows, &mut pile));
                pile
            })
            .collect()
    }

    #[inline(always)]
    fn warp_rows<S: Simd>(
        &self,
        simd: S,
        view: &LoadedView,
        rows: Range<u32>,
        pile: &mut RowSamples,
    ) {
        let mut surfaces = Surfaces::new(view, rows.clone(), self.centre, self.noise);
        let mut queue = Queue::new(view, pile);
        for y in rows.clone() {
            if y > rows.start {
                surfaces.next_row(y);
            }
            for x in (0..view.size_px[0]).step_by(LANES) {
                if let Some(patches) = surfaces.patches(simd, x, y) {
                    self.add(simd, &patches, [x, y], &mut queue);
                }
            }
        }
        queue.flush(simd);
    }

    /// Adds what sixteen pixels see, those from (x, y) on.
    #[inline(always)]
    fn add<S: Simd>(&self, simd: S, patches: &Patches<S>, [x, y]: [u32; 2], queue: &mut Queue<'_>) {
        let block = Block {
            x,
            y,
            normals: encoded(patches.normal).to_array(),
            weights: patches.weight.to_array(),
            areas: patches.area.to_array(),
        };
        let homes = home_faces(patches.point);
        let mut left = patches.known;
        while left != 0 {
            let home = homes.to_array()[left.trailing_zeros() as usize % LANES];
            let here = homes.simd_eq(home).to_bitmask() & left;
            left &= !here;
            let on_face = OnFace::new(simd, home, patches, self.face_px);
            let here = here & on_face.ahead;
            let reach = on_face.reach(OVERLAP);
            let points = reach[0].max(reach[1]).simd_le(POINT_PX).to_bitmask() & here;
            self.add_points(simd, &on_face, points, &block, queue);
            let filled = here & !points;
            if filled == 0 {
                continue;
            }
            self.fill(simd, &on_face, filled, &block, queue);
            // What reaches over the edge of its face is drawn on the neighbours as well.
            let beyond = on_face.reaching_over(reach, self.face_px) & filled;
            if beyond != 0 {
                for face in (0..6).filter(|face| face / 2 != home / 2) {
                    let on_face = OnFace::new(simd, face, patches, self.face_px);
                    self.fill(simd, &on_face, beyond & on_face.ahead, &block, queue);
                }
            }
        }
    }

    /// Minified samples, each in the one pixel that it falls into.
    #[inline(always)]
    fn add_points<S: Simd>(
        &self,
        simd: S,
        on_face: &OnFace<S>,
        mut lanes: u64,
        block: &Block,
        queue: &mut Queue<'_>,
    ) {
        if lanes == 0 {
            return;
        }
        let last = (self.face_px - 1) as f32;
        let zero = f32x16::splat(simd, 0.0);
        let [column, row] = [
            u32x16::truncate_from(on_face.at[0].max(0.0).min(last)),
            u32x16::truncate_from(on_face.at[1].max(0.0).min(last)),
        ];
        let offset = [
            f32x16::float_from(column) + 0.5 - on_face.at[0],
            f32x16::float_from(row) + 0.5 - on_face.at[1],
        ];
        let own = on_face.inverse_depth;
        let most = (own * 0.5).min(self.tolerance / 2.0);
        let shift = on_face.deeper(on_face.steps_to(offset));
        // A patch without area is not moved.
        let shift = on_face.regular.select(shift, zero).max(-most).min(most);
        let inverse_depth = (own + shift).to_array();
        let share = on_face.determinant.abs().max(1e-3).min(1.0).to_array();
        let (column, row) = (column.to_array(), row.to_array());
        while lanes != 0 {
            let i = lanes.trailing_zeros() as usize % LANES;
            lanes &= lanes - 1;
            let sample = block.sample(i, column[i], inverse_depth[i]);
            let sample = Sample {
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

    /// Magnified samples, each in every pixel whose middle its parallelogram holds.
    fn fill<S: Simd>(
        &self,
        simd: S,
        on_face: &OnFace<S>,
        lanes: u64,
        block: &Block,
        queue: &mut Queue<'_>,
    ) {
        simd.vectorize(
            #[inline(always)]
            || self.fill_at(simd, on_face, lanes, block, queue),
        );
    }

    #[inline(always)]
    fn fill_at<S: Simd>(
        &self,
        simd: S,
        on_face: &OnFace<S>,
        lanes: u64,
        block: &Block,
        queue: &mut Queue<'_>,
    ) {
        let lanes = lanes & on_face.regular.to_bitmask();
        let reach = on_face.reach(OVERLAP);
        let columns = Span::new(on_face.at[0], reach[0].min(MAX_REACH_PX), self.face_px);
        let rows = Span::new(on_face.at[1], reach[1].min(MAX_REACH_PX), self.face_px);
        let (most_columns, most_rows) = (columns.longest(lanes), rows.longest(lanes));
        for down in 0..most_rows {
            let row = rows.first + down;
            let offset_down = f32x16::float_from(row) + 0.5 - on_face.at[1];
            for across in 0..most_columns {
                let column = columns.first + across;
                let within = on_face.steps_to([
                    f32x16::float_from(column) + 0.5 - on_face.at[0],
                    offset_down,
                ]);
                let inverse_depth = on_face.inverse_depth + on_face.deeper(within);
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

impl Block {
    /// A sample of pixel `i`, without its colour.
    #[inline(always)]
    fn sample(&self, i: usize, column: u32, inverse_depth: f32) -> Sample {
        let normal = EncodedNormal::from_bits(self.normals[i]);
        Sample {
            column: column as u16,
            inverse_depth,
            normal,
            weight: self.weights[i],
            area: self.areas[i],
            ..Sample::NONE
        }
    }
}

/// The pixels along an axis of a face whose middles lie within the reach of footprints.
struct Span<S: Simd> {
    first: i32x16<S>,
    end: i32x16<S>,
}

impl<S: Simd> Span<S> {
    #[inline(always)]
    fn new(at: f32x16<S>, reach: f32x16<S>, face_px: u32) -> Self {
        Self {
            first: first_middle(at - reach, face_px),
            end: first_middle(at + reach, face_px),
        }
    }

    /// Of some lanes, how many pixels there are at most.
    #[inline(always)]
    fn longest(&self, lanes: u64) -> i32 {
        let counts = (self.end - self.first).to_array();
        let (mut longest, mut left) = (0, lanes);
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
