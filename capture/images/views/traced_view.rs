//! Views of image sets rendered by ray tracing: photographs with exact depth and camera.

use crate::{Distortion, Lens, LoadedView, Pinhole, Pose};
use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth::{eye_depth, render};

/// Traces colour and eye depth from `camera`, as a view of an image set.
pub fn trace(
    tracer: &Tracer,
    lighting: &Lighting,
    lit: bool,
    camera: &Camera,
    samples: u32,
    progress: &dyn Progress,
) -> LoadedView {
    let lens = Pinhole {
        focal_px: [camera.focal_px(); 2],
        principal_px: camera.principal_px(),
        distortion: Distortion::default(),
    };
    LoadedView {
        size_px: [camera.width(), camera.height()],
        lens: Lens::Pinhole(lens),
        pose: Pose {
            eye: camera.eye(),
            world_from_eye: camera.world_from_eye(),
        },
        color: render(tracer, lighting, lit, camera, samples, progress)
            .frame
            .color,
        depth: eye_depth(tracer, camera),
    }
}
