//! Writes `.house` files and walks: `headbox house -o F.house --walk PATH.json`.

use crate::commands::house::file::{kind_by_name, note_unvisited};
use crate::interrupt;
use crate::messages::UsageError;
use crate::output::{HOUSE, Outputs, PATH, write_text};
use crate::progress::{Bar, PlannedStage, duration};
use clap::Args;
use headbox_core::bounces::Bounces;
use headbox_core::camera::Camera;
use headbox_core::color::exposure::Exposure;
use headbox_core::color::tone::ToneMap;
use headbox_core::light_parameters::LightParameters;
use headbox_core::progress::Progress;
use headbox_house::backdrop::{BackdropKind, BackdropQuality};
use headbox_house::file;
use headbox_house::house::House;
use headbox_house::make::{BACKDROPS, LIGHT, MakeError, MakeOptions, make_house};
use headbox_house::walk_path::{PAPER_POSES, WalkPath};
use headbox_model::PortalModel;
use headbox_model::bake::BakeOptions;
use headbox_scene::camera_path::{CameraRecord, PathRecord};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Memory for backdrops, bytes.
const BUDGET: u64 = 4 << 30;

#[derive(Args)]
pub(super) struct HouseFileArgs {
    /// Write the model and the backdrops of its portals to this .house file
    #[arg(short, long, value_name = "F.house")]
    output: Option<PathBuf>,
    /// Backdrops to capture behind both sides of every portal, separated by commas, or none; a
    /// wrong name prints the list
    #[arg(
        long,
        value_name = "NAME,...",
        value_delimiter = ',',
        default_value = "window-ldi"
    )]
    backdrops: Vec<String>,
    /// Keep the model's colours instead of baking lighting into the vertices
    #[arg(long)]
    unlit: bool,
    /// Maximum edge length of the baked model, metres, at least 0.01
    #[arg(long, value_name = "M", default_value_t = BakeOptions::default().edge_m)]
    edge: f64,
    /// Light samples per vertex, 1 to 4096
    #[arg(long, value_name = "N", default_value_t = BakeOptions::default().samples,
        value_parser = clap::value_parser!(u32).range(1..=4096))]
    light_samples: u32,
    /// Diffuse bounces of baked light after direct light, 0 to 64, or full: all bounces
    #[arg(long, value_name = "B", default_value_t = BakeOptions::default().bounces)]
    bounces: Bounces,
    /// Write a camera path through every room to this JSON file
    #[arg(long, value_name = "PATH.json")]
    walk: Option<PathBuf>,
    /// Number of poses of the path, 1 to 100000
    #[arg(long, value_name = "N", default_value_t = PAPER_POSES, value_parser = parse_poses)]
    poses: usize,
}

fn parse_poses(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|poses| (1..=100_000).contains(poses))
        .ok_or("give a number from 1 to 100000".into())
}

/// The files that `headbox house` wrote.
#[derive(Debug, Serialize)]
pub(super) struct WrittenFiles {
    walk: Option<String>,
    #[serde(flatten)]
    house: Option<WrittenHouse>,
}

fn name_of(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// A `.house` file that was written.
#[derive(Debug, Serialize)]
struct WrittenHouse {
    output: String,
    /// Size of the file; `None` if it was streamed.
    bytes: Option<u64>,
    captures: usize,
    #[serde(rename = "captures_asked")]
    requested: usize,
    capture_s: f64,
    /// Minimum number of light samples of a vertex; 0 without baked light.
    light_samples: u32,
    /// Exposure that is baked in, stops.
    exposure: Option<f32>,
    interrupted: bool,
}

/// Progress of the light and the backdrops of a house in one bar; an interrupt cancels the work.
struct HouseProgress {
    /// Created when the number of light samples is known.
    bar: OnceLock<Bar>,
    /// Number of backdrops to capture.
    backdrops: usize,
}

impl HouseProgress {
    /// Time of a backdrop relative to that of a light sample (0.3 and 0.8 million in two homes).
    const BACKDROP_SAMPLES: f64 = 5e5;

    fn new(backdrops: usize) -> Self {
        Self {
            bar: OnceLock::new(),
            backdrops,
        }
    }

    /// Creates the bar when its first stage begins.
    fn planned(&self, stage: &str, total: u64) -> Bar {
        let planned = |stage, weight| PlannedStage {
            stages: stage,
            times: 1,
            weight,
        };
        let light = if stage == LIGHT { total as f64 } else { 0.0 };
        let backdrops = self.backdrops as f64 * Self::BACKDROP_SAMPLES;
        let plan = vec![planned(&[LIGHT], light), planned(&[BACKDROPS], backdrops)];
        Bar::planned(plan, false)
    }

    fn finish(&self) {
        if let Some(bar) = self.bar.get() {
            bar.finish();
        }
    }
}

impl Progress for HouseProgress {
    fn begin(&self, stage: &str, unit: &str, total: u64) {
        let bar = self.bar.get_or_init(|| self.planned(stage, total));
        bar.begin(stage, unit, total);
    }

    fn advance(&self, steps: u64) {
        if let Some(bar) = self.bar.get() {
            bar.advance(steps);
        }
    }

    fn is_cancelled(&self) -> bool {
        interrupt::is_requested()
    }
}

impl HouseFileArgs {
    /// Checks the arguments and the light. Returns true if a file is to be written.
    pub(super) fn check(&self, light: &LightParameters) -> Result<bool, UsageError> {
        self.kinds()?;
        if light.tone == ToneMap::SrgbCompressed {
            return Err(UsageError(
                "--tone hdr: the frames of a house have no later --exposure; give --tone neutral or linear".into(),
            ));
        }
        let of_baked_light = [
            ("--exposure", light.exposure != Exposure::default()),
            ("--bounces", self.bounces != BakeOptions::default().bounces),
        ];
        let given = of_baked_light.into_iter().find(|(_, is_given)| *is_given);
        if let Some((flag, _)) = given.filter(|_| self.unlit) {
            return Err(UsageError(format!(
                "{flag} is for baked light; --unlit keeps the colours of the model"
            )));
        }
        if self.edge.is_nan() || self.edge < 0.01 {
            return Err(UsageError(format!(
                "--edge {}: give a length of at least 0.01 m",
                self.edge
            )));
        }
        Ok(self.output.is_some() || self.walk.is_some())
    }

    /// Adds the files to the outputs.
    pub(super) fn add_outputs(&self, outputs: Outputs) -> anyhow::Result<Outputs> {
        outputs
            .maybe_file(self.output.as_ref(), &HOUSE)?
            .maybe_file(self.walk.as_ref(), &PATH)
    }

    fn kinds(&self) -> Result<Vec<BackdropKind>, UsageError> {
        let names = self.backdrops.iter().filter(|name| *name != "none");
        names.map(|name| kind_by_name(name)).collect()
    }

    /// Makes the house and writes the files. Ends the program if it is interrupted before there is
    /// any light.
    pub(super) fn write(&self, mut model: PortalModel) -> anyhow::Result<WrittenFiles> {
        let is_sound = model.scene.validate().is_ok();
        if self.output.is_some() && is_sound {
            interrupt::keep_partial_results();
            if self.unlit {
                model.stitch();
            }
        }
        let options = self.make_options()?;
        let progress = HouseProgress::new(2 * model.portals.len() * options.backdrops.len());
        let made = make_house(model, &options, &progress);
        progress.finish();
        if let Err(MakeError::NoLight) = &made {
            eprintln!("error: {}", MakeError::NoLight);
            interrupt::exit();
        }
        let made = made?;
        for portal in &made.oversized {
            eprintln!(
                "note: the backdrop of portal {portal} is larger than {BUDGET} bytes and left out"
            );
        }
        if let Some(path) = &self.walk {
            self.write_walk(&made.house, path)?;
        }
        let mut written = WrittenFiles {
            walk: self.walk.as_deref().map(name_of),
            house: None,
        };
        if let Some(path) = &self.output {
            file::write(path, &made.house, &made.store, &options.quality)?;
            let file = std::fs::metadata(path)
                .ok()
                .filter(std::fs::Metadata::is_file);
            written.house = Some(WrittenHouse {
                output: name_of(path),
                bytes: file.map(|file| file.len()),
                captures: made.captures,
                requested: made.requested,
                capture_s: made.capture_time.as_secs_f64(),
                light_samples: made.light.map_or(0, |light| light.samples),
                exposure: made.light.map(|light| light.exposure.log2()),
                interrupted: interrupt::is_requested(),
            });
        }
        Ok(written)
    }

    /// Light and backdrops of a `.house` file; none for a walk alone.
    fn make_options(&self) -> Result<MakeOptions, UsageError> {
        let is_written = self.output.is_some();
        let light = BakeOptions {
            edge_m: self.edge,
            samples: self.light_samples,
            bounces: self.bounces,
            ..BakeOptions::default()
        };
        Ok(MakeOptions {
            light: (is_written && !self.unlit).then_some(light),
            backdrops: if is_written {
                self.kinds()?
            } else {
                Vec::new()
            },
            quality: BackdropQuality::default(),
            budget_bytes: BUDGET,
        })
    }

    /// Prints the result of [`Self::write`].
    pub(super) fn print(&self, written: &WrittenFiles) {
        if let Some(path) = &written.walk {
            println!("{path}: a walk of {} poses", self.poses);
        }
        let Some(house) = &written.house else { return };
        let output = &house.output;
        let captures = house.captures;
        let size = house.bytes.map_or(String::new(), |bytes| {
            format!(", {:.1} MB", bytes as f64 / 1e6)
        });
        println!(
            "{output}: {captures} captures in {}{size}",
            duration(house.capture_s)
        );
        if let Some(exposure) = house.exposure {
            println!(
                "baked with --exposure {exposure:.2}, with which truth of the model is as bright"
            );
        }
        if house.interrupted {
            println!(
                "interrupted: {captures} of {} captures are in it, the others are made during a walk;",
                house.requested
            );
            if !self.unlit {
                println!(
                    "each vertex has at least {} of {} samples of light",
                    house.light_samples, self.light_samples
                );
            }
        }
        println!("walk through it: headbox view {output}");
    }

    fn write_walk(&self, house: &House, path: &Path) -> anyhow::Result<()> {
        let walk = WalkPath {
            poses: self.poses,
            ..WalkPath::default()
        };
        let frame = house.scene().frame;
        let record = |camera: &Camera| {
            let up = camera.world_from_eye().y_axis;
            CameraRecord::new(camera.eye(), camera.forward(), up, walk.fov_y_deg, &frame)
        };
        let poses = walk.cameras(house)?.iter().map(record).collect();
        note_unvisited(&walk, house);
        let text = serde_json::to_string(&PathRecord {
            size: Some(walk.size),
            poses,
        })?;
        write_text(path, &text)
    }
}
