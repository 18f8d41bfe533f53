//! A capture from beginning to end: scene, headbox and settings in; cube LDI (or shard) out.

use crate::merge::finish;
use crate::rays::trace;
use crate::rays::trace::Tracing;
use crate::scene_source::SceneSource;
use crate::settings::{CaptureSettings, Resources};
use glam::DVec3;
use headbox_core::progress::Progress;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::model::samples::CubeLdi;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::viewpoint;
use serde::{Deserialize, Serialize};
use std::io;
use std::time::{Duration, Instant};

/// Everything that decides the bytes of a cube LDI (but not how fast, with how much memory or in how many parts it is
/// made).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureJob {
    /// The scene.
    pub scene: SceneSource,
    /// Centre of the headbox, world metres.
    pub centre: DVec3,
    /// Half of its edge, metres.
    pub half_size_m: f64,
    /// Pixels a side of a face.
    pub face_size_px: u32,
    /// Rays, merging, light.
    #[serde(flatten)]
    pub parameters: CaptureParameters,
}

impl CaptureJob {
    /// Pixels a side of a face where nothing is said.
    pub const DEFAULT_FACE_SIZE_PX: u32 = 1024;

    /// What `headbox capture` does where nothing is said, for a headbox (world metres).
    pub fn new(scene: SceneSource, centre: DVec3, half_size_m: f64) -> Self {
        let (face_size_px, parameters) = (Self::DEFAULT_FACE_SIZE_PX, CaptureParameters::DEFAULT);
        Self {
            scene,
            centre,
            half_size_m,
            face_size_px,
            parameters,
        }
    }

    /// The settings of one part of the job.
    pub fn settings(&self, resources: &Resources, shard: (u32, u32)) -> CaptureSettings {
        let Self {
            half_size_m,
            face_size_px,
            parameters,
            ..
        } = *self;
        CaptureSettings {
            half_size_m,
            face_size_px,
            parameters,
            resources: resources.clone(),
            shard,
        }
    }

    /// Traces the whole job.
    ///
    /// # Errors
    /// If spilling fails.
    pub fn run(
        &self,
        tracer: &Tracer,
        lighting: &Lighting,
        resources: &Resources,
        progress: &dyn Progress,
    ) -> io::Result<(CubeLdi, Duration)> {
        let settings = self.settings(resources, (0, 1));
        let start = Instant::now();
        let tracing = trace::trace(tracer, &settings, progress)?;
        let trace_time = start.elapsed();
        Ok((
            self.finish(&tracing, tracer, lighting, resources, progress)?,
            trace_time,
        ))
    }

    /// Lights and merges traced rays.
    ///
    /// # Errors
    /// If spilled accumulators cannot be read.
    pub fn finish(
        &self,
        tracing: &Tracing,
        tracer: &Tracer,
        lighting: &Lighting,
        resources: &Resources,
        progress: &dyn Progress,
    ) -> io::Result<CubeLdi> {
        let settings = self.settings(resources, (0, 1));
        finish::finish(
            tracing,
            self.info(tracer, lighting),
            tracer,
            lighting,
            &settings,
            progress,
        )
    }

    /// What a look at the rays so far needs to know of them.
    pub fn shape_info(&self, tracer: &Tracer, lighting: &Lighting) -> CaptureInfo {
        CaptureInfo {
            centre: self.centre,
            half_size_m: self.half_size_m,
            frame: tracer.scene().frame,
            exposure: lighting.exposure,
            tone: lighting.tone,
            ..CaptureInfo::default()
        }
    }

    fn info(&self, tracer: &Tracer, lighting: &Lighting) -> CaptureInfo {
        CaptureInfo {
            scene: self.scene.name.clone(),
            light: self.scene.light.clone(),
            parameters: self.parameters,
            blocked_share: trace::blocked_share(tracer, self.half_size_m),
            ahead: Some(viewpoint::suggest_view(tracer, self.centre)),
            ..self.shape_info(tracer, lighting)
        }
    }
}
