//! `headbox report`.

pub(crate) mod images;

use super::images::is_image_set;
use crate::args::{SourceArgs, parse_length, parse_unit, parse_up, parse_vector, split_settings};
use crate::commands::capture::place::place_headbox;
use crate::commands::render::geometry::GeometryArgs;
use crate::commands::report::images as images_report;
use crate::image_set::SetArgs;
use crate::messages::UsageError;
use crate::output::{NO_INPUTS, Outputs, PAGE, print_notes, write_text};
use crate::progress::{Bar, PlannedStage};
use anyhow::{Context, bail};
use clap::Args;
use clap::builder::TypedValueParser;
use glam::DVec3;
use headbox_core::bounces::Bounces;
use headbox_core::container::Container;
use headbox_core::file_frame::UpAxis;
use headbox_core::headbox::Headbox;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::pack::CubeLdi;
use headbox_cube::pack::file::CUBE_LDI;
use headbox_lab::machine::{Machine, commit};
use headbox_lab::plan::{Plan, Quality, axis_with_most_geometry};
use headbox_lab::report::figures::{figures, short};
use headbox_lab::report::row::Report;
use headbox_lab::report::subject::Subject;
use headbox_lab::report::{promises, results, scene, summary};
use headbox_lab::stability;
use headbox_lab::walk::WalkReport;
use headbox_ldi::scene_source::SceneSource;
use headbox_photos::cache;
use headbox_sprite::{SPRITE_FILE, SpriteSet};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

#[derive(Args)]
pub(crate) struct ReportCommand {
    /// Scenes to capture (.obj, .gltf, .glb, .ply, .stl, homes, builtin:NAME), .ldi and .sprite
    /// files whose scenes still exist, or one folder of images; the name of a scene may be followed
    /// by its own settings: @center=X,Y,Z, @half=S, @up=z, @unit=cm
    #[arg(value_name = "SCENE|FILE", required_unless_present_any = ["results", "stability"], value_parser = parse_subject)]
    subjects: Vec<SubjectArg>,
    /// Folder for report.json, report.csv, summary.md and charts; headbox-report by default. With
    /// --results and --stability: page to write; results.md and STABILITY.md by default
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Measure at small sizes: one to two minutes per scene on two cores
    #[arg(long)]
    quick: bool,
    /// Measure at full sizes, frames of 1024x768 and faces of 1024 px, from few eyes and one
    /// capture: 4 to 45 minutes per scene on two cores, mostly for truth, which is cached
    #[arg(long, conflicts_with = "quick")]
    real: bool,
    /// Skip scenes already in OUTPUT/report.json, if its commit, sizes and seed are the same
    #[arg(long)]
    resume: bool,
    /// Check the claims of the README against the measurements, and fail if one does not hold
    #[arg(long)]
    promises: bool,
    /// Add a chapter to the page of --results from this walk.json of `headbox walk`
    #[arg(long, value_name = "walk.json", requires = "results")]
    walk: Option<PathBuf>,
    /// Seed of eyes and captures
    #[arg(long, value_name = "K", default_value_t = 0)]
    seed: u64,
    /// Diffuse bounces of light after direct light, 0 to 64, or full: all bounces
    #[arg(long, value_name = "B", default_value_t = CaptureParameters::DEFAULT.bounces)]
    bounces: Bounces,
    /// Cache folder of ray-traced truth, reused by later runs; headbox/truth in the user's cache
    /// folder by default
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Write a page and its charts from the report.json of an earlier run, without measuring
    #[arg(long, value_name = "report.json", conflicts_with_all = ["subjects", "quick", "real"])]
    results: Option<PathBuf>,
    /// Measure hard numerical cases instead, and write a page of their error bounds
    #[arg(long, conflicts_with_all = ["subjects", "quick", "real", "results"])]
    stability: bool,
    /// Compare with the page of an earlier --stability run, and fail if verdicts differ
    #[arg(long, value_name = "STABILITY.md", requires = "stability")]
    against: Option<PathBuf>,
    /// Number of seeds for each hard case of --stability
    #[arg(long, value_name = "N", default_value_t = 20, requires = "stability", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    seeds: u64,
    /// Folder of images: hold out every N-th view, render it from the others and compare; 1 holds
    /// out each view in turn
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..).map(usize::from))]
    hold_out: usize,
    #[command(flatten)]
    images: SetArgs,
    #[command(flatten)]
    geometry: GeometryArgs,
    #[command(flatten)]
    source: SourceArgs,
}

/// A scene or a file, with its own settings.
#[derive(Clone, Default)]
struct SubjectArg {
    name: String,
    center: Option<DVec3>,
    half_size: Option<f64>,
    up: Option<UpAxis>,
    unit: Option<f64>,
}

impl SubjectArg {
    fn is_placed(&self) -> bool {
        self.center.is_some()
            || self.half_size.is_some()
            || self.up.is_some()
            || self.unit.is_some()
    }
}

/// Parses `NAME`, or `NAME@KEY=VALUE@KEY=VALUE`.
fn parse_subject(text: &str) -> Result<SubjectArg, String> {
    const KEYS: [&str; 4] = ["center", "half", "up", "unit"];
    let (name, parts) = split_settings(text, &KEYS)?;
    let mut named = SubjectArg {
        name: name.to_owned(),
        ..SubjectArg::default()
    };
    for (key, value) in parts {
        match key {
            "center" => named.center = Some(parse_vector(value)?),
            "half" => named.half_size = Some(parse_length(value)?),
            "up" => named.up = Some(parse_up(value)?),
            "unit" => {
                named.unit =
                    Some(parse_unit(value).map_err(|cause| format!("unit={value}: {cause}"))?);
            }
            _ => return Err(format!("{key}: give one of {}", KEYS.join("=, "))),
        }
    }
    Ok(named)
}

impl ReportCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        match &self.results {
            Some(json) => self.write_page(json),
            None if self.stability => self.measure_stability(),
            None => match self.subjects.as_slice() {
                [set] if is_image_set(&set.name) => self.measure_images(Path::new(&set.name)),
                _ => self.measure(),
            },
        }
    }

    fn output_or<'a>(&'a self, default: &'a str) -> &'a Path {
        self.output.as_deref().unwrap_or(Path::new(default))
    }

    fn measure_stability(&self) -> anyhow::Result<()> {
        let output = self.output_or("STABILITY.md");
        Outputs::new(false, NO_INPUTS).file(output, &PAGE)?;
        // Read first: it may be the file that is overwritten.
        let earlier = self
            .against
            .as_ref()
            .map(|path| read_text(path))
            .transpose()?;
        let (page, all_hold) =
            stability::page(self.seed..self.seed.saturating_add(self.seeds), |name| {
                eprintln!("{name}");
            });
        write_text(output, &page)?;
        println!("{}: {} seeds a case", output.display(), self.seeds);
        if let Some(earlier) = earlier {
            let [before, now] =
                [&earlier, &page].map(|page| stability::verdicts(page).unwrap_or_default());
            let differences = stability::differences(&before, &now);
            if !differences.is_empty() {
                bail!("verdicts differ:\n{}", differences.join("\n"));
            }
        }
        if all_hold {
            Ok(())
        } else {
            bail!("a bound is exceeded; see {}", output.display())
        }
    }

    fn measure(&self) -> anyhow::Result<()> {
        for (i, subject) in self.subjects.iter().enumerate() {
            // Rows identify their scene by its name.
            if self.subjects[..i]
                .iter()
                .any(|other| other.name == subject.name)
            {
                bail_usage!("{} is named twice", subject.name);
            }
        }
        let output = self.output_or("headbox-report");
        let inputs = self.subjects.iter().map(|subject| Path::new(&subject.name));
        let outputs = Outputs::new(false, inputs).folder(output)?;
        let mut cache = self
            .cache
            .clone()
            .or_else(|| cache::folder("truth"))
            .unwrap_or_else(|| output.join("truth"));
        std::fs::create_dir_all(&cache)
            .with_context(|| format!("{} could not be made", cache.display()))?;
        if self.cache.is_some() {
            // A link that the user names is followed.
            cache = cache.canonicalize()?;
        }
        print_notes(cache::refuse_links(Some(cache.join("truth"))).1);
        let mut report = Report {
            version: Report::VERSION,
            machine: Machine::here(),
            commit: commit(),
            program: env!("CARGO_PKG_VERSION").into(),
            seed: self.seed,
            quick: self.quick,
            real: self.real,
            scenes: Vec::new(),
            rows: Vec::new(),
        };
        let json = output.join("report.json");
        if self.resume {
            report.resume(read_report(&json).ok());
        }
        let bar = Bar::planned(scene_plan(), false);
        for (number, named) in self.subjects.iter().enumerate() {
            bar.begin_part(short(&named.name), number, self.subjects.len());
            if report.scenes.iter().any(|facts| facts.scene == named.name) {
                continue;
            }
            let (subject, plan) = self.open(named, &outputs)?;
            let (facts, rows) = scene::run(&subject, &plan, Some(cache.clone()), &bar)?;
            report.scenes.push(facts);
            report.rows.extend(rows);
            // Written after each scene, so that an interrupted run can be resumed.
            write_text(&json, &(serde_json::to_string_pretty(&report)? + "\n"))?;
        }
        bar.finish();
        eprintln!("time: {}", bar.times());
        write_text(&output.join("report.csv"), &report.to_csv())?;
        let summary = summary::summary(&report);
        write_text(&output.join("summary.md"), &summary)?;
        save_charts(&report, output)?;
        print!("{summary}");
        eprintln!("truth is kept in {}", cache.display());
        if self.promises {
            print!("{}", promises::table(&report));
            let broken = promises::broken(&report);
            if !broken.is_empty() {
                bail!(
                    "the README promises what does not hold: {}",
                    broken.join("; ")
                );
            }
        }
        Ok(())
    }

    /// Measures an image set by held-out views.
    fn measure_images(&self, folder: &Path) -> anyhow::Result<()> {
        let set = self.images.open_registered(folder)?;
        let output = self.output_or("headbox-report");
        Outputs::new(false, [folder]).folder(output)?;
        images_report::write(&set, self.hold_out, &self.geometry, output)
    }

    fn write_page(&self, json: &Path) -> anyhow::Result<()> {
        let output = self.output_or("results.md");
        Outputs::new(false, std::iter::once(json).chain(self.walk.as_deref()))
            .file(output, &PAGE)?;
        let report = read_report(json)?;
        let walk: Option<WalkReport> = self.walk.as_deref().map(parse_report).transpose()?;
        write_text(output, &results::page(&report, walk.as_ref()))?;
        let folder = output.with_file_name("results");
        write_text(&folder.join("report.csv"), &report.to_csv())?;
        if let Some(walk) = &walk {
            write_text(&folder.join("along-path.svg"), &walk.chart().to_svg())?;
        }
        save_charts(&report, &folder)
    }

    /// Opens a scene or a file for measurement, with its plan.
    fn open(&self, named: &SubjectArg, outputs: &Outputs) -> anyhow::Result<(Subject, Plan)> {
        let name = named.name.as_str();
        let path = Path::new(name);
        let kind = if path.is_file() {
            Container::peek_kind(path)?
        } else {
            None
        };
        if kind.is_some() && named.is_placed() {
            bail_usage!("{name}: says itself where its headbox is");
        }
        let quality = match (self.quick, self.real) {
            (true, _) => Quality::QUICK,
            (_, true) => Quality::REAL,
            _ => Quality::FULL,
        };
        let (mut cube, mut sprites, mut view, mut origin) = (None, None, None, None);
        let source = if kind == Some(CUBE_LDI.tag) {
            let read = CubeLdi::read(path)?;
            let source = SceneSource::in_frame(&read.info.scene, read.info.frame)
                .lit_by(read.info.light.clone());
            cube = Some(read);
            source
        } else if kind == Some(SPRITE_FILE.tag) {
            let read = SpriteSet::read(path)?;
            let source = SceneSource::in_frame(&read.info.source, read.info.frame)
                .lit_by(read.info.light.clone());
            sprites = Some(read);
            source
        } else if let Some(representation) = headbox_views::find(path).filter(|_| path.is_file()) {
            let opened = (representation.open)(path)?;
            let no_origin = || {
                format!(
                    "{name}: a {} does not name the scene that it was made of",
                    representation.name
                )
            };
            let from = opened.origin().with_context(no_origin)?;
            let source = SceneSource::in_frame(&from.scene, from.frame).lit_by(from.light.clone());
            view = Some(Arc::new(Mutex::new(opened)));
            origin = Some(from);
            source
        } else {
            self.source.with(named.up, named.unit).source(name)
        };
        let scene = if kind.is_some() || view.is_some() {
            source
                .open()
                .with_context(|| format!("the scene of {name} is needed for truth"))?
        } else {
            source.open()?
        };
        let scene = Arc::new(scene);
        outputs.add_scene(&source.name, &scene, self.images.strict)?;
        let Headbox {
            mut centre,
            mut half_size_m,
        } = place_headbox(&scene, named.center, named.half_size)?;
        let (mut bounces, mut lit, mut ahead) = (self.bounces, true, None);
        if let Some(cube) = &cube {
            (centre, half_size_m) = (cube.info.centre, cube.info.half_size_m);
            (bounces, lit) = (
                cube.info.parameters.bounces,
                cube.info.parameters.light_samples > 0,
            );
        }
        if let Some(origin) = &origin {
            Headbox {
                centre,
                half_size_m,
            } = origin.headbox;
            lit = origin.lit;
        }
        if let Some(set) = &sprites {
            let Some(first) = set.sprites().first() else {
                bail!("{name}: holds no sprites")
            };
            let camera = first.sprite().sprite().camera();
            (centre, ahead) = (camera.eye(), Some(camera.forward()));
        }
        let tracer = Arc::new(Tracer::new(Arc::clone(&scene), centre));
        let lighting = Lighting::prepare(&tracer, centre, bounces, lit);
        let ahead = ahead.unwrap_or_else(|| axis_with_most_geometry(&tracer, centre));
        let plan = Plan::new(quality, centre, half_size_m, ahead, self.seed);
        let plan = plan.map_err(|error| UsageError(error.to_string()))?;
        Ok((
            Subject {
                name: name.to_owned(),
                tracer,
                lighting,
                lit,
                cube,
                sprites,
                view,
            },
            plan,
        ))
    }
}

/// Stages of a scene's measurement, with typical shares of the time: captures that vary one
/// parameter each, frames, and truth for each eye, repeated for some.
fn scene_plan() -> Vec<PlannedStage> {
    vec![
        PlannedStage {
            stages: &[
                "pilot",
                "trace",
                "look for holes",
                "light and merge",
                "sprites",
            ],
            times: 40,
            weight: 0.4,
        },
        PlannedStage {
            stages: &["frames"],
            times: 1,
            weight: 0.2,
        },
        PlannedStage {
            stages: &["truth"],
            times: 24,
            weight: 0.4,
        },
    ]
}

fn read_text(path: &Path) -> anyhow::Result<String> {
    std::fs::read_to_string(path).with_context(|| format!("{} could not be read", path.display()))
}

fn parse_report<T: DeserializeOwned>(path: &Path) -> anyhow::Result<T> {
    serde_json::from_str(&read_text(path)?)
        .with_context(|| format!("{}: not a report of this version", path.display()))
}

fn read_report(json: &Path) -> anyhow::Result<Report> {
    let report: Report = parse_report(json)?;
    if report.version != Report::VERSION {
        let (path, version, ours) = (json.display(), report.version, Report::VERSION);
        bail!("{path}: version {version} of reports; this program reads version {ours}");
    }
    Ok(report)
}

/// Writes every chart of a report as SVG.
fn save_charts(report: &Report, folder: &Path) -> anyhow::Result<()> {
    for figure in figures(report) {
        write_text(
            &folder.join(format!("{}.svg", figure.name)),
            &figure.chart.to_svg(),
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_follow_scene_names() {
        let named =
            parse_subject("a@home/house.obj@up=z@center=0,-1,1.5@half=0.4@unit=cm").unwrap();
        assert_eq!(
            (named.name.as_str(), named.center),
            ("a@home/house.obj", Some(DVec3::new(0.0, -1.0, 1.5)))
        );
        assert!(named.half_size == Some(0.4) && named.is_placed());
        assert!(matches!(
            (named.up, named.unit),
            (Some(UpAxis::Z), Some(0.01))
        ));
        let plain = parse_subject("a@home/house.obj").unwrap();
        assert!(plain.name == "a@home/house.obj" && !plain.is_placed());
        for wrong in [
            "a.obj@center=1,2",
            "a.obj@half=0",
            "a.obj@half=1@size=3",
            "a.obj@up=x",
            "a.obj@unit=m@z",
        ] {
            assert!(parse_subject(wrong).is_err(), "{wrong}");
        }
    }
}
