//! `headbox house`.
//!
//! * `write`: writes `.house` files and walks.
//! * [`file`]: `.house` files in other commands.

pub(crate) mod file;
mod write;

use crate::args::{LightArgs, StrictArgs};
use crate::output::{Outputs, PLAN, print_json, write_text};
use anyhow::bail;
use clap::Args;
use glam::{DVec2, DVec3};
use headbox_core::file_frame::triple;
use headbox_house::floor_plan::{FloorPlan, storeys};
use headbox_model::load::{LoadedModel, ModelOptions, load_model};
use headbox_model::{Finding, PortalModel, Severity};
use headbox_trace::bvh::Tracer;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use write::HouseFileArgs;

#[derive(Args)]
pub(crate) struct HouseCommand {
    /// Home or model: a Sweet Home 3D .sh3d, Home.xml with its OBJ export in the same folder, a
    /// .toml model, or builtin:house
    model: String,
    /// Draw the floor plan of each storey; storeys above the first are numbered: plan.svg,
    /// plan_2.svg
    #[arg(long, value_name = "PLAN.svg")]
    plan: Option<PathBuf>,
    /// Height of the plan's cutting plane above the floor, metres
    #[arg(long, value_name = "M", default_value_t = 1.1)]
    cut: f64,
    /// Keep door and window leaves, which close the openings
    #[arg(long)]
    keep_doors: bool,
    /// Maximum number of triangles of builtin:house
    #[arg(long, value_name = "N", default_value_t = headbox_scenes::HOUSE_TRIANGLES)]
    triangles: usize,
    /// Seed of builtin:house and of the rays that search for leaks
    #[arg(long, value_name = "K", default_value_t = 0)]
    seed: u64,
    /// Number of rays from each cell that search for leaks; 0 skips the search
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = clap::value_parser!(u32).range(0..=1 << 20))]
    rays: u32,
    #[command(flatten)]
    light: LightArgs,
    #[command(flatten)]
    strict: StrictArgs,
    #[command(flatten)]
    file: HouseFileArgs,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// A loaded model with the findings about it.
struct Survey {
    model: PortalModel,
    findings: Vec<Finding>,
}

impl HouseCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let outputs =
            Outputs::new(self.json, [&self.model]).maybe_file(self.plan.as_ref(), &PLAN)?;
        let outputs = self.file.add_outputs(outputs)?;
        let writes = self.file.check(&self.light.parameters())?;
        let LoadedModel {
            mut model,
            mut findings,
        } = self.open()?;
        model.scene.set_light(&self.light.parameters())?;
        outputs.add_scene(&self.model, &model.scene, self.strict)?;
        if self.rays > 0 && !model.cells.is_empty() {
            let [low, high] = model.scene.bounds();
            let tracer = Tracer::new(Arc::new(model.scene.clone()), (low + high) / 2.0);
            findings.extend(model.leaks(&tracer, self.rays, self.seed));
        }
        let frame = model.scene.frame;
        let findings = findings
            .into_iter()
            .map(|finding| finding.in_file(&frame))
            .collect();
        let survey = Survey { model, findings };
        let has_room = survey.model.cells.iter().any(|cell| !cell.space.is_empty());
        let lacks_space = |finding: &Finding| matches!(finding, Finding::NoSpace { .. });
        if writes && !has_room && survey.findings.iter().any(lacks_space) {
            bail!("no room has space; a .toml model gives it with [[cell.prism]]");
        }
        let plans = self
            .plan
            .as_ref()
            .map(|path| self.write_plans(&survey.model, path))
            .transpose()?
            .unwrap_or_default();
        let mut report = survey.to_json();
        let names = plans.iter().map(|path| path.to_string_lossy());
        report["plans"] = names.collect();
        if !self.json {
            survey.print();
        }
        if writes {
            let written = self.file.write(survey.model)?;
            if !self.json {
                self.file.print(&written);
            }
            report["file"] = serde_json::to_value(&written)?;
        }
        if self.json {
            print_json(&report);
        }
        Ok(())
    }

    fn open(&self) -> anyhow::Result<LoadedModel> {
        match self.model.strip_prefix("builtin:") {
            Some("house") => {
                let mut model = headbox_scenes::house(self.seed, self.triangles);
                let findings = model.repair();
                Ok(LoadedModel { model, findings })
            }
            Some(other) => {
                bail_usage!("there is no built-in portal model \"{other}\"; there is builtin:house")
            }
            None => Ok(load_model(
                Path::new(&self.model),
                &ModelOptions {
                    keep_doors: self.keep_doors,
                },
            )?),
        }
    }

    /// Writes a plan for each storey; those above the first have their number in their name.
    /// Returns the paths.
    fn write_plans(&self, model: &PortalModel, path: &Path) -> anyhow::Result<Vec<PathBuf>> {
        let mut written = Vec::new();
        for (storey, floor) in (1..).zip(storeys(model)) {
            let path = storey_path(path, storey);
            write_text(&path, &FloorPlan::new(model, floor + self.cut).to_svg())?;
            written.push(path);
        }
        Ok(written)
    }
}

/// The path of a storey's plan: `plan.svg` for the first, `plan_2.svg` for the second.
fn storey_path(path: &Path, storey: usize) -> PathBuf {
    match (storey, path.file_stem(), path.extension()) {
        (2.., Some(stem), Some(ending)) => path.with_file_name(format!(
            "{}_{storey}.{}",
            stem.to_string_lossy(),
            ending.to_string_lossy()
        )),
        _ => path.to_path_buf(),
    }
}

impl Survey {
    fn cell_name(&self, cell: u32) -> &str {
        self.model
            .cells
            .get(cell as usize)
            .map_or("?", |cell| &cell.name)
    }

    /// Names of the unreachable cells.
    fn unreachable(&self) -> Vec<&str> {
        let name = |finding: &Finding| match finding {
            Finding::Unreachable { cell, .. } => Some(*cell),
            _ => None,
        };
        self.findings
            .iter()
            .filter_map(name)
            .map(|cell| self.cell_name(cell))
            .collect()
    }

    /// Names of the portals that do not touch a cell that they name.
    fn touching_no_cell(&self) -> Vec<&str> {
        let findings = self.findings.iter();
        findings
            .filter_map(|finding| match finding {
                Finding::NotAdjacent { name, .. } => Some(name.as_str()),
                _ => None,
            })
            .collect()
    }

    fn print(&self) {
        let cells = &self.model.cells;
        let portals = &self.model.portals;
        println!(
            "{} cells, {} portals, {} triangles",
            cells.len(),
            portals.len(),
            self.model.scene.triangles.len()
        );
        let frame = &self.model.scene.frame;
        println!("\nPoints are in the file's axes and unit.");
        println!("\n cell  triangles  floor m2  portals  name (a point in it)");
        for (index, cell) in (0_u32..).zip(cells) {
            let count = self.model.portals_from(index).count();
            let area = floor_area(&self.model, index);
            let floor = if area > 0.0 {
                format!("{area:.1}")
            } else {
                "-".into()
            };
            let point = file::standing_point(&cell.space, frame)
                .map_or(String::new(), |point| format!("  ({})", triple(point)));
            println!(
                "{index:5} {:10} {floor:>9} {count:8}  {}{point}",
                cell.triangles.len(),
                cell.name
            );
        }
        println!(
            "\nportal  width x height  cells (name, centre; a point half a metre away in each cell)"
        );
        for (index, portal) in portals.iter().enumerate() {
            let [width, height] = extent(portal);
            let [a, b] = portal.cells.map(|cell| self.cell_name(cell));
            let [beside_a, beside_b] = beside(portal).map(|p| triple(frame.file_from_world(p)));
            println!(
                "{index:6}   {width:4.2} x {height:4.2} m  {a} | {b}  ({}, {}; {beside_a} | {beside_b})",
                portal.name,
                triple(frame.file_from_world(centre(portal)))
            );
        }
        let list = |names: &[&str]| {
            if names.is_empty() {
                "none".into()
            } else {
                names.join(", ")
            }
        };
        println!("\nunreachable cells: {}", list(&self.unreachable()));
        println!(
            "portals that touch no cell: {}",
            list(&self.touching_no_cell())
        );
        for finding in &self.findings {
            // Not errors here: unusable parts are left out and the rest is shown, as in any scene.
            let kind = if finding.severity() == Severity::Error {
                "warning"
            } else {
                "note"
            };
            println!("{kind}: {finding}");
        }
    }

    /// Returns the JSON object; positions are in the file's axes and unit.
    fn to_json(&self) -> Value {
        let frame = &self.model.scene.frame;
        let cells: Vec<Value> = (0_u32..)
            .zip(&self.model.cells)
            .map(|(index, cell)| {
                let portals = self.model.portals_from(index).map(|(portal, _)| portal);
                json!({
                    "name": cell.name,
                    "triangles": cell.triangles.len(),
                    "floor_m2": floor_area(&self.model, index),
                    "point": file::standing_point(&cell.space, frame).map(|p| p.to_array()),
                    "portals": portals.collect::<Vec<_>>(),
                    "outside": self.model.outside == Some(index),
                })
            })
            .collect();
        let portal = |portal: &headbox_model::Portal| {
            let [width, height] = extent(portal);
            let corner = |p: &DVec3| frame.file_from_world(*p).to_array();
            let polygon = portal.polygon.iter().map(corner);
            json!({
                "name": portal.name,
                "cells": portal.cells,
                "width_m": width,
                "height_m": height,
                "centre": frame.file_from_world(centre(portal)).to_array(),
                "beside": beside(portal).map(|p| frame.file_from_world(p).to_array()),
                "polygon": polygon.collect::<Vec<_>>(),
            })
        };
        let finding = |finding: &Finding| {
            json!({
                "severity": finding.severity().to_string(),
                "text": finding.to_string(),
            })
        };
        json!({
            "cells": cells,
            "portals": self.model.portals.iter().map(portal).collect::<Vec<_>>(),
            "triangles": self.model.scene.triangles.len(),
            "unreachable": self.unreachable(),
            "touching_no_cell": self.touching_no_cell(),
            "findings": self.findings.iter().map(finding).collect::<Vec<_>>(),
            "notes": self.model.scene.summary.notes,
        })
    }
}

/// Area of a cell's first prism in plan, square metres: its floor without the niches of its doors.
fn floor_area(model: &PortalModel, cell: u32) -> f64 {
    let outline: &[DVec2] = model.cells[cell as usize]
        .space
        .first()
        .map_or(&[], |prism| &prism.outline);
    let doubled: f64 = outline
        .iter()
        .zip(outline.iter().cycle().skip(1))
        .map(|(a, b)| a.perp_dot(*b))
        .sum();
    doubled.abs() / 2.0
}

/// Width in plan and height of an opening, metres.
fn extent(portal: &headbox_model::Portal) -> [f64; 2] {
    let [low, high] = bounds(portal);
    let size = high - low;
    [size.x.hypot(size.z), size.y]
}

/// Middle of an opening, world metres.
fn centre(portal: &headbox_model::Portal) -> DVec3 {
    let [low, high] = bounds(portal);
    low.midpoint(high)
}

/// Points half a metre from the middle of an opening, in the first and the second cell, world
/// metres.
fn beside(portal: &headbox_model::Portal) -> [DVec3; 2] {
    let [a, b, c] = [0, 1, 2].map(|i| portal.polygon.get(i).copied().unwrap_or_default());
    // The corners are counter-clockwise seen from the first cell.
    let step = (b - a).cross(c - b).normalize_or_zero() * 0.5;
    [centre(portal) + step, centre(portal) - step]
}

fn bounds(portal: &headbox_model::Portal) -> [DVec3; 2] {
    let points = || portal.polygon.iter().copied();
    [
        points().reduce(DVec3::min).unwrap_or_default(),
        points().reduce(DVec3::max).unwrap_or_default(),
    ]
}
