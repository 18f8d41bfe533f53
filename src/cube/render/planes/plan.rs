//! Per-frame visibility and homographies of plane textures.

use crate::pack::plane_textures::mips;
use crate::pack::{Plane, PlaneSet, PlaneTile};
use crate::render::setup::clip;
use glam::{DMat3, DVec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;
use std::ops::Range;

/// Least ratio of the eye depths in the frame and on the face, as for samples.
pub(super) const W_NEAR: f64 = clip::W_NEAR as f64;

/// Texels by which a texture is drawn beyond its border, so that rounding leaves no gap between
/// adjacent textures.
pub(super) const OVERLAP: f64 = 1e-3;

/// Least area of a texel in the frame, px^2, below which a texture is blurred (0.62 pixels a side),
/// and below which the blurred one is replaced by one of half the size (0.44).
pub(super) const LEAST_AREA_PX: [f64; 2] = [0.385, 0.19];

/// All plane textures in view, nearest first.
#[derive(Default)]
pub(crate) struct PlanesInView {
    pub(super) tiles: Vec<TileInView>,
    pub(super) frame: FrameSize,
    /// Last face and homography of each plane, computed on demand.
    planes: Vec<Option<(u16, PlaneInView)>>,
}

#[derive(Clone, Copy, Default)]
pub(super) struct FrameSize {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) principal_px: [f64; 2],
}

/// Homography of a plane from a face to the frame.
#[derive(Clone, Copy)]
struct PlaneInView {
    /// Frame position from the principal point, times w = Z2 / Z1, of a face position (x, y, 1).
    frame_from_face: DMat3,
    /// Face position times 1/w of a frame position (X, Y, 1).
    face_from_frame: DMat3,
    /// Inverse depth on the face, 1/m, as coefficients of (x, y, 1).
    inverse_depth: DVec3,
}

/// A plane texture in view.
pub(super) struct TileInView {
    /// Mip level; see [`mips`].
    pub(super) level: usize,
    /// Columns of texels at that level.
    pub(super) width: u32,
    /// Rows of texels at that level.
    pub(super) height: u32,
    pub(super) opaque: bool,
    /// Rows of the frame that it may touch.
    pub(super) rows: Range<u32>,
    /// Rows of a matrix on frame positions (X, Y, 1): texel column and row times 1/w, 1/w, and
    /// inverse depth, 1/m.
    pub(super) from_frame: [DVec3; 4],
    sides: [HalfPlane; 5],
    /// Largest inverse depth, 1/m.
    pub(super) nearest: f64,
    /// Index in [`PlaneSet::tiles`].
    pub(super) index: u32,
}

/// Pixels of a row of the frame that a texture covers.
pub(super) struct TextureSpan {
    /// Columns of the frame.
    pub(super) columns: Range<u32>,
    /// At the first column: texel column and row times 1/w, 1/w, inverse depth.
    pub(super) start: [f32; 4],
    /// Change of the same from column to column.
    pub(super) step: [f32; 4],
}

/// A half plane of the frame.
#[derive(Clone, Copy)]
struct HalfPlane {
    /// Positive if it lies to the right of its border, negative if to the left, 0 if the border is
    /// a row.
    slope: f64,
    /// The border crosses row y at the column `crossing[0] + crossing[1] y`, both from the
    /// principal point. If the slope is 0, a row lies inside where that is not negative.
    crossing: [f64; 2],
}

impl HalfPlane {
    /// Creates the half plane where a row vector on frame positions (X, Y, 1) is not negative.
    fn new(row: DVec3) -> Self {
        let crossing = [-row.z / row.x, -row.y / row.x];
        if crossing.iter().all(|c| c.is_finite()) {
            Self {
                slope: row.x,
                crossing,
            }
        } else {
            Self {
                slope: 0.0,
                crossing: [row.z, row.y],
            }
        }
    }
}

impl PlanesInView {
    /// Returns the columns and rows of the frame.
    pub(super) fn size_px(&self) -> [u32; 2] {
        [self.frame.width, self.frame.height]
    }

    /// Finds the textures in view of a camera. `eye_from_centre`: world axes, metres.
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
                Some((slot_face, in_view)) if *slot_face == tile.face => *in_view,
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
                .extend(in_view.project_tile(tile, index, set, &self.frame));
        }
        for level in 0..=mips::LEVELS {
            if self.tiles.iter().any(|tile| tile.level == level) {
                set.make_level(level);
            }
        }
        self.tiles
            .sort_unstable_by(|a, b| b.nearest.total_cmp(&a.nearest).then(a.index.cmp(&b.index)));
    }

    /// Returns the number of textures in view.
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

    /// Returns the mip level ([`mips`]) at which a texel at a face position has about the area of a
    /// frame pixel.
    fn mip_level(&self, position: DVec3) -> usize {
        let h = self.frame_from_face * position;
        let x = self.frame_from_face.x_axis;
        let y = self.frame_from_face.y_axis;
        let [xx, xy, yx, yy] = [
            x.x - x.z * h.x / h.z,
            x.y - x.z * h.y / h.z,
            y.x - y.z * h.x / h.z,
            y.y - y.z * h.y / h.z,
        ];
        let area_px = (xx * yy - xy * yx).abs() / (h.z * h.z);
        let area_at = |level: usize| area_px * f64::from(1 << (2 * mips::halvings(level)));
        (0..mips::LEVELS)
            .take_while(|level| area_at(*level) < LEAST_AREA_PX[level % 2])
            .count()
    }

    /// Returns a texture's tile if the frame can show it.
    fn project_tile(
        &self,
        tile: &PlaneTile,
        index: u32,
        set: &PlaneSet,
        frame: &FrameSize,
    ) -> Option<TileInView> {
        let x0 = f64::from(tile.x0) + 0.5;
        let y0 = f64::from(tile.y0) + 0.5;
        let x1 = x0 + f64::from(tile.width) - 1.0;
        let y1 = y0 + f64::from(tile.height) - 1.0;
        let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| DVec3::new(x, y, 1.0));
        let in_frame = corners.map(|corner| self.frame_from_face * corner);
        let [cx, cy] = frame.principal_px;
        let width = f64::from(frame.width);
        let height = f64::from(frame.height);
        let bounds_px = [-cx, width - cx, -cy, height - cy];
        if clip::are_outside(&in_frame, bounds_px) || !self.face_from_frame.is_finite() {
            return None;
        }
        let in_front = in_frame.iter().all(|h| h.z >= W_NEAR);
        let rows = if in_front {
            let y = in_frame.map(|h| h.y / h.z + cy);
            let top = y.into_iter().fold(height, f64::min);
            let bottom = y.into_iter().fold(0.0, f64::max);
            ((top - 0.5 - OVERLAP).ceil().max(0.0) as u32)
                ..((bottom + 0.5 + OVERLAP).floor().min(height) as u32)
        } else {
            0..frame.height
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
            self.mip_level(DVec3::new((x0 + x1) / 2.0, (y0 + y1) / 2.0, 1.0))
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
            from_frame: [u, v, w, q],
            // In front of the eye: w >= 1/1024, so that 1/w <= 1024.
            sides: [
                u + w * OVERLAP,
                w * (right + OVERLAP) - u,
                v + w * OVERLAP,
                w * (lower + OVERLAP) - v,
                DVec3::Z / W_NEAR - w,
            ]
            .map(HalfPlane::new),
            nearest,
            index,
        })
    }
}

impl TileInView {
    /// Returns the span of a row of the frame that the texture covers, with the values of
    /// [`Self::from_frame`].
    pub(super) fn span(&self, y: u32, frame: &FrameSize) -> Option<TextureSpan> {
        let [u, v, w, q] = self.from_frame;
        let [cx, cy] = frame.principal_px;
        let x_first = 0.5 - cx;
        let y = f64::from(y) + 0.5 - cy;
        let mut start = 0.0f64;
        let mut end = f64::from(frame.width) - 1.0;
        for HalfPlane {
            slope,
            crossing: [constant, per_row],
        } in self.sides
        {
            let value = constant + per_row * y;
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
        let floor = start as u32;
        let end = end as u32 + 1;
        let first = floor + u32::from(f64::from(floor) < start);
        if first >= end {
            return None;
        }
        let evaluate =
            |row: DVec3| (row.x * x_first + row.y * y + row.z + row.x * f64::from(first)) as f32;
        Some(TextureSpan {
            columns: first..end,
            start: [u, v, w, q].map(evaluate),
            step: [u.x as f32, v.x as f32, w.x as f32, q.x as f32],
        })
    }
}
