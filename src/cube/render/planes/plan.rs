//! What of the planes a frame shows, and how.

use crate::pack::{Plane, PlaneSet, PlaneTile, mips};
use glam::{DMat3, DVec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use std::ops::Range;

/// Least ratio of the eye depth in the frame to that in the face, as for samples.
const W_NEAR: f64 = 1.0 / 1024.0;

/// By how much of a texel a picture is drawn beyond its border, so that rounding leaves no gap between neighbours.
const OVERLAP: f64 = 1e-3;

/// Frame pixels that a texel has at least, before the picture is softened (0.62 pixels a side), and before the softened one gives
/// way to one of half the size (0.44).
const LEAST_AREA_PX: [f64; 2] = [0.385, 0.19];

/// All pictures in view, nearest first.
#[derive(Default)]
pub(crate) struct PlanesInView {
    pub(super) tiles: Vec<TileInView>,
    pub(super) frame: FrameSize,
    /// Of each plane and face, once it is needed.
    planes: Vec<Option<(u16, PlaneInView)>>,
}

#[derive(Clone, Copy, Default)]
pub(super) struct FrameSize {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) principal_px: [f64; 2],
}

/// A plane, from a face to the frame.
#[derive(Clone, Copy)]
struct PlaneInView {
    /// Frame position from the principal point, times w = Z2 / Z1, of a face position (x, y, 1).
    frame_from_face: DMat3,
    /// Face position times 1/w of a frame position (X, Y, 1).
    face_from_frame: DMat3,
    /// Inverse depth on the face as coefficients of (x, y, 1).
    inverse_depth: DVec3,
}

/// A picture in view.
pub(super) struct TileInView {
    /// See [`mips`].
    pub(super) level: usize,
    /// Texels at that size.
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) opaque: bool,
    /// Rows of the frame that it may touch.
    pub(super) rows: Range<u32>,
    /// Rows of a matrix on frame positions (X, Y, 1): texel column and row times 1/w, 1/w, and inverse depth, 1/m.
    pub(super) of_frame: [DVec3; 4],
    sides: [Side; 5],
    /// Largest inverse depth, 1/m.
    nearest: f64,
    pub(super) index: u32,
}

/// Which pixels of a row a picture covers, and what of it they show.
pub(super) struct Span {
    /// Of the frame.
    pub(super) columns: Range<u32>,
    /// At the first column: texel column and row times 1/w, 1/w, inverse depth.
    pub(super) start: [f32; 4],
    /// From column to column.
    pub(super) step: [f32; 4],
}

/// Where a picture may lie: a half plane of the frame.
#[derive(Clone, Copy)]
struct Side {
    /// Along a row: the picture lies to the right of the border if it is positive, to the left if it is negative.
    slope: f64,
    /// In row y, both from the principal point, the border lies at the column `crossing[0] + crossing[1] y`. If the slope is 0,
    /// the row lies inside where that is not negative.
    crossing: [f64; 2],
}

impl Side {
    /// Where a row vector on frame positions (X, Y, 1) is not negative.
    fn new(row: DVec3) -> Self {
        let crossing = [-row.z / row.x, -row.y / row.x];
        match crossing.iter().all(|of| of.is_finite()) {
            true => Self {
                slope: row.x,
                crossing,
            },
            false => Self {
                slope: 0.0,
                crossing: [row.z, row.y],
            },
        }
    }
}

impl PlanesInView {
    /// Columns and rows of the frame.
    pub(super) fn size_px(&self) -> [u32; 2] {
        [self.frame.width, self.frame.height]
    }

    /// Finds what a camera sees whose eye is at some place from the centre, world axes.
    pub(crate) fn prepare(
        &mut self,
        set: &PlaneSet,
        camera: &Camera,
        eye_from_centre: DVec3,
        face_px: u32,
    ) {
        self.tiles.clear();
        self.frame = FrameSize {
            width: camera.width(),
            height: camera.height(),
            principal_px: camera.principal_px(),
        };
        self.planes.clear();
        self.planes.resize(set.planes.len(), None);
        for (index, tile) in (0..).zip(&set.tiles) {
            let Some(face) = Face::ALL.get(usize::from(tile.face)) else {
                continue;
            };
            let Some(slot) = self.planes.get_mut(tile.plane as usize) else {
                continue;
            };
            let in_view = match slot {
                Some((of_face, in_view)) if *of_face == tile.face => *in_view,
                _ => PlaneInView::new(
                    &set.planes[tile.plane as usize],
                    camera,
                    eye_from_centre,
                    *face,
                    face_px,
                ),
            };
            *slot = Some((tile.face, in_view));
            self.tiles
                .extend(in_view.tile(tile, index, set, &self.frame));
        }
        for level in 0..=mips::LEVELS {
            if self.tiles.iter().any(|tile| tile.level == level) {
                set.make_level(level);
            }
        }
        self.tiles
            .sort_unstable_by(|a, b| b.nearest.total_cmp(&a.nearest).then(a.index.cmp(&b.index)));
    }

    /// Number of pictures in view.
    pub(crate) fn len(&self) -> usize {
        self.tiles.len()
    }
}

impl PlaneInView {
    fn new(
        plane: &Plane,
        camera: &Camera,
        eye_from_centre: DVec3,
        face: Face,
        face_px: u32,
    ) -> Self {
        let in_eye = camera.world_from_eye().transpose();
        let to_frame = |v: DVec3| {
            let v = in_eye * v;
            DVec3::new(v.x * camera.focal_px(), -v.y * camera.focal_px(), -v.z)
        };
        let step = 2.0 / f64::from(face_px);
        let [q, along_x, along_y] = plane.inverse_depth(face, face_px);
        // P - eye = (d - q eye) / q, and d and q are affine in the position on the face.
        let column = |d: DVec3, q: f64| to_frame(d - eye_from_centre * q);
        let frame_from_face = DMat3::from_cols(
            column(face.right() * step, along_x),
            column(-face.up() * step, along_y),
            column(face.direction(0.0, 0.0, face_px), q),
        );
        let face_from_frame = frame_from_face.inverse();
        Self {
            frame_from_face,
            face_from_frame,
            inverse_depth: DVec3::new(along_x, along_y, q),
        }
    }

    /// The level ([`mips`]) at which a texel at a place on the face is about as large as a frame pixel, by area.
    fn level(&self, at: DVec3) -> usize {
        let h = self.frame_from_face * at;
        let (x, y) = (self.frame_from_face.x_axis, self.frame_from_face.y_axis);
        let [xx, xy, yx, yy] = [
            x.x - x.z * h.x / h.z,
            x.y - x.z * h.y / h.z,
            y.x - y.z * h.x / h.z,
            y.y - y.z * h.y / h.z,
        ];
        let area_px = (xx * yy - xy * yx).abs() / (h.z * h.z);
        let at_level = |level: usize| area_px * f64::from(1 << (2 * mips::halvings(level)));
        (0..mips::LEVELS)
            .take_while(|level| at_level(*level) < LEAST_AREA_PX[level % 2])
            .count()
    }

    fn tile(
        &self,
        tile: &PlaneTile,
        index: u32,
        set: &PlaneSet,
        frame: &FrameSize,
    ) -> Option<TileInView> {
        let (x0, y0) = (f64::from(tile.x0) + 0.5, f64::from(tile.y0) + 0.5);
        let (x1, y1) = (
            x0 + f64::from(tile.width) - 1.0,
            y0 + f64::from(tile.height) - 1.0,
        );
        let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| DVec3::new(x, y, 1.0));
        let in_frame = corners.map(|corner| self.frame_from_face * corner);
        let [cx, cy] = frame.principal_px;
        let (width, height) = (f64::from(frame.width), f64::from(frame.height));
        let all = |outside: &dyn Fn(&DVec3) -> bool| in_frame.iter().all(outside);
        if all(&|h| h.z < W_NEAR)
            || all(&|h| h.x < -cx * h.z)
            || all(&|h| h.x > (width - cx) * h.z)
            || all(&|h| h.y < -cy * h.z)
            || all(&|h| h.y > (height - cy) * h.z)
            || !self.face_from_frame.is_finite()
        {
            return None;
        }
        let in_front = in_frame.iter().all(|h| h.z >= W_NEAR);
        let rows = match in_front {
            true => {
                let y = in_frame.map(|h| h.y / h.z + cy);
                let (top, bottom) = (
                    y.into_iter().fold(height, f64::min),
                    y.into_iter().fold(0.0, f64::max),
                );
                ((top - 0.5 - OVERLAP).ceil().max(0.0) as u32)
                    ..((bottom + 0.5 + OVERLAP).floor().min(height) as u32)
            }
            false => 0..frame.height,
        };
        let nearest = corners
            .iter()
            .zip(in_frame)
            .map(|(corner, h)| self.inverse_depth.dot(*corner) / h.z.max(W_NEAR));
        let nearest = nearest.fold(0.0, f64::max);
        let inverse = self.face_from_frame.transpose();
        let [u, v, w] = [inverse.x_axis, inverse.y_axis, inverse.z_axis];
        let q = u * self.inverse_depth.x + v * self.inverse_depth.y + w * self.inverse_depth.z;
        set.texels
            .get(tile.texel_range())
            .filter(|_| tile.width.min(tile.height) > 1)?;
        let level = if in_front {
            self.level(DVec3::new((x0 + x1) / 2.0, (y0 + y1) / 2.0, 1.0))
        } else {
            0
        };
        let scale = 1.0 / f64::from(1 << mips::halvings(level));
        let [u, v] = [(u - w * x0) * scale, (v - w * y0) * scale];
        let [right, lower] = [(x1 - x0) * scale, (y1 - y0) * scale];
        Some(TileInView {
            level,
            width: mips::side(tile.width, level) as u32,
            height: mips::side(tile.height, level) as u32,
            opaque: tile.opaque == 1,
            rows,
            of_frame: [u, v, w, q],
            // In front of the eye: w >= 1/1024, so that 1/w <= 1024.
            sides: [
                u + w * OVERLAP,
                w * (right + OVERLAP) - u,
                v + w * OVERLAP,
                w * (lower + OVERLAP) - v,
                DVec3::Z / W_NEAR - w,
            ]
            .map(Side::new),
            nearest,
            index,
        })
    }
}

impl TileInView {
    /// The columns of a row of the frame that the picture covers, and what [`Self::of_frame`] gives there.
    pub(super) fn span(&self, y: u32, frame: &FrameSize) -> Option<Span> {
        let [u, v, w, q] = self.of_frame;
        let [cx, cy] = frame.principal_px;
        let (x_first, y) = (0.5 - cx, f64::from(y) + 0.5 - cy);
        let at_first = |row: DVec3| row.x * x_first + row.y * y + row.z;
        let (mut start, mut end) = (0.0f64, f64::from(frame.width) - 1.0);
        for Side {
            slope,
            crossing: [at, per_row],
        } in self.sides
        {
            let value = at + per_row * y;
            if slope > 0.0 {
                start = start.max(value - x_first);
            } else if slope < 0.0 {
                end = end.min(value - x_first);
            } else if value < 0.0 {
                return None;
            }
        }
        if start.is_nan() || end.is_nan() || start > end {
            return None;
        }
        // Neither is negative: truncation is the floor, which would be a call.
        let (whole, end) = (start as u32, end as u32 + 1);
        let first = whole + u32::from(f64::from(whole) < start);
        if first >= end {
            return None;
        }
        let at = |row: DVec3| (at_first(row) + row.x * f64::from(first)) as f32;
        Some(Span {
            columns: first..end,
            start: [at(u), at(v), at(w), at(q)],
            step: [u.x as f32, v.x as f32, w.x as f32, q.x as f32],
        })
    }
}

#[cfg(test)]
pub(crate) mod tests;
