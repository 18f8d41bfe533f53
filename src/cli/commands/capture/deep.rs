//! `headbox capture F.exr`: cube LDIs from deep images of film renderers; description of deep
//! images.

use crate::output::{CUBE, Outputs, has_extension, peak_rss_mb, print_json};
use crate::packing::{PackingArgs, describe_cube};
use anyhow::{Context, bail};
use headbox_images::deep_exr::{DeepImage, DeepView};
use headbox_ldi::from_deep::{DeepCameraOptions, cube};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

/// Returns true if a scene's name is the path of a deep image.
pub(crate) fn is_deep_picture(name: &str) -> bool {
    !name.starts_with("builtin:") && has_extension(Path::new(name), "exr")
}

/// Reads a deep image and writes its cube. Positions and lengths are metres, Y up.
pub(super) fn run(
    name: &str,
    output: &Path,
    place: DeepCameraOptions,
    packing: &PackingArgs,
    as_json: bool,
) -> anyhow::Result<()> {
    let start = Instant::now();
    Outputs::new(as_json, [name]).file(output, &CUBE)?;
    let image = DeepImage::read(Path::new(name))?;
    let samples = image.offsets.last().copied().unwrap_or_default();
    let packed = packing.pack(cube(&image, place).with_context(|| name.to_owned())?)?;
    if packed.depth_pixel_count() == 0 && packed.planes.tiles.is_empty() {
        bail!(
            "{name}: all samples are so far that nothing moves within the headbox; give a larger --half-size"
        );
    }
    packed.write(output)?;
    let total_s = start.elapsed().as_secs_f64();
    if as_json {
        print_json(&json!({
            "samples": samples,
            "total_s": total_s,
            "peak_rss_mb": peak_rss_mb(),
            "depth_pixels": packed.depth_pixel_count(),
            "center": packed.info.frame.file_from_world(packed.info.centre),
            "half_size": packed.info.half_size_m / packed.info.frame.unit_m,
            "bytes": packed.bytes(),
            "face_size": packed.face_size_px,
        }));
        return Ok(());
    }
    println!(
        "{}: {} from {samples} deep samples, {total_s:.2} s",
        output.display(),
        describe_cube(&packed)
    );
    println!(
        "look at it: headbox render {} -o frame.png",
        output.display()
    );
    Ok(())
}

/// Describes a deep image: `headbox images F.exr`, `headbox info F.exr`.
pub(crate) fn describe(path: &Path, as_json: bool) -> anyhow::Result<()> {
    let image = DeepImage::read(path)?;
    let samples = image.offsets.last().copied().unwrap_or_default();
    let most = image
        .offsets
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .max()
        .unwrap_or_default();
    let channels: Vec<&str> = image
        .channels
        .iter()
        .map(|channel| channel.name.as_str())
        .collect();
    let depths = image
        .channel("Z")
        .unwrap_or_default()
        .iter()
        .copied()
        .filter(|z| *z > 0.0 && z.is_finite());
    let range = depths.fold(None, |range, z| {
        let [near, far] = range.unwrap_or([z, z]);
        Some([z.min(near), z.max(far)])
    });
    let DeepView {
        cube,
        world_to_camera,
        world_to_ndc,
    } = image.view;
    let (camera, needs) = match (cube, world_to_camera.is_some(), world_to_ndc.is_some()) {
        (true, ..) => ("all directions: six faces, one above another", ""),
        (false, true, true) => ("in the header (worldToCamera, worldToNDC)", ""),
        (false, true, false) => (
            "position in the header (worldToCamera), without a field of view",
            " --fov DEG",
        ),
        (false, false, _) => (
            "not in the header: at the origin looking along -Z unless specified",
            " --fov DEG",
        ),
    };
    let [width, height] = image.size_px;
    if as_json {
        print_json(&json!({
            "kind": "deep EXR",
            "size": image.size_px,
            "samples": samples,
            "most_in_a_pixel": most,
            "channels": channels,
            "depth": range,
            "cube": cube,
            "knows_camera": needs.is_empty(),
        }));
        return Ok(());
    }
    println!("{}: deep EXR, {width}x{height} px", path.display());
    println!("  samples     {samples}, at most {most} in a pixel");
    println!("  channels    {}", channels.join(", "));
    match range {
        Some([near, far]) => println!("  depth       from {near:.3} to {far:.3}"),
        None => println!("  depth       unknown (channel Z)"),
    }
    println!("  camera      {camera}");
    println!(
        "capture it: headbox capture {}{needs} -o F.ldi",
        path.display()
    );
    Ok(())
}
