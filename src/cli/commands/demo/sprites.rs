//! Sprites with depth in `headbox demo`: a few layers captured from the centre.

use crate::output::write_text;
use headbox_core::camera::Camera;
use headbox_core::frame::Frame;
use headbox_core::metrics;
use headbox_core::progress::Silent;
use headbox_core::statistics::median;
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use headbox_sprite::{
    DisplacementFormat, RenderOptions, SlabCapture, SpriteSet, SpriteVariant, capture_slabs,
    slabs_at_gaps,
};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use image::RgbImage;
use std::path::Path;
use std::time::Instant;

/// Maximum number of layers.
const LAYERS: usize = 4;
/// Rays per pixel of a layer.
const SAMPLES: u32 = 4;
/// Size of layers relative to frames, for eyes off the centre.
const MARGIN: f64 = 1.5;

/// Captures sprites from the first camera, renders them for all cameras by the paper's main
/// variants, and prints time and error (against `truths`, one for each camera). Writes
/// `demo.sprite` and `sprites.csv` to `folder`.
pub(super) fn print_sprite_rows(
    folder: &Path,
    tracer: &Tracer,
    lighting: &Lighting,
    cameras: &[Camera],
    truths: &[RgbImage],
) -> anyhow::Result<()> {
    let [first, ..] = cameras else { return Ok(()) };
    let start = Instant::now();
    let wider = |side: u32| (f64::from(side) * MARGIN) as u32;
    let (width, height) = (wider(first.width()), wider(first.height()));
    let taken = Camera::from_parts(
        first.eye(),
        first.world_from_eye(),
        first.focal_px(),
        width,
        height,
    )?;
    let capture = SlabCapture {
        tracer,
        lighting,
        lit: true,
        samples: SAMPLES,
        format: DisplacementFormat::default(),
    };
    let slabs = slabs_at_gaps(tracer, &taken, LAYERS);
    let mut set = SpriteSet::new(capture_slabs(&capture, &taken, &slabs, &Silent)?);
    set.environment = lighting.environment();
    set.write(&folder.join("demo.sprite"))?;
    let count = set.sprites().len();
    let layers = Composition::new(set, Vec::new());
    println!(
        "\n{count} sprites with depth of {width}x{height} pixels, taken from the centre in {:.1} s:",
        start.elapsed().as_secs_f64()
    );
    println!("variant       ms/frame    FLIP at the centre    off centre");
    let mut csv = String::from("variant,ms,flip_centre,flip_off_centre\n");
    for variant in [
        SpriteVariant::Homography,
        SpriteVariant::OnePass,
        SpriteVariant::TwoPass,
    ] {
        let (ms, flips) = draw(&layers, variant, cameras, truths)?;
        let off_centre = flips[1..].iter().sum::<f64>() / (flips.len() - 1).max(1) as f64;
        println!(
            "{:<12} {ms:>9.2} {:>21.4} {off_centre:>13.4}",
            variant.name(),
            flips[0]
        );
        csv += &format!("{},{ms:.3},{},{off_centre}\n", variant.name(), flips[0]);
    }
    write_text(&folder.join("sprites.csv"), &csv)
}

/// Renders all cameras; returns the median time of a frame, ms, and the FLIP error of each camera.
fn draw(
    layers: &Composition,
    variant: SpriteVariant,
    cameras: &[Camera],
    truths: &[RgbImage],
) -> anyhow::Result<(f64, Vec<f64>)> {
    const REPEATS: usize = 3;
    let settings = ComposeSettings {
        sprites: RenderOptions {
            variant,
            ..RenderOptions::default()
        },
        ..ComposeSettings::default()
    };
    let (mut composer, mut frame) = (Composer::default(), Frame::default());
    let (mut ms, mut flips) = (Vec::new(), Vec::new());
    for (camera, truth) in cameras.iter().zip(truths) {
        for _ in 0..REPEATS {
            let start = Instant::now();
            layers.render(&mut composer, camera, &settings, &mut frame);
            ms.push(start.elapsed().as_secs_f64() * 1e3);
        }
        flips.push(metrics::compare(truth, &frame.to_rgb()?)?.flip);
    }
    Ok((median(ms).unwrap_or(f64::NAN), flips))
}
