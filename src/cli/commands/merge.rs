//! `headbox merge`.

use super::capture::{budget, warn_if_blocked};
use crate::output::{CUBE, Outputs, name_of, peak_rss_mb, print_json};
use crate::packing::{PackingArgs, what_is_kept};
use crate::progress::Bar;
use crate::words::{UsageError, counted};
use anyhow::{Context, ensure};
use clap::Args;
use headbox_ldi::accumulate::shard;
use headbox_ldi::refine;
use headbox_ldi::scene_source::fingerprint;
use headbox_ldi::settings::Resources;
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
    /// The .ldi file to write; `-` for standard output
    #[arg(short, long)]
    output: PathBuf,
    /// Where the scene is now, if it is no longer where the shards were captured
    #[arg(long)]
    scene: Option<String>,
    /// Where the picture of the sky is now, if it is no longer where the shards were captured
    #[arg(long, value_name = "FILE.hdr|.exr")]
    sky: Option<PathBuf>,
    /// Memory to keep within, MiB
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(64..=1 << 24))]
    memory: Option<u64>,
    #[command(flatten)]
    packing: PackingArgs,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

impl MergeCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let outputs = Outputs::new(self.json, &self.shards).file(&self.output, &CUBE)?;
        let mut infos = Vec::with_capacity(self.shards.len());
        for path in &self.shards {
            infos.push((path.clone(), shard::read_info(path)?));
        }
        shard::check_complete(&infos)?;
        let (_, first) = &infos[0];
        // The file says where the scene and its sky are now, for whoever opens it.
        let mut job = first.job.clone();
        let source = &mut job.scene;
        if let Some(name) = &self.scene {
            source.name.clone_from(name);
        }
        match (&self.sky, &mut source.light.sky) {
            (Some(_), None) => {
                return Err(UsageError("--sky: the shards were captured without one".into()).into());
            }
            (Some(moved), Some(sky)) => sky.clone_from(moved),
            (None, _) => {}
        }
        let scene = source.open().context(
            "light is sampled after merging, which needs the scene (see --scene and --sky)",
        )?;
        outputs.scene_is_open(&scene)?;
        ensure!(
            fingerprint(&scene) == first.scene_fingerprint
                && scene.triangles.len() as u32 == first.triangles,
            "{} has changed since the shards were captured; capture them again",
            job.scene.name
        );
        let tracer = Tracer::new(Arc::new(scene), job.centre);
        let parameters = &job.parameters;
        let lighting = Lighting::prepare(&tracer, parameters.bounces, parameters.light_samples > 0);
        let resources = Resources {
            budget: budget(self.memory, &self.output),
        };
        let mut tracing = first.empty_tracing(resources.budget.clone())?;
        for (path, info) in &infos {
            shard::absorb(path, info, &mut tracing)?;
        }
        let bar = Bar::new();
        refine::close(&job, &mut tracing, &tracer, &lighting, &bar)?;
        let ldi = job.finish(&tracing, &tracer, &lighting, &resources, &bar)?;
        drop((tracing, tracer));
        let packed = self.packing.pack(ldi)?;
        packed.write(&self.output)?;
        bar.finish();
        warn_if_blocked(packed.info.blocked_share);
        let (count, rays) = (packed.depth_pixel_count(), packed.info.rays_traced);
        if self.json {
            print_json(&json!({
                "shards": infos.len(), "rays": rays, "depth_pixels": count,
                "samples_on_planes": packed.planes.samples, "bytes": packed.bytes(),
                "peak_rss_mb": peak_rss_mb(),
            }));
        } else {
            let (output, kept) = (name_of(&self.output), what_is_kept(&packed));
            println!(
                "{output}: {kept} from {rays} rays in {}",
                counted(infos.len() as u64, "shard")
            );
        }
        Ok(())
    }
}
