//! `.house` files: written by `headbox house`, walked by `headbox render`, described by `headbox info`.

use crate::args::DefaultCamera;
use crate::interrupt;
use crate::output::{HOUSE, Outputs, PATH, print_json, write_text};
use crate::progress::Bar;
use crate::words::UsageError;
use anyhow::Context;
use clap::Args;
use glam::DVec3;
use headbox_core::camera::{Camera, CameraError};
use headbox_core::file_frame::FileFrame;
use headbox_core::progress::Progress;
use headbox_house::backdrop::{Backdrop, BackdropKind, BackdropQuality, PortalSide};
use headbox_house::file;
use headbox_house::house::House;
use headbox_house::settings::{WalkSettings, WalkStats};
use headbox_house::store::Store;
use headbox_house::variant::HouseVariant;
use headbox_house::walk::Walker;
use headbox_house::walk_path::{PAPER_POSES, WalkPath};
use headbox_model::PortalModel;
use headbox_model::bake::{BakeOptions, bake_model};
use headbox_scene::camera_path::{CameraRecord, PathRecord};
use image::RgbImage;
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Memory for backdrops, bytes.
const BUDGET: u64 = 4 << 30;

#[derive(Args)]
pub(super) struct HouseFileArgs {
    /// Write the model, with what is captured behind its portals, to this .house file
    #[arg(short, long, value_name = "F.house")]
    output: Option<PathBuf>,
    /// What to capture behind both sides of every portal: see the list that a wrong name prints; `none` for nothing
    #[arg(
        long,
        value_name = "NAME,...",
        value_delimiter = ',',
        default_value = "window-ldi"
    )]
    backdrops: Vec<String>,
    /// Leave the model's colours as they are instead of baking its light into the vertices
    #[arg(long)]
    unlit: bool,
    /// Edges longer than this are cut before light is baked, metres
    #[arg(long, value_name = "M", default_value_t = BakeOptions::default().edge_m)]
    edge: f64,
    /// Light samples for each vertex
    #[arg(long, value_name = "N", default_value_t = BakeOptions::default().samples, value_parser = clap::value_parser!(u32).range(1..=4096))]
    light_samples: u32,
    /// Write a walk through every room to this JSON file
    #[arg(long, value_name = "PATH.json")]
    walk: Option<PathBuf>,
    /// Poses of the walk
    #[arg(long, value_name = "N", default_value_t = PAPER_POSES, value_parser = parse_poses)]
    poses: usize,
}

fn parse_poses(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|poses| (1..=100_000).contains(poses))
        .ok_or("give a number from 1 to 100000".into())
}

impl HouseFileArgs {
    /// Whether anything is to be written; names are checked.
    pub(super) fn wanted(&self) -> Result<bool, UsageError> {
        self.kinds()?;
        if self.edge.is_nan() || self.edge < 0.01 {
            return Err(UsageError(format!(
                "--edge {}: give a length of at least 0.01 m",
                self.edge
            )));
        }
        Ok(self.output.is_some() || self.walk.is_some())
    }

    /// Adds what will be written.
    pub(super) fn outputs(&self, outputs: Outputs) -> anyhow::Result<Outputs> {
        outputs
            .maybe_file(self.output.as_ref(), &HOUSE)?
            .maybe_file(self.walk.as_ref(), &PATH)
    }

    fn kinds(&self) -> Result<Vec<BackdropKind>, UsageError> {
        let named = self
            .backdrops
            .iter()
            .map(String::as_str)
            .filter(|name| *name != "none");
        named.map(kind_by_name).collect()
    }

    /// Captures and writes what is wanted.
    pub(super) fn write(&self, model: PortalModel) -> anyhow::Result<Value> {
        let (model, samples) = self.lit(model);
        let house = House::new(model)?;
        if let Some(path) = &self.walk {
            self.write_walk(&house, path)?;
        }
        let Some(path) = &self.output else {
            return Ok(json!({"walk": self.walk}));
        };
        let (store, quality, started) = (
            Store::new(BUDGET),
            BackdropQuality::default(),
            Instant::now(),
        );
        let sides = (0..house.plan().portals.len() as u32)
            .flat_map(|portal| [0, 1].map(|side| PortalSide { portal, side }));
        let keys: Vec<_> = self
            .kinds()?
            .into_iter()
            .flat_map(|kind| sides.clone().map(move |at| (at, kind)))
            .collect();
        let bar = Bar::new();
        bar.begin("backdrops", "sides of portals", keys.len() as u64);
        let mut captures = 0;
        for &(at, kind) in &keys {
            if interrupt::asked() {
                break;
            }
            let backdrop = Backdrop::capture(&house, at, kind, &quality)?;
            if !store.insert((at, kind), Arc::new(backdrop)) {
                eprintln!(
                    "note: the backdrop of portal {} is larger than {BUDGET} bytes and left out",
                    at.portal
                );
            }
            captures += 1;
            bar.advance(1);
        }
        bar.finish();
        let capture_s = started.elapsed().as_secs_f64();
        file::write(path, &house, &store, &quality)?;
        // What was streamed has no size any more.
        let bytes = std::fs::metadata(path)
            .ok()
            .filter(std::fs::Metadata::is_file)
            .map(|file| file.len());
        Ok(json!({
            "output": path, "bytes": bytes, "captures": captures, "captures_asked": keys.len(), "capture_s": capture_s,
            "walk": self.walk, "light_samples": samples, "interrupted": interrupt::asked(),
        }))
    }

    /// Says what [`Self::write`] has written.
    pub(super) fn print(&self, written: &Value) {
        if let Some(path) = &self.walk {
            println!("{}: a walk of {} poses", path.display(), self.poses);
        }
        if let Some(path) = &self.output {
            let megabytes = written["bytes"]
                .as_f64()
                .map_or(String::new(), |bytes| format!(", {:.1} MB", bytes / 1e6));
            let seconds =
                crate::progress::duration(written["capture_s"].as_f64().unwrap_or_default());
            println!(
                "{}: {} captures in {seconds}{megabytes}",
                path.display(),
                written["captures"]
            );
            if written["interrupted"] == true {
                let [captures, of_all] = [&written["captures"], &written["captures_asked"]];
                println!(
                    "interrupted: {captures} of {of_all} captures are in it, the others are made when they are walked past;"
                );
                if !self.unlit {
                    let (samples, of_all) = (&written["light_samples"], self.light_samples);
                    println!("each vertex has at least {samples} of {of_all} samples of light");
                }
            }
            println!("walk through it: headbox view {}", path.display());
        }
    }

    /// The model with its light baked in, if it is wanted, and without T-junctions, if there is a file to hold it; and the light samples
    /// that each vertex has at least. Ends the program if it is interrupted before it has any light.
    fn lit(&self, mut model: PortalModel) -> (PortalModel, u32) {
        if self.output.is_none() || model.scene.validate().is_err() {
            return (model, 0);
        }
        interrupt::keep_what_is_done();
        if self.unlit {
            model.stitch();
            return (model, 0);
        }
        let bar = Bar::new();
        let options = BakeOptions {
            edge_m: self.edge,
            samples: self.light_samples,
            ..BakeOptions::default()
        };
        let before = AtomicU64::new(0);
        let baked = bake_model(model, &options, &|done, all| {
            let before = before.fetch_max(done as u64, Ordering::Relaxed);
            if before == 0 {
                bar.begin("light", "samples", all as u64);
            }
            bar.advance((done as u64).saturating_sub(before));
            if interrupt::asked() {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        bar.finish();
        if baked.1 == 0 && interrupt::asked() {
            eprintln!("error: interrupted before every wall had light: nothing to keep");
            interrupt::end();
        }
        baked
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
        say_unvisited(&walk, house);
        let text = serde_json::to_string(&PathRecord {
            size: Some(walk.size),
            poses,
        })?;
        write_text(path, &text)
    }
}

/// Says which rooms a walk leaves out, if it does.
pub(crate) fn say_unvisited(walk: &WalkPath, house: &House) {
    let unvisited = walk.unvisited(house);
    if !unvisited.is_empty() {
        eprintln!(
            "note: no door leads to {}: the walk does not go there",
            unvisited.join(", ")
        );
    }
}

fn kind_by_name(name: &str) -> Result<BackdropKind, UsageError> {
    let known = BackdropKind::ALL.iter().find(|(known, _)| *known == name);
    known.map(|(_, kind)| *kind).ok_or_else(|| {
        let names: Vec<&str> = BackdropKind::ALL.iter().map(|(name, _)| *name).collect();
        UsageError(format!(
            "there is no backdrop \"{name}\"; there are: {}",
            names.join(", ")
        ))
    })
}

/// A way to draw a walk, or a sentence with the names of all.
pub(crate) fn variant_by_name(name: &str) -> Result<HouseVariant, UsageError> {
    HouseVariant::by_name(name).ok_or_else(|| {
        UsageError(format!(
            "there is no variant \"{name}\"; there are: {}",
            HouseVariant::names()
        ))
    })
}

/// How a house is seen first: from where a walk begins or, where nobody can stand, from the middle of everything.
pub(crate) fn first_view(house: &House) -> Result<Camera, CameraError> {
    let (walk, middle) = (WalkPath::default(), house.tracer().origin());
    let from_middle = || {
        Camera::look_at(
            middle,
            middle + DVec3::NEG_Z,
            DVec3::Y,
            walk.fov_y_deg,
            walk.size,
        )
    };
    WalkPath::first(house)?.map_or_else(from_middle, Ok)
}

/// A `.house` file to be walked.
pub(crate) struct HouseContent {
    house: House,
    store: Store,
    quality: BackdropQuality,
    walker: Walker,
    variant: HouseVariant,
    settings: WalkSettings,
}

/// A drawn pose.
pub(crate) struct WalkedFrame {
    pub(crate) image: RgbImage,
    pub(crate) ms: Vec<f64>,
    pub(crate) stats: WalkStats,
}

impl HouseContent {
    /// Opens a file. The variant is one of [`HouseVariant::ALL`], or the first kind that the file holds.
    pub(crate) fn open(
        path: &Path,
        variant: Option<&str>,
    ) -> anyhow::Result<(Self, FileFrame, DefaultCamera)> {
        let (house, store, quality) = file::read(path, BUDGET)?;
        let variant = match variant {
            Some(name) => variant_by_name(name)?,
            None => HouseVariant::of_store(&store),
        };
        let settings = variant.settings();
        let camera = DefaultCamera::like(&first_view(&house)?);
        let frame = house.scene().frame;
        Ok((
            Self {
                house,
                store,
                quality,
                walker: Walker::new(),
                variant,
                settings,
            },
            frame,
            camera,
        ))
    }

    pub(crate) fn variant(&self) -> &'static str {
        self.variant.name
    }

    /// Draws a pose `repeat` times. Backdrops that the file lacks are captured first, which is not timed.
    pub(crate) fn render(&mut self, camera: &Camera, repeat: u32) -> anyhow::Result<WalkedFrame> {
        let Self {
            house,
            store,
            quality,
            walker,
            settings,
            ..
        } = self;
        Walker::prepare(house, store, camera, settings, quality)?;
        let mut ms = Vec::with_capacity(repeat as usize);
        loop {
            let (frame, stats) = walker.frame(house, store, camera, settings);
            ms.push(stats.frame_ms);
            if ms.len() >= repeat as usize {
                if stats.cell.is_none() {
                    eprintln!(
                        "note: the eye is in no cell (inside a wall?); all cells are drawn as geometry"
                    );
                }
                return Ok(WalkedFrame {
                    image: frame.to_rgb()?,
                    ms,
                    stats: stats.clone(),
                });
            }
        }
    }
}

/// `headbox info` of a `.house` file. Reading checks all that a walk relies on.
pub(crate) fn info(path: &Path, check: bool, as_json: bool) -> anyhow::Result<()> {
    let (house, store, _) = file::read(path, u64::MAX)?;
    let bytes = std::fs::metadata(path)
        .with_context(|| format!("{}", path.display()))?
        .len();
    let (plan, captures) = (house.plan(), store.all());
    let of_kind = |kind: BackdropKind| {
        let of_kind = captures.iter().filter(|((_, of), _)| *of == kind);
        of_kind.fold((0u64, 0u64, 0u64), |(n, samples, bytes), (_, backdrop)| {
            (
                n + 1,
                samples + backdrop.sample_count(),
                bytes + backdrop.bytes(),
            )
        })
    };
    let depth_pixels: u64 = captures
        .iter()
        .map(|(_, backdrop)| backdrop.sample_count())
        .sum();
    if as_json {
        let kinds: Vec<_> = BackdropKind::ALL
            .iter()
            .map(|(name, kind)| {
                let (count, samples, bytes) = of_kind(*kind);
                json!({"name": name, "captures": count, "samples": samples, "bytes": bytes})
            })
            .collect();
        print_json(&json!({
            "kind": file::HOUSE_FILE.name, "bytes": bytes, "depth_pixels": depth_pixels, "faces": [],
            "cells": plan.cells.len(), "portals": plan.portals.len(), "triangles": house.scene().triangles.len(),
            "backdrops": kinds, "ok": true,
        }));
        return Ok(());
    }
    println!(
        "{}: {}, {bytes} bytes",
        path.display(),
        file::HOUSE_FILE.name
    );
    println!("  scene       {}", house.scene().name);
    println!(
        "  model       {} cells, {} portals",
        plan.cells.len(),
        plan.portals.len()
    );
    println!("  geometry    {} triangles", house.scene().triangles.len());
    for (name, kind) in BackdropKind::ALL {
        let (count, samples, bytes) = of_kind(kind);
        if count > 0 {
            println!("  {name:11} {count} captures, {samples} samples, {bytes} bytes");
        }
    }
    if check {
        println!("ok: every promise of the layout holds");
    }
    Ok(())
}
