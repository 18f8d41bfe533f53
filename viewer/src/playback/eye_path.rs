//! Recorded or scripted paths of the eye.

use crate::input::pose::Pose;
use glam::DVec3;
use std::f64::consts::TAU;

/// A pose and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPose {
    /// Seconds since the start of the path.
    pub time_s: f64,
    /// The pose.
    pub pose: Pose,
}

/// Error of constructing a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PathError {
    /// There is no pose.
    #[error("a path needs at least one pose")]
    Empty,
    /// Times do not increase.
    #[error(
        "pose {0} of the path is not later than the one before it, or its time is not a finite number"
    )]
    Time(usize),
}

/// Poses at strictly increasing times, at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath(Vec<TimedPose>);

impl CameraPath {
    /// Creates a path through `poses`.
    ///
    /// # Errors
    /// [`PathError`] if there is no pose, or if times are not finite and strictly increasing.
    pub fn new(poses: Vec<TimedPose>) -> Result<Self, PathError> {
        let first = poses.first().ok_or(PathError::Empty)?;
        if !first.time_s.is_finite() {
            return Err(PathError::Time(0));
        }
        for (i, pair) in poses.windows(2).enumerate() {
            if !(pair[1].time_s > pair[0].time_s && pair[1].time_s.is_finite()) {
                return Err(PathError::Time(i + 1));
            }
        }
        Ok(Self(poses))
    }

    /// The poses, in order.
    pub fn poses(&self) -> &[TimedPose] {
        &self.0
    }

    /// Time of the last pose after the first, seconds.
    pub fn duration_s(&self) -> f64 {
        self.0[self.0.len() - 1].time_s - self.0[0].time_s
    }

    /// Interpolates the pose `time_s` seconds after the first one, constant beyond both ends.
    /// Position, heading, tilt and field of view follow monotone cubics (Fritsch and Carlson 1980):
    /// smooth, and never outside the range of the two neighbouring poses, so that a path inside a
    /// box stays inside. Headings turn the short way.
    pub fn pose_at(&self, time_s: f64) -> Pose {
        let poses = &self.0;
        let time = poses[0].time_s + time_s;
        let after = poses.partition_point(|p| p.time_s <= time);
        if after == 0 {
            return poses[0].pose;
        }
        let Some(next) = poses.get(after) else {
            return poses[after - 1].pose;
        };
        let around = [
            poses.get(after.wrapping_sub(2)),
            Some(&poses[after - 1]),
            Some(next),
            poses.get(after + 1),
        ];
        let heading = poses[after - 1].pose.yaw_rad;
        let value = |get: &dyn Fn(&Pose) -> f64| {
            cubic(around.map(|p| p.map(|p| (p.time_s, get(&p.pose)))), time)
        };
        let eye = DVec3::new(
            value(&|p| p.eye.x),
            value(&|p| p.eye.y),
            value(&|p| p.eye.z),
        );
        Pose {
            eye,
            yaw_rad: value(&|p| heading + short_way(p.yaw_rad - heading)),
            pitch_rad: value(&|p| p.pitch_rad),
            fov_y_deg: value(&|p| p.fov_y_deg),
            up: next.pose.up, // the same for all poses of a path
        }
    }
}

/// Reduces an angle by whole turns to [-pi, pi].
fn short_way(angle_rad: f64) -> f64 {
    angle_rad - TAU * (angle_rad / TAU).round()
}

/// Evaluates the monotone cubic between the two middle knots (time, value); the outer knots, if
/// there are any, determine the slopes.
fn cubic(knots: [Option<(f64, f64)>; 4], time: f64) -> f64 {
    let [before, Some((t0, v0)), Some((t1, v1)), after] = knots else {
        return f64::NAN;
    };
    let (span, slope) = (t1 - t0, (v1 - v0) / (t1 - t0));
    let slope_before = before.map(|(t, v)| ((v0 - v) / (t0 - t), t0 - t));
    let slope_after = after.map(|(t, v)| ((v - v1) / (t - t1), t - t1));
    let tangent = |neighbour: Option<(f64, f64)>| match neighbour {
        None => slope,
        Some((other, _)) if other * slope <= 0.0 => 0.0,
        Some((other, other_span)) => {
            // Weighted harmonic mean: never exceeds three times the smaller slope.
            let (w_here, w_other) = (2.0 * other_span + span, other_span + 2.0 * span);
            (w_here + w_other) / (w_here / slope + w_other / other)
        }
    };
    let (m0, m1) = (tangent(slope_before) * span, tangent(slope_after) * span);
    let u = (time - t0) / span;
    let (u2, u3) = (u * u, u * u * u);
    v0 * (2.0 * u3 - 3.0 * u2 + 1.0)
        + m0 * (u3 - 2.0 * u2 + u)
        + v1 * (3.0 * u2 - 2.0 * u3)
        + m1 * (u3 - u2)
}

/// Recorder of a path while the eye moves.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Recorder {
    poses: Vec<TimedPose>,
}

impl Recorder {
    /// Minimum time between two recorded poses, seconds: shorter than any movement by hand.
    pub(crate) const INTERVAL_S: f64 = 1.0 / 30.0;

    /// Records the pose `time_s` seconds after a fixed moment. While the eye rests, only the first
    /// and the last pose of the rest are stored.
    pub(crate) fn record(&mut self, time_s: f64, pose: Pose) {
        match self.poses.as_slice() {
            [.., last] if time_s - last.time_s < Self::INTERVAL_S => {}
            [.., before, last] if before.pose == last.pose && last.pose == pose => {
                if let Some(last) = self.poses.last_mut() {
                    last.time_s = time_s;
                }
            }
            _ => self.poses.push(TimedPose { time_s, pose }),
        }
    }

    /// Number of poses so far.
    pub(crate) fn len(&self) -> usize {
        self.poses.len()
    }

    /// Returns the path with its first pose at time 0, or `None` if nothing was recorded.
    pub(crate) fn finish(mut self) -> Option<CameraPath> {
        let start = self.poses.first()?.time_s;
        for pose in &mut self.poses {
            pose.time_s -= start;
        }
        CameraPath::new(self.poses).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    /// Rounding of a cubic's four terms.
    const CUBIC_TOLERANCE: f64 = 1e-12;

    fn pose(x: f64, yaw_rad: f64) -> Pose {
        Pose {
            eye: dvec3(x, 0.0, 0.0),
            yaw_rad,
            pitch_rad: 0.0,
            fov_y_deg: 60.0,
            up: DVec3::Y,
        }
    }

    fn path(knots: &[(f64, f64, f64)]) -> CameraPath {
        let poses = knots.iter().map(|&(time_s, x, yaw)| TimedPose {
            time_s,
            pose: pose(x, yaw),
        });
        CameraPath::new(poses.collect()).unwrap()
    }

    #[test]
    fn passes_through_its_poses_and_holds_the_ends() {
        let path = path(&[(0.0, 1.0, 0.0), (0.5, 2.0, 0.3), (2.0, -1.0, 0.1)]);
        for knot in path.poses() {
            let at = path.pose_at(knot.time_s);
            assert!(at.eye.distance(knot.pose.eye) < CUBIC_TOLERANCE);
            assert!((at.yaw_rad - knot.pose.yaw_rad).abs() < CUBIC_TOLERANCE);
        }
        assert_eq!(path.pose_at(-1.0), path.poses()[0].pose);
        assert_eq!(path.pose_at(9.0), path.poses()[2].pose);
        assert_eq!(path.duration_s(), 2.0);
    }

    #[test]
    fn path_stays_in_range_of_neighbouring_poses() {
        let path = path(&[
            (0.0, 0.0, 0.0),
            (1.0, 0.0, 0.0),
            (1.1, 1.0, 0.0),
            (3.0, 1.0, 0.0),
            (3.2, 0.4, 0.0),
        ]);
        for i in 0..=3200 {
            let x = path.pose_at(f64::from(i) / 1000.0).eye.x;
            assert!(
                (-CUBIC_TOLERANCE..=1.0 + CUBIC_TOLERANCE).contains(&x),
                "{i} ms: {x}"
            );
        }
    }

    #[test]
    fn uniform_motion_stays_uniform() {
        let path = path(&[
            (0.0, 0.0, 0.0),
            (1.0, 1.0, 0.0),
            (2.5, 2.5, 0.0),
            (3.0, 3.0, 0.0),
        ]);
        for i in 0..=30 {
            let t = f64::from(i) / 10.0;
            assert!((path.pose_at(t).eye.x - t).abs() < CUBIC_TOLERANCE, "{t}");
        }
    }

    #[test]
    fn headings_take_the_short_way() {
        let path = path(&[(0.0, 0.0, 3.1), (1.0, 0.0, -3.1)]);
        let middle = path.pose_at(0.5).yaw_rad;
        assert!(
            (short_way(middle).abs() - std::f64::consts::PI).abs() < 1e-9,
            "{middle}"
        );
    }

    #[test]
    fn bad_times_are_refused() {
        let at = |time_s| TimedPose {
            time_s,
            pose: pose(0.0, 0.0),
        };
        assert_eq!(CameraPath::new(vec![]), Err(PathError::Empty));
        assert_eq!(CameraPath::new(vec![at(f64::NAN)]), Err(PathError::Time(0)));
        assert_eq!(
            CameraPath::new(vec![at(0.0), at(1.0), at(1.0)]),
            Err(PathError::Time(2))
        );
        assert_eq!(
            CameraPath::new(vec![at(0.0), at(f64::INFINITY)]),
            Err(PathError::Time(1))
        );
    }

    #[test]
    fn recording_replays_recorded_poses() {
        let seen = |t: f64| pose((t * 1.3).sin(), 0.5 * t);
        let mut recorder = Recorder::default();
        for i in 0..300 {
            recorder.record(100.0 + f64::from(i) / 90.0, seen(f64::from(i) / 90.0));
        }
        assert!(
            recorder.len() <= 101,
            "at most 30 poses a second: {}",
            recorder.len()
        );
        let path = recorder.finish().unwrap();
        for i in 0..320 {
            let t = f64::from(i) / 100.0;
            assert!(path.pose_at(t).eye.distance(seen(t).eye) < 1e-3, "{t}");
        }
    }

    #[test]
    fn rest_is_recorded_by_two_poses() {
        let mut recorder = Recorder::default();
        for i in 0..=100 {
            recorder.record(f64::from(i), pose(0.0, 0.0));
        }
        recorder.record(101.0, pose(1.0, 0.0));
        assert_eq!(recorder.len(), 3);
        let path = recorder.finish().unwrap();
        assert_eq!(path.pose_at(99.0), pose(0.0, 0.0));
        assert!(Recorder::default().finish().is_none());
    }
}
