//! Frames of a demo, with truth and cube map from the same eyes.

use super::{STEPS, Sizes, Stage};
use crate::progress::Bar;
use headbox_core::camera::Camera;
use headbox_core::metrics::{self, Comparison};
use headbox_core::statistics::median;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_lab::cube_map::CubeMap;
use headbox_trace::truth::{self, Truth};
use image::RgbImage;
use std::time::Instant;

/// Number of renderings of a frame, of which the median time counts.
const REPEATS: usize = 9;

/// Frame, truth and cube map at one eye position.
pub(super) struct Row {
    /// Distance of the eye from the centre of the headbox, metres.
    pub(super) distance_m: f64,
    pub(super) frame: RgbImage,
    pub(super) truth: Truth,
    /// The cube map as seen from its centre, which is all that it can show.
    pub(super) map: RgbImage,
    /// Time of the frame, ms.
    pub(super) frame_ms: f64,
    /// Time of tracing the truth, seconds.
    pub(super) truth_s: f64,
    /// Errors of frame and cube map against truth.
    pub(super) frame_error: Comparison,
    pub(super) map_error: Comparison,
}

/// Renders and measures all eye positions. The cube map has the face size of the capture.
pub(super) fn rows(
    cube: &CubeLdi,
    stage: &Stage,
    sizes: &Sizes,
    bar: &Bar,
) -> anyhow::Result<Vec<Row>> {
    let (tracer, lighting) = (&stage.tracer, &stage.lighting);
    let cameras: Vec<Camera> = STEPS
        .iter()
        .map(|step| stage.camera(*step, sizes))
        .collect::<Result<_, _>>()?;
    let cube_map = CubeMap::trace_for(
        tracer,
        lighting,
        stage.headbox.centre,
        &cameras,
        sizes.face_size_px,
        sizes.map_samples,
        bar,
    );
    let mut renderer = Renderer::new();
    let settings = RenderSettings::default();
    let mut rows = Vec::with_capacity(cameras.len());
    for camera in &cameras {
        let mut ms = Vec::with_capacity(REPEATS);
        for _ in 0..REPEATS {
            let start = Instant::now();
            renderer.render(cube, camera, &settings);
            ms.push(start.elapsed().as_secs_f64() * 1e3);
        }
        let frame = renderer.render(cube, camera, &settings).to_rgb()?;
        let start = Instant::now();
        let truth = truth::render(tracer, lighting, true, camera, sizes.truth_samples, bar);
        let truth_s = start.elapsed().as_secs_f64();
        let (truth_rgb, map) = (truth.rgb(), cube_map.resample(camera));
        rows.push(Row {
            distance_m: camera.eye().distance(stage.headbox.centre),
            frame_error: metrics::compare(&truth_rgb, &frame)?,
            map_error: metrics::compare(&truth_rgb, &map)?,
            frame_ms: median(ms).unwrap_or(f64::NAN),
            frame,
            truth,
            map,
            truth_s,
        });
    }
    Ok(rows)
}
