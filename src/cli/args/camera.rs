//! Camera of a frame.

use super::values::{parse_size, parse_vector};
use crate::commands::capture::place::place_headbox;
use crate::messages::UsageError;
use clap::Args;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::view::View;
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::viewpoint;
use std::sync::Arc;

/// A camera.
#[derive(Args)]
pub(crate) struct CameraArgs {
    /// Position of the eye, in the file's axes and unit; the centre of the headbox, or the capture
    /// position of sprites, by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    eye: Option<DVec3>,
    /// Point to look at, in the file's axes and unit; in the direction with the most detail from
    /// the headbox (for scenes from the eye), or the capture direction of sprites, by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    pub(crate) look_at: Option<DVec3>,
    /// Up direction of the frame, in the file's axes; the file's up axis, or the up direction of
    /// the input images, by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    up_vector: Option<DVec3>,
    /// Vertical field of view, degrees; 60, or that of the input's own camera, by default
    #[arg(long, value_name = "DEG")]
    fov: Option<f64>,
    /// Size of the frame, pixels; 1024x768, or that of the input's own camera, by default
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub(crate) size: Option<(u32, u32)>,
}

/// Default camera; world metres.
pub(crate) struct DefaultCamera {
    pub(crate) eye: DVec3,
    /// Viewing direction, any length.
    pub(crate) forward: DVec3,
    /// Up direction in the image.
    pub(crate) up: DVec3,
    pub(crate) fov_y_deg: f64,
    pub(crate) size: (u32, u32),
}

impl DefaultCamera {
    /// Camera at an eye in a scene, toward the direction with the most to see.
    pub(crate) fn from_scene(tracer: &Tracer, eye: DVec3) -> Self {
        Self {
            forward: viewpoint::suggest_view(tracer, eye),
            ..Self::from_eye(eye)
        }
    }

    /// Camera at an eye, along -Z.
    pub(crate) fn from_eye(eye: DVec3) -> Self {
        Self {
            eye,
            forward: DVec3::NEG_Z,
            up: DVec3::Y,
            fov_y_deg: 60.0,
            size: (1024, 768),
        }
    }

    /// Start camera of a view, for frames of `size` if given.
    pub(crate) fn from_view(view: &dyn View, size: Option<(u32, u32)>) -> Self {
        let size = size.unwrap_or_else(|| view.default_size_px().into());
        let start = view.start(size.into());
        Self {
            eye: start.eye,
            forward: start.forward,
            up: start.up,
            fov_y_deg: start.fov_y_deg,
            size,
        }
    }
}

impl CameraArgs {
    /// Flags of the camera, each with true if it is given.
    pub(crate) fn given_flags(&self) -> [(&'static str, bool); 5] {
        [
            ("--eye", self.eye.is_some()),
            ("--look-at", self.look_at.is_some()),
            ("--up-vector", self.up_vector.is_some()),
            ("--fov", self.fov.is_some()),
            ("--size", self.size.is_some()),
        ]
    }

    /// Resizes the cameras of a path to `--size`; refuses all other flags of the camera.
    pub(crate) fn resize_path(&self, cameras: Vec<Camera>) -> anyhow::Result<Vec<Camera>> {
        if let Some((flag, _)) = self
            .given_flags()
            .into_iter()
            .find(|(flag, is_given)| *is_given && *flag != "--size")
        {
            bail_usage!("{flag} has no meaning with --path, which says it; leave it out");
        }
        let Some((width, height)) = self.size else {
            return Ok(cameras);
        };
        let resized = |camera: Camera| {
            let focal_px = camera.focal_px() * f64::from(height) / f64::from(camera.height());
            Camera::from_parts(
                camera.eye(),
                camera.world_from_eye(),
                focal_px,
                width,
                height,
            )
        };
        Ok(cameras.into_iter().map(resized).collect::<Result<_, _>>()?)
    }

    /// Camera in a scene, by default in free space toward the direction with the most to see, and a
    /// tracer about its eye.
    pub(crate) fn aim(&self, scene: &Arc<Scene>) -> anyhow::Result<(Camera, Tracer)> {
        let eye = match self.eye {
            Some(eye) => scene.frame.world_from_file(eye),
            None => place_headbox(scene, None, None)?.centre,
        };
        let tracer = Tracer::new(Arc::clone(scene), eye);
        let camera = self.camera(&scene.frame, &DefaultCamera::from_scene(&tracer, eye))?;
        Ok((camera, tracer))
    }

    /// Camera in world space.
    pub(crate) fn camera(
        &self,
        frame: &FileFrame,
        default: &DefaultCamera,
    ) -> anyhow::Result<Camera> {
        let eye = self
            .eye
            .map_or(default.eye, |eye| frame.world_from_file(eye));
        let look_at = self
            .look_at
            .map_or(eye + default.forward, |point| frame.world_from_file(point));
        if self.up_vector == Some(DVec3::ZERO) {
            bail_usage!("--up-vector has no direction; give three numbers that are not all 0");
        }
        let up = self
            .up_vector
            .map_or(default.up, |up| frame.world_direction_from_file(up));
        warn_if_parallel(look_at - eye, up, frame);
        let (width, height) = self.size.unwrap_or(default.size);
        let fov_y_deg = self.fov.unwrap_or(default.fov_y_deg);
        let camera = Camera::look_at(eye, look_at, up, fov_y_deg, [width, height]);
        Ok(camera.map_err(|error| UsageError(error.to_string()))?)
    }
}

/// Warns if the up vector is parallel to the viewing direction.
fn warn_if_parallel(forward: DVec3, up: DVec3, frame: &FileFrame) {
    if forward.length() > 0.0 && forward.normalize().cross(up.normalize_or_zero()).length() <= 1e-6
    {
        let stand_in = if forward.normalize().y.abs() < 0.9 {
            DVec3::Y
        } else {
            DVec3::Z
        };
        // Adding 0 turns -0 into 0.
        let [x, y, z] = (frame.file_from_world(stand_in).normalize() + 0.0).to_array();
        eprintln!(
            "warning: the view runs along the up vector, which then does not say what is up in the picture; {x},{y},{z} (in the \
             file's axes) is taken. Give --up-vector X,Y,Z to hold the camera in another way"
        );
    }
}
