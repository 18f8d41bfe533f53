//! Pinhole camera of all stages.

use glam::{DMat3, DMat4, DVec3, DVec4, dvec3};
use std::ops::Range;

/// Error of creating a camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// A coordinate is NaN or infinite.
    #[error("the {0} of the camera has a coordinate that is not a finite number")]
    NotFinite(&'static str),
    /// Eye and look-at point coincide, so there is no direction to look in.
    #[error("the camera looks at its own eye; give a --look-at point that differs from --eye")]
    NoDirection,
    /// The field of view cannot be shown on a plane.
    #[error("a vertical field of view of {0} degrees; it must lie between 0.1 and 179")]
    FieldOfView(f64),
    /// The image has no pixels or more than can be addressed.
    #[error("an image of {0}x{1} pixels; each side must lie between 1 and {max}", max = Camera::MAX_SIDE_PX)]
    Size(u32, u32),
}

/// Returns the angle that a side of an image spans, degrees; side and focal length in pixels.
pub fn fov_deg(side_px: f64, focal_px: f64) -> f64 {
    2.0 * (side_px / 2.0 / focal_px).atan().to_degrees()
}

/// Returns the focal length at which a side of an image spans some degrees, pixels.
pub fn focal_px(side_px: f64, fov_deg: f64) -> f64 {
    side_px / 2.0 / (fov_deg.to_radians() / 2.0).tan()
}

/// Pinhole camera with square pixels. Eye space is X right, Y up, looking down -Z; row 0 of the
/// image is on top.
///
/// Invariant: `world_from_eye` is a rotation (orthonormal, right-handed), `focal_px` is positive
/// and finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: DVec3,
    world_from_eye: DMat3,
    focal_px: f64,
    principal_px: [f64; 2],
    width: u32,
    height: u32,
}

impl Camera {
    /// Maximum width and height of an image, pixels.
    pub const MAX_SIDE_PX: u32 = 16_384;

    /// Creates a camera at `eye` looking at `look_at`, with `up` (any length, not parallel to the
    /// view) pointing up in the image and `fov_y_deg` degrees between the top and the bottom edge,
    /// `width` by `height` pixels. If `up` is parallel to the view or zero, it is replaced by a
    /// world axis that is not: Y, or Z for views along Y.
    ///
    /// # Errors
    /// See [`CameraError`].
    pub fn look_at(
        eye: DVec3,
        look_at: DVec3,
        up: DVec3,
        fov_y_deg: f64,
        [width, height]: [u32; 2],
    ) -> Result<Self, CameraError> {
        for (point, name) in [(eye, "eye"), (look_at, "look-at point"), (up, "up vector")] {
            if !point.is_finite() {
                return Err(CameraError::NotFinite(name));
            }
        }
        if !(0.1..=179.0).contains(&fov_y_deg) {
            return Err(CameraError::FieldOfView(fov_y_deg));
        }
        let forward = (look_at - eye)
            .try_normalize()
            .ok_or(CameraError::NoDirection)?;
        let up = up
            .try_normalize()
            .filter(|up| up.cross(forward).length() > 1e-6);
        let up = up.unwrap_or_else(|| {
            if forward.y.abs() < 0.9 {
                DVec3::Y
            } else {
                DVec3::Z
            }
        });
        let right = forward.cross(up).normalize();
        // With `up` nearly parallel to the view, the cross product suffers from cancellation and is
        // no longer perpendicular.
        let right = (right - forward * forward.dot(right)).normalize();
        let world_from_eye = DMat3::from_cols(right, right.cross(forward), -forward);
        let focal_px = focal_px(f64::from(height), fov_y_deg);
        Self::from_parts(eye, world_from_eye, focal_px, width, height)
    }

    /// Creates a camera from its rotation (columns: right, up, back) and focal length in pixels,
    /// with the principal point at the centre of the image.
    ///
    /// # Errors
    /// [`CameraError::Size`] if a side is 0 or longer than [`Self::MAX_SIDE_PX`].
    pub fn from_parts(
        eye: DVec3,
        world_from_eye: DMat3,
        focal_px: f64,
        width: u32,
        height: u32,
    ) -> Result<Self, CameraError> {
        let sides = 1..=Self::MAX_SIDE_PX;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Err(CameraError::Size(width, height));
        }
        let principal_px = [f64::from(width) / 2.0, f64::from(height) / 2.0];
        Ok(Self {
            eye,
            world_from_eye,
            focal_px,
            principal_px,
            width,
            height,
        })
    }

    /// Returns the same camera with another eye position.
    #[must_use]
    pub fn with_eye(self, eye: DVec3) -> Self {
        Self { eye, ..self }
    }

    /// Returns the camera of a part of the image: pixel (0, 0) is the first of these columns and
    /// rows of the whole. The part may extend beyond the whole.
    ///
    /// # Errors
    /// [`CameraError::Size`] as for [`Self::from_parts`].
    pub fn cropped(self, columns: Range<u32>, rows: Range<u32>) -> Result<Self, CameraError> {
        let [width, height] = [&columns, &rows].map(|range| range.end.saturating_sub(range.start));
        let whole = Self::from_parts(self.eye, self.world_from_eye, self.focal_px, width, height)?;
        let [x, y] = self.principal_px;
        Ok(Self {
            principal_px: [x - f64::from(columns.start), y - f64::from(rows.start)],
            ..whole
        })
    }

    /// Returns the same camera with another principal point, pixels, as photographs have it.
    #[must_use]
    pub fn with_principal_px(self, principal_px: [f64; 2]) -> Self {
        Self {
            principal_px,
            ..self
        }
    }

    /// Principal point, pixels; the centre of the image unless it was cropped.
    pub fn principal_px(&self) -> [f64; 2] {
        self.principal_px
    }

    /// Position of the eye, world metres.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Rotation from eye space to world space; its columns are right, up and back (minus the
    /// viewing direction).
    pub fn world_from_eye(&self) -> DMat3 {
        self.world_from_eye
    }

    /// Unit vector along the viewing axis.
    pub fn forward(&self) -> DVec3 {
        -self.world_from_eye.z_axis
    }

    /// Distance from the eye to the image plane, in pixels.
    pub fn focal_px(&self) -> f64 {
        self.focal_px
    }

    /// Vertical field of view, degrees.
    pub fn fov_y_deg(&self) -> f64 {
        fov_deg(f64::from(self.height), self.focal_px)
    }

    /// Image width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Image height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Returns the matrix that takes a world point (X, Y, Z, 1) to (x w, y w, 1, w), where (x, y)
    /// is the position in pixels and w the eye depth. Its third row keeps the homogeneous 1, so
    /// that after the division by w the third component is the inverse depth (the choice
    /// `z2 = 1/Z2` of Shade et al., section 5.3; S20).
    pub fn image_from_world(&self) -> DMat4 {
        let [right, up, back] = self.world_from_eye.to_cols_array_2d().map(DVec3::from);
        let row_x = right * self.focal_px - back * self.principal_px[0];
        let row_y = -up * self.focal_px - back * self.principal_px[1];
        let row = |r: DVec3| DVec4::from((r, -r.dot(self.eye)));
        DMat4::from_cols(row(row_x), row(row_y), DVec4::W, row(-back)).transpose()
    }

    /// Projects a world point: position in pixels and eye depth, or `None` if it is not in front of
    /// the eye.
    pub fn project(&self, point: DVec3) -> Option<[f64; 3]> {
        let in_eye = self.world_from_eye.transpose() * (point - self.eye);
        let eye_depth = -in_eye.z;
        (eye_depth > 0.0).then(|| {
            let scale = self.focal_px / eye_depth;
            [
                self.principal_px[0] + in_eye.x * scale,
                self.principal_px[1] - in_eye.y * scale,
                eye_depth,
            ]
        })
    }

    /// Returns the world-space direction through the image position (x, y) in pixels, scaled to eye
    /// depth 1 (not normalised): `eye + eye_depth * direction` is the point seen there at that
    /// depth.
    pub fn direction(&self, x_px: f64, y_px: f64) -> DVec3 {
        let x = (x_px - self.principal_px[0]) / self.focal_px;
        let y = (self.principal_px[1] - y_px) / self.focal_px;
        self.world_from_eye * dvec3(x, y, -1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn image_from_world_agrees_with_project() {
        let eye = dvec3(0.3, -1.0, 2.0);
        let camera = Camera::look_at(eye, dvec3(4.0, 0.5, -3.0), DVec3::Y, 50.0, [320, 200])
            .expect("valid camera");
        for (x, y, depth) in [(0.0, 0.0, 0.5), (319.5, 10.0, 3.0), (100.0, 199.0, 250.0)] {
            let point = eye + camera.direction(x, y) * depth;
            let [px, py, eye_depth] = camera.project(point).expect("in front");
            assert!(
                (px - x).abs() < 1e-9 && (py - y).abs() < 1e-9 && (eye_depth - depth).abs() < 1e-9
            );
            let h = camera.image_from_world() * point.extend(1.0);
            assert!((h.x / h.w - x).abs() < 1e-9 && (h.y / h.w - y).abs() < 1e-9);
            assert!((h.z / h.w - 1.0 / depth).abs() < 1e-12 && (h.w - depth).abs() < 1e-9);
        }
        assert!(camera.project(eye - camera.forward()).is_none());
    }

    #[test]
    fn cropped_camera_sees_shifted_image() {
        let camera = Camera::look_at(
            DVec3::ZERO,
            dvec3(1.0, 0.2, -3.0),
            DVec3::Y,
            50.0,
            [320, 200],
        )
        .expect("valid");
        let part = camera.cropped(100..140, 7..200).expect("a part");
        assert_eq!(
            (part.width(), part.height(), part.principal_px()),
            (40, 193, [60.0, 93.0])
        );
        assert!((part.direction(3.0, 4.0) - camera.direction(103.0, 11.0)).length() < 1e-12);
        assert_eq!(camera.cropped(5..5, 0..9), Err(CameraError::Size(0, 9)));
    }

    #[test]
    fn field_of_view_round_trips_through_focal_length() {
        for fov in [0.1, 30.0, 90.0, 179.0] {
            let camera = Camera::look_at(DVec3::ZERO, DVec3::X, DVec3::Y, fov, [320, 200]);
            let found = camera.expect("valid").fov_y_deg();
            assert!((found - fov).abs() < 1e-12 * fov.max(1.0), "{found}");
            assert!((fov_deg(7.0, focal_px(7.0, fov)) - fov).abs() < 1e-12 * fov.max(1.0));
        }
        assert_eq!(fov_deg(2.0, 1.0), 90.0);
    }

    #[test]
    fn bad_cameras_are_refused() {
        let look = |eye, at, fov, w, h| Camera::look_at(eye, at, DVec3::Y, fov, [w, h]);
        let (o, x) = (DVec3::ZERO, DVec3::X);
        assert_eq!(look(o, o, 60.0, 4, 4), Err(CameraError::NoDirection));
        assert_eq!(
            look(DVec3::NAN, x, 60.0, 4, 4),
            Err(CameraError::NotFinite("eye"))
        );
        assert_eq!(
            look(o, x, 180.0, 4, 4),
            Err(CameraError::FieldOfView(180.0))
        );
        assert_eq!(look(o, x, 60.0, 0, 4), Err(CameraError::Size(0, 4)));
        assert!(
            look(o, DVec3::Y, 60.0, 4, 4).is_ok(),
            "looking along the up vector is allowed"
        );
    }
}
