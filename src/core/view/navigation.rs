//! First view, navigation and floor plan.

use crate::camera::{Camera, CameraError};
use glam::DVec3;

/// First view of a representation: an upright eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartView {
    /// Position, world metres.
    pub eye: DVec3,
    /// Viewing direction, a unit vector.
    pub forward: DVec3,
    /// Up direction, a unit vector.
    pub up: DVec3,
    /// Vertical field of view, degrees.
    pub fov_y_deg: f64,
}

impl StartView {
    /// Takes the view of a camera without its roll.
    pub fn from_camera(camera: &Camera) -> Self {
        Self {
            eye: camera.eye(),
            forward: camera.forward(),
            up: level_up(Some(camera.world_from_eye().y_axis)),
            fov_y_deg: camera.fov_y_deg(),
        }
    }

    /// Creates the camera of this view for a frame of `size_px` (width, height).
    ///
    /// # Errors
    /// [`CameraError`] if the frame cannot be rendered.
    pub fn camera(&self, size_px: [u32; 2]) -> Result<Camera, CameraError> {
        let target = self.eye + self.forward;
        Camera::look_at(self.eye, target, self.up, self.fov_y_deg, size_px)
    }
}

/// Returns the up direction for images taken with `pictures_up` upward: +Y, unless that would show
/// them sideways.
pub fn level_up(pictures_up: Option<DVec3>) -> DVec3 {
    /// Cosine of 45 degrees: +Y is still up for cameras that look down or up by less.
    const LEVEL: f64 = std::f64::consts::FRAC_1_SQRT_2;
    pictures_up.filter(|up| up.y < LEVEL).unwrap_or(DVec3::Y)
}

/// Navigation mode.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Navigation {
    /// Forward is the viewing direction.
    #[default]
    Fly,
    /// Forward stays level.
    Walk,
    /// The eye circles a point and looks at it (sprites).
    Orbit {
        /// Point, world metres.
        pivot: DVec3,
        /// Smallest distance from the point, metres.
        nearest: f64,
    },
}

/// Floor plan of rooms, in world metres: (x, z) pairs; x points right and z down on the page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomMap {
    /// Rooms.
    pub rooms: Vec<Room>,
    /// Doors and other openings, as line segments.
    pub openings: Vec<[[f64; 2]; 2]>,
}

/// Room of a [`RoomMap`].
#[derive(Clone, Debug, PartialEq)]
pub struct Room {
    /// Name.
    pub name: String,
    /// Corners of the floor, a simple polygon.
    pub outline: Vec<[f64; 2]>,
}

impl RoomMap {
    /// Returns the first room whose outline contains the eye, by the even-odd rule.
    pub fn room_at(&self, eye: DVec3) -> Option<usize> {
        self.rooms
            .iter()
            .position(|room| room.contains([eye.x, eye.z]))
    }
}

impl Room {
    fn contains(&self, [x, z]: [f64; 2]) -> bool {
        let next = self.outline.iter().cycle().skip(1);
        let crossings = self
            .outline
            .iter()
            .zip(next)
            .filter(|&(&[ax, az], &[bx, bz])| {
                let spans = (az > z) != (bz > z);
                spans && x < ax + (z - az) / (bz - az) * (bx - ax)
            });
        crossings.count() % 2 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn room_contains_eye() {
        let room = |name: &str, outline: &[[f64; 2]]| Room {
            name: name.into(),
            outline: outline.to_vec(),
        };
        let ell = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 1.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [0.0, 3.0],
        ];
        let square = [[1.0, 1.0], [4.0, 1.0], [4.0, 3.0], [1.0, 3.0]];
        let plan = RoomMap {
            rooms: vec![room("ell", &ell), room("square", &square)],
            openings: vec![],
        };
        assert_eq!(plan.room_at(dvec3(0.5, 1.6, 2.0)), Some(0));
        assert_eq!(plan.room_at(dvec3(3.0, -9.0, 0.5)), Some(0));
        assert_eq!(plan.room_at(dvec3(2.0, 0.0, 2.0)), Some(1));
        assert_eq!(plan.room_at(dvec3(5.0, 0.0, 2.0)), None);
    }
}
