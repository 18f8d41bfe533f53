//! `headbox capture`.

use super::UsageError;
use super::args::{SceneArgs, parse_length, parse_vector};
use super::estimate::{Estimate, rays_of};
use super::output::{CUBE, Outputs, SHARD, memory_bytes, peak_rss_mb, print_json};
use super::progress::{Bar, duration};
use crate::capture::light::Lighting;
use crate::capture::sampler::Strata;
use crate::capture::trace::Tracer;
use crate::capture::{Scene, files, viewpoint};
use crate::ldi::build::{self, Sampler};
use crate::ldi::job::{CaptureJob, Resources};
use crate::ldi::merge::MergeRule;
use crate::ldi::shard::{self, ShardInfo};
use crate::packed::{PackedCube, SplatIndexLayout, Split};
use crate::scene_source::{SceneSource, fingerprint};
use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use glam::DVec3;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

#[derive(Args)]
pub(super) struct Capture {
    #[command(flatten)]
    scene: SceneArgs,
    /// The .ldi file to write, or with --shard the .shard file; `-` for standard output
    #[arg(short, long)]
    output: PathBuf,
    /// Centre of the headbox; free space found by the program if absent
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    center: Option<DVec3>,
    /// Half of the headbox's edge; what fits into free space if absent
    #[arg(long, value_name = "LENGTH", value_parser = parse_length, allow_hyphen_values = true)]
    half_size: Option<f64>,
    #[command(flatten)]
    quality: QualityArgs,
    /// Memory to keep within, MiB; what does not fit goes to a temporary file beside the output
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(64..=1 << 24))]
    memory: Option<u64>,
    /// Capture only part I of N (0/4 to 3/4, or 1/4 to 4/4) into a shard file; see `merge`
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    shard: Option<(u32, u32)>,
    #[command(flatten)]
    packing: PackingArgs,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// What decides the quality of a capture.
#[derive(Args)]
pub(super) struct QualityArgs {
    /// Faces, strata, rays and light together, where they are not given one by one; best if absent
    #[arg(long)]
    quality: Option<Preset>,
    /// Pixels a side of each cube face; 256 for draft, 512 for good, 1024 for best
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..=i64::from(crate::ldi::MAX_FACE_SIZE_PX)))]
    face_size: Option<u32>,
    /// Strata along each of the four dimensions of rays; 16 for draft, 24 for good, 32 for best
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(Strata::MAX_PER_DIMENSION)))]
    strata: Option<u32>,
    /// Rays in each stratum; 8 for draft and good, 16 for best
    #[arg(long, value_name = "M", value_parser = clap::value_parser!(u32).range(1..=i64::from(Strata::MAX_RAYS)))]
    rays: Option<u32>,
    /// Diffuse bounces of light beyond direct light
    #[arg(long, value_name = "B", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=64))]
    pub(super) bounces: u32,
    /// Light samples per depth pixel, 1 for draft, 2 for good, 4 for best; 0 shows albedo and emission without light
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(0..=65_535))]
    light_samples: Option<u32>,
    /// Random seed
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub(super) seed: u64,
    /// Trace fewer rays where the next one is new with a probability below X; 0 traces all
    #[arg(long, value_name = "X", default_value_t = CaptureJob::DEFAULT_NOVELTY, value_parser = parse_share, allow_hyphen_values = true)]
    pub(super) novelty: f64,
    /// Which rays
    #[arg(long, default_value = "stratified")]
    sampler: SamplerArg,
    /// What becomes of samples at similar depth
    #[arg(long, default_value = "average")]
    merge: MergeArg,
}

/// How a cube LDI is packed.
#[derive(Args)]
pub(super) struct PackingArgs {
    /// What the splat index holds: the paper's normal and depth, or all bits for the normal
    #[arg(long, default_value = "normal")]
    layout: LayoutArg,
    /// Near/far split of each face: auto, none, or an eye depth
    #[arg(long, default_value = "auto", value_parser = parse_split, allow_hyphen_values = true)]
    split: SplitArg,
}

/// Qualities by name.
#[derive(Clone, Copy, ValueEnum)]
enum Preset {
    /// To see whether the headbox is in the right place
    Draft,
    /// To look around
    Good,
    /// The paper's: to keep
    Best,
}

/// Faces, strata, rays, light samples.
impl Preset {
    fn numbers(self) -> [u32; 4] {
        match self {
            Self::Draft => [256, 16, 8, 1],
            Self::Good => [512, 24, 8, 2],
            Self::Best => [1024, 32, 16, 4],
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum SamplerArg {
    Stratified,
    WhiteNoise,
    CentreRays,
}

#[derive(Clone, Copy, ValueEnum)]
enum MergeArg {
    Average,
    SmallerArea,
    ColorsApart,
}

#[derive(Clone, Copy, ValueEnum)]
enum LayoutArg {
    Paper,
    Normal,
}

#[derive(Clone, Copy)]
enum SplitArg {
    Auto,
    None,
    At(f64),
}

fn parse_split(text: &str) -> Result<SplitArg, String> {
    match text {
        "auto" => Ok(SplitArg::Auto),
        "none" => Ok(SplitArg::None),
        depth => parse_length(depth).map(SplitArg::At).map_err(|_| "give auto, none, or an eye depth above 0".into()),
    }
}

fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("give a probability from 0 to 1".into()),
    }
}

/// Parts are numbered from 0 or from 1: part N of N is part 0.
fn parse_shard(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse::<u32>().ok()?, n.parse::<u32>().ok()?)));
    match parts {
        Some((i, n)) if (1..=1024).contains(&n) && i <= n => Ok((i % n, n)),
        _ => Err("give I/N with N from 1 to 1024 and I from 0 to N, such as 1/4".into()),
    }
}

impl PackingArgs {
    pub(super) fn pack(&self, ldi: &crate::ldi::CubeLdi) -> anyhow::Result<PackedCube> {
        let layout = match self.layout {
            LayoutArg::Paper => SplatIndexLayout::Paper,
            LayoutArg::Normal => SplatIndexLayout::Normal,
        };
        let split = match self.split {
            SplitArg::Auto => Split::Auto,
            SplitArg::None => Split::None,
            SplitArg::At(depth) => Split::AtDepth(depth * ldi.info.unit_m),
        };
        Ok(PackedCube::pack(ldi, layout, split)?)
    }
}

impl QualityArgs {
    /// The capture of a headbox with this quality.
    fn job(&self, scene: SceneSource, centre: DVec3, half_size_m: f64) -> CaptureJob {
        let [face_size, strata, rays, light_samples] = self.quality.unwrap_or(Preset::Best).numbers();
        CaptureJob {
            scene,
            centre,
            half_size_m,
            face_size_px: self.face_size.unwrap_or(face_size),
            sampler: match self.sampler {
                SamplerArg::Stratified => Sampler::Stratified,
                SamplerArg::WhiteNoise => Sampler::WhiteNoise,
                SamplerArg::CentreRays => Sampler::CentreRays,
            },
            strata: self.strata.unwrap_or(strata),
            rays: self.rays.unwrap_or(rays),
            seed: self.seed,
            novelty: self.novelty,
            merge_rule: match self.merge {
                MergeArg::Average => MergeRule::Average,
                MergeArg::SmallerArea => MergeRule::SmallerArea,
                MergeArg::ColorsApart => MergeRule::ColorsApart,
            },
            bounces: self.bounces,
            light_samples: self.light_samples.unwrap_or(light_samples),
        }
    }
}

/// A scene this many of its diagonals away is less than a pixel wide on the largest face: 2/8192 of its depth.
const MAX_DIAGONALS_AWAY: f64 = 4096.0;

/// Where the headbox goes: what the user said, else what the scene suggests, else free space. World metres.
pub(super) fn place_headbox(
    scene: &Arc<Scene>,
    center: Option<DVec3>,
    half_size: Option<f64>,
) -> anyhow::Result<(DVec3, f64)> {
    let [low, high] = scene.bounds();
    let scout = || Tracer::new(Arc::clone(scene), (low + high) / 2.0);
    let (centre, suggested_half_size) = match (center, scene.headbox) {
        (Some(center), _) => (scene.frame.world_from_file(center), None),
        (None, Some(headbox)) => (headbox.centre, Some(headbox.half_size_m)),
        (None, None) => {
            let headbox = viewpoint::suggest_headbox(&scout());
            (headbox.centre, Some(headbox.half_size_m))
        }
    };
    let half_size_m = match (half_size, suggested_half_size) {
        (Some(half_size), _) => half_size * scene.frame.unit_m,
        (None, Some(half_size_m)) => half_size_m,
        (None, None) => viewpoint::suggest_half_size(&scout(), centre),
    };
    let beyond = (centre - centre.clamp(low, high)).length();
    if beyond > MAX_DIAGONALS_AWAY * (high - low).length() {
        let [low, high] = [low, high].map(|corner| scene.frame.file_from_world(corner));
        let message = format!(
            "--center lies so far from the scene that nothing of it would be seen; the scene reaches from {low} to {high} (in \
             the file's axes and unit)"
        );
        return Err(UsageError(message).into());
    }
    if !centre.is_finite() || !(1e-9..=1e9).contains(&half_size_m) {
        let message = format!("a headbox of half-size {half_size_m} m; it must lie between 1e-9 and 1e9 m");
        return Err(UsageError(message).into());
    }
    Ok((centre, half_size_m))
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
        eprintln!("warning: the scene alone takes {} MiB; --memory cannot be honoured", used >> 20);
    }
    Some(((limit.saturating_sub(used) / SHARE).max(16 << 20), spill_folder(output)))
}

/// Where there is as much room as the output will need: beside it, unless it is streamed or its folder is yet to be made.
fn spill_folder(output: &Path) -> PathBuf {
    let beside = match output.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
        _ => PathBuf::from("."),
    };
    let is_beside = beside.is_dir() && !files::is_stream(output).unwrap_or(true);
    if is_beside { beside } else { std::env::temp_dir() }
}

/// Rays for each pixel of the faces.
fn rays_per_pixel(job: &CaptureJob) -> f64 {
    rays_of(job) / (6.0 * f64::from(job.face_size_px).powi(2))
}

/// A length with four digits that count.
fn rounded(length: f64) -> f64 {
    let digits = (3.0 - length.abs().max(f64::MIN_POSITIVE).log10().floor()).clamp(0.0, 12.0);
    let scale = 10_f64.powf(digits);
    (length * scale).round() / scale
}

/// A position as the command line takes it.
fn triple(position: DVec3) -> String {
    position.to_array().map(|x| rounded(x).to_string()).join(",")
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

impl Capture {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let start = Instant::now();
        let source = self.scene.source();
        let endings = if self.shard.is_some() { &SHARD } else { &CUBE };
        let outputs = Outputs::new(self.json, [&source.name]).file(&self.output, endings)?;
        let scene = Arc::new(source.open()?);
        outputs.scene_is_open(&scene)?;
        let (centre, half_size_m) = place_headbox(&scene, self.center, self.half_size)?;
        let mut job = self.quality.job(source, centre, half_size_m);
        let is_free = self.half_size.is_none() && scene.headbox.is_none();
        if is_free {
            job.half_size_m = viewpoint::fitting_half_size(half_size_m, rays_per_pixel(&job));
        }
        let tracer = Tracer::new(Arc::clone(&scene), centre);
        eprintln!(
            "headbox: centre {}, half-size {} (in the file's axes and unit)",
            triple(scene.frame.file_from_world(centre)),
            rounded(job.half_size_m / scene.frame.unit_m)
        );
        eprintln!("will take: {}", Estimate::of(&job, &tracer, self.shard.map_or(1, |(_, parts)| parts)));
        let resources = Resources { budget: budget(self.memory, &self.output) };
        let bar = Bar::new();
        if let Some(part) = self.shard {
            return self.run_shard(job, part, &tracer, &resources, &bar, start);
        }
        let lighting = Lighting::measure(&tracer, job.bounces);
        let (ldi, trace_time) = job.run(&tracer, &lighting, &resources, &bar).context("the capture failed")?;
        drop((tracer, scene));
        let packed = self.packing.pack(&ldi)?;
        if packed.depth_pixel_count() == 0 {
            bail!("no ray from the headbox met the scene; move --center, or choose a larger --half-size");
        }
        drop(ldi);
        packed.write(&self.output)?;
        bar.finish();
        warn_if_blocked(packed.info.blocked_share);
        self.report(&packed, trace_time.as_secs_f64(), start.elapsed().as_secs_f64(), &bar.times());
        Ok(())
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
        let tracing = build::trace(tracer, &settings, bar).context("tracing failed")?;
        let scene = tracer.scene();
        let (scene_fingerprint, triangles) = (fingerprint(scene), scene.triangles.len() as u32);
        let info = ShardInfo { job, scene_fingerprint, triangles, part, parts, rays: tracing.rays };
        shard::write(&self.output, &info, &tracing)?;
        bar.finish();
        if self.json {
            print_json(&json!({
                "rays": info.rays, "total_s": start.elapsed().as_secs_f64(), "peak_rss_mb": peak_rss_mb(),
                "shard": format!("{part}/{parts}"),
            }));
        } else {
            println!("{}: shard {part}/{parts}, {} rays", self.output.display(), info.rays);
        }
        Ok(())
    }

    fn report(&self, cube: &PackedCube, trace_s: f64, total_s: f64, times: &str) {
        let rays = cube.info.rays_traced;
        let missing: Vec<f64> = cube.info.missing_estimate.iter().flatten().copied().collect();
        let mean = (!missing.is_empty()).then(|| missing.iter().sum::<f64>() / missing.len() as f64);
        if self.json {
            print_json(&json!({
                "rays": rays, "rays_per_s": rays as f64 / trace_s, "trace_s": trace_s, "total_s": total_s,
                "peak_rss_mb": peak_rss_mb(), "depth_pixels": cube.depth_pixel_count(),
                "missing_estimate": mean, "missing_estimate_per_face": cube.info.missing_estimate,
                "bytes": cube.bytes(), "blocked_share": cube.info.blocked_share,
            }));
            return;
        }
        println!("{}: {} depth pixels from {rays} rays", self.output.display(), cube.depth_pixel_count());
        println!("  {} in all: {times}; {:.1} Mrays/s while tracing", duration(total_s), rays as f64 / trace_s / 1e6);
        if let Some(mean) = mean {
            println!("  the next ray would find something new with a probability of {:.1} %", mean * 100.0);
        }
        println!("look at it: headbox render {} -o frame.png", self.output.display());
    }
}
