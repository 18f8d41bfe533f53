//! `.house` files in other commands: walked by `headbox render`, described by `headbox info`.

use crate::args::DefaultCamera;
use crate::output::print_json;
use crate::words::UsageError;
use anyhow::Context;
use glam::DVec3;
use headbox_core::camera::{Camera, CameraError};
use headbox_core::file_frame::FileFrame;
use headbox_house::backdrop::{BackdropKind, BackdropQuality};
use headbox_house::file;
use headbox_house::house::House;
use headbox_house::settings::{WalkSettings, WalkStats};
use headbox_house::store::Store;
use headbox_house::variant::HouseVariant;
use headbox_house::walk::Walker;
use headbox_house::walk_path::WalkPath;
use image::RgbImage;
use serde::Serialize;
use serde_json::json;
use std::path::Path;

/// Memory for backdrops, bytes.
const BUDGET: u64 = 4 << 30;

/// Prints a note about the rooms that a walk does not visit.
pub(crate) fn note_unvisited(walk: &WalkPath, house: &House) {
    let unvisited = walk.unvisited(house);
    if !unvisited.is_empty() {
        eprintln!(
            "note: no door leads to {}: the walk does not go there",
            unvisited.join(", ")
        );
    }
}

/// Finds a kind of backdrop, or returns an error with the names of all.
pub(super) fn kind_by_name(name: &str) -> Result<BackdropKind, UsageError> {
    let mut kinds = BackdropKind::ALL.into_iter();
    kinds.find(|kind| kind.name() == name).ok_or_else(|| {
        UsageError(format!(
            "there is no backdrop \"{name}\"; there are: {}",
            BackdropKind::ALL.map(BackdropKind::name).join(", ")
        ))
    })
}

/// Finds a variant of walks, or returns an error with the names of all.
pub(crate) fn variant_by_name(name: &str) -> Result<HouseVariant, UsageError> {
    HouseVariant::by_name(name).ok_or_else(|| {
        UsageError(format!(
            "there is no variant \"{name}\"; there are: {}",
            HouseVariant::names()
        ))
    })
}

/// The default camera of a house: the start of a walk, or the middle of the model if there is no
/// place to stand.
pub(crate) fn first_view(house: &House) -> Result<Camera, CameraError> {
    let walk = WalkPath::default();
    let middle = house.tracer().origin();
    let target = middle + DVec3::NEG_Z;
    let from_middle = || Camera::look_at(middle, target, DVec3::Y, walk.fov_y_deg, walk.size);
    WalkPath::first(house)?.map_or_else(from_middle, Ok)
}

/// An opened `.house` file.
pub(crate) struct HouseContent {
    house: House,
    store: Store,
    quality: BackdropQuality,
    walker: Walker,
    variant: HouseVariant,
    settings: WalkSettings,
}

/// A frame of a walk.
pub(crate) struct WalkedFrame {
    pub(crate) image: RgbImage,
    pub(crate) ms: Vec<f64>,
    pub(crate) stats: WalkStats,
}

impl HouseContent {
    /// Opens a file. The variant is one of [`HouseVariant::ALL`]; by default the first kind in the
    /// file.
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
        let content = Self {
            house,
            store,
            quality,
            walker: Walker::new(),
            variant,
            settings,
        };
        Ok((content, frame, camera))
    }

    pub(crate) fn variant(&self) -> &'static str {
        self.variant.name
    }

    /// Renders a pose `repeat` times. Missing backdrops are captured first, which is not timed.
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

/// Totals of the backdrops of one kind.
#[derive(Default, Serialize)]
struct KindTotals {
    name: &'static str,
    captures: u64,
    samples: u64,
    bytes: u64,
}

impl KindTotals {
    fn new(kind: BackdropKind, store: &Store) -> Self {
        let mut totals = Self {
            name: kind.name(),
            ..Self::default()
        };
        for ((_, backdrop_kind), backdrop) in store.all() {
            if backdrop_kind == kind {
                totals.captures += 1;
                totals.samples += backdrop.sample_count();
                totals.bytes += backdrop.bytes();
            }
        }
        totals
    }
}

/// `headbox info` of a `.house` file. Reading checks everything that a walk relies on.
pub(crate) fn info(path: &Path, check: bool, as_json: bool) -> anyhow::Result<()> {
    let (house, store, _) = file::read(path, u64::MAX)?;
    let bytes = std::fs::metadata(path)
        .with_context(|| format!("{}", path.display()))?
        .len();
    let plan = house.plan();
    let kinds = BackdropKind::ALL.map(|kind| KindTotals::new(kind, &store));
    if as_json {
        print_json(&json!({
            "kind": file::HOUSE_FILE.name,
            "bytes": bytes,
            "depth_pixels": kinds.iter().map(|kind| kind.samples).sum::<u64>(),
            "faces": [],
            "cells": plan.cells.len(),
            "portals": plan.portals.len(),
            "triangles": house.scene().triangles.len(),
            "backdrops": kinds,
            "ok": true,
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
    for kind in kinds.iter().filter(|kind| kind.captures > 0) {
        let KindTotals {
            name,
            captures,
            samples,
            bytes,
        } = kind;
        println!("  {name:11} {captures} captures, {samples} samples, {bytes} bytes");
    }
    if check {
        println!("ok: every promise of the layout holds");
    }
    Ok(())
}
