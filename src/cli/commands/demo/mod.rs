//! `headbox demo`: a heavy scene is captured once and shown from eyes ever farther off the centre,
//! next to ray-traced truth and to a cube map.
//!
//! * [`measure`]: frames, truth and cube map at each eye position.
//! * [`summary`]: the table, the closing sentence and the picture.

mod measure;
mod summary;

use crate::args::StrictArgs;
use crate::commands::capture::estimate::Estimate;
use crate::commands::capture::place::place_headbox;
use crate::messages::shell_quote;
use crate::output::{Outputs, save_picture, write_text};
use crate::packing::{PackingArgs, describe_cube};
use crate::progress::{Bar, PlannedStage, duration};
use clap::Args;
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::headbox::Headbox;
use headbox_core::progress::Silent;
use headbox_core::stopwatch::Stopwatch;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth::TruthSum;
use measure::Row;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use summary::Summary;

#[derive(Args)]
pub(crate) struct DemoCommand {
    /// Folder for the capture, the frames and the table
    #[arg(long, default_value = "headbox-demo")]
    out: PathBuf,
    /// Use small sizes: a few seconds, coarse pictures
    #[arg(long)]
    quick: bool,
    /// Do not open a window at the end
    #[arg(long)]
    no_window: bool,
    /// Scene to capture
    #[arg(long, default_value = "builtin:tree")]
    scene: String,
}

/// Sizes of a demo.
#[derive(Clone, Copy)]
struct Sizes {
    face_size_px: u32,
    strata: u32,
    rays: u32,
    light_samples: u32,
    /// Share of hole pixels at which the search for holes ends.
    holes: f64,
    frame: [u32; 2],
    /// Rays per pixel of the first picture, a multiple of 4.
    first_samples: u32,
    /// Rays per pixel of a truth, and per texel of the cube map.
    truth_samples: u32,
    map_samples: u32,
}

/// Chosen for 50 s on two cores of 2024, without visible flaws in the frames.
const FULL: Sizes = Sizes {
    face_size_px: 768,
    strata: 32,
    rays: 12,
    light_samples: 4,
    holes: 0.0005,
    frame: [384, 288],
    first_samples: 4,
    truth_samples: 24,
    map_samples: 8,
};
const QUICK: Sizes = Sizes {
    face_size_px: 256,
    strata: 16,
    rays: 8,
    light_samples: 2,
    holes: 1.0,
    frame: [240, 180],
    first_samples: 4,
    truth_samples: 8,
    map_samples: 4,
};

/// Share of the way from the centre to the farthest eye, for each row of the table.
const STEPS: [f64; 3] = [1.0 / 3.0, 2.0 / 3.0, 1.0];
/// Farthest eye, in half-sizes to the right and forward: a head that leans to the front left edge.
const FARTHEST: [f64; 2] = [-0.95, 0.95];

impl Sizes {
    fn spec(&self, scene: SceneSource, headbox: &Headbox) -> CaptureSpec {
        CaptureSpec {
            face_size_px: self.face_size_px,
            parameters: CaptureParameters {
                strata: self.strata,
                rays_per_stratum: self.rays,
                light_samples: self.light_samples,
                holes: self.holes,
                ..CaptureParameters::DEFAULT
            },
            ..CaptureSpec::new(scene, headbox.centre, headbox.half_size_m)
        }
    }

    /// Rays of all truths and of the face of the cube map that the cameras see.
    fn truth_rays(&self) -> f64 {
        let [width, height] = self.frame.map(f64::from);
        let truth = width * height * f64::from(self.truth_samples);
        let map = f64::from(self.face_size_px).powi(2) * f64::from(self.map_samples);
        truth * STEPS.len() as f64 + map
    }

    fn first_rays(&self) -> f64 {
        let [width, height] = self.frame.map(f64::from);
        width * height * f64::from(self.first_samples)
    }
}

/// A scene with its light, and the view that the demo shows of it.
struct Stage {
    tracer: Tracer,
    lighting: Lighting,
    headbox: Headbox,
    /// Viewing direction of all cameras.
    ahead: DVec3,
}

impl Stage {
    /// Camera at a share of the way to the farthest eye.
    fn camera(&self, step: f64, sizes: &Sizes) -> anyhow::Result<Camera> {
        let [right, forward] = FARTHEST;
        let offset = self.ahead.cross(DVec3::Y) * right + self.ahead * forward;
        let eye = self.headbox.centre + offset * step * self.headbox.half_size_m;
        let target = eye + self.ahead + DVec3::Y * 0.15;
        Ok(Camera::look_at(eye, target, DVec3::Y, 60.0, sizes.frame)?)
    }
}

impl DemoCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let start = Instant::now();
        let sizes = if self.quick { QUICK } else { FULL };
        let outputs = Outputs::new(false, [&self.scene]).folder(&self.out)?;
        let source = SceneSource::new(&self.scene);
        let scene = Arc::new(source.open()?);
        outputs.add_scene(&scene.name, &scene, StrictArgs::default())?;
        let headbox = place_headbox(&scene, None, None)?;
        let triangles = scene.triangles.len();
        println!(
            "{}: {} triangles; the headbox, in which the eye may move, is a cube of {:.1} m",
            self.scene,
            summary::grouped(triangles as u64),
            2.0 * headbox.half_size_m
        );
        let spec = sizes.spec(source, &headbox);
        let tracer = Tracer::new(scene, headbox.centre);
        let lighting = Lighting::prepare(&tracer, headbox.centre, spec.parameters.bounces, true);
        let ahead = headbox_trace::viewpoint::suggest_view(&tracer, headbox.centre);
        let stage = Stage {
            tracer,
            lighting,
            headbox,
            ahead,
        };
        let first_s = self.trace_first_picture(&stage, &sizes)?;
        let packing = PackingArgs::default();
        let (tracer, lighting) = (&stage.tracer, &stage.lighting);
        let estimate = Estimate::new(&spec, tracer, lighting, &packing, 1, start)?;
        let truth_s = first_s * sizes.truth_rays() / sizes.first_rays();
        println!(
            "about {} in all: capture, then {} frames, truth and cube map",
            duration(estimate.seconds() + truth_s),
            STEPS.len()
        );
        let mut plan = estimate.plan();
        plan.push(PlannedStage {
            stages: &["truth"],
            times: 1 + STEPS.len() as u32,
            weight: truth_s,
        });
        let bar = Bar::planned(plan, true);
        let options = RunOptions {
            progress: &bar,
            ..RunOptions::default()
        };
        let (ldi, _) = SceneCapture::new(&spec, tracer, lighting, &options).run()?;
        let cube = packing.pack(ldi)?;
        let path = self.out.join("demo.ldi");
        cube.write(&path)?;
        let captured_s = start.elapsed().as_secs_f64();
        let rows = measure::rows(&cube, &stage, &sizes, &bar)?;
        bar.finish();
        println!(
            "{}: {}, {:.1} MB, after {}\n",
            path.display(),
            describe_cube(&cube),
            std::fs::metadata(&path)?.len() as f64 / 1e6,
            duration(captured_s)
        );
        self.finish(&rows, &Summary::new(triangles, &sizes), start)
    }

    /// Traces the view from the centre with few rays, before anything else: the scene is seen at
    /// once, and the time of a ray becomes known. Returns the time of all its rays, seconds, by
    /// those of the second half: the first rays fill the cells of bounced light.
    fn trace_first_picture(&self, stage: &Stage, sizes: &Sizes) -> anyhow::Result<f64> {
        let samples = sizes.first_samples;
        let mut sum = TruthSum::new(&stage.camera(0.0, sizes)?);
        let mut trace_half = || {
            let watch = Stopwatch::start();
            sum.add(&stage.tracer, &stage.lighting, true, samples / 2, &Silent);
            watch.seconds_per_thread()
        };
        trace_half();
        let seconds = 2.0 * trace_half();
        let path = self.out.join("first.png");
        save_picture(&path, &sum.truth(&stage.lighting).rgb())?;
        println!("first picture, {samples} rays a pixel: {}", path.display());
        Ok(seconds)
    }

    /// Writes pictures and table, prints the table and the closing sentence, opens the window.
    fn finish(&self, rows: &[Row], summary: &Summary, start: Instant) -> anyhow::Result<()> {
        for (i, row) in rows.iter().enumerate() {
            let truth = row.truth.rgb();
            for (name, image) in [
                ("frame", &row.frame),
                ("truth", &truth),
                ("cube-map", &row.map),
            ] {
                save_picture(&self.out.join(format!("{name}_{i}.png")), image)?;
            }
        }
        write_text(&self.out.join("table.csv"), &summary::csv(rows))?;
        print!("{}", summary.table(rows));
        if let Some(last) = rows.last() {
            let path = self.out.join("demo.png");
            save_picture(&path, &summary::picture(last))?;
            println!("\n{}", summary.sentence(last));
            println!(
                "{}: headbox, ray-traced truth and cube map, {:.1} m off the centre",
                path.display(),
                last.distance_m
            );
        }
        let ldi = shell_quote(&self.out.join("demo.ldi"));
        println!(
            "\n{} in all. Look around: headbox view {ldi}; your own scene: headbox view SCENE.glb",
            duration(start.elapsed().as_secs_f64())
        );
        self.open_window();
        Ok(())
    }

    /// Opens the window on the capture; without a display only prints a message.
    #[cfg(feature = "viewer")]
    fn open_window(&self) {
        if !self.no_window
            && let Err(error) = super::view::show(&self.out.join("demo.ldi"))
        {
            eprintln!("no window: {error:#}");
        }
    }

    #[cfg(not(feature = "viewer"))]
    fn open_window(&self) {
        if !self.no_window {
            eprintln!("no window: this program was built without the viewer feature");
        }
    }
}
