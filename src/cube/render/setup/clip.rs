//! Which part of a segment a band of the frame can show (S23, C15, C17).
//!
//! In the LDI's projective coordinates (x, y on the face, inverse depth q) a segment is a box, and every plane of the view is
//! linear: the transfer's homogeneous position h(x, y, q) is, and a point shows only if `|X| <= W/2 * w`, and so on.

use super::transfer::Transfer;
use crate::pack::PackedSegment;
use crate::pack::blocks::{BLOCK_COLUMNS, BLOCK_ROWS};
use crate::render::footprint::size::Size;
use glam::{DMat3, DVec3};
use std::ops::Range;

/// The least w = Z2 / Z1 that is drawn (C8: w > 0 alone lets splats grow without bound). At it, a sample is 1,024 times
/// nearer to the eye than to the centre, and f32 has lost 10 of its 24 bits.
pub(crate) const W_NEAR: f32 = 1.0 / 1024.0;

/// Some rows of a frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Band {
    /// Frame width, px.
    pub(crate) width: u32,
    /// Frame height, px.
    pub(crate) height: u32,
    /// Where the viewing axis meets the frame, px.
    pub(crate) principal_px: [f64; 2],
    /// Rows of the band, row 0 on top.
    pub(crate) rows: Range<u32>,
}

impl Band {
    /// Left, right, upper and lower bound from the principal point, a radius wider.
    fn bounds_px(&self, radius_px: f64) -> [f64; 4] {
        let [x, y] = self.principal_px;
        let (right, bottom) = (f64::from(self.width) - x, f64::from(self.rows.end) - y);
        [
            -x - radius_px,
            right + radius_px,
            f64::from(self.rows.start) - y - radius_px,
            bottom + radius_px,
        ]
    }

    /// Width and height of the smallest frame about the principal point that holds this one.
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
    fn value(&self, point: DVec3) -> f64 {
        self.normal.dot(point) + self.offset
    }

    /// The same in the coordinates of a box: 0..1 along each axis; scaled so that the largest coefficient is 1.
    fn in_box(&self, [low, high]: [DVec3; 2]) -> Self {
        let (normal, offset) = (self.normal * (high - low), self.value(low));
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

/// The five half spaces outside of which a splat of `radius_px` cannot touch the band.
fn half_spaces(transfer: &Transfer, band: &Band, radius_px: f64) -> [HalfSpace; 5] {
    let [left, right, top, bottom] = band.bounds_px(radius_px);
    // h . of_h >= least
    let side = |of_h: DVec3, least: f64| HalfSpace {
        normal: DVec3::from(
            [transfer.x_step, transfer.y_step, transfer.inverse_depth]
                .map(|column| of_h.dot(column)),
        ),
        offset: of_h.dot(transfer.one) - least,
    };
    [
        side(DVec3::new(1.0, 0.0, -left), 0.0),
        side(DVec3::new(-1.0, 0.0, right), 0.0),
        side(DVec3::new(0.0, 1.0, -top), 0.0),
        side(DVec3::new(0.0, -1.0, bottom), 0.0),
        side(DVec3::Z, f64::from(W_NEAR)),
    ]
}

/// A segment's box; at least a millionth deep, so that a flat one has an inside.
fn segment_box(segment: &PackedSegment) -> [DVec3; 2] {
    let (q_min, q_max) = (
        f64::from(segment.inverse_depth_min),
        f64::from(segment.inverse_depth_max),
    );
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

/// Columns and rows of the face, inside the segment's rectangle, in which the samples lie whose splats of at most
/// `radius_px` can touch the band; `None` if there are none.
///
/// Exact (C15): the bounding rectangle of the vertices of the box cut by the five half spaces.
pub(crate) fn rectangle(
    transfer: &Transfer,
    segment: &PackedSegment,
    band: &Band,
    radius_px: f64,
) -> Option<[Range<u32>; 2]> {
    let bounds @ [low, high] = segment_box(segment);
    let views = half_spaces(transfer, band, radius_px).map(|half_space| half_space.in_box(bounds));
    let outside = |half_space: &HalfSpace| {
        half_space.normal.max(DVec3::ZERO).element_sum() + half_space.offset < 0.0
    };
    if views.iter().any(outside) {
        return None;
    }
    let [least, most] = vertex_bounds(&views)?;
    let size = high - low;
    let clip = |axis: usize, start: u32, length: u32| {
        let end = start.saturating_add(length);
        let first = (low[axis] + least[axis] * size[axis]).floor().max(0.0) as u32;
        let last = (low[axis] + most[axis] * size[axis]).ceil().max(0.0) as u32;
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

/// Bounds of the part of the unit cube that lies in five (scaled) half spaces: of all points in which three of the eleven planes
/// meet and that all eleven accept.
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
                if planes.iter().all(|plane| plane.value(vertex) >= -TOLERANCE) {
                    let [low, high] = bounds.unwrap_or([vertex; 2]);
                    bounds = Some([low.min(vertex), high.max(vertex)]);
                }
            }
        }
    }
    bounds
}

/// Says of a segment's blocks whether they can touch a band.
pub(crate) struct BlockClip<'a> {
    pub(crate) transfer: &'a Transfer,
    pub(crate) segment: &'a PackedSegment,
    pub(crate) band: &'a Band,
    /// Face size, px.
    pub(crate) face_px: u32,
}

impl BlockClip<'_> {
    /// Writes to `visible`, row-major, whether each block that the rectangle touches can touch the band.
    pub(crate) fn blocks(
        &self,
        [columns, rows]: &[Range<u32>; 2],
        size: &impl Size,
        visible: &mut Vec<bool>,
    ) {
        visible.clear();
        for row in rows.start / BLOCK_ROWS..rows.end.div_ceil(BLOCK_ROWS) {
            for column in columns.start / BLOCK_COLUMNS..columns.end.div_ceil(BLOCK_COLUMNS) {
                visible.push(self.is_visible(column, row, size));
            }
        }
    }

    /// Columns, rows and inverse depths of a block, or `None` if it holds nothing.
    pub(crate) fn bounds(&self, column: u32, row: u32) -> Option<[[f64; 2]; 3]> {
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

    /// The homogeneous positions of a block's corners in the frame, the least w of them, and a radius, px, that none of the
    /// block's footprints exceeds.
    pub(crate) fn corners(
        &self,
        [x, y, q]: &[[f64; 2]; 3],
        size: &impl Size,
    ) -> ([DVec3; 8], f64, f64) {
        let corners: [DVec3; 8] = std::array::from_fn(|i| {
            self.transfer.at(x[i & 1], y[i >> 1 & 1]) + self.transfer.inverse_depth * q[i >> 2]
        });
        let least_w = corners.iter().map(|h| h.z).fold(f64::INFINITY, f64::min);
        let radius = size.largest_radius_px(self.transfer, q[1], least_w, self.band.centred_size());
        (corners, least_w, radius)
    }

    /// The homogeneous test of C17: hidden only if all eight corners lie outside one half space.
    fn is_visible(&self, column: u32, row: u32, size: &impl Size) -> bool {
        let Some(bounds) = self.bounds(column, row) else {
            return false;
        };
        let (corners, _, radius) = self.corners(&bounds, size);
        let [left, right, top, bottom] = self.band.bounds_px(radius);
        let all = |outside: &dyn Fn(&DVec3) -> bool| corners.iter().all(outside);
        !(all(&|h| h.z < f64::from(W_NEAR))
            || all(&|h| h.x < left * h.z)
            || all(&|h| h.x > right * h.z)
            || all(&|h| h.y < top * h.z)
            || all(&|h| h.y > bottom * h.z))
    }
}

#[cfg(test)]
mod tests {
    //! A camera that looks along a face's axis: what it sees of the face is known in closed form.
    //!
    //! With the eye at (ex, ey, ez) in the face's axes, z toward the face, a sample of inverse depth q at (dx, dy) of the face (-1 to 1)
    //! lies at `f (dx - q ex) / w` from the principal point, w = 1 - q ez. So the side at L px is at `dx = L / f w + q ex`, which is
    //! linear in q.

    use super::*;
    use crate::model::samples::CubeLdi;
    use crate::pack::tests::{ldi, sample};
    use crate::pack::{PackedCube, SplatIndexLayout, Split};
    use crate::render::footprint::size::FixedSize;
    use headbox_core::camera::Camera;
    use headbox_core::cube_face::Face;
    use headbox_core::random::Rng;

    const FACE: Face = Face::NegX;
    const FACE_PX: u32 = 200;

    /// One sample in each pixel of a rectangle, nearer to the right and in the lower half.
    fn slope() -> CubeLdi {
        ldi(FACE_PX, |face, x, y| {
            let q = 0.3 + 0.004 * f64::from(x) + if y > 100 { 0.25 } else { 0.0 };
            let inside = face == FACE && (21..170).contains(&x) && (13..181).contains(&y);
            if inside {
                vec![sample(&mut Rng::keyed(1), face, q)]
            } else {
                Vec::new()
            }
        })
    }

    struct View {
        eye: DVec3,
        focal_px: f64,
        transfer: Transfer,
        band: Band,
    }

    impl View {
        /// A frame of 90 x 70 pixels, of which a band shows, whose axis does not meet its middle.
        fn new(eye: [f64; 3], fov_deg: f64, rows: Range<u32>) -> Self {
            let axes = [FACE.right(), FACE.up(), FACE.normal()];
            let at: DVec3 = axes.iter().zip(eye).map(|(axis, of)| *axis * of).sum();
            let camera = Camera::look_at(at, at + FACE.normal(), FACE.up(), fov_deg, [90, 70])
                .expect("valid");
            let camera = camera.with_principal_px([37.0, 41.0]);
            let band = Band {
                width: 90,
                height: 70,
                principal_px: camera.principal_px(),
                rows,
            };
            let transfer = Transfer::new(&camera, at, FACE, FACE_PX);
            Self {
                eye: DVec3::from(eye),
                focal_px: camera.focal_px(),
                transfer,
                band,
            }
        }

        /// Left, right, upper and lower side of the band, a radius wider, px from the principal point over the focal length.
        fn sides(&self, radius_px: f64) -> [f64; 4] {
            let rows = [self.band.rows.start, self.band.rows.end].map(f64::from);
            [
                -37.0 - radius_px,
                53.0 + radius_px,
                rows[0] - 41.0 - radius_px,
                rows[1] - 41.0 + radius_px,
            ]
            .map(|side| side / self.focal_px)
        }

        /// Columns and rows on the face, px, of the band's sides, for an inverse depth.
        fn on_face(&self, radius_px: f64, q: f64) -> [f64; 4] {
            let (w, half) = (1.0 - q * self.eye.z, f64::from(FACE_PX) / 2.0);
            let [left, right, top, bottom] = self.sides(radius_px).map(|side| side * w);
            let (x, y) = (q * self.eye.x, -q * self.eye.y);
            [
                (left + x + 1.0) * half,
                (right + x + 1.0) * half,
                (top + y + 1.0) * half,
                (bottom + y + 1.0) * half,
            ]
        }
    }

    fn views() -> impl Iterator<Item = View> {
        let eyes = [
            [0.0; 3],
            [0.3, -0.2, 0.0],
            [-0.4, 0.35, 0.25],
            [0.1, 0.5, -0.4],
            [0.0, -0.6, 0.5],
        ];
        let rows = [0..70, 30..47, 61..70];
        eyes.into_iter().flat_map(move |eye| {
            rows.clone().into_iter().flat_map(move |rows| {
                [20.0, 55.0].map(|fov_deg| View::new(eye, fov_deg, rows.clone()))
            })
        })
    }

    #[test]
    fn rectangles_are_those_of_the_sides_of_the_view() {
        let cube =
            PackedCube::pack(&slope(), SplatIndexLayout::Normal, Split::None).expect("packs");
        let segment = &cube.segments[0];
        let mut clipped = [0; 2];
        for view in views() {
            for radius_px in [0.0, 2.5] {
                let ends = [segment.inverse_depth_min, segment.inverse_depth_max]
                    .map(|q| view.on_face(radius_px, f64::from(q)));
                let range = |axis: usize, start: u32, length: u32| {
                    let (first, last) = (
                        ends[0][axis].min(ends[1][axis]),
                        ends[0][axis + 1].max(ends[1][axis + 1]),
                    );
                    let end = start + length;
                    // A pixel more on both sides, as `rectangle` has it.
                    let (first, last) = (
                        (first.floor() - 1.0).max(0.0) as u32,
                        (last.ceil() + 1.0).max(0.0) as u32,
                    );
                    first.clamp(start, end)..last.clamp(start, end)
                };
                let expected = [
                    range(0, segment.x0, segment.width),
                    range(2, segment.y0, segment.height),
                ];
                let found = rectangle(&view.transfer, segment, &view.band, radius_px);
                match expected.iter().any(|range| range.is_empty()) {
                    true => assert_eq!(found, None),
                    false => assert_eq!(found, Some(expected.clone())),
                }
                for (count, (range, whole)) in clipped
                    .iter_mut()
                    .zip(expected.iter().zip([segment.width, segment.height]))
                {
                    *count += u32::from(!range.is_empty() && (range.len() as u32) < whole);
                }
            }
        }
        assert!(clipped.iter().all(|count| *count > 20), "{clipped:?}");
    }

    #[test]
    fn blocks_show_unless_one_side_of_the_view_hides_all_of_them() {
        let cube =
            PackedCube::pack(&slope(), SplatIndexLayout::Normal, Split::None).expect("packs");
        let segment = &cube.segments[0];
        let (mut visible, mut counts) = (Vec::new(), [0; 2]);
        // Also eyes before which some blocks lie wholly, and some in part.
        for view in views().chain([0.9, 1.4, 2.2].map(|z| View::new([0.1, 0.05, z], 60.0, 0..70))) {
            let clip = BlockClip {
                transfer: &view.transfer,
                segment,
                band: &view.band,
                face_px: FACE_PX,
            };
            let rectangle @ [columns, rows] = &[40..165, 30..179];
            clip.blocks(rectangle, &FixedSize { radius_px: 1.5 }, &mut visible);
            let blocks = [
                columns.start / 64..columns.end.div_ceil(64),
                rows.start / 16..rows.end.div_ceil(16),
            ];
            let mut found = visible.iter();
            for (row, column) in blocks[1]
                .clone()
                .flat_map(|row| blocks[0].clone().map(move |column| (row, column)))
            {
                let ends = |block: u32, size: u32| {
                    [block * size, ((block + 1) * size).min(FACE_PX)].map(f64::from)
                };
                let ([x0, x1], [y0, y1]) = (ends(column, 64), ends(row, 16));
                let codes = segment
                    .blocks
                    .codes(column, row)
                    .expect("samples in every block");
                let of_depth = codes.map(|code| {
                    let q = segment.inverse_depth(code);
                    let [left, right, top, bottom] = view.on_face(1.5, q);
                    let behind = 1.0 - q * view.eye.z < f64::from(W_NEAR);
                    [behind, x1 < left, x0 > right, y1 < top, y0 > bottom]
                });
                let hidden = (0..5).any(|side| of_depth.iter().all(|of_depth| of_depth[side]));
                assert_eq!(found.next(), Some(&!hidden), "block {column}, {row}");
                counts[usize::from(hidden)] += 1;
            }
            assert_eq!(found.next(), None);
        }
        assert!(counts.iter().all(|count| *count > 100), "{counts:?}");
    }

    #[test]
    fn what_holds_a_frame_is_centred_on_its_axis() {
        let band = |principal_px| Band {
            width: 90,
            height: 70,
            principal_px,
            rows: 0..70,
        };
        assert_eq!(band([45.0, 35.0]).centred_size(), [90, 70]);
        assert_eq!(band([37.0, 41.0]).centred_size(), [106, 82]);
        assert_eq!(band([-10.0, 100.25]).centred_size(), [200, 201]);
    }
}
