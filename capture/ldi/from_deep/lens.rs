//! The camera of a deep image: from the image's header, or from arguments.

use super::{DeepCameraOptions, FromDeepError};
use glam::{DMat4, DVec3, DVec4};
use headbox_core::camera::Camera;
use headbox_images::deep_exr::{DeepImage, DeepView};

/// Projection of points to pixels of a camera's image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lens {
    /// World to NDC: columns and rows of the image, both from 0 to 1.
    ndc_from_world: DMat4,
    /// World metres.
    pub(super) eye: DVec3,
    /// Viewing direction, a unit vector.
    pub(super) ahead: DVec3,
    /// Direction to the right, a unit vector.
    right: DVec3,
}

/// Maps screen space (-1 to 1, y up) to NDC (0 to 1, y down).
const UNIT_FROM_SCREEN: DMat4 = DMat4::from_cols(
    DVec4::new(0.5, 0.0, 0.0, 0.0),
    DVec4::new(0.0, -0.5, 0.0, 0.0),
    DVec4::Z,
    DVec4::new(0.5, 0.5, 0.0, 1.0),
);

impl Lens {
    /// The camera of an image; `None` for an environment map, which has all directions.
    ///
    /// # Errors
    /// [`FromDeepError::View`] if neither header nor arguments specify the camera,
    /// [`FromDeepError::Redundant`] if both do, [`FromDeepError::Camera`], [`FromDeepError::Lens`].
    pub(super) fn new(
        image: &DeepImage,
        place: &DeepCameraOptions,
    ) -> Result<Option<Self>, FromDeepError> {
        let DeepView {
            cube,
            world_to_camera,
            world_to_ndc,
        } = image.view;
        let matrix = |m: [f32; 16]| DMat4::from_cols_array(&m.map(f64::from));
        let refuse = |flags: &[(&'static str, bool)], statement| {
            let given = flags.iter().find(|(_, is_given)| *is_given);
            given.map_or(Ok(()), |(flag, _)| {
                Err(FromDeepError::Redundant(flag, statement))
            })
        };
        let fov = ("--fov", place.fov_y_deg.is_some());
        let pose = [
            ("--center", place.centre.is_some()),
            ("--look-at", place.look_at.is_some()),
        ];
        if cube {
            refuse(&[fov, pose[1]], "is that of an environment map")?;
            return Ok(None);
        }
        if world_to_camera.is_some() {
            refuse(&pose, "specifies the camera's position")?;
        }
        if let Some((camera, ndc)) = world_to_camera.zip(world_to_ndc) {
            refuse(&[fov], "specifies the camera's field of view")?;
            return Self::from_matrices(matrix(camera), matrix(ndc)).map(Some);
        }
        let fov_y_deg = place.fov_y_deg.ok_or(FromDeepError::View)?;
        let [eye, target, up] = match world_to_camera {
            Some(camera) => {
                let world = matrix(camera).inverse();
                [
                    world.project_point3(DVec3::ZERO),
                    world.project_point3(DVec3::Z),
                    world.transform_vector3(DVec3::Y),
                ]
            }
            None => {
                let eye = place.centre.unwrap_or_default();
                [eye, place.look_at.unwrap_or(eye + DVec3::NEG_Z), DVec3::Y]
            }
        };
        let camera = Camera::look_at(eye, target, up, fov_y_deg, image.size_px)?;
        Ok(Some(Self::from_camera(&camera)))
    }

    fn from_camera(camera: &Camera) -> Self {
        let size = DVec3::new(f64::from(camera.width()), f64::from(camera.height()), 1.0);
        Self {
            ndc_from_world: DMat4::from_scale(size.recip()) * camera.image_from_world(),
            eye: camera.eye(),
            ahead: camera.forward(),
            right: camera.world_from_eye().x_axis,
        }
    }

    /// The camera of `worldToCamera` and `worldToNDC`, for column vectors.
    ///
    /// According to OpenEXR's *Standard Attributes*, the camera looks along +z of its axes, and NDC
    /// go from 0 to 1, y down. Some renderers write cameras that look along -z, and RenderMan's
    /// screen space, from -1 to 1, y up: the viewing axis is the one where w is above 0, and it
    /// leads to the middle of the image.
    fn from_matrices(camera: DMat4, ndc: DMat4) -> Result<Self, FromDeepError> {
        let world = camera.inverse();
        let eye = world.project_point3(DVec3::ZERO);
        let unit = |v: DVec3| {
            world
                .transform_vector3(v)
                .try_normalize()
                .ok_or(FromDeepError::Camera)
        };
        let forward = unit(DVec3::Z)?;
        let right = unit(DVec3::X)?;
        let in_ndc = |direction: DVec3| ndc * (eye + direction).extend(1.0);
        let ahead = [forward, -forward]
            .into_iter()
            .find(|ahead| in_ndc(*ahead).w > 0.0)
            .ok_or(FromDeepError::Camera)?;
        let middle = in_ndc(ahead);
        let [x, y] = [middle.x / middle.w, middle.y / middle.w];
        let is_screen = x.hypot(y) < (x - 0.5).hypot(y - 0.5);
        let ndc = if is_screen {
            UNIT_FROM_SCREEN * ndc
        } else {
            ndc
        };
        let lens = Self {
            ndc_from_world: ndc,
            eye,
            ahead,
            right,
        };
        let focal_px = lens.focal_px([1.0; 2]).ok_or(FromDeepError::Camera)?;
        if eye.is_finite() && focal_px.is_finite() && focal_px > 0.0 {
            Ok(lens)
        } else {
            Err(FromDeepError::Camera)
        }
    }

    /// Projects a direction from the eye to an image of this size. Returns the position, pixels,
    /// and the depth along the viewing axis.
    pub(super) fn project(&self, direction: DVec3, [width, height]: [f64; 2]) -> [f64; 3] {
        let ndc = self.ndc_from_world * (self.eye + direction).extend(1.0);
        [
            ndc.x / ndc.w * width,
            ndc.y / ndc.w * height,
            direction.dot(self.ahead),
        ]
    }

    /// Focal length in the middle of an image of this size, pixels.
    pub(super) fn focal_px(&self, size_px: [f64; 2]) -> Option<f64> {
        /// Step to the side, small against the depth and large against the rounding of f32
        /// matrices.
        const STEP: f64 = 1e-2;
        let [x0, y0, _] = self.project(self.ahead, size_px);
        let [x1, y1, _] = self.project(self.ahead + self.right * STEP, size_px);
        let focal_px = (x1 - x0).hypot(y1 - y0) / STEP;
        focal_px.is_finite().then_some(focal_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::look_at(
            DVec3::new(1.0, 2.0, 3.0),
            DVec3::new(4.0, 1.0, -2.0),
            DVec3::Y,
            50.0,
            [40, 30],
        )
        .expect("a camera")
    }

    fn image(view: DeepView) -> DeepImage {
        let size_px = [40, 30];
        DeepImage {
            size_px,
            origin_px: [0, 0],
            stored_px: size_px,
            offsets: vec![0; 1201],
            channels: Vec::new(),
            view,
        }
    }

    /// Compares a lens with the camera's own projection, which does not use NDC.
    fn assert_projects_like(lens: &Lens, camera: &Camera) {
        for [x, y, z] in [
            [0.0, 0.0, 0.0],
            [9.0, -3.0, -7.0],
            [2.0, 1.5, 1.0],
            [30.0, -3.0, -20.0],
        ] {
            let point = DVec3::new(x, y, z);
            let expected = camera.project(point);
            let projected = lens.project(point - camera.eye(), [40.0, 30.0]);
            match expected {
                // Rounding of f32 matrices, at a focal length of 32 px.
                Some(expected) => {
                    (0..3).for_each(|i| {
                        assert!(
                            (projected[i] - expected[i]).abs() < 2e-4,
                            "{projected:?} {expected:?}"
                        );
                    });
                }
                None => assert!(projected[2] <= 1e-6, "{projected:?}"),
            }
        }
        assert!((lens.focal_px([40.0, 30.0]).expect("finite") - camera.focal_px()).abs() < 1e-3);
        assert!(
            (lens.eye - camera.eye()).length() < 1e-5
                && (lens.ahead - camera.forward()).length() < 1e-5
        );
    }

    #[test]
    fn header_matrices_give_the_camera() {
        let camera = camera();
        let assert_read = |view: DeepView, place: &DeepCameraOptions| {
            let lens = Lens::new(&image(view), place).expect("read");
            assert_projects_like(&lens.expect("a camera"), &camera);
        };
        let standard = DeepView::from_camera(&camera);
        assert_read(standard, &DeepCameraOptions::default());
        // Forward is +z and the image's upper left corner is (0, 0), as OpenEXR specifies.
        let matrix =
            |m: Option<[f32; 16]>| DMat4::from_cols_array(&m.expect("written").map(f64::from));
        let point = camera.eye() + camera.forward() * 2.0;
        let in_camera = matrix(standard.world_to_camera);
        let in_ndc = matrix(standard.world_to_ndc);
        assert!((in_camera.transform_point3(point) - DVec3::new(0.0, 0.0, 2.0)).length() < 1e-5);
        assert!(
            (in_ndc.project_point3(point).truncate() - glam::DVec2::splat(0.5)).length() < 1e-5
        );
        let above = in_ndc.project_point3(point + camera.world_from_eye().y_axis * 0.1);
        assert!(above.y < 0.5, "y points down");
        // The variants of other renderers: right-handed, and -1 to 1.
        let back = DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0)) * in_camera;
        let screen = UNIT_FROM_SCREEN.inverse() * in_ndc;
        let array = |m: DMat4| Some(m.as_mat4().to_cols_array());
        for (camera_matrix, ndc) in [(back, in_ndc), (in_camera, screen), (back, screen)] {
            let view = DeepView {
                cube: false,
                world_to_camera: array(camera_matrix),
                world_to_ndc: array(ndc),
            };
            assert_read(view, &DeepCameraOptions::default());
        }
        // Without a field of view, and without any camera.
        let place = DeepCameraOptions {
            fov_y_deg: Some(50.0),
            ..DeepCameraOptions::default()
        };
        let pose = DeepView {
            world_to_ndc: None,
            ..standard
        };
        assert_read(pose, &place);
        let place = DeepCameraOptions {
            centre: Some(camera.eye()),
            look_at: Some(DVec3::new(4.0, 1.0, -2.0)),
            ..place
        };
        assert_read(DeepView::default(), &place);
    }

    #[test]
    fn arguments_that_repeat_the_header_are_refused() {
        let standard = DeepView::from_camera(&camera());
        let cube = DeepView {
            cube: true,
            ..DeepView::default()
        };
        let fov = DeepCameraOptions {
            fov_y_deg: Some(50.0),
            ..DeepCameraOptions::default()
        };
        let centre = DeepCameraOptions {
            centre: Some(DVec3::ONE),
            ..DeepCameraOptions::default()
        };
        let look_at = DeepCameraOptions {
            look_at: Some(DVec3::ONE),
            ..DeepCameraOptions::default()
        };
        let error =
            |view, place: &DeepCameraOptions| Lens::new(&image(view), place).expect_err("refused");
        for (view, place, flag) in [
            (cube, &fov, "--fov"),
            (cube, &look_at, "--look-at"),
            (standard, &fov, "--fov"),
            (standard, &centre, "--center"),
            (
                DeepView {
                    world_to_ndc: None,
                    ..standard
                },
                &look_at,
                "--look-at",
            ),
        ] {
            assert!(
                matches!(error(view, place), FromDeepError::Redundant(given, _) if given == flag),
                "{flag}"
            );
        }
        assert!(Lens::new(&image(cube), &centre).expect("read").is_none());
        assert_eq!(error(DeepView::default(), &centre), FromDeepError::View);
        let wide = DeepCameraOptions {
            fov_y_deg: Some(180.0),
            ..DeepCameraOptions::default()
        };
        assert!(matches!(
            error(DeepView::default(), &wide),
            FromDeepError::Lens(_)
        ));
    }
}
