//! `headbox capture`.
//!
//! * `quality`: arguments of quality; [`face_size`]: `--face-size`.
//! * [`place`]: the headbox in the axes and unit of the scene's file.
//! * [`estimate`]: time and space of a capture, before it starts; [`memory_limit`]: `--memory`.
//! * `report`: its result.
//! * `images`, [`deep`]: captures from image sets and deep images.

pub(crate) mod deep;
pub(crate) mod estimate;
mod face_size;
mod images;
pub(crate) mod memory_limit;
pub(crate) mod place;
mod quality;
mod report;

pub(crate) use quality::Preset;
#[cfg(feature = "viewer")]
pub(crate) use quality::PresetArgs;
pub(crate) use report::describe_aimed_rays;

use super::images::is_image_set;
use crate::args::{SceneArgs, parse_vector, refuse_given, refuse_misplaced};
use crate::image_set::SetArgs;
use crate::messages::UsageError;
use crate::output::{
    CUBE, Outputs, SHARD, has_extension, output_name, parent_folder, peak_rss_mb, print_json,
};
use crate::packing::PackingArgs;
use crate::progress::Bar;
use anyhow::{Context, bail};
use clap::Args;
use deep::is_deep_picture;
use estimate::Estimate;
use glam::DVec3;
use headbox_core::file_frame::{figure, triple};
use headbox_core::files;
use headbox_core::headbox::Headbox;
use headbox_core::memory;
use headbox_core::read_note::ReadNote;
use headbox_ldi::accumulate::shard::{self, ShardInfo};
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::from_deep::DeepCameraOptions;
use headbox_ldi::spec::RunOptions;
use headbox_photos::voxel_colouring::Backdrop;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use memory_limit::{MemoryLimit, run_on, too_large_warning};
use place::{HeadboxArgs, place_headbox};
use quality::QualityArgs;
use report::CaptureTimes;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

#[derive(Args)]
pub(crate) struct CaptureCommand {
    #[command(flatten)]
    scene: SceneArgs,
    /// Output .ldi file, or .shard file with --shard; `-` for standard output
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    headbox: HeadboxArgs,
    #[command(flatten)]
    quality: QualityArgs,
    /// Capture only part I of N (0/4 to 3/4, or 1/4 to 4/4) into a shard file; see `merge`
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    shard: Option<(u32, u32)>,
    #[command(flatten)]
    packing: PackingArgs,
    #[command(flatten)]
    images: SetArgs,
    /// Image sets with depth: standard deviation of inverse depth, 1/m; the measured one, or that
    /// of the format, by default
    #[arg(long, value_name = "X")]
    depth_noise: Option<f32>,
    /// Photographs without depth: colour agreement threshold for photo-consistency, a standard
    /// deviation in levels, above 0 up to 255, raised where no surface agrees; 18 by default
    #[arg(long, value_name = "LEVELS", value_parser = parse_agreement)]
    agreement: Option<f32>,
    /// Photographs without depth: threshold of a dark background, 0 to 255: pixels with no channel
    /// above it show no surface; auto detects a background, none keeps all pixels
    #[arg(long, value_name = "LEVEL", default_value = "auto", value_parser = parse_backdrop)]
    backdrop: Backdrop,
    /// Deep EXRs without a camera in the header: vertical field of view, degrees, of a camera at
    /// --center, the origin by default
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    fov: Option<f64>,
    /// Deep EXRs without a camera in the header: target of the camera; a point along -Z by default
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_vector, allow_hyphen_values = true)]
    look_at: Option<DVec3>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
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

/// Parses I/N. Parts are numbered from 0 or from 1: part N of N is part 0.
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

/// The folder of the output, where there is room for a file of its size; the folder for temporary
/// files if the output is streamed or its folder does not exist yet.
fn spill_folder(output: &Path) -> PathBuf {
    let folder = parent_folder(output);
    if folder.is_dir() && !files::is_stream(output).unwrap_or(true) {
        folder.to_path_buf()
    } else {
        std::env::temp_dir()
    }
}

/// Warns if geometry hides part of the headbox from its centre.
pub(super) fn warn_if_blocked(blocked_share: f64) {
    /// Share that is displayed as 0.0 %.
    const NEGLIGIBLE: f64 = 0.0005;
    if blocked_share >= NEGLIGIBLE {
        eprintln!(
            "warning: geometry inside the headbox hides {:.1} % of it from its centre; views from there will lack their \
             background. Move --center or choose a smaller --half-size",
            blocked_share * 100.0
        );
    }
}

impl CaptureCommand {
    pub(crate) fn run(&self, memory_mb: Option<u64>) -> anyhow::Result<()> {
        if is_image_set(self.scene.name()) {
            return self.run_images();
        }
        if is_deep_picture(self.scene.name()) {
            return self.run_deep();
        }
        self.run_scene(memory_mb)
    }

    fn run_deep(&self) -> anyhow::Result<()> {
        let quality = self.quality.preset.quality;
        self.refuse_scene_flags("a deep picture", [("--quality", quality.is_some())])?;
        self.refuse_image_flags()?;
        let place = DeepCameraOptions {
            centre: self.headbox.center,
            look_at: self.look_at,
            fov_y_deg: self.fov,
            half_size_m: self.headbox.half_size,
            name: self.scene.name().into(),
        };
        let name = self.scene.name();
        deep::run(name, &self.output, place, &self.packing, self.json)
    }

    fn run_scene(&self, memory_mb: Option<u64>) -> anyhow::Result<()> {
        refuse_misplaced(
            "deep EXRs without a camera in the header",
            self.deep_flags(),
        )?;
        self.refuse_image_flags()?;
        let start = Instant::now();
        let source = self.scene.source();
        let outputs = self.check_output(&source.name)?;
        let scene = Arc::new(source.open()?);
        outputs.add_scene(self.scene.name(), &scene, self.images.strict)?;
        let notes = scene.summary.notes.clone();
        let Headbox {
            centre,
            half_size_m,
        } = place_headbox(&scene, self.headbox.center, self.headbox.half_size)?;
        let mut spec = self.quality.spec(source, centre, half_size_m);
        if self.headbox.half_size.is_none() {
            spec.fit_half_size(&scene);
        }
        let tracer = Tracer::new(Arc::clone(&scene), centre);
        self.quality
            .face_size
            .choose(&mut spec, &tracer, &self.packing);
        eprintln!(
            "headbox: centre {}, half-size {} (in the file's axes and unit)",
            triple(scene.frame.file_from_world(centre)),
            figure(spec.half_size_m / scene.frame.unit_m)
        );
        let headbox = Headbox {
            centre,
            half_size_m: spec.half_size_m,
        };
        self.headbox.warn_if_bad(&tracer, &headbox);
        let parameters = &spec.parameters;
        let lighting = if self.shard.is_none() {
            Lighting::prepare(
                &tracer,
                centre,
                parameters.bounces,
                parameters.light_samples > 0,
            )
        } else {
            Lighting::unmetered(&tracer, 0) // shards are lit when they are merged
        };
        let shard = self.shard.unwrap_or((0, 1));
        let limit = MemoryLimit::new(memory_mb, spec.face_size_px);
        let estimate = Estimate::new(&spec, &tracer, &lighting, &self.packing, shard.1, start)
            .context("the capture failed")?;
        let all_threads = rayon::current_num_threads();
        let threads = limit.map_or(all_threads, |limit| {
            limit.threads(estimate.depth_pixels(), all_threads)
        });
        let estimate = estimate.limit_memory(limit, threads);
        eprintln!("estimate: {estimate}");
        if limit.is_none()
            && let (Some([_, used]), Some(free)) = (memory::peak_and_resident(), memory::free())
            && let Some(warning) = too_large_warning(estimate.memory_bytes(), used, free)
        {
            eprintln!("{warning}");
        }
        if let Some(limit) = limit
            && self.shard.is_none()
        {
            let smaller_faces = limit.smaller_faces(estimate.depth_pixels());
            limit.check(estimate.memory_bytes(), &smaller_faces)?;
        }
        let bar = Bar::planned(estimate.plan(), true);
        let options = RunOptions {
            budget: limit
                .map(|limit| limit.spill_budget(estimate.depth_pixels(), threads, &self.output)),
            shard,
            progress: &bar,
        };
        let capture = SceneCapture::new(&spec, &tracer, &lighting, &options);
        if self.shard.is_some() {
            return run_on(threads, || self.write_shard(&capture, &bar, start, &notes))?;
        }
        let (ldi, trace_time) = run_on(threads, || capture.run())?.context("the capture failed")?;
        let [low, high] = scene.bounds();
        let encloses = 2.0 * spec.half_size_m > (high - low).max_element();
        drop((tracer, scene));
        let packed = run_on(threads, || self.packing.pack(ldi))??;
        if packed.depth_pixel_count() == 0 && packed.planes.tiles.is_empty() {
            if encloses {
                bail!(
                    "no ray from the headbox met the scene, which is smaller; choose a smaller --half-size"
                );
            }
            bail!(
                "no ray from the headbox met the scene; move --center, or choose a larger --half-size"
            );
        }
        packed.write(&self.output)?;
        bar.finish();
        warn_if_blocked(packed.info.blocked_share);
        limit.iter().for_each(MemoryLimit::warn_if_exceeded);
        let times = CaptureTimes {
            trace_s: trace_time.as_secs_f64(),
            total_s: start.elapsed().as_secs_f64(),
            estimated_s: estimate.seconds(),
            stages: bar.times(),
        };
        self.report(&packed, &times, &notes);
        Ok(())
    }

    /// Checks that the output can be written.
    fn check_output(&self, scene_name: &str) -> anyhow::Result<Outputs> {
        if self.shard.is_none() && has_extension(&self.output, "shard") {
            bail_usage!(
                "{}: a .shard is a part of a capture; specify the part, such as --shard 1/2",
                self.output.display()
            );
        }
        let endings = if self.shard.is_some() { &SHARD } else { &CUBE };
        Outputs::new(self.json, [scene_name]).file(&self.output, endings)
    }

    /// Flags of deep images only, each with true if it is given.
    fn deep_flags(&self) -> [(&'static str, bool); 2] {
        [
            ("--fov", self.fov.is_some()),
            ("--look-at", self.look_at.is_some()),
        ]
    }

    /// Refuses flags of image sets for another kind of input.
    fn refuse_image_flags(&self) -> Result<(), UsageError> {
        self.images.refuse_without_set(false)?;
        self.refuse_photograph_flags()?;
        refuse_misplaced(images::DEPTH, [self.depth_flag()])
    }

    /// Refuses flags of photographs without depth.
    fn refuse_photograph_flags(&self) -> Result<(), UsageError> {
        let flags = [
            ("--agreement", self.agreement.is_some()),
            ("--backdrop", self.backdrop != Backdrop::Auto),
        ];
        refuse_misplaced(images::PHOTOGRAPHS, flags)
    }

    /// Flag of image sets with depth only, with true if it is given.
    fn depth_flag(&self) -> (&'static str, bool) {
        ("--depth-noise", self.depth_noise.is_some())
    }

    /// Refuses flags of scenes, and `more`, for another kind of input.
    fn refuse_scene_flags<const N: usize>(
        &self,
        kind: &str,
        more: [(&'static str, bool); N],
    ) -> Result<(), UsageError> {
        let flags = [("--shard", self.shard.is_some())]
            .into_iter()
            .chain(self.quality.given_flags())
            .chain(self.scene.source.given_flags())
            .chain(more);
        refuse_given(kind, flags)
    }

    /// Traces and writes a shard.
    fn write_shard(
        &self,
        capture: &SceneCapture,
        bar: &Bar,
        start: Instant,
        notes: &[ReadNote],
    ) -> anyhow::Result<()> {
        let tracing = capture.trace().context("tracing failed")?;
        let info = ShardInfo::new(capture, &tracing);
        shard::write(&self.output, &info, &tracing)?;
        bar.finish();
        let ShardInfo {
            part, parts, rays, ..
        } = info;
        if self.json {
            print_json(&json!({
                "rays": rays,
                "total_s": start.elapsed().as_secs_f64(),
                "peak_rss_mb": peak_rss_mb(),
                "shard": format!("{part}/{parts}"),
                "notes": notes,
            }));
        } else {
            let output = output_name(&self.output);
            let label = shard::part_label(part, parts);
            println!("{output}: shard {label}, {rays} rays");
        }
        Ok(())
    }
}
