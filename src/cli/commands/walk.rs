//! `headbox walk`.

use crate::args::parse_size;
use crate::commands::house::file::{note_unvisited, variant_by_name};
use crate::messages::UsageError;
use crate::output::{Outputs, print_json, save_picture, write_text};
use crate::progress::Bar;
use clap::Args;
use headbox_core::drawing::contact_sheet::{SheetRow, contact_sheet};
use headbox_house::file;
use headbox_house::variant::HouseVariant;
use headbox_house::walk_path::{PAPER_POSES, WalkPath};
use headbox_lab::walk::{MeasureSettings, PosePictures, measure};
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct WalkCommand {
    /// Input .house file
    file: PathBuf,
    /// Folder for walk.md, walk.json, a chart of frame times (along_path.svg), and frames next to
    /// truth (frames.html)
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Number of poses of the walk, 1 to 100000
    #[arg(long, value_name = "N", default_value_t = PAPER_POSES as u32, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    poses: u32,
    /// Frame size, pixels
    #[arg(long, value_name = "WxH", default_value = "640x512", value_parser = parse_size)]
    size: (u32, u32),
    /// Seed of the walk
    #[arg(long, value_name = "K", default_value_t = 0)]
    seed: u32,
    /// Variants to measure, separated by commas; a wrong name prints the list; all by default
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    variants: Vec<String>,
    /// Compare every N-th pose with truth
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    truth_every: u32,
    /// Number of times to render each pose by each variant, 1 to 1000; the fastest counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeat: u32,
    /// Number of poses whose frames are saved next to truth
    #[arg(long, value_name = "N", default_value_t = 8)]
    pictures: usize,
    /// Print walk.json on standard output
    #[arg(long)]
    json: bool,
}

impl WalkCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let variants = self.variants()?;
        Outputs::new(self.json, [&self.file]).folder(&self.output)?;
        // Unlimited memory: the next pose needs the backdrops captured on the way again.
        let (house, store, quality) = file::read(&self.file, u64::MAX)?;
        let path = WalkPath {
            poses: self.poses as usize,
            size: [self.size.0, self.size.1],
            seed: self.seed,
            ..WalkPath::default()
        };
        note_unvisited(&path, &house);
        let settings = MeasureSettings {
            path,
            quality,
            variants,
            repeats: self.repeat,
            truth_every: self.truth_every as usize,
            pictures: self.pictures,
            ..MeasureSettings::default()
        };
        let bar = Bar::new();
        let mut sheet = Ok(Vec::new());
        let mut save = |pictures: PosePictures| {
            if let Ok(rows) = &mut sheet {
                match save_frames(&self.output, pictures) {
                    Ok(row) => rows.push(row),
                    Err(error) => sheet = Err(error),
                }
            }
        };
        let report = measure(&house, &store, &settings, &bar, &mut save)?;
        bar.finish();
        let title = format!("Frames of {} and truth", report.scene);
        write_text(
            &self.output.join("frames.html"),
            &contact_sheet(&title, &sheet?),
        )?;
        let page = report.to_markdown();
        write_text(&self.output.join("walk.md"), &page)?;
        write_text(
            &self.output.join("along_path.svg"),
            &report.chart().to_svg(),
        )?;
        let value = serde_json::to_value(&report)?;
        write_text(&self.output.join("walk.json"), &format!("{value:#}\n"))?;
        if self.json {
            print_json(&value);
        } else {
            print!("{page}");
        }
        Ok(())
    }

    fn variants(&self) -> Result<Vec<HouseVariant>, UsageError> {
        if self.variants.is_empty() {
            return Ok(HouseVariant::ALL.to_vec());
        }
        self.variants
            .iter()
            .map(|name| variant_by_name(name))
            .collect()
    }
}

/// Saves truth and the frame of each variant; returns their row of the contact sheet.
fn save_frames(folder: &Path, pictures: PosePictures) -> anyhow::Result<SheetRow> {
    let PosePictures { pose, frames } = pictures;
    let mut row = SheetRow {
        label: format!("pose {pose}"),
        pictures: Vec::new(),
    };
    for (name, image) in frames {
        let file = format!("frames/pose_{pose:03}_{name}.png");
        save_picture(&folder.join(&file), &image)?;
        row.pictures.push((file, name.into()));
    }
    Ok(row)
}
