//! A capture from beginning to end: scene, headbox and settings in; cube LDI (or shard) out.

use super::build::{self, CaptureSettings, Progress, Tracing};
use super::{CaptureInfo, CubeLdi, finish};
use crate::capture::light::Lighting;
use crate::capture::sampler::{Sampling, Strata};
use crate::capture::scene::UpAxis;
use crate::capture::trace::Tracer;
use crate::capture::viewpoint;
use crate::ldi::build::Sampler;
use crate::ldi::merge::MergeRule;
use crate::scene_source::SceneSource;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::PathBuf;
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
    /// Which rays.
    pub sampler: Sampler,
    /// Strata per dimension (N).
    pub strata: u32,
    /// Rays per stratum (M).
    pub rays: u32,
    /// Random seed.
    pub seed: u64,
    /// Threshold of the novelty plan; 0 traces every ray.
    pub novelty: f64,
    /// What becomes of samples at similar depth.
    pub merge_rule: MergeRule,
    /// Diffuse bounces.
    pub bounces: u32,
    /// Light samples per depth pixel; 0 for albedo without light.
    pub light_samples: u32,
}

/// How a job is run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resources {
    /// Bytes for accumulators, and the folder to spill to beyond.
    pub budget: Option<(u64, PathBuf)>,
}

impl CaptureJob {
    /// Default of [`Self::novelty`]: half of the rays for less than 0.1 dB (docs/decisions.md: novelty 0.18).
    pub const DEFAULT_NOVELTY: f64 = 0.18;

    /// The settings of one part of the job.
    pub fn settings(&self, resources: &Resources, shard: (u32, u32)) -> CaptureSettings {
        let sampling = if self.sampler == Sampler::WhiteNoise { Sampling::WhiteNoise } else { Sampling::Stratified };
        CaptureSettings {
            half_size_m: self.half_size_m,
            face_size_px: self.face_size_px,
            sampler: self.sampler,
            strata: Strata { per_dimension: self.strata, rays: self.rays, seed: self.seed, sampling },
            novelty: self.novelty,
            merge_rule: self.merge_rule,
            light_samples: self.light_samples,
            budget: resources.budget.clone(),
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
        let tracing = build::trace(tracer, &settings, progress)?;
        let trace_time = start.elapsed();
        Ok((self.finish(&tracing, tracer, lighting, resources, progress)?, trace_time))
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
        finish::finish(tracing, self.info(tracer, lighting), tracer, lighting, &settings, progress)
    }

    fn info(&self, tracer: &Tracer, lighting: &Lighting) -> CaptureInfo {
        let frame = tracer.scene().frame;
        CaptureInfo {
            scene: self.scene.name.clone(),
            centre: self.centre,
            half_size_m: self.half_size_m,
            unit_m: frame.unit_m,
            z_up: frame.up == UpAxis::Z,
            exposure: lighting.exposure,
            sampler: self.sampler,
            strata: self.strata,
            rays_per_stratum: self.rays,
            novelty: self.novelty,
            merge_rule: self.merge_rule,
            seed: self.seed,
            bounces: self.bounces,
            light_samples: self.light_samples,
            blocked_share: build::blocked_share(tracer, self.half_size_m),
            ahead: Some(viewpoint::suggest_view(tracer, self.centre)),
            ..CaptureInfo::default()
        }
    }
}
