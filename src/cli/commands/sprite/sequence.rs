//! `headbox sprite FOLDER`: sprites of a sequence of photographs.

use crate::args::refuse_misplaced;
use crate::commands::report::images::{SheetWriter, write_report};
use crate::image_set::SetArgs;
use crate::messages::UsageError;
use crate::output::{has_extension, print_damage};
use crate::progress::Bar;
use anyhow::{Context, bail};
use clap::Args;
use headbox_core::file_frame::FileFrame;
use headbox_core::image::codec;
use headbox_core::progress::Progress;
use headbox_images::ImageSet;
use headbox_images::planar_layers::{Frames, LayerJob, MAX_LAYERS, Mask, PlanarLayers};
use headbox_lab::sequence;
use image::RgbImage;
use std::path::{Path, PathBuf};

/// Options of sprites of a sequence.
#[derive(Args)]
pub(crate) struct SequenceArgs {
    /// Folder of images: reference view, whose layers are made, by name or by number from 1; the
    /// middle one by default
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// Folder of images: maximum number of layers, 1 to 64; 6 by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=64))]
    layers: Option<u8>,
    /// Folder of images: number of other views, 1 to 8, from which depth and hidden regions are
    /// recovered; 6 by default
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=8))]
    frames: Option<u8>,
    /// Folder of images: folder of hand-made regions that replace detected ones: one PNG per layer
    /// in order of names, as large as the view's image, white inside the layer
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    /// Folder of images: use the depth in its files instead of depth estimated from the images
    #[arg(long)]
    own_depth: bool,
    #[command(flatten)]
    pub(super) set: SetArgs,
}

impl SequenceArgs {
    /// Refuses the flags of image sets for other input.
    pub(super) fn refuse_without_set(&self) -> Result<(), UsageError> {
        self.set.refuse_without_set(false)?;
        let given = [
            ("--view", self.view.is_some()),
            ("--layers", self.layers.is_some()),
            ("--frames", self.frames.is_some()),
            ("--masks", self.masks.is_some()),
            ("--own-depth", self.own_depth),
        ];
        refuse_misplaced("folders of images", given)
    }

    /// Segments a folder of images into layers; returns its axes and unit, too. Measures the layers
    /// by held-out photographs if `range` is given, and writes the report into that folder.
    pub(super) fn layers(
        &self,
        name: &str,
        range: Option<&Path>,
    ) -> anyhow::Result<(PlanarLayers, FileFrame)> {
        let set = self.set.open_registered(Path::new(name))?;
        let job = self.job(&set)?;
        let bar = Bar::new();
        let (report, layers) = match range {
            Some(folder) => measure(&set, &job, &bar, folder)?,
            None => (String::new(), job.segment(&load(&set, &job, &bar)?)?),
        };
        bar.finish();
        print!("{report}");
        Ok((layers, set.frame))
    }

    fn job(&self, set: &ImageSet) -> anyhow::Result<LayerJob> {
        let mut job = LayerJob::suggest(set);
        if let Some(name) = &self.view {
            job.view = LayerJob::find_view(set, name)?;
        }
        job.layers = self.layers.map_or(job.layers, usize::from);
        job.others = self.frames.map_or(job.others, usize::from);
        job.own_depth = self.own_depth;
        if self.own_depth && set.views_with_depth().next().is_none() {
            bail!(
                "{}: no view has depth; leave --own-depth out",
                set.folder.display()
            );
        }
        if let Some(folder) = &self.masks {
            job.masks = read_masks(folder)?;
        }
        Ok(job)
    }
}

/// Reads the PNG files of a folder, ordered by name.
fn read_masks(folder: &Path) -> anyhow::Result<Vec<Mask>> {
    let entries = std::fs::read_dir(folder)
        .with_context(|| format!("{} cannot be read", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    paths.retain(|path| has_extension(path, "png"));
    paths.sort();
    if paths.is_empty() {
        bail!(
            "{}: no PNG files; --masks takes a folder of them, one for each layer",
            folder.display()
        );
    }
    if paths.len() > MAX_LAYERS {
        bail!(
            "{}: {} PNG files, more than layers are made",
            folder.display(),
            paths.len()
        );
    }
    let read = |path: PathBuf| {
        let picture = codec::read(&path, codec::MAX_BYTES);
        let picture =
            picture.with_context(|| format!("{} could not be read as an image", path.display()))?;
        print_damage(&path, &picture);
        Ok(Mask {
            picture: picture.image.to_luma8(),
            path,
        })
    };
    paths.into_iter().map(read).collect()
}

fn load(set: &ImageSet, job: &LayerJob, bar: &Bar) -> anyhow::Result<Frames> {
    bar.begin("finding depth", "steps", job.steps(set));
    Ok(job.load(set, &|steps| bar.advance(steps))?)
}

/// Segments layers without the held-out frames and measures them by these; returns the summary,
/// too.
fn measure(
    set: &ImageSet,
    job: &LayerJob,
    bar: &Bar,
    folder: &Path,
) -> anyhow::Result<(String, PlanarLayers)> {
    let (kept, job, left_out) = sequence::leave_out(set, job)?;
    let frames = load(&kept, &job, bar)?;
    let mut sheets = SheetWriter {
        folder,
        failed: None,
    };
    let mut save = |name: &str, pictures: &[&RgbImage]| sheets.save(name, pictures, 3);
    let (report, layers) = sequence::measure(&kept, &job, &frames, &left_out, &mut save)?;
    if let Some(error) = sheets.failed {
        return Err(error);
    }
    let summary = report.summary();
    write_report(folder, serde_json::to_string_pretty(&report)?, &summary)?;
    Ok((summary, layers))
}
