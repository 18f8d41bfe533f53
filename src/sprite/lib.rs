//! Sprites with depth (Shade et al. 1998, section 3; S2 to S9, corrected by C4 to C7 and C30).
//!
//! A [`Sprite`] is an alpha-matted image taken by a camera, and a plane through its surfaces. A
//! [`SpriteWithDepth`] adds a *displacement* per pixel: signed distance of the surface off the
//! plane, positive towards the camera, divided by eye depth (`d1` in the paper; dimensionless). A
//! new view is drawn in two passes: `forward` moves the displacements by pure parallax; `backward`
//! visits each output pixel once, maps it by the plane's homography into the moved displacements
//! and from there to a position in the image, and samples the image there.
//!
//! | paper | here |
//! |---|---|
//! | camera with the plane as third row, homography, epipole (Eq. 1 to 6; C4, C6) | `transfer` |
//! | first pass: d1 to d3 (Eq. 6; C5, C7), by planar patches; gap filling (S9) | `patches`, `forward`, `planes`, `fill` |
//! | second pass (Eq. 7, 8; C5), crude one-pass, displacement field, affine parallax | `backward` |
//! | forward mapping of colours (Eq. 4), what the paper argues against | `splat` |
//! | sprites of a photo sequence (S10) | `from_layers`, of [`headbox_images::planar_layers`] |
//!
//! Image positions are in pixels, pixel centres at half-integers; output frames are 8-bit sRGB,
//! premultiplied.

pub mod compose;
mod error;
mod make;
mod model;
pub mod view;
mod warp;

pub use crate::make::capture::{SlabCapture, capture_slabs, slabs_at_gaps};
pub use crate::make::from_layers::sprites_from_layers;
pub use crate::make::import::DepthImport;
pub use crate::model::displacement::{Displacement, DisplacementFormat};
pub use crate::model::file::SPRITE_FILE;
pub use crate::model::file::SpriteHeader;
pub use crate::model::image_files::{ImageFileError, write_depth_exr};
pub use crate::model::plane::SpritePlane;
pub use crate::model::set::visible_points;
pub use crate::model::set::{SpriteInfo, SpriteSet};
pub use crate::warp::layer::SpriteLayer;
pub(crate) use crate::warp::layer::unpremultiply;
pub use crate::warp::render::{PreparedSprite, RenderOptions, SpriteRenderer, SpriteVariant};
pub use crate::warp::second_pass::sampling::SpriteSampling;
pub use crate::warp::transfer::{Outcome, SpriteTransfer};
pub use error::SpriteError;
pub use headbox_images::DepthPicture;

/// Constants of the two passes, for exporters that draw in the same way.
pub mod rules {
    pub use crate::warp::cell::STEEPEST;
    pub use crate::warp::field::SMOOTHING_ROUNDS;
    pub use crate::warp::first_pass::forward::MAGNIFIED;
    pub use crate::warp::first_pass::planes::LEAST_STRETCH;
    pub use crate::warp::first_pass::pure_parallax::NEAREST_DEPTH_SHARE;
    pub use crate::warp::transfer::EDGE_ON;
}

use glam::DVec3;
use headbox_core::camera::Camera;
use image::RgbaImage;

/// An alpha-matted image on a plane (S2).
///
/// Invariants: the image has the camera's size; the camera's eye is on the positive side of the
/// plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Sprite {
    color: RgbaImage,
    camera: Camera,
    plane: SpritePlane,
}

impl Sprite {
    /// Creates a sprite from an image (8-bit sRGB, straight alpha) taken by `camera`. The plane is
    /// oriented so that the eye is on its positive side.
    ///
    /// # Errors
    /// [`SpriteError::SizeMismatch`] if image and camera differ in size,
    /// [`SpriteError::PlaneThroughEye`] if the plane is seen edge-on or is not finite.
    pub fn new(color: RgbaImage, camera: Camera, plane: SpritePlane) -> Result<Self, SpriteError> {
        SpriteError::check_sizes(
            "colour",
            color.dimensions(),
            "camera",
            (camera.width(), camera.height()),
        )?;
        let plane = plane.facing(camera.eye());
        // A plane closer to the eye than a millionth of a pixel's width at unit depth is
        // indistinguishable from one through it.
        let distance = plane.signed_distance(camera.eye());
        if !plane.is_finite() || !camera.eye().is_finite() || distance.is_nan() || distance <= 1e-9
        {
            return Err(SpriteError::PlaneThroughEye);
        }
        Ok(Self {
            color,
            camera,
            plane,
        })
    }

    /// The image: 8-bit sRGB, straight alpha.
    pub fn color(&self) -> &RgbaImage {
        &self.color
    }

    /// The camera that took the image.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The plane, the camera's eye on its positive side.
    pub fn plane(&self) -> &SpritePlane {
        &self.plane
    }

    /// Centre of the image on the plane, world metres.
    pub fn middle(&self) -> DVec3 {
        let (camera, plane) = (&self.camera, &self.plane);
        let axis = plane.inverse_depth(
            camera,
            f64::from(camera.width()) / 2.0,
            f64::from(camera.height()) / 2.0,
        );
        // If the axis misses the plane, the foot of the perpendicular from the eye is used.
        if axis > 0.0 {
            camera.eye() + camera.forward() / axis
        } else {
            camera.eye() - plane.normal * plane.signed_distance(camera.eye())
        }
    }
}

/// A sprite and a displacement per pixel, off its plane.
///
/// Invariant: every displacement is finite. The grid may be coarser than the image (S4).
#[derive(Clone, Debug, PartialEq)]
pub struct SpriteWithDepth {
    sprite: Sprite,
    displacement: Displacement,
}

impl SpriteWithDepth {
    /// Combines a sprite with its displacement.
    ///
    /// # Errors
    /// [`SpriteError::DisplacementSize`] if the displacement has more columns or rows than the
    /// image.
    pub fn new(sprite: Sprite, displacement: Displacement) -> Result<Self, SpriteError> {
        let (displacement_size, color) = (displacement.size(), sprite.color.dimensions());
        if displacement_size.0 > color.0 || displacement_size.1 > color.1 {
            return Err(SpriteError::DisplacementSize {
                displacement: displacement_size,
                color,
            });
        }
        Ok(Self {
            sprite,
            displacement,
        })
    }

    /// Image, camera and plane.
    pub fn sprite(&self) -> &Sprite {
        &self.sprite
    }

    /// Displacement per pixel.
    pub fn displacement(&self) -> &Displacement {
        &self.displacement
    }

    /// Eye depth of the surface seen at a pixel of the displacement grid, metres; `None` where it
    /// would not lie in front of the eye.
    pub fn eye_depth(&self, x: u32, y: u32) -> Option<f64> {
        let camera = &self.sprite.camera;
        let (width, height) = self.displacement.size();
        let x_px = (f64::from(x) + 0.5) * f64::from(camera.width()) / f64::from(width);
        let y_px = (f64::from(y) + 0.5) * f64::from(camera.height()) / f64::from(height);
        let on_plane = self.sprite.plane.inverse_depth(camera, x_px, y_px);
        let distance = self.sprite.plane.signed_distance(camera.eye());
        let inverse_depth = on_plane + f64::from(self.displacement.at(x, y)) / distance;
        (inverse_depth > 0.0).then(|| 1.0 / inverse_depth)
    }
}
