//! `headbox export`.

use crate::output::{EXPORT, Outputs, print_json, print_warnings};
use crate::progress::Bar;
use anyhow::{Context, bail};
use clap::Args;
use headbox_core::cube_face::Face;
use headbox_core::files;
use headbox_core::progress::Progress;
use headbox_core::view::View;
use headbox_cube::pack::CubeLdi;
use headbox_export::ExportError;
use headbox_export::deep::Faces;
use headbox_export::mesh::glb::GlbBudget;
use headbox_views::{ExportOptions, ExportSummary, Exporter, ViewError};
use serde_json::json;
use std::io;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct ExportCommand {
    /// Input .ldi, .sprite, .house or .lumi file; .house and .lumi only as .html
    file: PathBuf,
    /// Output file, whose extension selects the format: .html, an offline page to look around in,
    /// or to walk through a house; .glb for engines, or with --gaussians as splats; .ply, flat
    /// Gaussians of 3D Gaussian splatting, or plain points with --points; .exr for compositing,
    /// deep or, with --layers, flat
    #[arg(short, long)]
    output: PathBuf,
    /// Title of the .html page; the name of the input file by default
    #[arg(long)]
    title: Option<String>,
    /// Maximum number of triangles of a .glb, at least 2; 200000 by default
    #[arg(long, value_name = "N", value_parser = parse_triangles)]
    triangles: Option<u64>,
    /// Write Gaussians to a .glb (KHR_gaussian_splatting) instead of triangles. N is their maximum
    /// number, also in a .ply, or that of points with --points: neighbours on one surface are
    /// merged, those first that the headbox sees least; all that fit into 100 MB by default
    #[arg(long, value_name = "N", num_args = 0..=1, value_parser = parse_gaussians)]
    gaussians: Option<Option<u64>>,
    /// Maximum size of a .glb or .ply, MB of 10^6 bytes: fewer Gaussians, or fewer triangles and
    /// coarser textures
    #[arg(long, value_name = "M", value_parser = parse_megabytes)]
    mb: Option<f64>,
    /// Write plain points with normal and colour to a .ply instead of Gaussians
    #[arg(long)]
    points: bool,
    /// Number of flat layers of an .exr, 1 to 64, instead of deep data: one part per layer, nearest
    /// first; the last holds everything deeper
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=64))]
    layers: Option<u64>,
    /// Single face of the cube in an .exr, as the image of a camera of 90 degrees: +X, -X, +Y, -Y,
    /// +Z or -Z; all six, stacked as in OpenEXR environment maps, by default
    #[arg(long, value_name = "FACE", allow_hyphen_values = true, value_parser = parse_face)]
    face: Option<Face>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

fn parse_triangles(text: &str) -> Result<u64, String> {
    let count = text.parse().ok().filter(|count| *count >= 2);
    count.ok_or_else(|| "give a number of triangles, at least 2".into())
}

fn parse_gaussians(text: &str) -> Result<u64, String> {
    let count = text.parse().ok().filter(|count| *count >= 1);
    count.ok_or_else(|| "give a number of Gaussians, at least 1".into())
}

fn parse_megabytes(text: &str) -> Result<f64, String> {
    let megabytes = text.parse().ok().filter(|mb| *mb > 0.0 && *mb <= 1e9);
    megabytes.ok_or_else(|| "give MB above 0, up to 1e9".into())
}

fn parse_face(text: &str) -> Result<Face, String> {
    let found = Face::ALL
        .into_iter()
        .find(|face| face.name().eq_ignore_ascii_case(text));
    found.ok_or_else(|| "give +X, -X, +Y, -Y, +Z or -Z".into())
}

/// Maximum size of Gaussians and points without another budget, bytes: viewers open more slowly or
/// not at all.
const DEFAULT_BYTES: u64 = 100_000_000;

impl ExportCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        Outputs::new(self.json, [&self.file]).file(&self.output, &EXPORT)?;
        let ending = self
            .output
            .extension()
            .unwrap_or_default()
            .to_ascii_lowercase();
        let options: [(bool, &str, &[&str]); 7] = [
            (self.title.is_some(), "--title", &["html"]),
            (self.triangles.is_some(), "--triangles", &["glb"]),
            (self.gaussians.is_some(), "--gaussians", &["glb", "ply"]),
            (self.mb.is_some(), "--mb", &["glb", "ply"]),
            (self.points, "--points", &["ply"]),
            (self.layers.is_some(), "--layers", &["exr"]),
            (self.face.is_some(), "--face", &["exr"]),
        ];
        for (given, name, endings) in options {
            if given && !endings.iter().any(|wanted| ending == *wanted) {
                let is_page = name == "--mb" && ending == "html";
                let advice = if is_page {
                    "; for a smaller page, capture with --quality good or draft, or a smaller --face-size"
                } else {
                    ""
                };
                bail_usage!("{name} is for .{} files{advice}", endings.join(" and ."));
            }
        }
        if self.gaussians.is_some() && self.triangles.is_some() {
            bail_usage!("--triangles and --gaussians are two contents of a .glb; leave one out");
        }
        let Some(representation) = headbox_views::find(&self.file) else {
            // The reader of cubes has the best error message for other and missing files.
            CubeLdi::read(&self.file)?;
            bail!("{}: cannot be exported", self.file.display())
        };
        let mut exporters = representation.exporters.iter();
        let Some(exporter) = exporters.find(|exporter| ending == exporter.extension) else {
            let known = representation.exporters.iter();
            let known: Vec<_> = known.map(|it| format!(".{}", it.extension)).collect();
            bail!(
                "{} is a {}, which is exported as {} alone",
                self.file.display(),
                representation.name,
                known.join(", ")
            )
        };
        let view = (representation.open)(&self.file)?;
        let (count, primitive) = view.primitives();
        let mut report =
            json!({"output": self.output.to_string_lossy(), primitive.replace(' ', "_"): count});
        let summary = self.write(&*view, exporter)?;
        print_warnings(&summary.warnings);
        for (name, value) in summary.figures {
            report[name] = value;
        }
        let bytes = std::fs::metadata(&self.output).map_or(0, |found| found.len());
        report["bytes"] = bytes.into();
        if self.json {
            print_json(&report);
        } else {
            println!(
                "{}: {:.1} MB{}",
                self.output.display(),
                bytes as f64 / 1e6,
                summary.details
            );
            if let Some(viewer) = self.viewer(exporter) {
                println!("look at it: open it in {viewer}");
            }
            if self.has_default_budget(exporter) && bytes > DEFAULT_BYTES / 100 * 98 {
                eprintln!("note: merged to 100 MB; --mb or --gaussians chooses another size");
            }
        }
        Ok(())
    }

    /// Returns the programs that show the output, if it is for such.
    fn viewer(&self, exporter: &Exporter) -> Option<&'static str> {
        match exporter.extension {
            "html" => Some("a browser"),
            "glb" if self.gaussians.is_some() => Some("a viewer of Gaussian splats"),
            "glb" => Some("Blender or another viewer of glTF"),
            "ply" if self.points => Some("MeshLab or CloudCompare"),
            "ply" => Some("a viewer of Gaussian splats"),
            _ => None,
        }
    }

    /// Returns true if Gaussians or points are written without a requested budget.
    fn has_default_budget(&self, exporter: &Exporter) -> bool {
        let has_many = exporter.extension == "ply" || self.gaussians.is_some();
        has_many && self.mb.is_none() && self.gaussians.flatten().is_none()
    }

    /// Writes the output, completely or not at all.
    fn write(&self, view: &dyn View, exporter: &Exporter) -> anyhow::Result<ExportSummary> {
        let options = ExportOptions {
            title: self
                .title
                .clone()
                .unwrap_or_else(|| default_title(&self.file)),
            triangles: self.triangles.unwrap_or(GlbBudget::default().triangles),
            has_gaussians: self.gaussians.is_some(),
            gaussians: self.gaussians.flatten(),
            bytes: match self.mb {
                Some(mb) => Some((mb * 1e6) as u64),
                None => self.has_default_budget(exporter).then_some(DEFAULT_BYTES),
            },
            points: self.points,
            layers: self.layers.map(|layers| layers as usize),
            faces: self.face.map_or(Faces::All, Faces::One),
        };
        let bar = Bar::new();
        bar.begin("preparing", "steps", 1);
        let mut outcome = Err(ViewError::Other("nothing was written".into()));
        let written = files::write_whole(&self.output, |mut to| {
            outcome = (exporter.write)(view, &options, &bar, &mut to);
            match &outcome {
                Ok(_) => Ok(()),
                Err(_) => Err(io::Error::other("the export failed")),
            }
        });
        bar.finish();
        match outcome {
            Err(ViewError::Write(error)) | Err(ViewError::Export(ExportError::Io(error))) => {
                Err(error)
                    .with_context(|| format!("{} could not be written", self.output.display()))
            }
            Err(error) => Err(error).with_context(|| self.file.display().to_string()),
            Ok(summary) => {
                written
                    .with_context(|| format!("{} could not be written", self.output.display()))?;
                Ok(summary)
            }
        }
    }
}

/// Name of a file without folder and extension.
fn default_title(path: &Path) -> String {
    path.file_stem().map_or_else(
        || "headbox".into(),
        |stem| stem.to_string_lossy().into_owned(),
    )
}
