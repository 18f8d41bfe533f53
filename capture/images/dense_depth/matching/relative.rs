//! Warp of a pixel at an inverse depth into another image: `start + q * shift`.

use crate::{Pinhole, Pose};
use glam::{DVec3, Vec3};

/// Camera of an image level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LevelCamera {
    /// Focal lengths and principal point, pixels of the level.
    pub(crate) focal_px: [f64; 2],
    pub(crate) principal_px: [f64; 2],
    pub(crate) pose: Pose,
}

impl LevelCamera {
    /// Creates the camera of an image that is halved `shift` times.
    pub(crate) fn new(lens: Pinhole, pose: Pose, shift: u32) -> Self {
        let scale = 0.5f64.powi(shift as i32);
        let [focal_px, principal_px] =
            [lens.focal_px, lens.principal_px].map(|pair| pair.map(|c| c * scale));
        Self {
            focal_px,
            principal_px,
            pose,
        }
    }

    /// Returns the ray in eye space through a position in pixels, at eye depth 1.
    pub(crate) fn ray(&self, x: f64, y: f64) -> DVec3 {
        let [cx, cy] = self.principal_px;
        DVec3::new(
            (x - cx) / self.focal_px[0],
            (cy - y) / self.focal_px[1],
            -1.0,
        )
    }

    /// Projects a point or direction of eye space to (x w, y w, w).
    fn homogeneous(&self, p: DVec3) -> DVec3 {
        let [cx, cy] = self.principal_px;
        DVec3::new(
            self.focal_px[0] * p.x - cx * p.z,
            -self.focal_px[1] * p.y - cy * p.z,
            -p.z,
        )
    }
}

/// Warp from one camera to another in homogeneous coordinates (x w, y w, w), with w the other's eye
/// depth times this one's inverse depth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Relative {
    /// Projection of the image's upper left corner at infinity.
    start: Vec3,
    /// Change per pixel to the right.
    right: Vec3,
    /// Change per pixel down.
    down: Vec3,
    /// Change per 1/m of inverse depth.
    shift: Vec3,
}

/// Projection of a plane into another camera, affine in the pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WarpedPlane {
    /// Projection (x w, y w, w) of the pixel.
    pub(crate) center: Vec3,
    /// Changes per pixel to the right and down on the plane.
    pub(crate) right: Vec3,
    pub(crate) down: Vec3,
}

impl Relative {
    /// Creates the warp between two cameras.
    pub(crate) fn new(from: &LevelCamera, to: &LevelCamera) -> Self {
        let turn = to.pose.world_from_eye.transpose() * from.pose.world_from_eye;
        let project = |x: f64, y: f64| to.homogeneous(turn * from.ray(x, y));
        let start = project(0.0, 0.0);
        let right = project(1.0, 0.0);
        let down = project(0.0, 1.0);
        Self {
            start: start.as_vec3(),
            right: (right - start).as_vec3(),
            down: (down - start).as_vec3(),
            shift: to.homogeneous(to.pose.to_eye(from.pose.eye)).as_vec3(),
        }
    }

    /// Warps a position in pixels at an inverse depth, 1/m.
    #[inline(always)]
    pub(crate) fn warp(&self, x: f32, y: f32, inverse_depth: f32) -> Vec3 {
        self.start + self.right * x + self.down * y + self.shift * inverse_depth
    }

    /// Warps a plane around a position; `slopes` are its changes of inverse depth per pixel.
    #[inline(always)]
    pub(crate) fn warp_plane(
        &self,
        x: f32,
        y: f32,
        inverse_depth: f32,
        slopes: [f32; 2],
    ) -> WarpedPlane {
        WarpedPlane {
            center: self.warp(x, y, inverse_depth),
            right: self.right + self.shift * slopes[0],
            down: self.down + self.shift * slopes[1],
        }
    }

    /// Returns the motion of a point in the other image per change of inverse depth, pixels metres.
    #[inline(always)]
    pub(crate) fn motion_px(&self, x: f32, y: f32, inverse_depth: f32) -> f32 {
        let h = self.warp(x, y, inverse_depth);
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
