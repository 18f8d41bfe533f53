//! `headbox render`.

use super::UsageError;
use super::args::{CameraArgs, frame_of};
use super::output::{print_json, save_png};
use crate::capture::Camera;
use crate::frame::Frame;
use crate::packed::PackedCube;
use crate::path;
use crate::splat::SplatKernel;
use crate::warp::{FrameStats, RenderSettings, Renderer};
use anyhow::Context;
use clap::Args;
use image::RgbImage;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Args)]
pub(super) struct Render {
    /// A .ldi file
    file: PathBuf,
    /// PNG to write, or with --path the folder for frames and times.csv
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    camera: CameraArgs,
    /// Render a frame per pose of this JSON file
    #[arg(long, value_name = "PATH.json")]
    path: Option<PathBuf>,
    /// How samples become pixels: see the list that a wrong name prints
    #[arg(long, value_name = "NAME")]
    variant: Option<String>,
    /// Render each frame so many times and report the median
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    repeat: u32,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// One rendered pose.
struct Rendered {
    frame: Frame,
    stats: FrameStats,
    ms: Vec<f64>,
}

impl Rendered {
    fn ms_median(&self) -> f64 {
        let mut sorted = self.ms.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    }
}

impl Render {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let settings = self.settings()?;
        let cube = PackedCube::read(&self.file)?;
        let frame = frame_of(&cube.info);
        match &self.path {
            Some(path) => self.render_path(&cube, &path::read(path, &frame)?, &settings),
            None => self.render_one(&cube, &self.camera.camera(&frame, cube.info.centre)?, &settings),
        }
    }

    fn settings(&self) -> anyhow::Result<RenderSettings> {
        let Some(wanted) = &self.variant else { return Ok(RenderSettings::default()) };
        let Some(&(_, kernel)) = SplatKernel::ALL.iter().find(|(name, _)| name == wanted) else {
            let names = SplatKernel::ALL.map(|(name, _)| name).join(", ");
            return Err(UsageError(format!("there is no variant \"{wanted}\"; there are: {names}")).into());
        };
        Ok(RenderSettings { kernel, ..RenderSettings::default() })
    }

    fn render_one(&self, cube: &PackedCube, camera: &Camera, settings: &RenderSettings) -> anyhow::Result<()> {
        let rendered = self.render(&mut Renderer::new(), cube, camera, settings);
        save_png(&self.output, &rgb_image(&rendered.frame)?)?;
        let (stats, ms_median) = (&rendered.stats, rendered.ms_median());
        let pixels = rendered.frame.color.len() as f64;
        if self.json {
            print_json(&json!({
                "ms_median": ms_median, "ms": rendered.ms, "stages": {"clear_ms": stats.clear_ms, "warp_ms": stats.warp_ms, "finish_ms": stats.finish_ms},
                "variant": settings.kernel.name(),
                "depth_pixels_in": stats.depth_pixels_in, "splatted": stats.splatted, "statistics": stats,
                "hole_fraction": stats.hole_pixels as f64 / pixels, "threads": rayon::current_num_threads(),
            }));
        } else {
            println!(
                "{}: {ms_median:.2} ms, {} of {} depth pixels splatted, {:.3} % holes",
                self.output.display(),
                stats.splatted,
                cube.depth_pixel_count(),
                stats.hole_pixels as f64 / pixels * 100.0
            );
        }
        Ok(())
    }

    fn render_path(&self, cube: &PackedCube, cameras: &[Camera], settings: &RenderSettings) -> anyhow::Result<()> {
        let folder = &self.output;
        std::fs::create_dir_all(folder).with_context(|| format!("{} could not be made", folder.display()))?;
        let mut renderer = Renderer::new();
        let mut csv = String::from("pose,ms,depth_pixels_in,splatted,hole_pixels\n");
        let mut times = Vec::with_capacity(cameras.len());
        for (pose, camera) in cameras.iter().enumerate() {
            let rendered = self.render(&mut renderer, cube, camera, settings);
            save_png(&folder.join(format!("frame_{pose:04}.png")), &rgb_image(&rendered.frame)?)?;
            let (ms, stats) = (rendered.ms_median(), &rendered.stats);
            csv += &format!("{pose},{ms:.4},{},{},{}\n", stats.depth_pixels_in, stats.splatted, stats.hole_pixels);
            times.push(ms);
        }
        write_text(&folder.join("times.csv"), &csv)?;
        let mut sorted = times.clone();
        sorted.sort_by(f64::total_cmp);
        let (median, worst) = (sorted[sorted.len() / 2], sorted[sorted.len() - 1]);
        if self.json {
            print_json(&json!({
                "ms_median": median, "ms": times, "frames": times.len(), "variant": settings.kernel.name(),
                "threads": rayon::current_num_threads(),
            }));
        } else {
            println!("{}: {} frames, median {median:.2} ms, worst {worst:.2} ms", folder.display(), times.len());
        }
        Ok(())
    }

    fn render(
        &self,
        renderer: &mut Renderer,
        cube: &PackedCube,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> Rendered {
        let mut ms = Vec::with_capacity(self.repeat as usize);
        let mut last = None;
        for _ in 0..self.repeat {
            let start = Instant::now();
            let (frame, stats) = renderer.render(cube, camera, settings);
            ms.push(start.elapsed().as_secs_f64() * 1e3);
            if ms.len() == self.repeat as usize {
                last = Some((frame.clone(), *stats));
            }
        }
        let (frame, stats) = last.unwrap_or_default();
        Rendered { frame, stats, ms }
    }
}

/// The colours of a frame.
pub(super) fn rgb_image(frame: &Frame) -> anyhow::Result<RgbImage> {
    let rgb = frame.color.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    RgbImage::from_raw(frame.width, frame.height, rgb).context("the frame's size does not fit its pixels")
}

/// Writes a text file, whole or not at all.
pub(super) fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    let written = crate::files::write_atomically(path, |w| std::io::Write::write_all(w, text.as_bytes()));
    written.with_context(|| format!("{} could not be written", path.display()))
}
