//! `headbox export`.

use super::output::{EXPORT, Outputs, print_json};
use crate::capture::files;
use crate::container::{Container, FileKind};
use crate::export::page::Page;
use crate::packed::PackedCube;
use anyhow::{Context, bail};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Export {
    /// A .ldi file
    file: PathBuf,
    /// What to write; its ending decides the format: .html, a page to look around in that works offline
    #[arg(short, long)]
    output: PathBuf,
    /// What the export is called; the name of the file if absent
    #[arg(long)]
    title: Option<String>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

impl Export {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        Outputs::new(self.json, [&self.file]).file(&self.output, &EXPORT)?;
        let cube = open(&self.file)?;
        let name = self.title.clone().unwrap_or_else(|| name_of(&self.file));
        let page = Page::new(&cube, &name).with_context(|| self.file.display().to_string())?;
        files::write_whole(&self.output, |mut to| page.write(&mut to))
            .with_context(|| format!("{} could not be written", self.output.display()))?;
        let bytes = std::fs::metadata(&self.output).map_or(0, |found| found.len());
        let samples = cube.depth_pixel_count();
        if self.json {
            print_json(&json!({"output": self.output, "bytes": bytes, "depth_pixels": samples}));
        } else {
            println!("{}: {:.1} MB, {samples} depth pixels", self.output.display(), bytes as f64 / 1e6);
        }
        Ok(())
    }
}

/// A cube LDI; of other files of ours it is said what can be exported.
pub(super) fn open(path: &Path) -> anyhow::Result<PackedCube> {
    let found = Container::peek_kind(path).ok().flatten();
    let kind = found.and_then(|tag| FileKind::ALL.iter().find(|kind| kind.tag == tag));
    match kind {
        Some(kind) if kind.tag != FileKind::CUBE_LDI.tag => {
            bail!("{} is a {}, which cannot be exported yet; a cube LDI (.ldi) can", path.display(), kind.name)
        }
        _ => Ok(PackedCube::read(path)?),
    }
}

/// The name of a file without folder and ending.
pub(super) fn name_of(path: &Path) -> String {
    path.file_stem().map_or_else(|| "headbox".into(), |stem| stem.to_string_lossy().into_owned())
}
