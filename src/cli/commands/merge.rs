//! `headbox merge`.

use super::capture::memory_limit::{MemoryLimit, run_on};
use super::capture::warn_if_blocked;
use crate::args::StrictArgs;
use crate::messages::format_count;
use crate::output::{CUBE, Outputs, output_name, peak_rss_mb, print_json};
use crate::packing::{PackingArgs, describe_cube};
use crate::progress::Bar;
use anyhow::{Context, ensure};
use clap::Args;
use headbox_ldi::accumulate::shard;
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::rays::trace_and_accumulate::TracedRays;
use headbox_ldi::scene_source::fingerprint;
use headbox_ldi::spec::RunOptions;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Args)]
pub(crate) struct MergeCommand {
    /// All shards of one capture
    #[arg(required = true)]
    shards: Vec<PathBuf>,
    /// Output .ldi file; `-` for standard output
    #[arg(short, long)]
    output: PathBuf,
    /// New path of the scene, if it has moved since the shards were captured
    #[arg(long)]
    scene: Option<String>,
    /// New path of the sky image, if it has moved since the shards were captured
    #[arg(long, value_name = "FILE.hdr|.exr")]
    sky: Option<PathBuf>,
    #[command(flatten)]
    packing: PackingArgs,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

impl MergeCommand {
    pub(crate) fn run(&self, memory_mb: Option<u64>) -> anyhow::Result<()> {
        let outputs = Outputs::new(self.json, &self.shards).file(&self.output, &CUBE)?;
        let mut infos = Vec::with_capacity(self.shards.len());
        for path in &self.shards {
            infos.push((path.clone(), shard::read_info(path)?));
        }
        shard::check_complete(&infos)?;
        let (_, first) = &infos[0];
        // The new paths go into the header of the LDI, from which the window opens the scene.
        let mut spec = first.spec.clone();
        let source = &mut spec.scene;
        if let Some(name) = &self.scene {
            source.name.clone_from(name);
        }
        match (&self.sky, &mut source.light.sky) {
            (Some(_), None) => bail_usage!("--sky: the shards were captured without one"),
            (Some(moved), Some(sky)) => sky.clone_from(moved),
            (None, _) => {}
        }
        let scene = source.open().context(
            "light is sampled after merging, which needs the scene (see --scene and --sky)",
        )?;
        outputs.add_scene(&scene.name, &scene, StrictArgs::default())?;
        ensure!(
            fingerprint(&scene) == first.scene_fingerprint
                && scene.triangles.len() as u32 == first.triangles,
            "{} has changed since the shards were captured; capture them again",
            spec.scene.name
        );
        let tracer = Tracer::new(Arc::new(scene), spec.centre);
        let parameters = &spec.parameters;
        let lighting = Lighting::prepare(
            &tracer,
            tracer.origin(),
            parameters.bounces,
            parameters.light_samples > 0,
        );
        let bar = Bar::new();
        let limit = MemoryLimit::new(memory_mb, spec.face_size_px);
        let all_threads = rayon::current_num_threads();
        // Not known yet: about one for each pixel of the faces.
        let depth_pixels = 6.0 * f64::from(spec.face_size_px).powi(2);
        let threads = limit.map_or(all_threads, |limit| {
            limit.threads(depth_pixels, all_threads)
        });
        if let Some(limit) = limit {
            limit.check(limit.peak_bytes(depth_pixels, threads), "")?;
        }
        let options = RunOptions {
            budget: limit.map(|limit| limit.spill_budget(depth_pixels, threads, &self.output)),
            progress: &bar,
            ..RunOptions::default()
        };
        let mut tracing = TracedRays::empty(&spec, &options)?;
        for (path, info) in &infos {
            shard::absorb(path, info, &mut tracing)?;
        }
        let capture = SceneCapture::new(&spec, &tracer, &lighting, &options);
        let ldi = run_on(threads, || {
            capture.fill_holes(&mut tracing)?;
            capture.light_and_merge(&tracing)
        })??;
        drop((tracing, tracer));
        let packed = run_on(threads, || self.packing.pack(ldi))??;
        packed.write(&self.output)?;
        bar.finish();
        warn_if_blocked(packed.info.blocked_share);
        limit.iter().for_each(MemoryLimit::warn_if_exceeded);
        let rays = packed.info.rays_traced;
        if self.json {
            print_json(&json!({
                "shards": infos.len(),
                "rays": rays,
                "depth_pixels": packed.depth_pixel_count(),
                "samples_on_planes": packed.planes.samples,
                "bytes": packed.bytes(),
                "peak_rss_mb": peak_rss_mb(),
            }));
        } else {
            println!(
                "{}: {} from {rays} rays in {}",
                output_name(&self.output),
                describe_cube(&packed),
                format_count(infos.len() as u64, "shard")
            );
        }
        Ok(())
    }
}
