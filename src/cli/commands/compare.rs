//! `headbox compare`.

use crate::commands::truth::NOISE_KEYWORD;
use crate::output::{Outputs, PICTURE, print_damage, print_json, save_picture};
use anyhow::Context;
use clap::Args;
use headbox_core::image::{codec, png_chunks};
use headbox_core::memory;
use headbox_core::metrics;
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct CompareCommand {
    /// Reference image
    reference: PathBuf,
    /// Image to compare with the reference, of the same size
    test: PathBuf,
    /// Write the FLIP error map to this image: black without error, through red to pale yellow at
    /// an error of 1
    #[arg(long, value_name = "OUT.png")]
    map: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Reads an image, and its standard error in dB if it is a PNG that `truth` wrote.
fn open(path: &Path) -> anyhow::Result<(image::RgbImage, Option<f64>)> {
    let unreadable = || format!("{} could not be read as an image", path.display());
    let bytes = memory::read_file(path).with_context(unreadable)?;
    let image = codec::decode(&bytes, Some(path), codec::MAX_BYTES).with_context(unreadable)?;
    print_damage(path, &image);
    let noise = png_chunks::text(&bytes, NOISE_KEYWORD);
    let noise_db = noise.and_then(|text| text.parse().ok());
    Ok((image.image.to_rgb8(), noise_db))
}

impl CompareCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        Outputs::new(self.json, [&self.reference, &self.test])
            .maybe_file(self.map.as_ref(), &PICTURE)?;
        let (reference, noise_db) = open(&self.reference)?;
        let (test, _) = open(&self.test)?;
        let (comparison, map) = metrics::compare_with_map(&reference, &test)?;
        if let Some(path) = &self.map {
            save_picture(path, &map.to_magma())?;
        }
        if self.json {
            let mut json = serde_json::to_value(comparison)?;
            json["reference_standard_error_psnr_db"] = json!(noise_db);
            print_json(&json);
        } else {
            println!(
                "FLIP {:.4}  PSNR {:.2} dB  SSIM {:.4}  differing pixels {:.2} %",
                comparison.flip,
                comparison.psnr_db,
                comparison.ssim,
                comparison.differing_fraction * 100.0
            );
        }
        if let Some(noise_db) = noise_db
            && comparison.psnr_db.is_finite()
            && comparison.psnr_db > noise_db - AMPLE_DB
        {
            eprintln!("{}", describe_limit(comparison.psnr_db, noise_db));
        }
        Ok(())
    }
}

/// Distance of the reference's noise below the error of the test image from which on it changes the
/// PSNR by less than 0.5 dB, dB.
const AMPLE_DB: f64 = 10.0;

/// Describes how far the noise of a reference limits a comparison.
fn describe_limit(psnr_db: f64, noise_db: f64) -> String {
    let noise = format!("the reference has noise of its own ({noise_db:.1} dB)");
    let wanted_db = (psnr_db.min(noise_db) + AMPLE_DB).ceil();
    let advice = format!("trace it with --noise {wanted_db:.0} or more");
    if psnr_db >= noise_db {
        return format!("note: {noise} as large as all that differs; {advice}");
    }
    format!("note: {noise}, so that the image is better than {psnr_db:.1} dB; {advice}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limit_by_noise_names_the_noise_to_trace() {
        assert_eq!(
            describe_limit(31.2, 38.0),
            "note: the reference has noise of its own (38.0 dB), so that the image is better than \
             31.2 dB; trace it with --noise 42 or more"
        );
        assert!(describe_limit(39.0, 38.0).contains("all that differs; trace it with --noise 48"));
    }
}
