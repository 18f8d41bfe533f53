//! Projection of positions in `f32`, and fixed-point positions in the frame.

use fearless_simd::Level;
use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::image::triangle_scan::SUBPIXELS;

/// Eye depth of the near plane, metres. It only keeps divisions finite: the part that it clips is
/// smaller than a pixel.
pub(super) const NEAR_M: f32 = 1e-5;

/// Triangles that reach farther from the frame's upper left corner than this are clipped, px:
/// products of two edges stay below 2^46, and the sum in `snap` below 2^24.
pub(super) const GUARD_PX: f32 = 16_383.0;

/// A projected vertex in fixed point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SnappedVertex {
    /// Position in 1/256 px.
    pub(super) x: i32,
    pub(super) y: i32,
    /// 1 / eye depth, 1/m.
    pub(super) inverse_depth: f32,
}

/// A camera in the local frame of a mesh.
pub(super) struct LocalCamera {
    pub(super) eye: Vec3,
    /// Rows of the matrix from a position relative to the eye to (x w, y w, w), x and y in px from
    /// the upper left corner.
    pub(super) rows: [Vec3; 3],
    eye_f64: DVec3,
    rows_f64: [DVec3; 3],
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) level: Level,
}

impl LocalCamera {
    pub(super) fn new(camera: &Camera, origin: DVec3, level: Level) -> Self {
        let matrix = camera.image_from_world();
        let rows_f64 = [0, 1, 3].map(|row| matrix.row(row).truncate());
        let eye_f64 = camera.eye() - origin;
        Self {
            eye: eye_f64.as_vec3(),
            rows: rows_f64.map(|row| row.as_vec3()),
            eye_f64,
            rows_f64,
            width: camera.width(),
            height: camera.height(),
            level,
        }
    }

    /// Projects a local position to (x w, y w, w).
    #[inline(always)]
    pub(super) fn project(&self, position: Vec3) -> Vec3 {
        let d = position - self.eye;
        let [x, y, w] = self.rows;
        let along = |row: Vec3| (row.x * d.x + row.y * d.y) + row.z * d.z;
        Vec3::new(along(x), along(y), along(w))
    }

    /// Same as [`Self::project`] in `f64`: a corner 2 km behind the eye determines where its edge
    /// passes a millimetre in front of the eye.
    #[inline(always)]
    pub(super) fn project_f64(&self, position: Vec3) -> DVec3 {
        let d = position.as_dvec3() - self.eye_f64;
        DVec3::from(self.rows_f64.map(|row| row.dot(d)))
    }
}

/// Rounds a coordinate to multiples of 1/[`SUBPIXELS`] px, ties to even. Unspecified beyond
/// [`GUARD_PX`].
#[inline(always)]
pub(super) fn snap(px: f32) -> i32 {
    /// 1.5 * 2^23: the sum has steps of 1, so its low bits are the rounded number.
    const MAGIC: f32 = 12_582_912.0;
    ((px * SUBPIXELS as f32 + MAGIC).to_bits() as i32).wrapping_sub(MAGIC.to_bits() as i32)
}

/// Same as [`snap`], for corners created by clipping.
pub(super) fn snap_f64(px: f64) -> i32 {
    (px * f64::from(SUBPIXELS)).round_ties_even() as i32
}
