//! Camera pose: position and orientation.

use glam::{DMat3, DMat4, DVec3};

/// Position and orientation of a camera in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The eye, world metres.
    pub eye: DVec3,
    /// Rotation from eye space (X right, Y up, looking down -Z) to the world.
    pub world_from_eye: DMat3,
}

/// Maximum deviation of a matrix from a rotation: poses are written with about six digits.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// Maximum distance of an eye from the origin along an axis, in the file's unit: the Earth is
/// 12,756,000 m across, so a larger number is an error.
const FARTHEST_EYE: f64 = 1e9;

impl Pose {
    /// Pose at the origin that looks down -Z.
    pub(crate) const IDENTITY: Self = Self {
        eye: DVec3::ZERO,
        world_from_eye: DMat3::IDENTITY,
    };

    /// Converts a camera-to-world matrix whose eye space is that of this crate (OpenGL, Blender,
    /// nerfstudio, Seurat).
    ///
    /// # Errors
    /// The rest of a sentence if the matrix is not finite, mirrors, or is not a rotation.
    pub fn from_opengl(world_from_eye: DMat4) -> Result<Self, String> {
        if !world_from_eye.is_finite() {
            return Err("is not finite".into());
        }
        let rotation = DMat3::from_mat4(world_from_eye);
        let eye = world_from_eye.w_axis.truncate();
        let last_row = world_from_eye.transpose().w_axis;
        if (last_row - glam::DVec4::W).abs().max_element() > ROTATION_TOLERANCE {
            return Err(format!("its last row is {last_row}, not 0, 0, 0, 1"));
        }
        let farthest = eye.abs().max_element();
        if farthest > FARTHEST_EYE {
            return Err(format!("puts the eye {farthest:.3e} away from the origin"));
        }
        Ok(Self {
            eye,
            world_from_eye: orthonormalize(rotation)?,
        })
    }

    /// Converts a camera-to-world matrix whose camera has X right, Y down, Z forward (OpenCV, RGB-D
    /// sensors).
    ///
    /// # Errors
    /// See [`Self::from_opengl`].
    pub fn from_opencv(world_from_camera: DMat4) -> Result<Self, String> {
        let flip = DMat4::from_diagonal(glam::dvec4(1.0, -1.0, -1.0, 1.0));
        Self::from_opengl(world_from_camera * flip)
    }

    /// Converts world-to-camera extrinsics whose camera has X right, Y down, Z forward (COLMAP,
    /// Middlebury).
    ///
    /// # Errors
    /// See [`Self::from_opengl`].
    pub fn from_camera_from_world(rotation: DMat3, translation: DVec3) -> Result<Self, String> {
        let world_from_camera = rotation.transpose();
        let eye = -(world_from_camera * translation);
        let mut matrix = DMat4::from_mat3(world_from_camera);
        matrix.w_axis = eye.extend(1.0);
        Self::from_opencv(matrix)
    }

    /// Converts the pose from the axes and unit of a file to the world.
    pub fn in_world(self, frame: &headbox_core::file_frame::FileFrame) -> Self {
        let turn = |axis: DVec3| frame.world_direction_from_file(axis);
        let [x, y, z] = [
            self.world_from_eye.x_axis,
            self.world_from_eye.y_axis,
            self.world_from_eye.z_axis,
        ]
        .map(turn);
        Self {
            eye: frame.world_from_file(self.eye),
            world_from_eye: DMat3::from_cols(x, y, z),
        }
    }

    /// Returns the angle between two poses, degrees, and the distance of their eyes, metres.
    pub fn difference(&self, other: &Self) -> [f64; 2] {
        let turn = self.world_from_eye * other.world_from_eye.transpose();
        let cosine = (turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0) / 2.0;
        [
            cosine.clamp(-1.0, 1.0).acos().to_degrees(),
            self.eye.distance(other.eye),
        ]
    }

    /// Transforms a point from eye space to the world.
    pub fn to_world(&self, point: DVec3) -> DVec3 {
        self.eye + self.world_from_eye * point
    }

    /// Transforms a point from the world to eye space.
    pub fn to_eye(&self, point: DVec3) -> DVec3 {
        self.world_from_eye.transpose() * (point - self.eye)
    }
}

/// Returns the mean angle of pairs of poses, degrees, and the mean distance of their eyes, metres.
pub(crate) fn mean_difference(pairs: impl ExactSizeIterator<Item = (Pose, Pose)>) -> [f64; 2] {
    let count = pairs.len().max(1) as f64;
    let differences = pairs.map(|(pose, other)| pose.difference(&other));
    differences
        .fold([0.0; 2], |sum, difference| {
            [sum[0] + difference[0], sum[1] + difference[1]]
        })
        .map(|sum| sum / count)
}

/// Orthonormalises a matrix that is a rotation up to rounding.
fn orthonormalize(matrix: DMat3) -> Result<DMat3, String> {
    let max_difference = |gram: DMat3| {
        let differences = (gram - DMat3::IDENTITY).abs().to_cols_array();
        differences.into_iter().fold(0.0, f64::max)
    };
    let gram = matrix.transpose() * matrix;
    let error = max_difference(gram);
    if error > ROTATION_TOLERANCE * 3.0 {
        let scale = matrix.determinant().abs().cbrt();
        let unscaled_error = max_difference(gram * (1.0 / (scale * scale)));
        return Err(if unscaled_error < ROTATION_TOLERANCE * 3.0 {
            format!("is a rotation times a scale of {scale:.6}; poses must not scale")
        } else {
            format!("is not a rotation: its columns deviate from orthonormal by {error:.3}")
        });
    }
    if matrix.determinant() < 0.0 {
        return Err(
            "mirrors (its determinant is -1): the file is left-handed, or an axis is flipped"
                .into(),
        );
    }
    let x = matrix.x_axis.normalize();
    let y = (matrix.y_axis - x * x.dot(matrix.y_axis)).normalize();
    Ok(DMat3::from_cols(x, y, x.cross(y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opencv_pose_looks_along_z() {
        let pose =
            Pose::from_opencv(DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0))).expect("a pose");
        assert_eq!(
            pose.to_world(DVec3::new(0.0, 0.0, -2.0)),
            DVec3::new(1.0, 2.0, 5.0),
            "forward"
        );
        assert_eq!(
            pose.to_world(DVec3::Y),
            DVec3::new(1.0, 1.0, 3.0),
            "up is minus the file's y"
        );
        let turned =
            Pose::from_camera_from_world(DMat3::from_rotation_y(0.4), DVec3::new(0.1, 0.2, 0.3))
                .expect("one");
        let p = DVec3::new(3.0, -2.0, 1.0);
        let camera = DMat3::from_rotation_y(0.4) * p + DVec3::new(0.1, 0.2, 0.3);
        assert!((turned.to_eye(p) - camera * DVec3::new(1.0, -1.0, -1.0)).length() < 1e-12);
    }

    #[test]
    fn invalid_matrix_refused_with_reason() {
        let error = |matrix: DMat4| Pose::from_opengl(matrix).expect_err("no pose");
        assert!(error(DMat4::from_scale(DVec3::splat(1000.0))).contains("scale of 1000"));
        assert!(error(DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0))).contains("mirrors"));
        assert!(error(DMat4::from_scale(DVec3::new(1.0, 2.0, 1.0))).contains("not a rotation"));
        assert!(error(DMat4::from_translation(DVec3::NAN)).contains("finite"));
        assert!(error(DMat4::from_translation(DVec3::X * 1e300)).contains("away from the origin"));
        assert!(error(DMat4::ZERO).contains("last row"));
    }
}
