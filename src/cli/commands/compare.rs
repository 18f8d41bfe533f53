//! `headbox compare`.

use crate::output::{Outputs, PICTURE, print_damage, print_json, save_picture};
use anyhow::Context;
use clap::Args;
use headbox_core::image::codec;
use headbox_core::metrics;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct CompareCommand {
    /// Reference image
    reference: PathBuf,
    /// Image to compare with the reference, of the same size
    test: PathBuf,
    /// Write the FLIP error map to this image
    #[arg(long, value_name = "OUT.png")]
    map: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

fn open(path: &Path) -> anyhow::Result<image::RgbImage> {
    let image = codec::read(path, codec::MAX_BYTES)
        .with_context(|| format!("{} could not be read as an image", path.display()))?;
    print_damage(path, &image);
    Ok(image.image.to_rgb8())
}

impl CompareCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        Outputs::new(self.json, [&self.reference, &self.test])
            .maybe_file(self.map.as_ref(), &PICTURE)?;
        let (reference, test) = (open(&self.reference)?, open(&self.test)?);
        let (comparison, map) = metrics::compare_with_map(&reference, &test)?;
        if let Some(path) = &self.map {
            save_picture(path, &map.to_magma())?;
        }
        if self.json {
            print_json(&serde_json::to_value(comparison)?);
        } else {
            println!(
                "FLIP {:.4}  PSNR {:.2} dB  SSIM {:.4}  differing pixels {:.2} %",
                comparison.flip,
                comparison.psnr_db,
                comparison.ssim,
                comparison.differing_fraction * 100.0
            );
        }
        Ok(())
    }
}
