//! Flight of the eye to another pose, in a fraction of a second, so that the user sees where it
//! went.

use crate::input::pose::Pose;
use crate::playback::eye_path::{CameraPath, TimedPose};

/// A flight from one pose to another.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Flight {
    path: CameraPath,
    /// Time of its start on the window's clock, seconds.
    start_s: f64,
}

impl Flight {
    /// Duration, seconds.
    pub(crate) const DURATION_S: f64 = 0.35;

    /// Creates a flight; `None` if a pose is not finite.
    pub(crate) fn new(from: Pose, to: Pose, start_s: f64) -> Option<Self> {
        let timed = |time_s, pose| TimedPose { time_s, pose };
        let poses = vec![timed(0.0, from), timed(1.0, to)];
        let path = CameraPath::new(poses).ok().filter(|_| to.eye.is_finite())?;
        Some(Self { path, start_s })
    }

    /// Returns the pose at a time on the window's clock, and true if the flight is over.
    pub(crate) fn pose_at(&self, now_s: f64) -> (Pose, bool) {
        let time = ((now_s - self.start_s) / Self::DURATION_S).clamp(0.0, 1.0);
        // Smoothstep: starts and ends at rest.
        let pose = self.path.pose_at(time * time * (3.0 - 2.0 * time));
        (pose, time >= 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, dvec3};

    #[test]
    fn flight_starts_and_ends_at_its_poses() {
        let from = Pose::looking_at(DVec3::ZERO, DVec3::NEG_Z, 60.0);
        let to = Pose::looking_at(DVec3::X, dvec3(1.0, 3.0, 4.0), 40.0);
        let flight = Flight::new(from, to, 10.0).unwrap();
        assert_eq!(flight.pose_at(9.0), (from, false));
        assert_eq!(flight.pose_at(10.0), (from, false));
        assert_eq!(flight.pose_at(11.0), (to, true));
        let (middle, over) = flight.pose_at(10.0 + Flight::DURATION_S / 2.0);
        assert!(!over && (middle.eye.x - 0.5).abs() < 1e-9);
        let nowhere = Pose {
            eye: DVec3::INFINITY,
            ..to
        };
        assert_eq!(Flight::new(from, nowhere, 0.0), None);
    }
}
