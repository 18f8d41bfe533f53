//! Scan conversion and depth test of a triangle: exact integers for coverage, `f32` for depth.
//!
//! With corners at multiples of 1/256 px, the edge function of an edge from a to b at the centre of
//! pixel (i, j) is `E = (b - a) x (p - a)`, an integer. From pixel to pixel it changes by multiples
//! of 256, so that E / 256, rounded down, has the same sign at every pixel and needs fewer bits.
//!
//! A centre on an edge is covered by both triangles that share the edge: no crack is left between
//! neighbours whose edges have the same ends. At a T-junction (a corner on the edge of a
//! neighbour), snapping opens cracks of up to 1.4/256 px, so meshes must be stitched
//! ([`Scene::stitch`](headbox_scene::scene::Scene::stitch)).

use super::SurfaceId;
use super::mesh::RasterMesh;
use super::view::{LocalCamera, SnappedVertex};
use super::weights::CornerWeights;
use super::{LANES, RasterStats};
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, i32x16, mask32x16, u32x16};
use headbox_core::image::triangle_scan::{EdgeFunction, pixels_between};
use std::ops::Range;

/// Rows of a frame that are being drawn.
pub(super) struct DrawnRows<'a> {
    /// Frame width, px.
    pub(super) width: u32,
    pub(super) rows: Range<u32>,
    pub(super) inverse_depth: &'a mut [f32],
    pub(super) surface: &'a mut [SurfaceId],
    /// The triangles that passed the depth test somewhere.
    pub(super) drawn: &'a mut Vec<DrawnTriangle>,
    pub(super) stats: RasterStats,
}

/// A triangle, and its bounding box in the target.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DrawnTriangle {
    pub(super) id: SurfaceId,
    pub(super) columns: Range<u32>,
    pub(super) rows: Range<u32>,
}

/// Alpha test of a triangle with a cut-out material.
#[derive(Clone, Copy)]
pub(super) struct CutoutTest<'a> {
    pub(super) mesh: &'a RasterMesh,
    pub(super) view: &'a LocalCamera,
    pub(super) primitive: u32,
}

impl CutoutTest<'_> {
    fn is_solid(&self, x: u32, y: u32) -> bool {
        let corners = self
            .mesh
            .corners(&self.mesh.triangles[self.primitive as usize]);
        let weights = CornerWeights::new(self.view, corners).evaluate(x, y);
        self.mesh
            .scene()
            .is_solid(self.primitive, weights.y, weights.z)
    }
}

/// E / 256 of an edge, rounded down, as a linear function of the pixel; a centre is inside where
/// the value is not negative.
#[derive(Clone, Copy)]
struct Edge {
    /// Value at the first pixel of the bounding box.
    start: i64,
    /// Change per column.
    column: i64,
    /// Change per row.
    row: i64,
}

impl Edge {
    #[inline(always)]
    fn new(a: SnappedVertex, b: SnappedVertex, pixel: [u32; 2]) -> Self {
        let edge = EdgeFunction::new([a.x, a.y], [b.x, b.y], pixel);
        Self {
            start: edge.value >> 8,
            column: edge.per_column,
            row: edge.per_row,
        }
    }

    /// Finds the first and the end of the columns, of `count`, that are inside the edge in a row
    /// with `value` at its first column.
    #[inline(always)]
    fn inside_columns(&self, value: i64, count: i64) -> [i64; 2] {
        match self.column {
            0 => [if value >= 0 { 0 } else { count }, count],
            up if up > 0 => [
                (-value).div_euclid(up) + i64::from((-value).rem_euclid(up) != 0),
                count,
            ],
            down => [0, value.div_euclid(-down) + 1],
        }
    }
}

/// 1 / eye depth over a triangle: linear in the frame, and clamped to the range of the corners, as
/// slivers may have any slope. Rows start in `f64`: on a floor a millimetre under the eye, the
/// corner may be 10^5 times nearer than the pixel.
struct DepthPlane {
    /// Value at the first corner.
    at_corner: f64,
    per_column: f64,
    per_row: f64,
    /// Offset from the first corner to the centre of pixel (0, 0), px.
    corner_offset: [f64; 2],
    range: [f32; 2],
}

impl DepthPlane {
    #[inline(always)]
    fn new([a, b, c]: [SnappedVertex; 3], twice_area: i64) -> Self {
        let per_area = 256.0 / twice_area as f64;
        let at_corner = f64::from(a.inverse_depth);
        let (qb, qc) = (
            f64::from(b.inverse_depth) - at_corner,
            f64::from(c.inverse_depth) - at_corner,
        );
        let apart = |p: i32, q: i32| f64::from(p) - f64::from(q);
        let q = [a.inverse_depth, b.inverse_depth, c.inverse_depth];
        let per_column = (qb * apart(c.y, a.y) - qc * apart(b.y, a.y)) * per_area;
        let per_row = (qc * apart(b.x, a.x) - qb * apart(c.x, a.x)) * per_area;
        Self {
            at_corner,
            per_column,
            per_row,
            corner_offset: [
                (128.0 - f64::from(a.x)) * (1.0 / 256.0),
                (128.0 - f64::from(a.y)) * (1.0 / 256.0),
            ],
            range: [q[0].min(q[1]).min(q[2]), q[0].max(q[1]).max(q[2])],
        }
    }

    /// Evaluates the plane at the centre of a pixel, without the clamp.
    #[inline(always)]
    fn evaluate(&self, x: u32, y: u32) -> f32 {
        let [dx, dy] = [
            f64::from(x) + self.corner_offset[0],
            f64::from(y) + self.corner_offset[1],
        ];
        ((self.at_corner + self.per_row * dy) + self.per_column * dx) as f32
    }

    /// Evaluates the plane `along` pixels to the right of a pixel with the value `first`.
    #[inline(always)]
    fn evaluate_lanes<S: Simd>(&self, first: f32, along: i32x16<S>) -> f32x16<S> {
        let [least, most] = self.range;
        (first + f32x16::float_from(along) * self.per_column as f32)
            .max(least)
            .min(most)
    }
}

/// Returns true if the new surface passes the depth test of a pixel; the new value and number come
/// first, then the stored ones. At equal depth the surface with the smaller number wins, in any
/// drawing order; markers have the largest numbers.
#[inline(always)]
fn is_nearer([value, stored]: [f32; 2], [id, stored_id]: [SurfaceId; 2]) -> bool {
    (value > stored) | ((value == stored) & (id.0 < stored_id.0))
}

/// Width in columns up to which all pixels of a triangle's bounding box are tested; for wider
/// triangles the ends of each row are computed. Over this width E / 256 fits into 32 bits: with
/// corners within [`GUARD_PX`](super::view::GUARD_PX), an edge is 2^14 by 2^23 units at most, and E
/// no more than 2^38.3 within 80 columns of the box's start.
const NARROW_PX: u32 = 64;

/// Index of each lane.
const LANE_NUMBERS: [i32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

impl DrawnRows<'_> {
    /// Draws a triangle of either orientation: surfaces have two sides.
    pub(super) fn triangle<S: Simd>(
        &mut self,
        simd: S,
        corners: [SnappedVertex; 3],
        id: SurfaceId,
        cutout: Option<CutoutTest>,
    ) {
        simd.vectorize(
            #[inline(always)]
            || self.triangle_at(simd, corners, id, cutout),
        );
    }

    #[inline(always)]
    fn triangle_at<S: Simd>(
        &mut self,
        simd: S,
        [a, mut b, mut c]: [SnappedVertex; 3],
        id: SurfaceId,
        cutout: Option<CutoutTest>,
    ) {
        let [left, right] = [a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x)];
        let [top, bottom] = [a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y)];
        let columns = pixels_between(left, right, &(0..self.width));
        let rows = pixels_between(top, bottom, &self.rows);
        if columns.start >= columns.end || rows.start >= rows.end {
            return;
        }
        let difference = |p: i32, q: i32| i64::from(p) - i64::from(q);
        let mut twice_area = difference(b.x, a.x) * difference(c.y, a.y)
            - difference(b.y, a.y) * difference(c.x, a.x);
        if twice_area == 0 {
            return;
        }
        if twice_area < 0 {
            (b, c, twice_area) = (c, b, -twice_area);
        }
        self.stats.triangles_set_up += 1;
        let edge =
            |a: SnappedVertex, b: SnappedVertex| Edge::new(a, b, [columns.start, rows.start]);
        let edges = [edge(a, b), edge(b, c), edge(c, a)];
        let plane = DepthPlane::new([a, b, c], twice_area);
        let is_narrow = right - left <= (NARROW_PX * 256) as i32;
        let before = self.stats.pixels_written;
        match cutout {
            None if is_narrow => self.scan_box(simd, &columns, &rows, edges, &plane, id),
            _ => self.scan_spans(simd, &columns, &rows, edges, &plane, id, cutout),
        }
        if self.stats.pixels_written > before {
            self.record(DrawnTriangle { id, columns, rows });
        }
    }

    /// Appends a triangle to `drawn`; consecutive parts of a clipped triangle become one entry.
    #[inline(always)]
    fn record(&mut self, drawn: DrawnTriangle) {
        match self.drawn.last_mut() {
            Some(last) if last.id == drawn.id => {
                last.columns = last.columns.start.min(drawn.columns.start)
                    ..last.columns.end.max(drawn.columns.end);
                last.rows =
                    last.rows.start.min(drawn.rows.start)..last.rows.end.max(drawn.rows.end);
            }
            _ => self.drawn.push(drawn),
        }
    }

    /// Tests all pixels of the bounding box, [`LANES`] at a time.
    #[inline(always)]
    fn scan_box<S: Simd>(
        &mut self,
        simd: S,
        columns: &Range<u32>,
        rows: &Range<u32>,
        edges: [Edge; 3],
        plane: &DepthPlane,
        id: SurfaceId,
    ) {
        let count = (columns.end - columns.start) as i32;
        let lane = i32x16::load_array_ref(simd, &LANE_NUMBERS);
        let mut written = 0;
        for (below, y) in (0..).zip(rows.clone()) {
            let first = plane.evaluate(columns.start, y);
            let row = (y - self.rows.start) as usize * self.width as usize + columns.start as usize;
            for done in (0..count).step_by(LANES) {
                let along = lane + done;
                // Negative right of the box: the pixels there may be those of the next row.
                let mut inside = (count - 1) - along;
                for edge in &edges {
                    let start =
                        (edge.start as i32).wrapping_add((edge.row as i32).wrapping_mul(below));
                    inside |= along * edge.column as i32 + start;
                }
                let covered = inside.simd_ge(0);
                if !covered.any_true() {
                    continue;
                }
                let value = plane.evaluate_lanes(first, along);
                written += self.depth_test(simd, row + done as usize, covered, value, id);
            }
        }
        self.stats.pixels_written += u64::from(written);
    }

    /// Tests and writes [`LANES`] pixels from index `start` on; returns the number of pixels
    /// written.
    #[inline(always)]
    fn depth_test<S: Simd>(
        &mut self,
        simd: S,
        start: usize,
        covered: mask32x16<S>,
        value: f32x16<S>,
        id: SurfaceId,
    ) -> u32 {
        let depths = self
            .inverse_depth
            .get_mut(start..)
            .and_then(<[f32]>::first_chunk_mut::<LANES>);
        let surfaces: &mut [u32] =
            bytemuck::cast_slice_mut(self.surface.get_mut(start..).unwrap_or_default());
        if let (Some(depths), Some(surfaces)) = (depths, surfaces.first_chunk_mut::<LANES>()) {
            let depth = f32x16::load_array_ref(simd, depths);
            let surface = u32x16::load_array_ref(simd, surfaces);
            let ours = u32x16::splat(simd, id.0);
            // Same as `is_nearer`.
            let nearer =
                covered & (value.simd_gt(depth) | (value.simd_eq(depth) & ours.simd_lt(surface)));
            *depths = nearer.select(value, depth).to_array();
            *surfaces = nearer.select(ours, surface).to_array();
            return nearer.to_bitmask().count_ones();
        }
        // The end of the band.
        let (covered, value) = (covered.to_bitmask(), value.to_array());
        let rest = self
            .inverse_depth
            .iter_mut()
            .zip(self.surface.iter_mut())
            .skip(start);
        let mut written = 0;
        for (lane, (depth, surface)) in rest.enumerate().take(LANES) {
            if covered >> lane & 1 == 1 && is_nearer([value[lane], *depth], [id, *surface]) {
                (*depth, *surface) = (value[lane], id);
                written += 1;
            }
        }
        written
    }

    /// Tests the covered span of each row.
    #[inline(always)]
    fn scan_spans<S: Simd>(
        &mut self,
        simd: S,
        columns: &Range<u32>,
        rows: &Range<u32>,
        mut edges: [Edge; 3],
        plane: &DepthPlane,
        id: SurfaceId,
        cutout: Option<CutoutTest>,
    ) {
        let count = i64::from(columns.end - columns.start);
        for y in rows.clone() {
            let (mut start, mut end) = (0, count);
            for edge in &mut edges {
                let [first, last] = edge.inside_columns(edge.start, count);
                (start, end) = (first.max(start), last.min(end));
                edge.start += edge.row;
            }
            if start < end {
                let columns = columns.start + start as u32..columns.start + end as u32;
                match cutout {
                    None => self.span(simd, columns, y, plane, id),
                    Some(cutout) => self.cutout_span(columns, y, plane, id, cutout),
                }
            }
        }
    }

    /// Tests and writes a span of covered pixels.
    #[inline(always)]
    fn span<S: Simd>(
        &mut self,
        simd: S,
        columns: Range<u32>,
        y: u32,
        plane: &DepthPlane,
        id: SurfaceId,
    ) {
        let lane = i32x16::load_array_ref(simd, &LANE_NUMBERS);
        let first = plane.evaluate(columns.start, y);
        let row = (y - self.rows.start) as usize * self.width as usize;
        let count = columns.len() as i32;
        let mut written = 0;
        for done in (0..count).step_by(LANES) {
            let along = lane + done;
            let start = row + columns.start as usize + done as usize;
            let value = plane.evaluate_lanes(first, along);
            written += self.depth_test(simd, start, along.simd_lt(count), value, id);
        }
        self.stats.pixels_written += u64::from(written);
    }

    /// Same as [`Self::span`] for a material with cut-outs.
    fn cutout_span(
        &mut self,
        columns: Range<u32>,
        y: u32,
        plane: &DepthPlane,
        id: SurfaceId,
        cutout: CutoutTest,
    ) {
        let start = (y - self.rows.start) as usize * self.width as usize;
        let run = start + columns.start as usize..start + columns.end as usize;
        let (Some(depths), Some(surfaces)) = (
            self.inverse_depth.get_mut(run.clone()),
            self.surface.get_mut(run),
        ) else {
            return;
        };
        let first = plane.evaluate(columns.start, y);
        let step = plane.per_column as f32;
        let [least, most] = plane.range;
        for (((k, x), depth), surface) in (0u32..).zip(columns).zip(depths).zip(surfaces) {
            let value = (first + step * k as f32).max(least).min(most);
            if is_nearer([value, *depth], [id, *surface]) && cutout.is_solid(x, y) {
                (*depth, *surface) = (value, id);
                self.stats.pixels_written += 1;
            }
        }
    }
}
