//! Pose of the eye, as steered by the user.

use glam::{DMat3, DQuat, DVec3};
use headbox_core::camera::{Camera, CameraError};
use std::ops::RangeInclusive;

/// An eye that never rolls: position, heading, tilt and field of view. World metres.
///
/// With +Y up, yaw 0 and pitch 0 look down -Z, so that eye space and world space coincide; where
/// another direction is up (pictures taken with the camera on its side), everything is rotated by
/// the shortest arc from +Y to it. Positive yaw turns left (counter-clockwise seen from above),
/// positive pitch looks up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position of the eye, world metres.
    pub eye: DVec3,
    /// Heading, radians.
    pub yaw_rad: f64,
    /// Tilt, radians, at most [`Self::MAX_PITCH_RAD`] either way.
    pub pitch_rad: f64,
    /// Vertical field of view, degrees.
    pub fov_y_deg: f64,
    /// Up direction, a unit vector.
    pub up: DVec3,
}

impl Pose {
    /// Maximum tilt, radians. Below a right angle, so that the up direction always determines the
    /// roll when a pose is written as eye and look-at point.
    pub const MAX_PITCH_RAD: f64 = 89.5 * std::f64::consts::PI / 180.0;

    /// Range of the vertical field of view, degrees.
    pub const FOV_Y_DEG: RangeInclusive<f64> = 1.0..=170.0;

    /// Pose at `eye` that looks at `target` with a vertical field of view of `fov_y_deg` degrees,
    /// +Y up. Looks down -Z if the two points coincide.
    pub fn looking_at(eye: DVec3, target: DVec3, fov_y_deg: f64) -> Self {
        Self::upright(eye, target, DVec3::Y, fov_y_deg)
    }

    /// Same as [`Self::looking_at`] with up direction `up` (+Y if it is zero).
    pub fn upright(eye: DVec3, target: DVec3, up: DVec3, fov_y_deg: f64) -> Self {
        let up = up.try_normalize().unwrap_or(DVec3::Y);
        let forward = (target - eye)
            .try_normalize()
            .map_or(DVec3::NEG_Z, |ahead| {
                world_from_level(up).transpose() * ahead
            });
        let yaw_rad = if forward.x == 0.0 && forward.z == 0.0 {
            0.0
        } else {
            (-forward.x).atan2(-forward.z)
        };
        let pitch_rad = forward
            .y
            .clamp(-1.0, 1.0)
            .asin()
            .clamp(-Self::MAX_PITCH_RAD, Self::MAX_PITCH_RAD);
        // Adding 0 turns -0 into 0, for display.
        Self {
            eye,
            yaw_rad: yaw_rad + 0.0,
            pitch_rad,
            fov_y_deg: clamp(fov_y_deg, &Self::FOV_Y_DEG),
            up,
        }
    }

    /// Rotation from eye space to world space; its columns are right, up and back.
    pub fn world_from_eye(&self) -> DMat3 {
        world_from_level(self.up)
            * DMat3::from_rotation_y(self.yaw_rad)
            * DMat3::from_rotation_x(self.pitch_rad)
    }

    /// Unit vector along the viewing axis.
    pub fn forward(&self) -> DVec3 {
        -self.world_from_eye().z_axis
    }

    /// Camera of this pose for an image of `width` x `height` pixels.
    ///
    /// # Errors
    /// [`CameraError`] if the image size cannot be rendered.
    pub fn camera(&self, width: u32, height: u32) -> Result<Camera, CameraError> {
        let focal_px = f64::from(height) / 2.0 / (self.fov_y_deg.to_radians() / 2.0).tan();
        Camera::from_parts(self.eye, self.world_from_eye(), focal_px, width, height)
    }

    /// Returns the pose turned left by `yaw_rad` and up by `pitch_rad`, with limited tilt.
    #[must_use]
    pub fn turned(self, yaw_rad: f64, pitch_rad: f64) -> Self {
        let pitch_rad =
            (self.pitch_rad + pitch_rad).clamp(-Self::MAX_PITCH_RAD, Self::MAX_PITCH_RAD);
        Self {
            yaw_rad: self.yaw_rad + yaw_rad,
            pitch_rad,
            ..self
        }
    }

    /// Returns the pose with the image magnified by `factor` about its centre, with limited field
    /// of view.
    #[must_use]
    pub fn zoomed(self, factor: f64) -> Self {
        let half_height = (self.fov_y_deg.to_radians() / 2.0).tan() / factor;
        let fov_y_deg = (2.0 * half_height.atan()).to_degrees();
        Self {
            fov_y_deg: clamp(fov_y_deg, &Self::FOV_Y_DEG),
            ..self
        }
    }
}

/// Rotation from axes in which +Y is up to world axes.
fn world_from_level(up: DVec3) -> DMat3 {
    DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Y, up))
}

fn clamp(value: f64, range: &RangeInclusive<f64>) -> f64 {
    value.clamp(*range.start(), *range.end())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    /// A few roundings of sines and cosines of order 1.
    const ROTATION_TOLERANCE: f64 = 1e-12;

    #[test]
    fn looking_at_and_forward_are_inverse() {
        let eye = dvec3(1.0, 2.0, 3.0);
        for target in [
            dvec3(4.0, 2.5, -1.0),
            dvec3(-2.0, -3.0, 8.0),
            dvec3(1.0, 2.0, 10.0),
        ] {
            let pose = Pose::looking_at(eye, target, 60.0);
            assert!(pose.forward().distance((target - eye).normalize()) < ROTATION_TOLERANCE);
        }
    }

    #[test]
    fn positive_yaw_turns_left_and_positive_pitch_looks_up() {
        let pose = Pose::looking_at(DVec3::ZERO, DVec3::NEG_Z, 60.0);
        assert!(pose.turned(0.1, 0.0).forward().x < 0.0);
        assert!(pose.turned(0.0, 0.1).forward().y > 0.0);
    }

    #[test]
    fn the_camera_equals_the_one_made_from_eye_and_look_at() {
        let (eye, target) = (dvec3(0.2, 1.5, -0.4), dvec3(3.0, 0.5, -2.0));
        let ours = Pose::looking_at(eye, target, 47.0)
            .camera(320, 200)
            .unwrap();
        let theirs = Camera::look_at(eye, target, DVec3::Y, 47.0, [320, 200]).unwrap();
        let difference = ours.world_from_eye() - theirs.world_from_eye();
        assert!(
            difference
                .to_cols_array()
                .iter()
                .all(|d| d.abs() < ROTATION_TOLERANCE)
        );
        assert!((ours.focal_px() - theirs.focal_px()).abs() < 1e-9);
    }

    #[test]
    fn other_up_direction_is_kept_while_turning() {
        let eye = dvec3(0.3, -0.2, 0.9);
        for up in [
            DVec3::X,
            DVec3::NEG_Y,
            dvec3(1.0, 0.2, -3.0),
            dvec3(0.0, 0.9, 0.1),
        ] {
            let target = eye + dvec3(0.4, 0.6, -0.8);
            let pose = Pose::upright(eye, target, up, 50.0);
            assert!(
                pose.forward().distance((target - eye).normalize()) < ROTATION_TOLERANCE,
                "{up}"
            );
            let theirs = Camera::look_at(eye, target, up, 50.0, [64, 48])
                .unwrap()
                .world_from_eye();
            let difference = pose.world_from_eye() - theirs;
            assert!(
                difference
                    .to_cols_array()
                    .iter()
                    .all(|d| d.abs() < ROTATION_TOLERANCE),
                "{up} {difference}"
            );
            let right = pose.turned(0.7, -0.2).world_from_eye().x_axis;
            assert!(
                right.dot(up).abs() < ROTATION_TOLERANCE,
                "the horizon stays level: {up}"
            );
        }
        let none = Pose::upright(eye, eye, DVec3::ZERO, 50.0);
        assert!(none.up == DVec3::Y && none.forward() == DVec3::NEG_Z);
    }

    #[test]
    fn tilt_and_field_of_view_stay_in_range() {
        let pose = Pose::looking_at(DVec3::ZERO, DVec3::Y, 60.0).turned(0.0, 3.0);
        assert_eq!(pose.pitch_rad, Pose::MAX_PITCH_RAD);
        assert_eq!(pose.zoomed(1e9).fov_y_deg, 1.0);
        assert_eq!(pose.zoomed(1e-9).fov_y_deg, 170.0);
        let there_and_back = pose.zoomed(1.3).zoomed(1.0 / 1.3);
        assert!((there_and_back.fov_y_deg - 60.0).abs() < 1e-9);
    }
}
