//! What a capture is asked for, stated once: the job, the headers of files, and the command line hold these types.

use super::merge::MergeRule;
use crate::capture::sampler::{Sampling, Strata};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Which rays a capture traces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Sampler {
    /// Jittered in 4-D strata (S15; default).
    #[default]
    Stratified,
    /// Independent over the whole domain.
    WhiteNoise,
    /// One ray through the centre of each pixel, from the centre of the cube, every hit kept (S13): the baseline that
    /// undersamples surfaces seen edge-on.
    CentreRays,
}

/// Which rays are traced, what becomes of what they hit, and with how much light: all that decides a capture's quality but the size of
/// its faces, which an LDI tells by itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct CaptureParameters {
    /// Strata along each of the four dimensions of rays (N)
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Self::DEFAULT.strata,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(Strata::MAX_PER_DIMENSION))))]
    pub strata: u32,
    /// Rays in each stratum (M)
    #[serde(alias = "rays")]
    #[cfg_attr(feature = "cli", arg(long = "rays", value_name = "M", default_value_t = Self::DEFAULT.rays_per_stratum,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(Strata::MAX_RAYS))))]
    pub rays_per_stratum: u32,
    /// Diffuse bounces of light beyond direct light
    #[cfg_attr(feature = "cli", arg(long, value_name = "B", default_value_t = Self::DEFAULT.bounces,
        value_parser = clap::value_parser!(u32).range(0..=64)))]
    pub bounces: u32,
    /// Light samples per depth pixel; 0 shows albedo and emission without light
    #[cfg_attr(feature = "cli", arg(long, value_name = "K", default_value_t = Self::DEFAULT.light_samples,
        value_parser = clap::value_parser!(u32).range(0..=65_535)))]
    pub light_samples: u32,
    /// Random seed
    #[cfg_attr(feature = "cli", arg(long, value_name = "K", default_value_t = Self::DEFAULT.seed))]
    pub seed: u64,
    /// Trace fewer rays where the next one is new with a probability below X; 0 traces all
    #[cfg_attr(feature = "cli", arg(long, value_name = "X", default_value_t = Self::DEFAULT.novelty,
        value_parser = parse_share, allow_hyphen_values = true))]
    pub novelty: f64,
    /// Aim rays at what frames lack until its share, with its standard error, is below X (a share, or a percentage such as
    /// 0.01%); 1 looks for nothing
    #[serde(rename = "most_holes", default = "all")]
    #[cfg_attr(feature = "cli", arg(long, value_name = "X", default_value_t = Self::DEFAULT.holes,
        value_parser = parse_holes, allow_hyphen_values = true))]
    pub holes: f64,
    /// Which rays
    #[cfg_attr(feature = "cli", arg(long, default_value = "stratified"))]
    pub sampler: Sampler,
    /// What becomes of samples at similar depth
    #[cfg_attr(feature = "cli", arg(long = "merge", default_value = "average"))]
    pub merge_rule: MergeRule,
}

#[cfg(feature = "cli")]
fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("give a probability from 0 to 1".into()),
    }
}

#[cfg(feature = "cli")]
fn parse_holes(text: &str) -> Result<f64, String> {
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |number| (number, 0.01));
    match number.parse::<f64>().map(|number| number * unit) {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("give a share from 0 to 1, or a percentage such as 0.01%".into()),
    }
}

/// What captures were asked for that could not look for holes.
fn all() -> f64 {
    1.0
}

impl Default for CaptureParameters {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl CaptureParameters {
    /// What `headbox capture` does where nothing is said: the papers' strata and rays.
    pub const DEFAULT: Self = Self {
        strata: 32,
        rays_per_stratum: 16,
        bounces: 1,
        light_samples: 4,
        seed: 0,
        novelty: Self::DEFAULT_NOVELTY,
        holes: 1e-4,
        sampler: Sampler::Stratified,
        merge_rule: MergeRule::Average,
    };

    /// All of so many rays, no aimed ones, and no light: what is asked for where geometry is looked at.
    pub const fn unlit(strata: u32, rays_per_stratum: u32) -> Self {
        Self { strata, rays_per_stratum, novelty: 0.0, holes: 1.0, bounces: 0, light_samples: 0, ..Self::DEFAULT }
    }

    /// Default of [`Self::novelty`]: half of the rays for less than 0.1 dB (docs/decisions/0018).
    pub const DEFAULT_NOVELTY: f64 = 0.18;

    /// The strata of each face of the headbox.
    pub fn strata(&self) -> Strata {
        let sampling = if self.sampler == Sampler::WhiteNoise { Sampling::WhiteNoise } else { Sampling::Stratified };
        Strata { per_dimension: self.strata, rays: self.rays_per_stratum, seed: self.seed, sampling }
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
