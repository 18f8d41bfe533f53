//! `headbox truth`.

use crate::args::{CameraArgs, SceneArgs, parse_sides};
use crate::commands::render::radiance::{is_radiance, save_radiance};
use crate::messages::UsageError;
use crate::output::{FRAME, Outputs, output_name, peak_rss_mb, print_json, save_picture};
use crate::progress::Bar;
use clap::Args;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::progress::Progress;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_images::SetWriter;
use headbox_images::traced_view;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use headbox_trace::viewpoint;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

#[derive(Args)]
pub(crate) struct TruthCommand {
    #[command(flatten)]
    scene: SceneArgs,
    /// Picture to write: .png, .jpg, .webp, .tif, .bmp or .tga, or linear radiance, .exr; `-` for
    /// standard output (PNG); with --images a folder
    #[arg(short, long)]
    output: PathBuf,
    /// Instead of one picture, a folder of so many with their depth, an image set for capture,
    /// render, view and report: from a wall of cameras across the headbox, all of which look as the
    /// camera does
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = parse_wall)]
    images: Option<(u32, u32)>,
    #[command(flatten)]
    camera: CameraArgs,
    /// Diffuse bounces of light beyond direct light; as in the capture to compare with
    #[arg(long, value_name = "B", default_value_t = CaptureParameters::FULL_BOUNCES, value_parser = clap::value_parser!(u32).range(0..=64))]
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
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let source = self.scene.source();
        let outputs = Outputs::new(self.json, [&source.name]);
        let outputs = match self.images {
            Some(_) => outputs.folder(&self.output)?,
            None => outputs.file(&self.output, &FRAME)?,
        };
        let scene = Arc::new(source.open()?);
        outputs.add_scene(&scene)?;
        let (camera, tracer) = self.camera.aim(&scene)?;
        let start = Instant::now();
        let place = metering_place(&tracer, camera.eye());
        let lighting = Lighting::prepare(&tracer, place, self.bounces, !self.unlit);
        let bar = Bar::new();
        if let Some(wall) = self.images {
            let half_size_m = viewpoint::place_headbox(&scene, None, None)
                .map_or(0.0, |headbox| headbox.half_size_m);
            let views =
                self.write_images(wall, half_size_m, &camera, (&tracer, &lighting), &bar)?;
            self.print_result(
                start,
                &format!("{views} images with depth"),
                json!({ "images": views }),
            );
            return Ok(());
        }
        let truth = truth::render(&tracer, &lighting, !self.unlit, &camera, self.samples, &bar);
        bar.finish();
        if is_radiance(&self.output) {
            let size = (truth.frame.width, truth.frame.height);
            save_radiance(&self.output, size, &truth.radiance)?;
        } else {
            save_picture(&self.output, &truth.rgb())?;
        }
        let error_db = truth.standard_error_psnr_db;
        let known = error_db.is_finite().then_some(error_db);
        self.print_result(
            start,
            &describe_noise(error_db),
            json!({ "standard_error_psnr_db": known }),
        );
        Ok(())
    }

    /// Prints the description of the output, or its JSON object.
    fn print_result(&self, start: Instant, description: &str, json: serde_json::Value) {
        let seconds = start.elapsed().as_secs_f64();
        if self.json {
            let mut all = json!({ "seconds": seconds, "samples": self.samples, "peak_rss_mb": peak_rss_mb() });
            if let (Some(all), serde_json::Value::Object(json)) = (all.as_object_mut(), json) {
                all.extend(json);
            }
            print_json(&all);
        } else {
            println!(
                "{}: {seconds:.1} s, {description}",
                output_name(&self.output)
            );
        }
    }

    /// Writes a set of images from cameras evenly distributed over a square across the headbox.
    /// Returns their number.
    fn write_images(
        &self,
        (columns, rows): (u32, u32),
        half_size_m: f64,
        camera: &Camera,
        (tracer, lighting): (&Tracer, &Lighting),
        bar: &Bar,
    ) -> anyhow::Result<u32> {
        /// Maximum offset of a camera, in half-sizes of the headbox: nothing is visible from its
        /// faces.
        const MAX_OFFSET: f64 = 0.9;
        let mut set = SetWriter::new(&self.output);
        let rotation = camera.world_from_eye();
        let offset = |index: u32, count: u32| match count {
            1 => 0.0,
            _ => (2.0 * f64::from(index) / f64::from(count - 1) - 1.0) * MAX_OFFSET * half_size_m,
        };
        let images = columns * rows;
        bar.begin(
            "tracing",
            "rows",
            u64::from(images) * u64::from(camera.height()),
        );
        let progress = SingleStage(bar);
        for number in 0..images {
            let (column, row) = (number % columns, number / columns);
            let eye = camera.eye() + rotation.x_axis * offset(column, columns)
                - rotation.y_axis * offset(row, rows);
            let moved = Camera::from_parts(
                eye,
                rotation,
                camera.focal_px(),
                camera.width(),
                camera.height(),
            )
            .map_err(|error| UsageError(error.to_string()))?;
            let view = traced_view::trace(
                tracer,
                lighting,
                !self.unlit,
                &moved,
                self.samples,
                &progress,
            );
            set.add(number as usize, &view, true)?;
        }
        bar.finish();
        set.finish()?;
        Ok(images)
    }
}

/// Returns where exposure is metered: at the centre of the default headbox, as a capture does, if
/// the eye is inside it, else at the eye.
fn metering_place(tracer: &Tracer, eye: DVec3) -> DVec3 {
    let headbox = tracer.scene().headbox;
    let headbox = headbox.unwrap_or_else(|| viewpoint::suggest_headbox(tracer));
    if (eye - headbox.centre).abs().max_element() <= headbox.half_size_m {
        headbox.centre
    } else {
        eye
    }
}

/// Progress of many pictures as one stage: ignores the beginning of each.
struct SingleStage<'a>(&'a Bar);

impl Progress for SingleStage<'_> {
    fn begin(&self, _stage: &str, _unit: &str, _total: u64) {}

    fn advance(&self, steps: u64) {
        self.0.advance(steps);
    }

    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// Describes the noise of a picture, with a note if it limits comparisons.
fn describe_noise(error_db: f64) -> String {
    /// PSNR that captures of a lit scene do not reach, dB.
    const AMPLE_DB: f64 = 40.0;
    let error = format!("standard error {error_db:.1} dB (PSNR)");
    if error_db < AMPLE_DB {
        format!(
            "{error}: what is compared with it is at most so good, however good it is; more --samples lower its noise"
        )
    } else {
        error
    }
}

/// Parses numbers of cameras side by side and above each other, `COLUMNSxROWS`.
fn parse_wall(text: &str) -> Result<(u32, u32), String> {
    parse_sides(text)
        .filter(|(columns, rows)| {
            (1..=10_000).contains(columns)
                && (1..=10_000).contains(rows)
                && columns * rows <= 10_000
        })
        .ok_or_else(|| "give COLUMNSxROWS, 10000 images at most, such as 9x1".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_walls_parse_or_are_refused() {
        assert_eq!(parse_wall("9x1"), Ok((9, 1)));
        for bad in [
            "",
            "9",
            "0x3",
            "3x0",
            "-1x2",
            "101x100",
            "99999x99999",
            "axb",
        ] {
            assert!(parse_wall(bad).is_err(), "{bad}");
        }
    }
}
