//! Bounds of the eye: a box with a soft edge that keeps the eye inside.

use glam::DVec3;

/// Axis-aligned box in which the eye may move (for a cube LDI the headbox). World metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EyeBounds {
    /// Centre of the box.
    pub centre: DVec3,
    /// Half its size along each axis, at least 0.
    pub half_size: DVec3,
}

impl EyeBounds {
    /// Width of the margin along the walls in which the eye is slowed down, as a share of the half
    /// size.
    pub const SOFT_SHARE: f64 = 0.15;

    /// Returns true if `eye` lies in the box (walls included).
    pub fn contains(&self, eye: DVec3) -> bool {
        (eye - self.centre).abs().cmple(self.half_size).all()
    }

    /// Returns the box with every wall moved inward by `distance` metres, to keep both eyes of a
    /// stereo pair inside.
    #[must_use]
    pub fn shrunk(&self, distance: f64) -> Self {
        Self {
            half_size: (self.half_size - distance).max(DVec3::ZERO),
            ..*self
        }
    }

    /// Moves the eye from `from` by `by`, slowed down at the walls. Along each axis it moves freely
    /// up to the soft margin ([`Self::SOFT_SHARE`]), then at a speed proportional to the distance
    /// left, so that it approaches the wall but never crosses it. An eye outside may only move
    /// back. The law is solved exactly, so one long move equals many short ones, at any frame rate.
    pub fn soft_move(&self, from: DVec3, by: DVec3) -> DVec3 {
        let offset = from - self.centre;
        let axis = |i: usize| soft_axis(offset[i], by[i], self.half_size[i]);
        self.centre + DVec3::new(axis(0), axis(1), axis(2))
    }

    /// Moves the eye from `from` by `by` along the straight line, as far as the box without its
    /// soft margin allows. An eye that is not in that part stays.
    pub fn clip(&self, from: DVec3, by: DVec3) -> DVec3 {
        let free = self.half_size * (1.0 - Self::SOFT_SHARE);
        let offset = from - self.centre;
        let share = |i: usize| {
            let wall = free[i].copysign(by[i]);
            if by[i] == 0.0 {
                1.0
            } else {
                ((wall - offset[i]) / by[i]).clamp(0.0, 1.0)
            }
        };
        from + by * share(0).min(share(1)).min(share(2))
    }

    /// Braking factor of the edge at `eye`: 0 where the eye moves freely, 1 on a wall or beyond.
    pub fn edge_share(&self, eye: DVec3) -> f64 {
        let offset = (eye - self.centre).abs();
        let share = |i: usize| {
            let margin = self.half_size[i] * Self::SOFT_SHARE;
            let left = self.half_size[i] - offset[i];
            if margin > 0.0 {
                (1.0 - left / margin).clamp(0.0, 1.0)
            } else {
                1.0
            }
        };
        share(0).max(share(1)).max(share(2))
    }
}

/// One axis of [`EyeBounds::soft_move`], with the centre at 0.
fn soft_axis(offset: f64, by: f64, half: f64) -> f64 {
    if by < 0.0 {
        return -soft_axis(-offset, -by, half);
    }
    let margin = half * EyeBounds::SOFT_SHARE;
    let free_until = half - margin;
    if offset + by <= free_until || by == 0.0 {
        return offset + by;
    }
    let start = offset.max(free_until);
    let left = half - start;
    if left <= 0.0 {
        return offset;
    }
    let rest = by - (start - offset);
    half - left * (-rest / margin).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    const BOUNDS: EyeBounds = EyeBounds {
        centre: DVec3::new(1.0, 2.0, 3.0),
        half_size: DVec3::new(0.5, 0.5, 1.0),
    };

    /// Rounding of a few exponentials on lengths of order 1 m.
    const MOVE_TOLERANCE_M: f64 = 1e-12;

    #[test]
    fn free_inside_and_never_through_the_wall() {
        let centre = BOUNDS.centre;
        assert_eq!(
            BOUNDS.soft_move(centre, dvec3(0.1, -0.2, 0.3)),
            centre + dvec3(0.1, -0.2, 0.3)
        );
        for by in [
            dvec3(1.0, 0.0, 0.0),
            dvec3(-40.0, 3.0, -1e9),
            DVec3::splat(1e300),
        ] {
            assert!(BOUNDS.contains(BOUNDS.soft_move(centre, by)), "{by}");
        }
    }

    #[test]
    fn one_long_move_equals_many_short_ones() {
        for by in [dvec3(0.9, -0.7, 0.2), dvec3(0.46, -0.5, 0.95)] {
            let once = BOUNDS.soft_move(BOUNDS.centre, by);
            let steps = 7;
            let many = (0..steps).fold(BOUNDS.centre, |eye, _| {
                BOUNDS.soft_move(eye, by / f64::from(steps))
            });
            assert!(once.distance(many) < MOVE_TOLERANCE_M, "{once} {many}");
        }
    }

    #[test]
    fn moving_inward_is_not_slowed() {
        let at_wall = BOUNDS.centre + dvec3(0.499, 0.0, 0.0);
        assert!(
            (BOUNDS.soft_move(at_wall, dvec3(-0.1, 0.0, 0.0)).x - (at_wall.x - 0.1)).abs()
                < MOVE_TOLERANCE_M
        );
    }

    #[test]
    fn eye_outside_moves_only_inward() {
        let outside = BOUNDS.centre + dvec3(2.0, 0.0, 0.0);
        assert_eq!(BOUNDS.soft_move(outside, dvec3(0.5, 0.0, 0.0)), outside);
        assert_eq!(
            BOUNDS.soft_move(outside, dvec3(-0.5, 0.0, 0.0)),
            outside - dvec3(0.5, 0.0, 0.0)
        );
    }

    #[test]
    fn clipped_move_keeps_its_direction() {
        let [near, far] = [0.1, 9.0].map(|length| dvec3(1.0, 2.0, -0.5) * length);
        assert_eq!(BOUNDS.clip(BOUNDS.centre, near), BOUNDS.centre + near);
        let moved = BOUNDS.clip(BOUNDS.centre, far) - BOUNDS.centre;
        assert!(moved.normalize().distance(far.normalize()) < MOVE_TOLERANCE_M);
        assert!((moved.y - 0.5 * (1.0 - EyeBounds::SOFT_SHARE)).abs() < MOVE_TOLERANCE_M);
        let at_wall = BOUNDS.centre + dvec3(0.5, 0.0, 0.0);
        assert_eq!(BOUNDS.clip(at_wall, far), at_wall);
    }

    #[test]
    fn empty_box_fixes_eye() {
        let point = EyeBounds {
            centre: DVec3::ZERO,
            half_size: DVec3::ZERO,
        };
        assert_eq!(
            point.soft_move(DVec3::ZERO, dvec3(1.0, -1.0, 0.0)),
            DVec3::ZERO
        );
        assert_eq!(BOUNDS.shrunk(9.0).half_size, DVec3::ZERO);
    }

    #[test]
    fn the_brake_share_grows_from_0_to_1() {
        let at = |x: f64| BOUNDS.edge_share(BOUNDS.centre + dvec3(x, 0.0, 0.0));
        assert_eq!(at(0.0), 0.0);
        assert!(at(0.5 * (1.0 - EyeBounds::SOFT_SHARE)) < 1e-9);
        assert!((at(0.5 * (1.0 - EyeBounds::SOFT_SHARE / 2.0)) - 0.5).abs() < 1e-9);
        assert_eq!(at(0.6), 1.0);
    }
}
