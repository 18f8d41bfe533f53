//! `headbox capture`.

pub(crate) mod deep;
mod estimate;
mod face_size;
mod images;
pub(crate) mod place;

use super::images::is_image_set;
use crate::args::{Names, by_name};
use crate::args::{SceneArgs, parse_length, parse_vector};
use crate::commands::capture::deep as capture_deep;
use crate::commands::capture::deep::is_deep_picture;
use crate::commands::capture::estimate::{Estimate, rays_of};
use crate::commands::capture::face_size::FaceSize;
use crate::commands::capture::place::{figure, place_headbox, triple};
use crate::image_set::SetArgs;
use crate::output::{CUBE, Outputs, SHARD, memory_bytes, name_of, peak_rss_mb, print_json};
use crate::packing::{PackingArgs, what_is_kept};
use crate::progress::{Bar, duration};
use crate::words::{UsageError, counted, quoted};
use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use glam::DVec3;
use headbox_core::files;
use headbox_core::headbox::Headbox;
use headbox_cube::model::info::Holes;
use headbox_cube::model::parameters::{CaptureParameters, MergeRule, Sampler};
use headbox_cube::pack::PackedCube;
use headbox_ldi::accumulate::shard;
use headbox_ldi::accumulate::shard::ShardInfo;
use headbox_ldi::from_deep::DeepPlace;
use headbox_ldi::job::CaptureJob;
use headbox_ldi::rays::trace;
use headbox_ldi::refine;
use headbox_ldi::scene_source::{SceneSource, fingerprint};
use headbox_ldi::settings::Resources;
use headbox_photos::voxel_colouring::Backdrop;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::sampler::Strata;
use headbox_trace::viewpoint;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

#[derive(Args)]
pub(crate) struct CaptureCommand {
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    /// The .ldi file to write, or with --shard the .shard file; `-` for standard output
    #[arg(short, long)]
    pub(super) output: PathBuf,
    /// Centre of the headbox; free space found by the program if absent
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    pub(super) center: Option<DVec3>,
    /// Half of the headbox's edge; what fits into free space if absent
    #[arg(long, value_name = "LENGTH", value_parser = parse_length, allow_hyphen_values = true)]
    pub(super) half_size: Option<f64>,
    #[command(flatten)]
    pub(super) quality: QualityArgs,
    /// Memory to keep within, MiB; what does not fit goes to a temporary file beside the output
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(64..=1 << 24))]
    memory: Option<u64>,
    /// Capture only part I of N (0/4 to 3/4, or 1/4 to 4/4) into a shard file; see `merge`
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    shard: Option<(u32, u32)>,
    #[command(flatten)]
    pub(super) packing: PackingArgs,
    #[command(flatten)]
    pub(super) images: SetArgs,
    /// Of image sets: standard deviation of inverse depth, 1/m; by the format if absent
    #[arg(long, value_name = "X")]
    pub(super) depth_noise: Option<f32>,
    /// Of photographs without depth: they agree on a colour up to this standard deviation, levels of 255; more where nothing else is
    /// found; 18 if absent
    #[arg(long, value_name = "LEVELS", value_parser = parse_agreement)]
    pub(super) agreement: Option<f32>,
    /// Of photographs without depth: what stands before a dark backdrop has no pixel of which all channels are at most this; auto,
    /// none, or a level of 255
    #[arg(long, value_name = "LEVEL", default_value = "auto", value_parser = parse_backdrop)]
    pub(super) backdrop: Backdrop,
    /// Of a deep picture (.exr) of a camera that its header does not tell: degrees between its top and its bottom edge; it stands at
    /// --center, or the origin
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub(super) fov: Option<f64>,
    /// Of such a picture: where its camera looked; along -Z if absent
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    pub(super) look_at: Option<DVec3>,
    /// Keep light above white, up to four stops, in coarser steps: for render --exposure, and -o FRAME.exr
    #[arg(long)]
    hdr: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    pub(super) json: bool,
}

/// What decides the quality of a capture.
#[derive(Args)]
pub(super) struct QualityArgs {
    /// Faces, strata, rays and light together, where they are not given one by one; best if absent
    #[arg(long)]
    quality: Option<Preset>,
    /// Pixels a side of each cube face; or auto, or auto:WIDTHxHEIGHT@DEGREES: as fine as such frames (1024x768@60) show to within
    /// --error-px, with strata to match
    #[arg(long, value_name = "PX", default_value_t = FaceSize::Px(CaptureJob::DEFAULT_FACE_SIZE_PX))]
    pub(super) face_size: FaceSize,
    #[command(flatten)]
    pub(super) parameters: ParameterArgs,
}

/// Rays, merging and light of a capture.
#[derive(Args)]
pub(super) struct ParameterArgs {
    /// Strata along each of the four dimensions of rays (N)
    #[arg(long, value_name = "N", default_value_t = CaptureParameters::DEFAULT.strata,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(Strata::MAX_PER_DIMENSION)))]
    strata: u32,
    /// Rays in each stratum (M)
    #[arg(long = "rays", value_name = "M", default_value_t = CaptureParameters::DEFAULT.rays_per_stratum,
        value_parser = clap::value_parser!(u32).range(1..=i64::from(Strata::MAX_RAYS)))]
    rays_per_stratum: u32,
    /// Diffuse bounces of light beyond direct light
    #[arg(long, value_name = "B", default_value_t = CaptureParameters::DEFAULT.bounces,
        value_parser = clap::value_parser!(u32).range(0..=64))]
    bounces: u32,
    /// Light samples per depth pixel; 0 shows albedo and emission without light
    #[arg(long, value_name = "K", default_value_t = CaptureParameters::DEFAULT.light_samples,
        value_parser = clap::value_parser!(u32).range(0..=65_535))]
    light_samples: u32,
    /// Random seed
    #[arg(long, value_name = "K", default_value_t = CaptureParameters::DEFAULT.seed)]
    seed: u64,
    /// Trace fewer rays where the next one is new with a probability below X; 0 traces all
    #[arg(long, value_name = "X", default_value_t = CaptureParameters::DEFAULT.novelty, value_parser = parse_share,
        allow_hyphen_values = true)]
    novelty: f64,
    /// Aim rays at what frames lack until its share, with its standard error, is below X (a share, or a percentage such as
    /// 0.01%); 1 looks for nothing
    #[arg(long, value_name = "X", default_value_t = CaptureParameters::DEFAULT.holes, value_parser = parse_holes,
        allow_hyphen_values = true)]
    pub(super) holes: f64,
    /// Which rays
    #[arg(long, default_value = "stratified", value_parser = by_name(SAMPLERS))]
    sampler: Sampler,
    /// What becomes of samples at similar depth
    #[arg(long = "merge", default_value = "average", value_parser = by_name(MERGE_RULES))]
    pub(super) merge_rule: MergeRule,
}

const SAMPLERS: Names<Sampler> = &[
    ("stratified", "Jittered in 4-D strata", Sampler::Stratified),
    (
        "white-noise",
        "Independent over the whole domain",
        Sampler::WhiteNoise,
    ),
    (
        "centre-rays",
        "One ray through the centre of each pixel, from the centre of the cube",
        Sampler::CentreRays,
    ),
];

const MERGE_RULES: Names<MergeRule> = &[
    (
        "average",
        "One depth pixel with their mean depth and colour",
        MergeRule::Average,
    ),
    (
        "smaller-area",
        "The surface that was sampled with the smallest area",
        MergeRule::SmallerArea,
    ),
    (
        "colors-apart",
        "Surfaces whose colours differ are kept apart",
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

fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
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

/// Qualities by name; their numbers are in [`Preset::NUMBERS`].
#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Preset {
    /// To see whether the headbox is in the right place
    Draft,
    /// To look around
    Good,
    /// The paper's: to keep
    Best,
}

impl Preset {
    /// What arguments are where they are not given, for draft and good; best is what they are without a preset.
    pub(crate) const NUMBERS: [(&str, [&str; 2]); 4] = [
        ("face_size", ["256", "512"]),
        ("strata", ["16", "24"]),
        ("rays_per_stratum", ["8", "8"]),
        ("light_samples", ["1", "2"]),
    ];

    /// Pixels a side of the faces for which the strata of a preset are meant.
    fn face_size(preset: Option<Self>) -> u32 {
        let [(_, [draft, good]), ..] = Self::NUMBERS;
        let size = match preset {
            Some(Self::Draft) => draft,
            Some(Self::Good) => good,
            Some(Self::Best) | None => "",
        };
        size.parse().unwrap_or(CaptureJob::DEFAULT_FACE_SIZE_PX)
    }
}

impl QualityArgs {
    /// What is said of how rays are traced and lit other than the defaults, by its flag.
    fn given(&self) -> [(&'static str, bool); 9] {
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
        let usual = CaptureParameters::DEFAULT;
        [
            (
                "--face-size",
                self.face_size != FaceSize::Px(CaptureJob::DEFAULT_FACE_SIZE_PX),
            ),
            ("--strata", strata != usual.strata),
            ("--rays", rays_per_stratum != usual.rays_per_stratum),
            ("--bounces", bounces != usual.bounces),
            ("--light-samples", light_samples != usual.light_samples),
            ("--seed", seed != usual.seed),
            ("--novelty", novelty != usual.novelty),
            ("--holes", holes != usual.holes),
            ("--sampler", sampler != usual.sampler),
        ]
    }
}

fn parse_agreement(text: &str) -> Result<f32, String> {
    let level = text
        .parse()
        .ok()
        .filter(|level| *level > 0.0 && *level <= 255.0);
    level.ok_or_else(|| "give a number of levels above 0, up to 255".into())
}

fn parse_backdrop(text: &str) -> Result<Backdrop, String> {
    match text {
        "auto" => Ok(Backdrop::Auto),
        "none" => Ok(Backdrop::None),
        level => level
            .parse()
            .map(Backdrop::Dark)
            .map_err(|_| "give auto, none, or a level from 0 to 255".into()),
    }
}

/// Parts are numbered from 0 or from 1: part N of N is part 0.
fn parse_shard(text: &str) -> Result<(u32, u32), String> {
    let parts = text
        .split_once('/')
        .and_then(|(i, n)| Some((i.parse::<u32>().ok()?, n.parse::<u32>().ok()?)));
    match parts {
        Some((i, n)) if (1..=shard::MAX_PARTS).contains(&n) && i <= n => Ok((i % n, n)),
        _ => Err(format!(
            "give I/N with N from 1 to {} and I from 0 to N, such as 1/4",
            shard::MAX_PARTS
        )),
    }
}

impl QualityArgs {
    /// The capture of a headbox with this quality.
    fn job(&self, scene: SceneSource, centre: DVec3, half_size_m: f64) -> CaptureJob {
        let (face_size_px, parameters) = (
            self.face_size.or(Preset::face_size(self.quality)),
            self.parameters.parameters(),
        );
        CaptureJob {
            scene,
            centre,
            half_size_m,
            face_size_px,
            parameters,
        }
    }
}

/// Memory for accumulators within a limit for the whole process, and the folder to spill to.
pub(super) fn budget(memory_mb: Option<u64>, output: &Path) -> Option<(u64, PathBuf)> {
    /// Room for thread buffers, the heads of tiles, and what a tile needs while it is sorted.
    const RESERVE: u64 = 96 << 20;
    /// The rest is shared with the LDI that grows at the end, while the allocator still holds what accumulators have freed.
    const SHARE: u64 = 2;
    let limit = memory_mb? << 20;
    let used = memory_bytes().map_or(0, |(_, now)| now) + RESERVE;
    if used >= limit {
        eprintln!(
            "warning: the scene alone takes {} MiB; --memory cannot be honoured",
            used >> 20
        );
    }
    Some((
        (limit.saturating_sub(used) / SHARE).max(16 << 20),
        spill_folder(output),
    ))
}

/// Where there is as much room as the output will need: beside it, unless it is streamed or its folder is yet to be made.
fn spill_folder(output: &Path) -> PathBuf {
    let beside = match output.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    };
    let is_beside = beside.is_dir() && !files::is_stream(output).unwrap_or(true);
    if is_beside {
        beside
    } else {
        std::env::temp_dir()
    }
}

/// Rays for each pixel of the faces.
fn rays_per_pixel(job: &CaptureJob) -> f64 {
    rays_of(job) / (6.0 * f64::from(job.face_size_px).powi(2))
}

/// Refuses the first of some flags that is given.
fn refuse_given(kind: &str, flags: &[(&str, bool)]) -> Result<(), UsageError> {
    match flags.iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(UsageError(format!(
            "{flag} has no meaning for {kind}; leave it out"
        ))),
        None => Ok(()),
    }
}

/// Warns if geometry hides part of the headbox from its centre.
pub(super) fn warn_if_blocked(blocked_share: f64) {
    if blocked_share > 0.0 {
        eprintln!(
            "warning: {:.1} % of the headbox is hidden from its centre by geometry inside it; views from there will lack \
             what is behind. Move --center or choose a smaller --half-size",
            blocked_share * 100.0
        );
    }
}

impl CaptureCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        if is_image_set(self.scene.name()) {
            return self.run_images();
        }
        if is_deep_picture(self.scene.name()) {
            self.refuse("a deep picture", &self.flags_of_images())?;
            let place = DeepPlace {
                centre: self.center,
                look_at: self.look_at,
                fov_y_deg: self.fov,
                half_size_m: self.half_size,
                name: self.scene.name().into(),
            };
            return capture_deep::run(
                self.scene.name(),
                &self.output,
                place,
                &self.packing,
                self.json,
            );
        }
        refuse_given("a scene", &self.flags_of_deep())?;
        let start = Instant::now();
        let mut source = self.scene.source();
        source.light.hdr = self.hdr;
        if self.shard.is_none()
            && self
                .output
                .extension()
                .is_some_and(|ending| ending.eq_ignore_ascii_case("shard"))
        {
            let path = self.output.display();
            let message = format!(
                "{path}: a .shard is a part of a capture; say which by --shard I/N, such as --shard 1/2"
            );
            return Err(UsageError(message).into());
        }
        let endings = if self.shard.is_some() { &SHARD } else { &CUBE };
        let outputs = Outputs::new(self.json, [&source.name]).file(&self.output, endings)?;
        let scene = Arc::new(source.open()?);
        outputs.scene_is_open(&scene)?;
        let Headbox {
            centre,
            half_size_m,
        } = place_headbox(&scene, self.center, self.half_size)?;
        let mut job = self.quality.job(source, centre, half_size_m);
        let is_free = self.half_size.is_none() && scene.headbox.is_none();
        if is_free {
            job.half_size_m = viewpoint::fitting_half_size(half_size_m, rays_per_pixel(&job));
        }
        let tracer = Tracer::new(Arc::clone(&scene), centre);
        self.quality
            .face_size
            .settle(&mut job, &tracer, &self.packing);
        eprintln!(
            "headbox: centre {}, half-size {} (in the file's axes and unit)",
            triple(scene.frame.file_from_world(centre)),
            figure(job.half_size_m / scene.frame.unit_m)
        );
        let lighting = match self.shard {
            None => Lighting::prepare(
                &tracer,
                job.parameters.bounces,
                job.parameters.light_samples > 0,
            ),
            Some(_) => Lighting::of_scene(&tracer, 0), // of a shard nothing is lit
        };
        let parts = self.shard.map_or(1, |(_, parts)| parts);
        let estimate = Estimate::of(&job, &tracer, &lighting, &self.packing, parts, start);
        let estimate = estimate.context("the capture failed")?.within(self.memory);
        eprintln!("will take: {estimate}");
        let resources = Resources {
            budget: budget(self.memory, &self.output),
        };
        let bar = Bar::planned(estimate.plan(), true);
        if let Some(part) = self.shard {
            return self.run_shard(job, part, &tracer, &resources, &bar, start);
        }
        let (ldi, trace_time) = refine::capture(&job, &tracer, &lighting, &resources, &bar)
            .context("the capture failed")?;
        let [low, high] = scene.bounds();
        let encloses = 2.0 * job.half_size_m > (high - low).max_element();
        drop((tracer, scene));
        let packed = self.packing.pack(ldi)?;
        if packed.depth_pixel_count() == 0 && packed.planes.tiles.is_empty() {
            match encloses {
                true => bail!(
                    "no ray from the headbox met the scene, which is smaller; choose a smaller --half-size"
                ),
                false => bail!(
                    "no ray from the headbox met the scene; move --center, or choose a larger --half-size"
                ),
            }
        }
        packed.write(&self.output)?;
        bar.finish();
        warn_if_blocked(packed.info.blocked_share);
        let took_s = [
            trace_time.as_secs_f64(),
            start.elapsed().as_secs_f64(),
            estimate.seconds(),
        ];
        self.report(&packed, took_s, &bar.times());
        Ok(())
    }

    /// What is said about image sets alone.
    fn flags_of_images(&self) -> [(&'static str, bool); 2] {
        [
            ("--depth-noise", self.depth_noise.is_some()),
            ("--agreement", self.agreement.is_some()),
        ]
    }

    /// What is said about deep pictures alone.
    pub(super) fn flags_of_deep(&self) -> [(&'static str, bool); 2] {
        [
            ("--fov", self.fov.is_some()),
            ("--look-at", self.look_at.is_some()),
        ]
    }

    /// Refuses what has no meaning for what is no scene: how rays are traced, and `more`.
    pub(super) fn refuse(&self, kind: &str, more: &[(&str, bool)]) -> Result<(), UsageError> {
        let of_rays = [
            ("--shard", self.shard.is_some()),
            ("--memory", self.memory.is_some()),
            ("--quality", self.quality.quality.is_some()),
            ("--hdr", self.hdr),
        ];
        let of_scenes = self.quality.given().into_iter().chain(self.scene.given());
        let all: Vec<_> = of_rays
            .into_iter()
            .chain(of_scenes)
            .chain(more.iter().copied())
            .collect();
        refuse_given(kind, &all)
    }

    fn run_shard(
        &self,
        job: CaptureJob,
        (part, parts): (u32, u32),
        tracer: &Tracer,
        resources: &Resources,
        bar: &Bar,
        start: Instant,
    ) -> anyhow::Result<()> {
        let settings = job.settings(resources, (part, parts));
        let tracing = trace::trace(tracer, &settings, bar).context("tracing failed")?;
        let scene = tracer.scene();
        let (scene_fingerprint, triangles) = (fingerprint(scene), scene.triangles.len() as u32);
        let info = ShardInfo {
            job,
            scene_fingerprint,
            triangles,
            part,
            parts,
            rays: tracing.rays,
        };
        shard::write(&self.output, &info, &tracing)?;
        bar.finish();
        if self.json {
            print_json(&json!({
                "rays": info.rays, "total_s": start.elapsed().as_secs_f64(), "peak_rss_mb": peak_rss_mb(),
                "shard": format!("{part}/{parts}"),
            }));
        } else {
            println!(
                "{}: shard {}, {} rays",
                name_of(&self.output),
                shard::numbered(part, parts),
                info.rays
            );
        }
        Ok(())
    }

    fn report(&self, cube: &PackedCube, [trace_s, total_s, estimated_s]: [f64; 3], times: &str) {
        let rays = cube.info.rays_traced;
        let missing: Vec<f64> = cube
            .info
            .missing_estimate
            .iter()
            .flatten()
            .copied()
            .collect();
        let mean =
            (!missing.is_empty()).then(|| missing.iter().sum::<f64>() / missing.len() as f64);
        if self.json {
            print_json(&json!({
                "rays": rays, "rays_per_s": rays as f64 / trace_s, "trace_s": trace_s, "total_s": total_s,
                "peak_rss_mb": peak_rss_mb(), "depth_pixels": cube.depth_pixel_count(), "samples_on_planes": cube.planes.samples,
                "missing_estimate": mean, "missing_estimate_per_face": cube.info.missing_estimate,
                "bytes": cube.bytes(), "blocked_share": cube.info.blocked_share,
                "estimated_s": estimated_s, "holes": cube.info.holes,
            }));
            return;
        }
        println!(
            "{}: {} from {rays} rays",
            name_of(&self.output),
            what_is_kept(cube)
        );
        let times = if times.is_empty() {
            String::new()
        } else {
            format!(": {times}")
        };
        println!(
            "  {} in all{times}; {:.1} Mrays/s while tracing",
            duration(total_s),
            rays as f64 / trace_s / 1e6
        );
        if let Some(mean) = mean {
            println!(
                "  the next ray would find something new with a probability of {:.1} %",
                mean * 100.0
            );
        }
        if let Some(holes) = cube.info.holes {
            println!(
                "  holes: {}",
                words_of(&holes, self.quality.parameters.holes)
            );
        }
        if self.output.as_os_str() != files::STANDARD_OUTPUT {
            println!(
                "look at it: headbox render {} -o frame.png",
                quoted(&self.output)
            );
        }
    }
}

/// How many rays were aimed at holes, and what there was before.
pub(super) fn aimed(holes: &Holes) -> String {
    let before = holes.share_before * 100.0;
    match holes.aimed_rays {
        0 => "no ray needed to be aimed at any".into(),
        1 => format!("{before:.3} % before 1 ray was aimed"),
        rays => format!("{before:.3} % before {rays} rays were aimed"),
    }
}

/// What became of the search for holes.
fn words_of(holes: &Holes, limit: f64) -> String {
    let [share, error] = [holes.share, holes.standard_error].map(|share| share * 100.0);
    let found = format!(
        "{share:.4} % of frames' pixels (+- {error:.4} %), {}",
        aimed(holes)
    );
    let is_met = holes.share + holes.standard_error <= limit;
    if is_met {
        found
    } else {
        format!(
            "{found}; that is all that {} reach of {} %",
            counted(holes.rounds, "round"),
            limit * 100.0
        )
    }
}
