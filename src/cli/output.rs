//! What goes to standard output, and what the process has used.

use crate::capture::picture;
use anyhow::Context;
use std::io::Write;
use std::path::Path;

/// Prints one JSON object on standard output.
pub(super) fn print_json(value: &serde_json::Value) {
    println!("{value:#}");
}

/// Prints on standard output. Where nobody reads it any more, the program ends: quietly if a reader has gone, as `head`
/// does, else with a sentence.
pub(super) fn print_text(text: std::fmt::Arguments<'_>) {
    if let Err(error) = std::io::stdout().write_fmt(text) {
        if error.kind() == std::io::ErrorKind::BrokenPipe {
            std::process::exit(0);
        }
        eprintln!("error: standard output could not be written: {error}");
        std::process::exit(1);
    }
}

/// Prints what a loader met and survived to standard error.
pub(super) fn print_notes(scene: &crate::capture::Scene) {
    for note in &scene.summary.notes {
        eprintln!("note: {note}");
    }
}

/// Peak and present resident memory of this process in bytes, where the system tells (Linux).
pub(super) fn memory_bytes() -> Option<(u64, u64)> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let field = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
    };
    Some((field("VmHWM:")?, field("VmRSS:")?))
}

/// Peak resident memory in MiB.
pub(super) fn peak_rss_mb() -> Option<f64> {
    memory_bytes().map(|(peak, _)| peak as f64 / 1_048_576.0)
}

/// Saves an image as PNG, whole or not at all.
pub(super) fn save_png(path: &Path, image: &image::RgbImage) -> anyhow::Result<()> {
    let (width, height) = image.dimensions();
    let png = picture::png(image.as_raw(), width, height, image::ExtendedColorType::Rgb8)?;
    let written = crate::files::write_atomically(path, |w| w.write_all(&png));
    written.with_context(|| format!("{} could not be written", path.display()))
}

/// Writes a text file, whole or not at all.
pub(super) fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    let written = crate::files::write_atomically(path, |w| w.write_all(text.as_bytes()));
    written.with_context(|| format!("{} could not be written", path.display()))
}
