//! `.house` files in other commands, such as `headbox info`.

use crate::messages::UsageError;
use crate::output::print_json;
use anyhow::Context;
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, triple};
use headbox_house::backdrop::BackdropKind;
use headbox_house::file;
use headbox_house::house::House;
use headbox_house::store::Store;
use headbox_house::variant::HouseVariant;
use headbox_house::walk_path::WalkPath;
use headbox_model::{Cell, Prism};
use serde::Serialize;
use serde_json::json;
use std::path::Path;

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

/// Prints the description of a `.house` file: `headbox info`. Reading checks everything that a walk
/// relies on.
pub(crate) fn info(path: &Path, check: bool, as_json: bool) -> anyhow::Result<()> {
    let (house, store, _) = file::read(path, u64::MAX)?;
    let bytes = std::fs::metadata(path)
        .with_context(|| format!("{}", path.display()))?
        .len();
    let plan = house.plan();
    let kinds = BackdropKind::ALL.map(|kind| KindTotals::new(kind, &store));
    let frame = &house.scene().frame;
    let room = |cell: &Cell| Some((cell.name.clone(), standing_point(&cell.space, frame)?));
    let rooms: Vec<(String, DVec3)> = plan.cells.iter().filter_map(room).collect();
    if as_json {
        print_json(&json!({
            "kind": file::HOUSE_FILE.name,
            "bytes": bytes,
            "depth_pixels": kinds.iter().map(|kind| kind.samples).sum::<u64>(),
            "faces": [],
            "cells": plan.cells.len(),
            "rooms": rooms.iter().map(|(name, point)| json!({ "name": name, "point": point.to_array() })).collect::<Vec<_>>(),
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
    println!("  rooms       a point in each, in the file's axes and unit, for --eye:");
    for (name, point) in &rooms {
        println!("    {:20} {name}", triple(*point));
    }
    if check {
        println!("ok: every promise of the layout holds");
    }
    Ok(())
}

/// Returns a point where one can stand in a cell, in the file's axes and unit; `None` outside.
pub(super) fn standing_point(space: &[Prism], frame: &FileFrame) -> Option<DVec3> {
    let point = space.first()?.standing_point()?;
    Some(frame.file_from_world(point))
}
