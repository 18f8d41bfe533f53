//! `headbox truth`.

mod goal;

use self::goal::{Goal, RoundProgress};
use crate::args::{CameraArgs, DefaultCamera, SceneArgs, StrictArgs, parse_sides, refuse_given};
use crate::commands::render::radiance::{is_radiance, save_radiance};
use crate::interrupt;
use crate::messages::UsageError;
use crate::output::{FRAME, Outputs, output_name, peak_rss_mb, print_json, save_picture_with_text};
use crate::progress::{Bar, duration};
use anyhow::{Context, anyhow};
use clap::Args;
use glam::DVec3;
use headbox_core::bounces::Bounces;
use headbox_core::camera::Camera;
use headbox_core::container::{Container, FileKind};
use headbox_core::progress::Progress;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::pack::CubeLdi;
use headbox_images::SetWriter;
use headbox_images::traced_view;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth::TruthSum;
use headbox_trace::viewpoint;
use headbox_views::{LitScene, TruthView};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Instant;

#[derive(Args)]
pub(crate) struct TruthCommand {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    strict: StrictArgs,
    /// Image to write: .png, in which `compare` finds its standard error, .jpg, .webp, .tif, .bmp
    /// or .tga, or linear radiance, .exr; `-` for standard output (PNG); with --images a folder
    #[arg(short, long)]
    output: PathBuf,
    /// Write a folder of images with depth instead, an image set for capture, render, view and
    /// report: from a grid of cameras across the headbox that look in the direction of the camera
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = parse_wall)]
    images: Option<(u32, u32)>,
    #[command(flatten)]
    camera: CameraArgs,
    /// Diffuse bounces of light after direct light, 0 to 64, or full: all bounces, the default
    #[arg(long, value_name = "B")]
    bounces: Option<Bounces>,
    /// Maximum number of rays per pixel, rounded up to an even number; 256 by default, without limit
    /// with --noise or --time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SAMPLES)))]
    samples: Option<u32>,
    /// Stop once the standard error is this small, dB (PSNR); 40 is hardly visible
    #[arg(long, value_name = "DB", value_parser = parse_noise, conflicts_with = "images")]
    noise: Option<f64>,
    /// Stop after this time, seconds
    #[arg(long, value_name = "S", value_parser = parse_seconds, conflicts_with = "images")]
    time: Option<f64>,
    /// Show albedo and emission without light, as `capture --light-samples 0` does
    #[arg(long)]
    unlit: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Maximum number of rays per pixel.
const MAX_SAMPLES: u32 = 1 << 20;

/// Rays per pixel if nothing is specified.
const DEFAULT_SAMPLES: u32 = 256;

/// Keyword of the text in a PNG file that holds the standard error of a truth, dB (PSNR).
pub(crate) const NOISE_KEYWORD: &str = "headbox standard error dB";

/// A lit scene and the camera that looks at it.
struct Subject {
    camera: Camera,
    scene: LitScene,
    /// Half-size of the headbox, metres.
    half_size_m: f64,
}

impl TruthCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let outputs = Outputs::new(self.json, [self.scene.name()]);
        let outputs = match self.images {
            Some(_) => outputs.folder(&self.output)?,
            None => outputs.file(&self.output, &FRAME)?,
        };
        let start = Instant::now();
        let Subject {
            camera,
            scene,
            half_size_m,
        } = if self.is_ldi()? {
            self.open_ldi(&outputs)?
        } else {
            self.open_scene(&outputs)?
        };
        if let Some(wall) = self.images {
            let views = self.write_images(wall, half_size_m, &camera, &scene)?;
            let json = json!({ "images": views, "samples": self.samples() });
            self.print_result(start, &format!("{views} images with depth"), json);
            return Ok(());
        }
        let rays_start = Instant::now();
        let sum = self.trace(&camera, &scene, start);
        let rays_s = rays_start.elapsed().as_secs_f64();
        let truth = sum.truth(&scene.lighting);
        let error_db = truth.standard_error_psnr_db;
        let known = error_db.is_finite().then_some(error_db);
        if is_radiance(&self.output) {
            let size = (truth.frame.width, truth.frame.height);
            save_radiance(&self.output, size, &truth.radiance)?;
        } else {
            let text = known.map(|error_db| format!("{error_db:.2}"));
            let text = text.as_deref().map(|text| (NOISE_KEYWORD, text));
            save_picture_with_text(&self.output, &truth.rgb(), text)?;
        }
        self.print_result(
            start,
            &describe_noise(sum.samples(), rays_s, error_db),
            json!({ "samples": sum.samples(), "standard_error_psnr_db": known }),
        );
        Ok(())
    }

    /// Returns true if the input is a cube LDI; scenes need not be files.
    fn is_ldi(&self) -> anyhow::Result<bool> {
        let path = Path::new(self.scene.name());
        match Container::peek_kind(path) {
            Ok(tag) => Ok(tag == Some(FileKind::CUBE_LDI.tag)),
            Err(cause) if path.extension().is_some_and(|it| it == "ldi") => {
                Err(cause).with_context(|| path.display().to_string())
            }
            Err(_) => Ok(false),
        }
    }

    /// Reopens the scene of a cube LDI.
    fn open_ldi(&self, outputs: &Outputs) -> anyhow::Result<Subject> {
        let cube = CubeLdi::read(Path::new(self.scene.name()))?;
        let info = cube.info.clone();
        let is_lit = info.parameters.light_samples > 0;
        let own_flags = [
            ("--bounces", self.bounces.is_some()),
            ("--unlit", self.unlit && is_lit),
        ];
        let flags = self.scene.source.given_flags().into_iter();
        refuse_given("a cube LDI, which has its own", flags.chain(own_flags))?;
        let mut scene = LitScene::reopen(&info).map_err(|error| anyhow!(error))?;
        outputs.add_scene(&info.scene, scene.tracer.scene(), self.strict)?;
        scene.guide();
        let default = DefaultCamera::from_view(&TruthView::new(cube), None);
        Ok(Subject {
            camera: self.camera.camera(&info.frame, &default)?,
            scene,
            half_size_m: info.half_size_m,
        })
    }

    fn open_scene(&self, outputs: &Outputs) -> anyhow::Result<Subject> {
        let scene = Arc::new(self.scene.source().open()?);
        outputs.add_scene(self.scene.name(), &scene, self.strict)?;
        let (camera, tracer) = self.camera.aim(&scene)?;
        let distant = scene
            .frame
            .distant_eye_warning(scene.bounds(), camera.eye());
        if let Some(warning) = distant {
            eprintln!("warning: {warning}");
        }
        let place = if self.unlit {
            camera.eye() // nothing is metered
        } else {
            metering_place(&tracer, camera.eye())
        };
        let bounces = self.bounces.unwrap_or(CaptureParameters::DEFAULT.bounces);
        let lighting = Lighting::prepare_paths(&tracer, place, bounces, !self.unlit);
        let half_size_m = match self.images {
            Some(_) => viewpoint::place_headbox(&scene, None, None)
                .map_or(0.0, |headbox| headbox.half_size_m),
            None => 0.0,
        };
        Ok(Subject {
            camera,
            scene: LitScene {
                tracer: Arc::new(tracer),
                lighting: Arc::new(lighting),
                lit: !self.unlit,
                guided: !self.unlit,
            },
            half_size_m,
        })
    }

    /// Returns the maximum number of rays per pixel.
    fn samples(&self) -> u32 {
        let is_limited = self.noise.is_some() || self.time.is_some();
        let default = if is_limited {
            MAX_SAMPLES
        } else {
            DEFAULT_SAMPLES
        };
        self.samples.unwrap_or(default)
    }

    /// Traces a frame in rounds until it has its rays, its noise or its time, or is interrupted.
    /// Announces the time once it can be estimated.
    fn trace(&self, camera: &Camera, scene: &LitScene, start: Instant) -> TruthSum {
        /// Steps of the progress bar.
        const STEPS: u64 = 1000;
        interrupt::keep_partial_results();
        let LitScene {
            tracer,
            lighting,
            lit,
            ..
        } = scene;
        let rays_start = Instant::now();
        let loading_s = (rays_start - start).as_secs_f64();
        let goal = Goal {
            samples: self.samples(),
            noise_db: self.noise,
            time_s: self
                .time
                .map(|time| (time - loading_s).max(f64::MIN_POSITIVE)),
        };
        let bar = Bar::new();
        bar.begin("tracing", "steps", STEPS);
        let mut sum = TruthSum::new(camera);
        let mut expected_samples = f64::from(goal.samples);
        let mut announced = None;
        loop {
            let round = goal.round(sum.samples(), rays_start.elapsed().as_secs_f64());
            if round == 0 {
                break;
            }
            let progress = RoundProgress {
                bar: &bar,
                goal: &goal,
                start: rays_start,
                samples: [sum.samples(), round],
                expected_samples,
                rows: camera.height(),
                rows_done: AtomicU64::new(0),
            };
            if !sum.add(tracer, lighting, *lit, round, &progress) {
                break;
            }
            let ray_s = rays_start.elapsed().as_secs_f64() / f64::from(sum.samples());
            let is_clean = goal.noise_db.is_some_and(|noise_db| {
                let error_db = sum.truth(lighting).standard_error_psnr_db;
                expected_samples = goal.expected_samples(sum.samples(), error_db);
                error_db >= noise_db
            });
            if is_clean {
                break;
            }
            let note = goal.note(sum.samples(), expected_samples, ray_s, announced);
            if let Some(note) = note {
                eprintln!("note: {note}");
                announced = Some(expected_samples);
            }
        }
        bar.finish();
        if sum.samples() == 0 {
            eprintln!(
                "error: interrupted in the first round: nothing was traced yet, so that no file was written"
            );
            interrupt::exit();
        }
        sum
    }

    /// Prints the description of the output, or its JSON object.
    fn print_result(&self, start: Instant, description: &str, json: serde_json::Value) {
        let seconds = start.elapsed().as_secs_f64();
        if self.json {
            let mut all = json!({ "seconds": seconds, "peak_rss_mb": peak_rss_mb() });
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
        scene: &LitScene,
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
        let bar = Bar::new();
        bar.begin(
            "tracing",
            "rows",
            u64::from(images) * u64::from(camera.height()),
        );
        let progress = SingleStage(&bar);
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
                &scene.tracer,
                &scene.lighting,
                scene.lit,
                &moved,
                self.samples(),
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

/// Progress of many images as one stage: ignores the beginning of each.
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

/// Describes the noise of a frame that took `seconds`; if it limits comparisons, also how it is
/// reduced and about how long that takes.
fn describe_noise(samples: u32, seconds: f64, error_db: f64) -> String {
    /// PSNR that captures of a lit scene do not reach, dB.
    const AMPLE_DB: f64 = 40.0;
    let error = format!("{samples} rays per pixel, standard error {error_db:.1} dB (PSNR)");
    if error_db < AMPLE_DB {
        let factor = 10f64.powf((AMPLE_DB - error_db) / 10.0);
        format!(
            "{error}; smaller errors cannot be measured against it: for less noise give --noise {AMPLE_DB} \
             (about {:.0} rays per pixel, {})",
            f64::from(samples) * factor,
            duration(seconds * factor)
        )
    } else {
        error
    }
}

/// Parses a standard error, dB.
fn parse_noise(text: &str) -> Result<f64, String> {
    let error_db = text.parse().ok().filter(|db| (1.0..=80.0).contains(db));
    error_db.ok_or_else(|| "give dB from 1 to 80".into())
}

/// Parses a time, seconds.
fn parse_seconds(text: &str) -> Result<f64, String> {
    let time = text.parse().ok().filter(|time| *time > 0.0 && *time <= 1e6);
    time.ok_or_else(|| "give seconds above 0, up to 1000000".into())
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
