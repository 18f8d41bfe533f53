//! `headbox truth`.

use super::args::{CameraArgs, SceneArgs};
use super::output::{Outputs, PICTURE, peak_rss_mb, print_json, save_picture};
use super::progress::Bar;
use crate::capture::light::Lighting;
use crate::truth;
use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

#[derive(Args)]
pub(super) struct TruthCommand {
    #[command(flatten)]
    scene: SceneArgs,
    /// Picture to write: .png, .jpg, .webp, .tif, .bmp or .tga; `-` for standard output (PNG)
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    camera: CameraArgs,
    /// Diffuse bounces of light beyond direct light; as in the capture to compare with
    #[arg(long, value_name = "B", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=64))]
    bounces: u32,
    /// Rays per pixel
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    samples: u32,
    /// Show albedo and emission without light, as `capture --light-samples 0` does
    #[arg(long)]
    unlit: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

impl TruthCommand {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let source = self.scene.source();
        let outputs = Outputs::new(self.json, [&source.name]).file(&self.output, &PICTURE)?;
        let scene = Arc::new(source.open()?);
        outputs.scene_is_open(&scene)?;
        let (camera, tracer) = self.camera.aim(&scene)?;
        let start = Instant::now();
        let lighting = Lighting::prepare(&tracer, self.bounces, !self.unlit);
        let bar = Bar::new();
        let truth = truth::render(&tracer, &lighting, !self.unlit, &camera, self.samples, &bar);
        bar.finish();
        let seconds = start.elapsed().as_secs_f64();
        save_picture(&self.output, &truth.rgb())?;
        let error_db = truth.standard_error_psnr_db;
        if self.json {
            print_json(&json!({
                "seconds": seconds, "samples": self.samples, "peak_rss_mb": peak_rss_mb(),
                "standard_error_psnr_db": if error_db.is_finite() { Some(error_db) } else { None },
            }));
        } else {
            println!("{}: {seconds:.1} s, standard error {error_db:.1} dB (PSNR)", self.output.display());
        }
        Ok(())
    }
}
