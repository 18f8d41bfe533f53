//! `headbox export`.

pub(crate) mod input;

use crate::commands::export::input::ExportInput;
use crate::output::{EXPORT, Outputs, print_json};
use crate::words::UsageError;
use anyhow::Context;
use clap::Args;
use headbox_core::cube_face::Face;
use headbox_core::files;
use headbox_cube::pack::CubeLdi;
use headbox_export::deep;
use headbox_export::deep::{DeepSummary, Faces};
use headbox_export::{ExportError, glb, ply, splats};
use serde_json::{Value, json};
use std::io;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct ExportCommand {
    /// A .ldi, .sprite, .house or .lumi file; the latter two as pages alone
    file: PathBuf,
    /// What to write; its ending decides the format: .html, a page to look around in that works
    /// offline, of a house to walk through; .glb for engines; .ply, flat Gaussians as of 3D
    /// Gaussian splatting, or plain points with --points; .exr for compositing, deep or with
    /// --layers flat
    #[arg(short, long)]
    output: PathBuf,
    /// What the page is called; the name of the file if absent
    #[arg(long)]
    title: Option<String>,
    /// The most triangles of a .glb; 200000 if absent
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..))]
    triangles: Option<u64>,
    /// Write plain points with normal and colour to a .ply
    #[arg(long)]
    points: bool,
    /// Flat layers of an .exr, each a part, nearest first, instead of deep data; the last holds all
    /// that lies deeper
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    layers: Option<u64>,
    /// The one face of the cube that an .exr holds, as the picture of a camera of 90 degrees: +X,
    /// -X, +Y, -Y, +Z or -Z; all six, one above another as OpenEXR's environment maps have them, if
    /// absent
    #[arg(long, value_name = "FACE", allow_hyphen_values = true, value_parser = parse_face)]
    face: Option<Face>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

fn parse_face(text: &str) -> Result<Face, String> {
    let found = Face::ALL
        .into_iter()
        .find(|face| face.name().eq_ignore_ascii_case(text));
    found.ok_or_else(|| "give +X, -X, +Y, -Y, +Z or -Z".into())
}

/// Triangles of a .glb unless something else is said.
const TRIANGLES: u64 = 200_000;

impl ExportCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        Outputs::new(self.json, [&self.file]).file(&self.output, &EXPORT)?;
        let ending = self
            .output
            .extension()
            .unwrap_or_default()
            .to_ascii_lowercase();
        for (given, name, wanted) in [
            (self.title.is_some(), "--title", "html"),
            (self.triangles.is_some(), "--triangles", "glb"),
            (self.points, "--points", "ply"),
            (self.layers.is_some(), "--layers", "exr"),
            (self.face.is_some(), "--face", "exr"),
        ] {
            if given && ending != wanted {
                return Err(UsageError(format!("{name} is for .{wanted} files")).into());
            }
        }
        let exported = ExportInput::open(&self.file)?;
        let (amount, of_what) = exported.amount();
        let mut told = json!({"output": self.output, of_what.replace(' ', "_"): amount});
        self.write_as(ending.to_str(), exported, &mut told)?;
        let bytes = std::fs::metadata(&self.output).map_or(0, |found| found.len());
        told["bytes"] = bytes.into();
        if self.json {
            print_json(&told);
        } else {
            println!(
                "{}: {:.1} MB{}",
                self.output.display(),
                bytes as f64 / 1e6,
                told["words"].as_str().unwrap_or("")
            );
        }
        Ok(())
    }

    fn write_as(
        &self,
        ending: Option<&str>,
        exported: ExportInput,
        told: &mut Value,
    ) -> anyhow::Result<()> {
        let of_file = || self.file.display().to_string();
        if !matches!(ending, Some("glb" | "ply" | "exr")) {
            let name = self.title.clone().unwrap_or_else(|| name_of(&self.file));
            let page = exported.page(&name).with_context(of_file)?;
            return self.write(|to| Ok(page.write(to)?));
        }
        let cube = exported.cube(&self.file)?;
        match ending {
            Some("glb") => self.glb(&cube, told).with_context(of_file),
            Some("ply") => self.write(|to| match self.points {
                true => ply::write_points(&cube, to),
                false => splats::write_ply(&cube, to),
            }),
            _ => self.exr(&cube, told).with_context(of_file),
        }
    }

    fn glb(&self, cube: &CubeLdi, told: &mut Value) -> anyhow::Result<()> {
        let mut summary = None;
        self.write(|to| {
            summary = Some(glb::write(cube, self.triangles.unwrap_or(TRIANGLES), to)?);
            Ok(())
        })?;
        let Some(summary) = summary else {
            return Ok(());
        };
        let (triangles, error_px, dropped) =
            (summary.triangles, summary.error_px, summary.dropped_samples);
        (told["triangles"], told["error_px"], told["dropped_samples"]) =
            (triangles.into(), error_px.into(), dropped.into());
        told["words"] =
            format!(", {triangles} triangles, samples off by up to {error_px:.1} face pixels")
                .into();
        if dropped > 0 {
            eprintln!(
                "warning: {dropped} samples, in the smallest pieces of surfaces, are left out to stay within the budget; give \
                 more --triangles, or capture with a smaller --face-size"
            );
        }
        Ok(())
    }

    fn exr(&self, cube: &CubeLdi, told: &mut Value) -> anyhow::Result<()> {
        let faces = self.face.map_or(Faces::All, Faces::One);
        let mut summary = None;
        self.write(|to| {
            summary = Some(match self.layers {
                Some(layers) => deep::write_layers(cube, faces, layers as usize, to)?,
                None => deep::write(cube, faces, to)?,
            });
            Ok(())
        })?;
        let Some(DeepSummary {
            samples,
            size_px: [width, height],
        }) = summary
        else {
            return Ok(());
        };
        (told["samples"], told["size"]) = (samples.into(), json!([width, height]));
        let layers = self
            .layers
            .map_or_else(|| "deep".into(), |layers| format!("{layers} layers"));
        told["words"] = format!(", {width}x{height}, {layers}, of {samples} samples").into();
        Ok(())
    }

    /// Writes the output, whole or not at all.
    fn write(
        &self,
        write: impl FnOnce(&mut dyn io::Write) -> Result<(), ExportError>,
    ) -> anyhow::Result<()> {
        let written = files::write_whole(&self.output, |mut to| match write(&mut to) {
            Err(ExportError::Io(error)) => Err(error),
            other => other.map_err(io::Error::other),
        });
        written.with_context(|| format!("{} could not be written", self.output.display()))
    }
}

/// The name of a file without folder and ending.
fn name_of(path: &Path) -> String {
    path.file_stem().map_or_else(
        || "headbox".into(),
        |stem| stem.to_string_lossy().into_owned(),
    )
}
