//! Transfer matrix from LDI pixels with inverse depth to frame pixels (S18, C2, C8).

use glam::{DVec3, Vec3};
use headbox_core::camera::Camera;
use headbox_core::cube_face::Face;

/// `target_from_reference` matrix of one face, one column for each coordinate of the LDI.
///
/// The position (x, y) in face pixels with inverse depth q maps to the homogeneous position `one +
/// x * x_step + y * y_step + q * inverse_depth`, whose components are (X w, Y w, w): X, Y in frame
/// pixels **from the principal point** (so that f32 keeps its digits for the sub-pixel part), w =
/// Z2 / Z1, the ratio of the eye depths in the frame and in the LDI. w > 0 is in front of the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transfer {
    /// Column of the constant 1.
    pub one: DVec3,
    /// Column of x, per face pixel.
    pub x_step: DVec3,
    /// Column of y, per face pixel.
    pub y_step: DVec3,
    /// Column of the inverse depth, per 1/m.
    pub inverse_depth: DVec3,
}

impl Transfer {
    /// Computes the transfer from a face of `size_px` pixels a side. `eye_from_centre` is the eye's
    /// position relative to the cube's centre, world axes, metres.
    pub fn new(camera: &Camera, eye_from_centre: DVec3, face: Face, size_px: u32) -> Self {
        let in_eye = camera.world_from_eye().transpose();
        let to_target = |v: DVec3| {
            let v = in_eye * v;
            DVec3::new(v.x * camera.focal_px(), -v.y * camera.focal_px(), -v.z)
        };
        let origin = face.direction(0.0, 0.0, size_px);
        Self {
            one: to_target(origin),
            x_step: to_target(face.direction(1.0, 0.0, size_px) - origin),
            y_step: to_target(face.direction(0.0, 1.0, size_px) - origin),
            inverse_depth: -to_target(eye_from_centre),
        }
    }

    /// Maps the face position (x, y) at inverse depth 0.
    pub fn map_infinite(&self, x: f64, y: f64) -> DVec3 {
        self.one + self.x_step * x + self.y_step * y
    }

    /// Returns the transfer of one row re-anchored at a column, to be evaluated in f32 (see
    /// [`RowTransfer`]).
    pub fn anchor(
        &self,
        column: u32,
        row: u32,
        inverse_depth_min: f64,
        inverse_depth_step: f64,
    ) -> RowTransfer {
        let start = self.map_infinite(f64::from(column) + 0.5, f64::from(row) + 0.5);
        RowTransfer {
            anchor: (start + self.inverse_depth * inverse_depth_min).as_vec3(),
            step: self.x_step.as_vec3(),
            per_code: (self.inverse_depth * inverse_depth_step).as_vec3(),
        }
    }
}

/// Incremental warp of a row near one anchor: `(anchor + k * step) + code * per_code` for the depth
/// pixel `k` columns from the anchor, evaluated without fused multiply-adds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowTransfer {
    /// Homogeneous position of the anchor's pixel centre at the segment's smallest inverse depth.
    pub anchor: Vec3,
    /// Change from column to column.
    pub step: Vec3,
    /// Change from one inverse depth code to the next.
    pub per_code: Vec3,
}

#[cfg(test)]
impl RowTransfer {
    /// Evaluates the transfer as [`crate::render::warp`] does.
    pub(crate) fn apply(&self, k: f32, code: f32) -> Vec3 {
        (self.anchor + self.step * k) + self.per_code * code
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::INVERSE_DEPTH_CODE_MAX;
    use crate::pack::blocks::BLOCK_COLUMNS;

    /// Bound of the f32 position error, px. f32 keeps 24 bits. The three sums of
    /// [`RowTransfer::apply`] act on homogeneous coordinates of at most about twice the frame's
    /// half width (4096 px here) at w near 1, so each rounds by 2^-24 * 4096 = 2.4e-4 px; the
    /// stored steps, times 63 columns and 2^20 codes, round by as much each. Seven of these and the
    /// division's own stay below this. (Without re-anchoring, the paper's running sum drifts by
    /// 0.085 px in 2,048 columns: C8.)
    const F32_POSITION_PX: f64 = 2e-3;

    #[test]
    fn f32_positions_along_wide_row_agree_with_f64() {
        let size = 4096;
        let eye = DVec3::new(0.21, -0.13, 0.34);
        let camera = Camera::look_at(
            eye,
            DVec3::new(0.3, 0.2, -5.0),
            DVec3::Y,
            90.0,
            [4096, 4096],
        )
        .expect("valid");
        let transfer = Transfer::new(&camera, eye, Face::NegZ, size);
        let min = 0.01;
        let step = 1.2 / f64::from(INVERSE_DEPTH_CODE_MAX);
        let mut worst = 0.0f64;
        let mut drift = 0.0f64;
        for row in [0, 1027, 2048, 4095] {
            let mut running = transfer.anchor(0, row, min, step).anchor;
            for column in 0..size {
                let block = column - column % BLOCK_COLUMNS;
                let anchored = transfer.anchor(block, row, min, step);
                for code in [0, 77_777, INVERSE_DEPTH_CODE_MAX] {
                    let exact = transfer
                        .map_infinite(f64::from(column) + 0.5, f64::from(row) + 0.5)
                        + transfer.inverse_depth * (min + f64::from(code) * step);
                    let position = anchored.apply((column - block) as f32, code as f32);
                    let error =
                        |h: Vec3| (f64::from(h.x) / f64::from(h.z) - exact.x / exact.z).abs();
                    let in_view = (exact.x / exact.z).abs() < 2048.0 && exact.z > 0.0;
                    if in_view {
                        let x = f64::from(position.x) / f64::from(position.z) - exact.x / exact.z;
                        let y = f64::from(position.y) / f64::from(position.z) - exact.y / exact.z;
                        worst = worst.max(x.abs()).max(y.abs());
                        drift = drift.max(error(running + anchored.per_code * code as f32));
                    }
                }
                running += anchored.step;
            }
        }
        assert!(worst < F32_POSITION_PX, "{worst}");
        assert!(
            drift > 4.0 * worst,
            "the running sum is expected to be worse: {drift} against {worst}"
        );
    }

    #[test]
    fn transfer_agrees_with_cameras() {
        let centre = DVec3::new(10.0, 20.0, -5.0);
        let eye = centre + DVec3::new(0.3, -0.2, 0.1);
        let camera = Camera::look_at(
            eye,
            centre + DVec3::new(2.0, 1.0, -0.5),
            DVec3::Y,
            70.0,
            [640, 480],
        )
        .expect("valid");
        for face in Face::ALL {
            let transfer = Transfer::new(&camera, eye - centre, face, 100);
            for (x, y, depth) in [(3.0, 4.0, 2.0), (50.0, 50.0, 100.0), (99.0, 20.0, 0.9)] {
                let h = transfer.map_infinite(x, y) + transfer.inverse_depth / depth;
                let point = centre + face.direction(x, y, 100) * depth;
                match camera.project(point) {
                    Some([px, py, eye_depth]) => {
                        let agrees = |a: f64, b: f64| (a - b).abs() < 1e-9 * (1.0 + b.abs());
                        assert!(agrees(h.x / h.z + 320.0, px) && agrees(h.y / h.z + 240.0, py));
                        assert!((h.z * depth - eye_depth).abs() < 1e-12);
                    }
                    None => assert!(h.z <= 0.0),
                }
            }
        }
    }
}
