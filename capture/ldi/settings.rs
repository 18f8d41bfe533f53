//! How one run of a capture is done.

use headbox_cube::model::parameters::{CaptureParameters, Sampler};
use headbox_trace::sampler::{Sampling, Strata};
use std::path::PathBuf;

/// The ray strata of each face of the headbox.
pub fn strata_of(parameters: &CaptureParameters) -> Strata {
    let sampling = match parameters.sampler {
        Sampler::WhiteNoise => Sampling::WhiteNoise,
        Sampler::Stratified | Sampler::CentreRays => Sampling::Stratified,
    };
    Strata {
        per_dimension: parameters.strata,
        rays: parameters.rays_per_stratum,
        seed: parameters.seed,
        sampling,
    }
}

/// How a job is run; nothing here changes a byte of what it makes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resources {
    /// Bytes for accumulators, and the folder to spill to beyond.
    pub budget: Option<(u64, PathBuf)>,
}

/// One run of a job: what to capture, how, and which part of it.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureSettings {
    /// Half of the headbox's edge, metres; its centre is the tracer's origin.
    pub half_size_m: f64,
    /// Pixels a side of a face.
    pub face_size_px: u32,
    /// Rays, merging, light.
    pub parameters: CaptureParameters,
    /// Memory.
    pub resources: Resources,
    /// Part `.0` (from 0) of `.1`: this run traces only its share of the rays.
    pub shard: (u32, u32),
}
