//! Parameters of a capture, embedded in capture specifications and in headers of files.

use headbox_core::bounces::Bounces;
use serde::{Deserialize, Serialize};

/// Sampling of a capture's rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampler {
    /// Jittered in 4-D strata (S15; default).
    #[default]
    Stratified,
    /// Independent over the whole domain.
    WhiteNoise,
    /// One ray through the centre of each pixel, from the centre of the cube, all hits along it
    /// (S13): a baseline that undersamples surfaces seen edge-on.
    CentreRays,
}

/// Rule for merging samples at similar depth in one pixel: the papers disagree (D1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MergeRule {
    /// One depth pixel with their mean depth and colour, weighted by their numbers of rays (Shade
    /// et al.; default).
    #[default]
    Average,
    /// Only the surface that was sampled with the smallest area stays (Rafferty et al.).
    SmallerArea,
    /// Surfaces with different colours stay separate, of the others the first stays; first in the
    /// order of ray keys, which makes the result unique (Popescu et al.).
    ColorsApart,
}

/// Parameters of a capture's quality: rays, merging and light. The size of the faces is a property
/// of the LDI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureParameters {
    /// Strata along each of the four dimensions of rays (N)
    pub strata: u32,
    /// Rays in each stratum (M)
    #[serde(alias = "rays")]
    pub rays_per_stratum: u32,
    /// Diffuse bounces of light beyond direct light
    pub bounces: Bounces,
    /// Light samples per depth pixel; 0 shows albedo and emission without light
    pub light_samples: u32,
    /// Random seed
    pub seed: u64,
    /// Trace fewer rays where the next one is new with a probability below X; 0 traces all
    pub novelty: f64,
    /// Aim rays at what frames lack until its share, with its standard error, is below X (a share,
    /// or a percentage such as 0.01%); 1 looks for nothing
    #[serde(rename = "most_holes", default = "no_hole_search")]
    pub holes: f64,
    /// Sampling of rays
    pub sampler: Sampler,
    /// Merging of samples at similar depth
    pub merge_rule: MergeRule,
}

/// Value for captures made before the hole search existed.
fn no_hole_search() -> f64 {
    1.0
}

impl Default for CaptureParameters {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl CaptureParameters {
    /// Defaults of `headbox capture`: the papers' strata and rays.
    pub const DEFAULT: Self = Self {
        strata: 32,
        rays_per_stratum: 16,
        bounces: Bounces::Full,
        light_samples: 4,
        seed: 0,
        novelty: Self::DEFAULT_NOVELTY,
        holes: 1e-4,
        sampler: Sampler::Stratified,
        merge_rule: MergeRule::Average,
    };

    /// Parameters without light, early termination or aimed rays, for tests of geometry.
    pub const fn unlit(strata: u32, rays_per_stratum: u32) -> Self {
        Self {
            strata,
            rays_per_stratum,
            novelty: 0.0,
            holes: 1.0,
            bounces: Bounces::Exactly(0),
            light_samples: 0,
            ..Self::DEFAULT
        }
    }

    /// Default of [`Self::novelty`]: half of the rays for less than 0.1 dB (docs/decisions/0018).
    pub const DEFAULT_NOVELTY: f64 = 0.18;
}
