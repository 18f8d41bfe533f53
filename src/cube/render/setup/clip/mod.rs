//! Clipping of a segment against a band of the frame (S23, C15, C17).
//!
//! In the LDI's projective coordinates (x, y on the face, inverse depth q) a segment is a box, and
//! every plane of the view volume is linear: the transfer's homogeneous position h(x, y, q) is, and
//! a point is visible only if `|X| <= W/2 * w`, and so on.

#[cfg(test)]
mod tests;

use super::transfer::Transfer;
use crate::pack::PackedSegment;
use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::render::footprint::size::SegmentSize;
use glam::{DMat3, DVec3};
use headbox_core::camera::Camera;
use std::ops::Range;

/// Least w = Z2 / Z1 that is drawn (C8: w > 0 alone lets splats grow without bound). At it, a
/// sample is 1,024 times nearer to the eye than to the centre, and f32 has lost 10 of its 24 bits.
pub(crate) const W_NEAR: f32 = 1.0 / 1024.0;

/// A band: consecutive rows of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Band {
    /// Frame width, px.
    pub width: u32,
    /// Frame height, px.
    pub height: u32,
    /// Principal point, px.
    pub principal_px: [f64; 2],
    /// Rows of the band, row 0 at the top.
    pub rows: Range<u32>,
}

impl Band {
    /// Creates a band of a camera's frame.
    pub fn new(camera: &Camera, rows: Range<u32>) -> Self {
        Self {
            width: camera.width(),
            height: camera.height(),
            principal_px: camera.principal_px(),
            rows,
        }
    }

    /// Returns the left, right, upper and lower bound from the principal point, px, widened by a
    /// radius.
    fn bounds_px(&self, radius_px: f64) -> [f64; 4] {
        let [x, y] = self.principal_px;
        let right = f64::from(self.width) - x;
        let bottom = f64::from(self.rows.end) - y;
        [
            -x - radius_px,
            right + radius_px,
            f64::from(self.rows.start) - y - radius_px,
            bottom + radius_px,
        ]
    }

    /// Returns width and height of the smallest frame centred on the principal point that contains
    /// this one.
    fn centred_size(&self) -> [u32; 2] {
        let [x, y] = self.principal_px;
        [(x, self.width), (y, self.height)]
            .map(|(c, size)| (2.0 * c.abs().max((f64::from(size) - c).abs())).ceil() as u32)
    }
}

/// A half space of LDI coordinates: the points (x, y, q) with `normal . (x, y, q) + offset >= 0`.
#[derive(Clone, Copy, Debug)]
struct HalfSpace {
    normal: DVec3,
    offset: f64,
}

impl HalfSpace {
    fn evaluate(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.offset
    }

    /// Converts to the coordinates of a box, 0..1 along each axis, scaled so that the largest
    /// coefficient is 1.
    fn to_box(self, [low, high]: [DVec3; 2]) -> Self {
        let normal = self.normal * (high - low);
        let offset = self.evaluate(low);
        let scale = normal
            .abs()
            .max_element()
            .max(offset.abs())
            .max(f64::MIN_POSITIVE);
        Self {
            normal: normal / scale,
            offset: offset / scale,
        }
    }
}

/// Returns the five half spaces outside of which a splat of `radius_px` cannot touch the band.
fn view_half_spaces(transfer: &Transfer, band: &Band, radius_px: f64) -> [HalfSpace; 5] {
    let [left, right, top, bottom] = band.bounds_px(radius_px);
    // h . coefficients >= limit
    let side = |coefficients: DVec3, limit: f64| HalfSpace {
        normal: DVec3::from(
            [transfer.x_step, transfer.y_step, transfer.inverse_depth]
                .map(|column| coefficients.dot(column)),
        ),
        offset: coefficients.dot(transfer.one) - limit,
    };
    [
        side(DVec3::new(1.0, 0.0, -left), 0.0),
        side(DVec3::new(-1.0, 0.0, right), 0.0),
        side(DVec3::new(0.0, 1.0, -top), 0.0),
        side(DVec3::new(0.0, -1.0, bottom), 0.0),
        side(DVec3::Z, f64::from(W_NEAR)),
    ]
}

/// Returns a segment's box; at least a millionth deep, so that a flat one has an interior.
fn segment_box(segment: &PackedSegment) -> [DVec3; 2] {
    let q_min = f64::from(segment.inverse_depth_min);
    let q_max = f64::from(segment.inverse_depth_max);
    let end = |start: u32, length: u32| f64::from(start) + f64::from(length);
    [
        DVec3::new(
            f64::from(segment.x0),
            f64::from(segment.y0),
            q_min * (1.0 - 1e-6),
        ),
        DVec3::new(
            end(segment.x0, segment.width),
            end(segment.y0, segment.height),
            q_max * (1.0 + 1e-6),
        ),
    ]
}

/// Returns the columns and rows of a segment, clipped to a face of `face_px`.
pub(crate) fn face_rectangle(segment: &PackedSegment, face_px: u32) -> [Range<u32>; 2] {
    let clip =
        |start: u32, length: u32| start.min(face_px)..start.saturating_add(length).min(face_px);
    [
        clip(segment.x0, segment.width),
        clip(segment.y0, segment.height),
    ]
}

/// Returns the number of blocks that a rectangle touches.
fn block_count([columns, rows]: &[Range<u32>; 2]) -> usize {
    let blocks = |range: &Range<u32>, length: u32| {
        (range.end.div_ceil(length) - range.start / length) as usize
    };
    blocks(columns, BLOCK_COLUMNS) * blocks(rows, BLOCK_ROWS)
}

/// Returns the columns and rows of the face, inside the segment's rectangle, that contain all
/// samples whose splats of at most `radius_px` can touch the band; `None` if there are none.
///
/// Exact (C15): the bounding rectangle of the vertices of the box cut by the five half spaces.
fn clip_rectangle(
    transfer: &Transfer,
    segment: &PackedSegment,
    band: &Band,
    radius_px: f64,
) -> Option<[Range<u32>; 2]> {
    let bounds @ [low, high] = segment_box(segment);
    let views =
        view_half_spaces(transfer, band, radius_px).map(|half_space| half_space.to_box(bounds));
    let outside = |half_space: &HalfSpace| {
        half_space.normal.max(DVec3::ZERO).element_sum() + half_space.offset < 0.0
    };
    if views.iter().any(outside) {
        return None;
    }
    let [min, max] = vertex_bounds(&views)?;
    let size = high - low;
    let clip = |axis: usize, start: u32, length: u32| {
        let end = start.saturating_add(length);
        let first = (low[axis] + min[axis] * size[axis]).floor().max(0.0) as u32;
        let last = (low[axis] + max[axis] * size[axis]).ceil().max(0.0) as u32;
        // One more on both sides: tolerances of the vertices are far below a pixel.
        first.saturating_sub(1).clamp(start, end)..last.saturating_add(1).clamp(start, end)
    };
    let ranges = [
        clip(0, segment.x0, segment.width),
        clip(1, segment.y0, segment.height),
    ];
    ranges
        .iter()
        .all(|range| !range.is_empty())
        .then_some(ranges)
}

/// Returns the bounds of the part of the unit cube that lies in five (scaled) half spaces: of all
/// points where three of the eleven planes meet and that lie inside all eleven.
fn vertex_bounds(views: &[HalfSpace; 5]) -> Option<[DVec3; 2]> {
    const TOLERANCE: f64 = 1e-7;
    let cube = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
        [
            HalfSpace {
                normal: axis,
                offset: 0.0,
            },
            HalfSpace {
                normal: -axis,
                offset: 1.0,
            },
        ]
    });
    let mut planes = [views[0]; 11];
    planes[..5].copy_from_slice(views);
    planes[5..]
        .iter_mut()
        .zip(cube.into_iter().flatten())
        .for_each(|(slot, plane)| *slot = plane);
    let mut bounds: Option<[DVec3; 2]> = None;
    for i in 0..planes.len() {
        for j in 0..i {
            for k in 0..j {
                let [a, b, c] = [planes[i], planes[j], planes[k]];
                let rows = DMat3::from_cols(a.normal, b.normal, c.normal).transpose();
                if rows.determinant().abs() < 1e-12 {
                    continue;
                }
                let vertex = rows.inverse() * -DVec3::new(a.offset, b.offset, c.offset);
                if planes
                    .iter()
                    .all(|plane| plane.evaluate(vertex) >= -TOLERANCE)
                {
                    let [low, high] = bounds.unwrap_or([vertex; 2]);
                    bounds = Some([low.min(vertex), high.max(vertex)]);
                }
            }
        }
    }
    bounds
}

/// Clipping of one segment against a band: first its rectangle of face pixels, then block by block.
pub struct SegmentClip<'a> {
    pub(crate) transfer: &'a Transfer,
    pub(crate) segment: &'a PackedSegment,
    pub(crate) band: &'a Band,
    /// Face size, px.
    pub(crate) face_px: u32,
    pub(crate) size: SegmentSize<'a>,
    /// Keeps everything: see
    /// [`RenderSettings::unclipped`](crate::render::RenderSettings::unclipped).
    pub(crate) unclipped: bool,
}

impl SegmentClip<'_> {
    /// Returns the columns and rows of the face that can touch the band, or `None` if there are
    /// none. Writes to `visible`, row-major, whether each block that the rectangle touches can
    /// touch the band.
    pub fn clip(&self, visible: &mut Vec<bool>) -> Option<[Range<u32>; 2]> {
        let whole = face_rectangle(self.segment, self.face_px);
        if self.unclipped {
            visible.clear();
            visible.resize(block_count(&whole), true);
            return Some(whole);
        }
        let radius_px = f64::from(self.size.max_radius_px());
        let clipped = clip_rectangle(self.transfer, self.segment, self.band, radius_px)?;
        let rectangle =
            [0, 1].map(|i| clipped[i].start.min(whole[i].end)..clipped[i].end.min(whole[i].end));
        self.clip_blocks(&rectangle, visible);
        Some(rectangle)
    }

    fn clip_blocks(&self, [columns, rows]: &[Range<u32>; 2], visible: &mut Vec<bool>) {
        visible.clear();
        for row in rows.start / BLOCK_ROWS..rows.end.div_ceil(BLOCK_ROWS) {
            for column in columns.start / BLOCK_COLUMNS..columns.end.div_ceil(BLOCK_COLUMNS) {
                visible.push(self.is_visible(column, row));
            }
        }
    }

    /// Returns the columns, rows and inverse depths of a block, or `None` if it has no samples.
    pub fn block_bounds(&self, column: u32, row: u32) -> Option<[[f64; 2]; 3]> {
        let codes = self.segment.blocks.codes(column, row)?;
        let ends = |block: u32, length: u32| {
            let start = block * length;
            [
                f64::from(start),
                f64::from((start + length).min(self.face_px)),
            ]
        };
        let q = codes.map(|code| self.segment.inverse_depth(code));
        Some([ends(column, BLOCK_COLUMNS), ends(row, BLOCK_ROWS), q])
    }

    /// Returns the homogeneous positions of a block's corners in the frame, the least w of them,
    /// and an upper bound of the radii of the block's footprints, px.
    pub fn project_block(&self, [x, y, q]: &[[f64; 2]; 3]) -> ([DVec3; 8], f64, f64) {
        let corners: [DVec3; 8] = std::array::from_fn(|i| {
            self.transfer.map_infinite(x[i & 1], y[i >> 1 & 1])
                + self.transfer.inverse_depth * q[i >> 2]
        });
        let least_w = corners.iter().map(|h| h.z).fold(f64::INFINITY, f64::min);
        let radius_px =
            self.size
                .radius_bound_px(self.transfer, q[1], least_w, self.band.centred_size());
        (corners, least_w, radius_px)
    }

    /// Applies the homogeneous test of C17: hidden only if all eight corners lie outside one half
    /// space.
    fn is_visible(&self, column: u32, row: u32) -> bool {
        let Some(bounds) = self.block_bounds(column, row) else {
            return false;
        };
        let (corners, _, radius_px) = self.project_block(&bounds);
        !are_outside(&corners, self.band.bounds_px(radius_px))
    }
}

/// Returns true if all corners, homogeneous frame positions from the principal point, lie behind
/// the near plane or outside one of the bounds: left, right, upper and lower, px.
pub(crate) fn are_outside(corners: &[DVec3], [left, right, top, bottom]: [f64; 4]) -> bool {
    let all = |outside: &dyn Fn(&DVec3) -> bool| corners.iter().all(outside);
    all(&|h| h.z < f64::from(W_NEAR))
        || all(&|h| h.x < left * h.z)
        || all(&|h| h.x > right * h.z)
        || all(&|h| h.y < top * h.z)
        || all(&|h| h.y > bottom * h.z)
}
