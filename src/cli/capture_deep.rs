//! `headbox capture F.exr`: deep pictures of film renderers as cube LDIs.

use super::output::{CUBE, Outputs, peak_rss_mb, print_json};
use super::packing::{PackingArgs, what_is_kept};
use crate::capture::deep_exr::DeepImage;
use crate::ldi::from_deep::{DeepPlace, cube};
use anyhow::{Context, bail};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Whether a scene's name is that of a deep picture.
pub(super) fn is_deep_picture(name: &str) -> bool {
    !name.starts_with("builtin:")
        && Path::new(name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("exr"))
}

/// Reads a deep picture and writes its cube. Positions and lengths are metres, Y up.
pub(super) fn run(
    name: &str,
    output: &Path,
    place: DeepPlace,
    packing: &PackingArgs,
    as_json: bool,
) -> anyhow::Result<()> {
    let start = Instant::now();
    Outputs::new(as_json, [name]).file(output, &CUBE)?;
    let image = DeepImage::read(Path::new(name))?;
    let samples = image.offsets.last().copied().unwrap_or_default();
    let packed = packing.pack(cube(&image, place).with_context(|| name.to_owned())?)?;
    if packed.depth_pixel_count() == 0 && packed.planes.tiles.is_empty() {
        bail!("{name}: all of it is so far that nothing moves within the headbox; give a larger --half-size");
    }
    packed.write(output)?;
    let total_s = start.elapsed().as_secs_f64();
    if as_json {
        print_json(&json!({
            "samples": samples, "total_s": total_s, "peak_rss_mb": peak_rss_mb(), "depth_pixels": packed.depth_pixel_count(),
            "bytes": packed.bytes(), "face_size": packed.face_size_px,
        }));
        return Ok(());
    }
    println!("{}: {} from {samples} deep samples, {total_s:.2} s", output.display(), what_is_kept(&packed));
    println!("look at it: headbox render {} -o frame.png", output.display());
    Ok(())
}
