//! From a pixel of one picture and an inverse depth to its place in another: `start + q * shift`.

use crate::{Pinhole, Pose};
use glam::{DVec3, Vec3};

/// A camera at one size of its picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraAt {
    /// Focal lengths and principal point, pixels of this size.
    pub(super) focal_px: [f64; 2],
    pub(super) principal_px: [f64; 2],
    pub(super) pose: Pose,
}

impl CameraAt {
    /// Of a picture that is halved `shift` times.
    pub(super) fn new(lens: Pinhole, pose: Pose, shift: u32) -> Self {
        let scale = 0.5f64.powi(shift as i32);
        let [focal_px, principal_px] =
            [lens.focal_px, lens.principal_px].map(|pair| pair.map(|c| c * scale));
        Self {
            focal_px,
            principal_px,
            pose,
        }
    }

    /// The ray through a position, pixels, at eye depth 1; eye space.
    pub(super) fn ray(&self, x: f64, y: f64) -> DVec3 {
        let [cx, cy] = self.principal_px;
        DVec3::new(
            (x - cx) / self.focal_px[0],
            (cy - y) / self.focal_px[1],
            -1.0,
        )
    }

    /// (x w, y w, w) of a point or direction of eye space.
    fn homogeneous(&self, p: DVec3) -> DVec3 {
        let [cx, cy] = self.principal_px;
        DVec3::new(
            self.focal_px[0] * p.x - cx * p.z,
            -self.focal_px[1] * p.y - cy * p.z,
            -p.z,
        )
    }
}

/// Where another camera sees what this one sees: (x w, y w, w), w the other's eye depth times this one's inverse depth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Relative {
    /// Of the picture's upper left corner at infinity.
    start: Vec3,
    /// What a pixel to the right adds.
    right: Vec3,
    /// What a pixel down adds.
    down: Vec3,
    /// What an inverse depth of 1/m adds.
    shift: Vec3,
}

/// What a plane looks like from another camera: affine in the pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// (x w, y w, w) of the pixel.
    pub(super) at: Vec3,
    /// What steps right and down on the plane add.
    pub(super) right: Vec3,
    pub(super) down: Vec3,
}

impl Relative {
    pub(super) fn new(from: &CameraAt, to: &CameraAt) -> Self {
        let turn = to.pose.world_from_eye.transpose() * from.pose.world_from_eye;
        let of = |x: f64, y: f64| to.homogeneous(turn * from.ray(x, y));
        let (start, right, down) = (of(0.0, 0.0), of(1.0, 0.0), of(0.0, 1.0));
        Self {
            start: start.as_vec3(),
            right: (right - start).as_vec3(),
            down: (down - start).as_vec3(),
            shift: to.homogeneous(to.pose.to_eye(from.pose.eye)).as_vec3(),
        }
    }

    /// Of a position, pixels, at an inverse depth, 1/m.
    #[inline(always)]
    pub(super) fn at(&self, x: f32, y: f32, inverse_depth: f32) -> Vec3 {
        self.start + self.right * x + self.down * y + self.shift * inverse_depth
    }

    /// Of a plane about a position: `slopes` is what its inverse depth gains from pixel to pixel.
    #[inline(always)]
    pub(super) fn plane(&self, x: f32, y: f32, inverse_depth: f32, slopes: [f32; 2]) -> Seen {
        Seen {
            at: self.at(x, y, inverse_depth),
            right: self.right + self.shift * slopes[0],
            down: self.down + self.shift * slopes[1],
        }
    }

    /// Pixels by which a point moves in the other picture for a change of inverse depth of 1/m.
    #[inline(always)]
    pub(super) fn motion_px(&self, x: f32, y: f32, inverse_depth: f32) -> f32 {
        let h = self.at(x, y, inverse_depth);
        if h.z <= 0.0 {
            return 0.0;
        }
        let [dx, dy] = [
            self.shift.x - h.x / h.z * self.shift.z,
            self.shift.y - h.y / h.z * self.shift.z,
        ];
        (dx * dx + dy * dy).sqrt() / h.z
    }
}
