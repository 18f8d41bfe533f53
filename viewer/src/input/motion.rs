//! Motion of the eye: from keys, mouse and wheel to the next pose. Smooth at any frame rate,
//! independent of the window.

use crate::input::bounds::EyeBounds;
use crate::input::pose::Pose;
use glam::DVec3;
use headbox_core::view::Navigation;

/// Input since the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Steering {
    /// Held movement keys: right, up, forward, each -1, 0 or 1.
    pub drive: DVec3,
    /// Held turning keys: left, up, each -1, 0 or 1.
    pub turn: [f64; 2],
    /// Mouse drag since the last frame: right, down, in points.
    pub drag_points: [f64; 2],
    /// Wheel since the last frame, in notches; positive magnifies.
    pub wheel_notches: f64,
    /// Factor on the speed (shift, alt).
    pub speed_factor: f64,
}

/// Response to steering: user preferences and the source's kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SteeringResponse {
    /// Free flight, walking or orbiting.
    pub navigation: Navigation,
    /// Speed of the eye with a key held, metres per second.
    pub speed_m_per_s: f64,
    /// True if a drag moves the scene with the pointer, false if it turns the head with it.
    pub grab_scene: bool,
    /// The box in which the eye stays.
    pub bounds: Option<EyeBounds>,
    /// Height of the shown frame, points: a drag over the whole height turns by the field of view.
    pub view_height_points: f64,
}

/// Velocity of the eye. Velocities follow the keys with a first-order lag, integrated exactly over
/// a frame, so that the distance covered does not depend on the frame rate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Motion {
    /// Velocity along the axes of [`Navigation`]: right, up, forward, metres per second.
    velocity: DVec3,
    /// Angular velocity: left, up, radians per second.
    turning: [f64; 2],
}

/// Time constant of the lag, seconds: short enough to feel direct, long enough to smooth key
/// presses.
const LAG_S: f64 = 0.07;
/// Speed of the turning keys, radians per second.
const TURN_RAD_PER_S: f64 = 1.3;
/// Magnification of one wheel notch.
const NOTCH_ZOOM: f64 = 1.1;
/// Share of the full speed below which the eye stops, so that the window need not repaint.
const STANDSTILL_SHARE: f64 = 2e-3;
/// Minimum distance of an orbiting eye from its pivot, metres.
const MIN_ORBIT_RADIUS_M: f64 = 1e-3;

impl Motion {
    /// Returns true if the eye still moves, even with no key held.
    pub(crate) fn is_moving(&self) -> bool {
        *self != Self::default()
    }

    /// Returns the pose `dt_s` seconds after `pose`.
    pub(crate) fn advance(
        &mut self,
        pose: &Pose,
        steering: &Steering,
        handling: &SteeringResponse,
        dt_s: f64,
    ) -> Pose {
        let speed = handling.speed_m_per_s * steering.speed_factor;
        let drive = if steering.drive.length() > 1.0 {
            steering.drive.normalize()
        } else {
            steering.drive
        };
        let mut travel = DVec3::ZERO;
        for i in 0..3 {
            (self.velocity[i], travel[i]) = follow_with_lag(
                self.velocity[i],
                drive[i] * speed,
                dt_s,
                handling.speed_m_per_s,
            );
        }
        let mut turn = [0.0; 2];
        for i in 0..2 {
            let wanted = steering.turn[i] * TURN_RAD_PER_S;
            (self.turning[i], turn[i]) =
                follow_with_lag(self.turning[i], wanted, dt_s, TURN_RAD_PER_S);
        }
        let rad_per_point = pose.fov_y_deg.to_radians() / handling.view_height_points.max(1.0);
        let orbits = matches!(handling.navigation, Navigation::Orbit { .. });
        let drag_sign = if handling.grab_scene || orbits {
            1.0
        } else {
            -1.0
        };
        for i in 0..2 {
            turn[i] += drag_sign * steering.drag_points[i] * rad_per_point;
        }
        // Without the wheel the field of view stays exactly the same.
        let pose = if steering.wheel_notches != 0.0 {
            pose.zoomed(NOTCH_ZOOM.powf(steering.wheel_notches))
        } else {
            *pose
        };
        match handling.navigation {
            Navigation::Fly | Navigation::Walk => {
                let pose = pose.turned(turn[0], turn[1]);
                let by = world_travel(&pose, handling.navigation, travel);
                Pose {
                    eye: move_eye(handling.bounds, pose.eye, by),
                    ..pose
                }
            }
            Navigation::Orbit { pivot, nearest } => {
                // A drag to the right turns the object to the right: the eye orbits to the left.
                let turned = Pose::upright(pose.eye, pivot, pose.up, pose.fov_y_deg)
                    .turned(-turn[0], -turn[1]);
                let radius =
                    (pose.eye.distance(pivot) - travel.z).max(nearest.max(MIN_ORBIT_RADIUS_M));
                let around = turned.turned(travel.x / radius, -travel.y / radius);
                let eye = move_eye(
                    handling.bounds,
                    pose.eye,
                    pivot - around.forward() * radius - pose.eye,
                );
                Pose {
                    eye,
                    ..Pose::upright(eye, pivot, pose.up, pose.fov_y_deg)
                }
            }
        }
    }

    /// Stops immediately (after a jump to another pose).
    pub(crate) fn stop(&mut self) {
        *self = Self::default();
    }
}

/// Transforms travel along right, up, forward to world axes: flight follows the view, walking stays
/// level; both use the pose's up direction.
fn world_travel(pose: &Pose, navigation: Navigation, travel: DVec3) -> DVec3 {
    let level = Pose {
        pitch_rad: 0.0,
        ..*pose
    };
    let forward = if navigation == Navigation::Walk {
        level.forward()
    } else {
        pose.forward()
    };
    level.world_from_eye().x_axis * travel.x + pose.up * travel.y + forward * travel.z
}

fn move_eye(bounds: Option<EyeBounds>, eye: DVec3, by: DVec3) -> DVec3 {
    bounds.map_or(eye + by, |bounds| bounds.soft_move(eye, by))
}

/// Returns the velocity after `dt_s` seconds and the distance covered, for a velocity that
/// approaches `wanted` with time constant [`LAG_S`].
fn follow_with_lag(velocity: f64, wanted: f64, dt_s: f64, full_speed: f64) -> (f64, f64) {
    let kept = (-dt_s / LAG_S).exp();
    let next = wanted + (velocity - wanted) * kept;
    let way = wanted * dt_s + (velocity - wanted) * LAG_S * (1.0 - kept);
    let rests = wanted == 0.0 && next.abs() < full_speed * STANDSTILL_SHARE;
    (if rests { 0.0 } else { next }, way)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    const PIVOT: DVec3 = DVec3::new(0.0, 0.0, -3.0);
    const ORBIT: Navigation = Navigation::Orbit {
        pivot: PIVOT,
        nearest: 1.0,
    };

    fn handling(navigation: Navigation) -> SteeringResponse {
        SteeringResponse {
            navigation,
            speed_m_per_s: 2.0,
            grab_scene: false,
            bounds: None,
            view_height_points: 600.0,
        }
    }

    fn start() -> Pose {
        Pose::looking_at(DVec3::ZERO, DVec3::NEG_Z, 60.0)
    }

    fn held(drive: DVec3) -> Steering {
        Steering {
            drive,
            speed_factor: 1.0,
            ..Steering::default()
        }
    }

    fn simulate(
        steering: &Steering,
        handling: &SteeringResponse,
        seconds: f64,
        fps: u32,
    ) -> (Pose, Motion) {
        let (mut pose, mut motion) = (start(), Motion::default());
        for _ in 0..(seconds * f64::from(fps)) as u32 {
            pose = motion.advance(&pose, steering, handling, 1.0 / f64::from(fps));
        }
        (pose, motion)
    }

    #[test]
    fn distance_does_not_depend_on_frame_rate() {
        // Walking straight ahead has a closed solution, so the only difference is rounding.
        let steering = held(dvec3(1.0, 0.0, 1.0));
        let [slow, fast] = [10, 240].map(|fps| {
            simulate(&steering, &handling(Navigation::Fly), 1.0, fps)
                .0
                .eye
        });
        assert!(slow.distance(fast) < 1e-9, "{slow} {fast}");
        assert!(slow.x > 1.0 && slow.z < -1.0, "right and forward: {slow}");
    }

    #[test]
    fn diagonals_are_no_faster_and_lag_delays_by_time_constant() {
        let straight = simulate(
            &held(dvec3(0.0, 0.0, 1.0)),
            &handling(Navigation::Fly),
            1.0,
            60,
        )
        .0
        .eye
        .length();
        let diagonal = simulate(
            &held(dvec3(1.0, 1.0, 1.0)),
            &handling(Navigation::Fly),
            1.0,
            60,
        )
        .0
        .eye
        .length();
        assert!((straight - diagonal).abs() < 1e-9);
        assert!((straight - 2.0 * (1.0 - LAG_S)).abs() < 1e-4);
    }

    #[test]
    fn the_eye_comes_to_rest() {
        let (mut pose, mut motion) = simulate(&held(DVec3::Z), &handling(Navigation::Fly), 0.5, 60);
        assert!(motion.is_moving());
        for _ in 0..60 {
            pose = motion.advance(
                &pose,
                &held(DVec3::ZERO),
                &handling(Navigation::Fly),
                1.0 / 60.0,
            );
        }
        assert!(!motion.is_moving());
        assert_eq!(
            motion.advance(&pose, &held(DVec3::ZERO), &handling(Navigation::Fly), 1.0),
            pose
        );
    }

    #[test]
    fn a_drag_over_the_height_turns_by_the_field_of_view() {
        let mut steering = held(DVec3::ZERO);
        steering.drag_points = [600.0, -300.0];
        let pose =
            Motion::default().advance(&start(), &steering, &handling(Navigation::Fly), 1.0 / 60.0);
        assert!(
            (pose.yaw_rad + 60_f64.to_radians()).abs() < 1e-12,
            "the head follows the pointer to the right"
        );
        assert!(
            (pose.pitch_rad - 30_f64.to_radians()).abs() < 1e-12,
            "and up"
        );
        let grabbing = SteeringResponse {
            grab_scene: true,
            ..handling(Navigation::Fly)
        };
        let grabbed = Motion::default().advance(&start(), &steering, &grabbing, 1.0 / 60.0);
        assert!((grabbed.yaw_rad + pose.yaw_rad).abs() < 1e-12);
    }

    #[test]
    fn walking_stays_level() {
        let looking_down = start().turned(0.0, -1.0);
        let step = |navigation| {
            Motion::default().advance(&looking_down, &held(DVec3::Z), &handling(navigation), 0.5)
        };
        assert_eq!(step(Navigation::Walk).eye.y, 0.0);
        assert!(step(Navigation::Fly).eye.y < -0.1);
    }

    #[test]
    fn orbiting_keeps_distance_and_looks_at_the_pivot() {
        let mut steering = held(DVec3::ZERO);
        steering.drag_points = [120.0, 40.0];
        let pose = Motion::default().advance(&start(), &steering, &handling(ORBIT), 1.0 / 60.0);
        assert!((pose.eye.distance(PIVOT) - 3.0).abs() < 1e-9);
        assert!(pose.forward().distance((PIVOT - pose.eye).normalize()) < 1e-9);
        assert!(
            pose.eye.x < 0.0 && pose.eye.y > 0.0,
            "dragging right and down shows the left and the top: {}",
            pose.eye
        );
    }

    #[test]
    fn orbit_has_minimum_radius() {
        let (pose, _) = simulate(&held(DVec3::Z), &handling(ORBIT), 5.0, 30);
        assert!((pose.eye.distance(PIVOT) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn eye_stays_in_bounds() {
        let bounds = EyeBounds {
            centre: DVec3::ZERO,
            half_size: DVec3::splat(0.25),
        };
        for navigation in [Navigation::Fly, Navigation::Walk, ORBIT] {
            let handling = SteeringResponse {
                bounds: Some(bounds),
                ..handling(navigation)
            };
            let (pose, _) = simulate(&held(dvec3(1.0, 0.3, 1.0)), &handling, 5.0, 30);
            assert!(bounds.contains(pose.eye), "{navigation:?} {}", pose.eye);
            assert_eq!(pose.fov_y_deg, 60.0, "moving does not zoom");
        }
    }
}
