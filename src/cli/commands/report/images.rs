//! `headbox report` of an image set: held-out views, rendered from the others.

use crate::commands::render::geometry::GeometryArgs;
use crate::output::{print_warnings, save_picture, write_text};
use crate::progress::Bar;
use headbox_images::ImageSet;
use headbox_lab::held_out::SHEET_COLUMNS;
use headbox_lab::images::{self, Geometry, SideBySide};
use headbox_lab::photographs;
use headbox_ldi::from_images::ImageSetCapture;
use headbox_photos::voxel_colouring::PhotographsJob;
use image::RgbImage;
use std::path::Path;

/// Arranges pictures in rows of `across`, in cells of the largest width and height.
fn sheet(pictures: &[&RgbImage], across: usize) -> RgbImage {
    let [width, height] = [RgbImage::width, RgbImage::height].map(|side| {
        pictures
            .iter()
            .map(|picture| side(picture))
            .max()
            .unwrap_or(0)
    });
    let rows = pictures.len().div_ceil(across);
    let mut sheet = RgbImage::new(
        width * pictures.len().min(across) as u32,
        height * rows as u32,
    );
    for (number, picture) in pictures.iter().enumerate() {
        let [x, y] = [number % across, number / across].map(|place| place as i64);
        image::imageops::replace(
            &mut sheet,
            *picture,
            x * i64::from(width),
            y * i64::from(height),
        );
    }
    sheet
}

/// Saves pictures side by side; keeps the first error.
pub(crate) struct SheetWriter<'a> {
    pub(crate) folder: &'a Path,
    pub(crate) failed: Option<anyhow::Error>,
}

impl SheetWriter<'_> {
    pub(crate) fn save(&mut self, name: &str, pictures: &[&RgbImage], across: usize) {
        let path = self
            .folder
            .join(format!("{}.png", name.replace(['/', '.'], "_")));
        self.failed = self
            .failed
            .take()
            .or(save_picture(&path, &sheet(pictures, across)).err());
    }
}

/// Measures a set by its own depth or, without any, by voxel colouring of its photographs, and
/// writes the report into a folder.
pub(super) fn write(
    set: &ImageSet,
    hold_out: usize,
    geometry: &GeometryArgs,
    folder: &Path,
) -> anyhow::Result<()> {
    let bar = Bar::new();
    let mut sheets = SheetWriter {
        folder,
        failed: None,
    };
    let has_own_depth = set.views_with_depth().next().is_some() && !set.has_estimated_depth();
    let (json, summary) = if has_own_depth {
        let geometry = Geometry {
            settings: geometry.settings(),
            resources: geometry.resources.resources(None),
        };
        let mut save = |shown: SideBySide| {
            let pictures: Vec<&RgbImage> = std::iter::once(&shown.photograph)
                .chain(&shown.frames)
                .collect();
            sheets.save(&shown.view, &pictures, SHEET_COLUMNS);
        };
        let report = images::measure(
            set,
            &ImageSetCapture::suggest(set),
            &geometry,
            hold_out,
            &bar,
            &mut save,
        )?;
        (serde_json::to_string_pretty(&report)?, report.summary())
    } else {
        let mut save =
            |name: &str, pictures: &[&RgbImage]| sheets.save(name, pictures, SHEET_COLUMNS);
        let job = PhotographsJob::suggest(set);
        print_warnings(job.left_out(&set.views.iter().collect::<Vec<_>>()));
        let report = photographs::measure(set, &job, hold_out, &bar, &mut save)?;
        (serde_json::to_string_pretty(&report)?, report.summary())
    };
    bar.finish();
    if let Some(error) = sheets.failed {
        return Err(error);
    }
    write_report(folder, json, &summary)?;
    print!("{summary}");
    Ok(())
}

/// Writes `report.json` and `summary.md`.
pub(crate) fn write_report(folder: &Path, json: String, summary: &str) -> anyhow::Result<()> {
    write_text(&folder.join("report.json"), &(json + "\n"))?;
    write_text(&folder.join("summary.md"), summary)
}
