//! Headbox: the cube from which a capture can be viewed.

use crate::camera::Camera;
use glam::DVec3;
use std::f64::consts::TAU;

/// Cube, aligned with the world's axes, in which the eye may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Headbox {
    /// Centre, world metres.
    pub centre: DVec3,
    /// Half of the edge length, metres.
    pub half_size_m: f64,
}

impl Headbox {
    /// Returns cameras on a closed loop about the eye of `first`, twice as wide as high, in the
    /// plane of its image and without turning, as a head moves to show parallax. The loop extends
    /// over nine tenths of the way to the nearest face of the headbox. `None` if the eye is not
    /// inside.
    #[must_use]
    pub fn camera_loop(&self, first: &Camera, count: usize) -> Option<Vec<Camera>> {
        /// Extent of the loop, in distances of the eye from the nearest face.
        const EXTENT: f64 = 0.9;
        let offset_m = (first.eye() - self.centre).abs().max_element();
        let radius_m = EXTENT * (self.half_size_m - offset_m);
        if radius_m.is_nan() || radius_m <= 0.0 {
            return None;
        }
        let rotation = first.world_from_eye();
        let pose = |i: usize| {
            let (sin, cos) = (TAU * i as f64 / count as f64).sin_cos();
            let eye =
                first.eye() + radius_m * (cos * rotation.x_axis + 0.5 * sin * rotation.y_axis);
            let [width, height] = [first.width(), first.height()];
            Camera::from_parts(eye, rotation, first.focal_px(), width, height).ok()
        };
        (0..count).map(pose).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_loop_stays_inside_and_shows_parallax() {
        let headbox = Headbox {
            centre: DVec3::new(1.0, 2.0, 3.0),
            half_size_m: 0.5,
        };
        let at = |offset: DVec3| {
            let eye = headbox.centre + offset;
            let target = eye + DVec3::new(1.0, -0.3, 0.7);
            Camera::look_at(eye, target, DVec3::Y, 60.0, [64, 48]).expect("valid")
        };
        for offset in [DVec3::ZERO, DVec3::new(0.3, -0.1, 0.2)] {
            let first = at(offset);
            let cameras = headbox.camera_loop(&first, 12).expect("has room");
            assert_eq!(cameras.len(), 12);
            for camera in &cameras {
                let offset_m = (camera.eye() - headbox.centre).abs().max_element();
                assert!(offset_m < headbox.half_size_m, "{offset_m}");
                assert_eq!(camera.world_from_eye(), first.world_from_eye());
            }
            let width_m = (cameras[0].eye() - cameras[6].eye()).length();
            let room_m = headbox.half_size_m - offset.abs().max_element();
            assert!((width_m - 1.8 * room_m).abs() < 1e-12, "{width_m}");
        }
        assert!(headbox.camera_loop(&at(DVec3::X), 12).is_none());
    }
}
