//! Mapping from a frame's pixels to a camera's image.

use crate::view_geometry::cameras::picture::Picture;
use crate::view_geometry::{EdgeRule, RealCamera};
use glam::{DMat3, DVec3, Vec3};
use headbox_core::camera::Camera;
use std::sync::Arc;

/// A point is hidden from a camera if the camera's surface is nearer by more than this share of
/// inverse depth, beyond the range of a texel on a steep surface.
const HIDDEN: f32 = 0.02;

/// Camera whose image textures a frame.
pub(crate) struct TextureCamera {
    pub(super) picture: Arc<Picture>,
    /// Homogeneous position in the image, pixels: at the frame's upper left corner at infinity, and
    /// its change per pixel right, per pixel down, and per unit of inverse depth (1/m).
    pub(super) start: Vec3,
    pub(super) right: Vec3,
    pub(super) down: Vec3,
    pub(super) shift: Vec3,
    /// Focal length over the frame's; texels per pixel are this over the ratio of depths.
    pub(super) scale: f32,
    /// Ratio of inverse depths from which on the camera's surface hides a point.
    pub(super) hidden: f32,
    /// Additional tolerance of inverse depth, 1/m.
    pub(super) slack: f32,
}

impl TextureCamera {
    pub(crate) fn new(
        camera: &RealCamera,
        picture: Arc<Picture>,
        frame: &Camera,
        edge: &EdgeRule,
    ) -> Self {
        let eye_from_world = camera.pose.world_from_eye.transpose();
        let shift = camera.homogeneous(eye_from_world * (frame.eye() - camera.pose.eye));
        let rotated = Self::rotated(
            camera,
            picture,
            frame,
            eye_from_world * frame.world_from_eye(),
        );
        // The image's inverse depth is known to one quantisation step.
        let slack = edge.noise_floor + rotated.picture.inverse_depth_step;
        Self {
            shift: shift.as_vec3(),
            slack,
            ..rotated
        }
    }

    /// Creates a camera with the pose of the frame's camera: it shows the image without depth.
    pub(super) fn pasted(camera: &RealCamera, picture: Arc<Picture>, frame: &Camera) -> Self {
        Self::rotated(camera, picture, frame, DMat3::IDENTITY)
    }

    fn rotated(camera: &RealCamera, picture: Arc<Picture>, frame: &Camera, turn: DMat3) -> Self {
        let [x, y] = frame.principal_px();
        let focal = frame.focal_px();
        let along = |direction: DVec3| camera.homogeneous(turn * direction).as_vec3();
        Self {
            picture,
            start: along(DVec3::new(-x / focal, y / focal, -1.0)),
            right: along(DVec3::X / focal),
            down: along(DVec3::NEG_Y / focal),
            shift: Vec3::ZERO,
            scale: (camera.lens.focal_px[1] / focal) as f32,
            hidden: 1.0 + HIDDEN + EdgeRule::MAX_SLOPE / camera.lens.focal_px[1] as f32,
            slack: f32::INFINITY,
        }
    }

    /// Projects the point of a frame position (x, y), pixels, into the image: image position,
    /// pixels, the inverse depth there, and the ratio of depths. `None` behind the camera.
    #[inline]
    pub(super) fn locate(&self, [x, y]: [f32; 2], inverse_depth: f32) -> Option<[f32; 4]> {
        let h = (self.start + self.down * y) + self.right * x + self.shift * inverse_depth;
        let per = 1.0 / h.z;
        (h.z > 0.0).then_some([h.x * per, h.y * per, inverse_depth * per, h.z])
    }

    /// Inverse depths, 1/m, of the camera's surface in the direction of a point of the frame, and
    /// of the point itself; `None` if unknown.
    pub(super) fn depths_at(&self, at: [f32; 2], inverse_depth: f32) -> Option<[f32; 2]> {
        let [u, v, there, _] = self.locate(at, inverse_depth)?;
        let (_, shown) = self.picture.sample(0, u, v)?;
        (shown > 0.0).then_some([shown, there])
    }

    /// Returns true if the camera sees a point of the frame: its own surface there is neither
    /// nearer nor farther.
    pub(crate) fn agrees(&self, at: [f32; 2], inverse_depth: f32) -> bool {
        self.depths_at(at, inverse_depth)
            .is_some_and(|[shown, there]| {
                shown <= there * self.hidden + self.slack
                    && there <= shown * self.hidden + self.slack
            })
    }

    /// Linear colour, 0 to 65,535, of the image at a point of the frame, without a depth test.
    pub(super) fn color_at(&self, at: [f32; 2], inverse_depth: f32) -> Option<[f32; 3]> {
        let [u, v, _, ratio] = self.locate(at, inverse_depth)?;
        let (color, _) = self
            .picture
            .sample(self.picture.level_for(self.scale / ratio), u, v)?;
        Some(color)
    }
}
