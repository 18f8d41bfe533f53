//! Arguments that decide the quality of a capture.

use super::face_size::FaceSize;
use crate::args::{Names, by_name};
use clap::{Args, ValueEnum};
use glam::DVec3;
use headbox_core::bounces::Bounces;
use headbox_cube::model::parameters::{CaptureParameters, MergeRule, Sampler};
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::CaptureSpec;
use headbox_trace::sampler::Strata;

/// Quality of a capture.
#[derive(Args)]
pub(super) struct QualityArgs {
    #[command(flatten)]
    pub(super) preset: PresetArgs,
    /// Face size, pixels, 1 to 8192; or auto:WIDTHxHEIGHT@DEGREES, the size and strata that such
    /// frames need for an error below --error-px; auto alone is auto:1024x768@60
    #[arg(long, value_name = "PX", default_value_t = FaceSize::Px(CaptureSpec::DEFAULT_FACE_SIZE_PX))]
    pub(super) face_size: FaceSize,
    #[command(flatten)]
    pub(super) parameters: ParameterArgs,
}

/// Preset of a capture's quality.
#[derive(Args, Clone, Copy)]
pub(crate) struct PresetArgs {
    /// Preset of face size, strata, rays, light samples and holes, each overridden by its own flag of
    /// capture; best by default, in a window with a fifth of its rays. Photographs without depth are
    /// reduced fourfold for a draft, by half for good
    #[arg(long)]
    pub(crate) quality: Option<Preset>,
}

/// Rays, merging and light of a capture.
#[derive(Args)]
pub(super) struct ParameterArgs {
    /// Strata along each of the four dimensions of rays (N), 1 to 128
    #[arg(long, value_name = "N", default_value_t = CaptureParameters::DEFAULT.strata,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(Strata::MAX_PER_DIMENSION)))]
    strata: u32,
    /// Rays per stratum (M)
    #[arg(long = "rays", value_name = "M", default_value_t = CaptureParameters::DEFAULT.rays_per_stratum,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(Strata::MAX_RAYS)))]
    rays_per_stratum: u32,
    /// Diffuse bounces of light after direct light, 0 to 64, or full: all bounces
    #[arg(long, value_name = "B", default_value_t = CaptureParameters::DEFAULT.bounces)]
    bounces: Bounces,
    /// Light samples per depth pixel, 0 to 65535; 0 stores albedo and emission without lighting
    #[arg(long, value_name = "K", default_value_t = CaptureParameters::DEFAULT.light_samples,
        value_parser = clap::value_parser!(u32).range(0..=65_535))]
    light_samples: u32,
    /// Random seed
    #[arg(long, value_name = "K", default_value_t = CaptureParameters::DEFAULT.seed)]
    seed: u64,
    /// Trace fewer rays where the next one finds a new sample with a probability below X, 0 to 1; 0
    /// traces all rays
    #[arg(long, value_name = "X", default_value_t = CaptureParameters::DEFAULT.novelty,
        value_parser = parse_probability, allow_hyphen_values = true)]
    novelty: f64,
    /// Aim rays at holes until the share of hole pixels in test frames, plus its standard error, is
    /// below X (0 to 1, or a percentage such as 0.01%); 1 skips the search
    #[arg(long, value_name = "X", default_value_t = CaptureParameters::DEFAULT.holes,
        value_parser = parse_holes, allow_hyphen_values = true)]
    pub(super) holes: f64,
    /// Distribution of the rays
    #[arg(long, default_value = "stratified", value_parser = by_name(SAMPLERS))]
    sampler: Sampler,
    /// Rule for merging samples of similar depth in a pixel
    #[arg(long = "merge", default_value = "average", value_parser = by_name(MERGE_RULES))]
    pub(super) merge_rule: MergeRule,
}

const SAMPLERS: Names<Sampler> = &[
    ("stratified", "Jittered in 4-D strata", Sampler::Stratified),
    (
        "white-noise",
        "Independent random rays over the whole domain",
        Sampler::WhiteNoise,
    ),
    (
        "centre-rays",
        "One ray from the centre of the cube through the centre of each pixel",
        Sampler::CentreRays,
    ),
];

const MERGE_RULES: Names<MergeRule> = &[
    (
        "average",
        "One depth pixel with the mean depth and colour",
        MergeRule::Average,
    ),
    (
        "smaller-area",
        "Only the surface sampled with the smallest area",
        MergeRule::SmallerArea,
    ),
    (
        "colors-apart",
        "One depth pixel per colour",
        MergeRule::ColorsApart,
    ),
];

impl ParameterArgs {
    /// The parameters that these arguments specify.
    fn parameters(&self) -> CaptureParameters {
        CaptureParameters {
            strata: self.strata,
            rays_per_stratum: self.rays_per_stratum,
            bounces: self.bounces,
            light_samples: self.light_samples,
            seed: self.seed,
            novelty: self.novelty,
            holes: self.holes,
            sampler: self.sampler,
            merge_rule: self.merge_rule,
        }
    }
}

fn parse_probability(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(probability) if (0.0..=1.0).contains(&probability) => Ok(probability),
        _ => Err("give a probability from 0 to 1".into()),
    }
}

fn parse_holes(text: &str) -> Result<f64, String> {
    let (number, unit) = text
        .strip_suffix('%')
        .map_or((text, 1.0), |number| (number, 0.01));
    match number.parse::<f64>().map(|number| number * unit) {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("give a share from 0 to 1, or a percentage such as 0.01%".into()),
    }
}

/// Quality presets; their numbers are in [`Preset::NUMBERS`].
#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Preset {
    /// Fast preview, to check the placement of the headbox
    Draft,
    /// Medium quality, to look around
    Good,
    /// Full quality, that of the paper, to keep
    Best,
}

impl Preset {
    /// Defaults of arguments in the presets draft and good. Best has the arguments' own defaults.
    pub(crate) const NUMBERS: [(&str, [&str; 2]); 5] = [
        ("face_size", ["256", "512"]),
        ("strata", ["16", "24"]),
        ("rays_per_stratum", ["8", "8"]),
        ("light_samples", ["1", "2"]),
        ("holes", ["0.001", "0.0001"]),
    ];

    /// Factor by which photographs without depth are reduced.
    pub(crate) fn reduction(self) -> u32 {
        match self {
            Self::Draft => 4,
            Self::Good => 2,
            Self::Best => 1,
        }
    }

    /// Face size, pixels, and parameters of a capture with this preset and no other flag.
    pub(crate) fn numbers(self) -> (u32, CaptureParameters) {
        let column = match self {
            Self::Draft => Some(0),
            Self::Good => Some(1),
            Self::Best => None,
        };
        let default = CaptureParameters::DEFAULT;
        let text = |argument: &str| {
            let row = Self::NUMBERS.iter().find(|(name, _)| *name == argument);
            row.zip(column).map(|((_, texts), column)| texts[column])
        };
        let number = |argument: &str, default: u32| {
            let text = text(argument);
            text.and_then(|text| text.parse().ok()).unwrap_or(default)
        };
        let holes = text("holes").and_then(|text| text.parse().ok());
        let parameters = CaptureParameters {
            strata: number("strata", default.strata),
            rays_per_stratum: number("rays_per_stratum", default.rays_per_stratum),
            light_samples: number("light_samples", default.light_samples),
            holes: holes.unwrap_or(default.holes),
            ..default
        };
        let face_size_px = number("face_size", CaptureSpec::DEFAULT_FACE_SIZE_PX);
        (face_size_px, parameters)
    }
}

impl QualityArgs {
    /// Flags of rays and light, each with true if it differs from the preset.
    pub(super) fn given_flags(&self) -> [(&'static str, bool); 9] {
        let CaptureParameters {
            strata,
            rays_per_stratum,
            bounces,
            light_samples,
            seed,
            novelty,
            holes,
            sampler,
            ..
        } = self.parameters.parameters();
        let (face_size_px, default) = self.preset.quality.unwrap_or(Preset::Best).numbers();
        [
            ("--face-size", self.face_size != FaceSize::Px(face_size_px)),
            ("--strata", strata != default.strata),
            ("--rays", rays_per_stratum != default.rays_per_stratum),
            ("--bounces", bounces != default.bounces),
            ("--light-samples", light_samples != default.light_samples),
            ("--seed", seed != default.seed),
            ("--novelty", novelty != default.novelty),
            ("--holes", holes != default.holes),
            ("--sampler", sampler != default.sampler),
        ]
    }

    /// Specification of the capture of a headbox (world metres) with this quality.
    pub(super) fn spec(&self, scene: SceneSource, centre: DVec3, half_size_m: f64) -> CaptureSpec {
        CaptureSpec {
            scene,
            centre,
            half_size_m,
            face_size_px: self.face_size.or(self
                .preset
                .quality
                .unwrap_or(Preset::Best)
                .numbers()
                .0),
            parameters: self.parameters.parameters(),
        }
    }
}
