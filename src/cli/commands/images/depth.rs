//! `headbox images --depth`: estimates the depth of photographs.

use crate::image_set::SetArgs;
use crate::progress::Bar;
use anyhow::{Context, bail};
use clap::Args;
use headbox_core::files::{self, StagingFolder};
use headbox_core::progress::Progress;
use headbox_images::dense_depth::{Agreement, DenseDepth};
use headbox_images::{ImageSet, ImageSetOptions, View, write_set};
use serde_json::{Value, json};
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Args, Default)]
pub(super) struct DepthArgs {
    /// Estimate the depth of photographs with known cameras by stereo and store it in their folder
    /// (headbox-depth), where capture, render, view and report find it
    #[arg(long)]
    depth: bool,
    /// Write images, depth of --depth and a transforms.json to this new folder, instead of storing
    /// depth with the originals; depth that the set already has is compared with the estimate, not
    /// used
    #[arg(short, long, value_name = "FOLDER", requires = "depth")]
    output: Option<PathBuf>,
    /// Maximum longer side of images for --depth, pixels, 64 to 16384; larger images are halved
    /// until they fit
    #[arg(long, value_name = "PX", requires = "depth", default_value_t = DenseDepth::default().longest_px,
        value_parser = clap::value_parser!(u32).range(64..=16384))]
    depth_size: u32,
}

/// Longer side of images from which depth takes minutes, pixels.
const LARGE_PX: u32 = 640;

/// Result of the depth estimation.
pub(super) struct Outcome {
    views: usize,
    agreement: Agreement,
    seconds: f64,
    /// Folder of the set with the estimated depth.
    pub(super) folder: PathBuf,
}

impl DepthArgs {
    /// Estimates depth, if requested.
    pub(super) fn run(&self, folder: &Path, args: &SetArgs) -> anyhow::Result<Option<Outcome>> {
        if !self.depth {
            return Ok(None);
        }
        let started = Instant::now();
        let bar = Bar::new();
        let (mut set, known, copy) = match &self.output {
            Some(output) => {
                let (set, known, copy) = copy_set(folder, output, args, &bar)?;
                (set, known, Some(copy))
            }
            None => (args.open(folder)?, Vec::new(), None),
        };
        let lacking = set
            .views
            .iter()
            .filter(|view| !view.has_own_depth())
            .count();
        if lacking == 0 {
            bail!(
                "{}: all {} views have depth; with -o FOLDER it is found anew, from the colours alone, and compared",
                folder.display(),
                set.views.len()
            );
        }
        let names: Vec<String> = set.views.iter().map(|view| view.name.clone()).collect();
        let (mut agreement, mut views, mut failed) = (Agreement::default(), 0, None);
        bar.begin("finding depth", "steps", set.find_depth_steps());
        let sides = set.views.iter().flat_map(|view| view.size_px);
        let longest = sides.max().unwrap_or(0).min(self.depth_size);
        if longest > LARGE_PX {
            eprintln!(
                "note: --depth-size {} finds coarser depth in about a fourth of the time",
                longest.div_ceil(2)
            );
        }
        let settings = DenseDepth {
            longest_px: self.depth_size,
            ..DenseDepth::default()
        };
        set.estimate_depth(
            &settings,
            &|steps| bar.advance(steps),
            &mut |view, found| {
                let original = names
                    .iter()
                    .position(|name| *name == view.name)
                    .and_then(|i| known.get(i));
                let known = match original.map(View::load).transpose() {
                    Ok(original) => original.map(|original| original.depth).unwrap_or_default(),
                    Err(error) => {
                        failed = failed.take().or(Some(error));
                        Vec::new()
                    }
                };
                agreement.add(&found.view.depth, &known);
                views += 1;
            },
        )
        .with_context(|| folder.display().to_string())?;
        bar.finish();
        if let Some(error) = failed {
            return Err(error.into());
        }
        if let Some(copy) = copy {
            set.folder = copy.publish()?;
        }
        Ok(Some(Outcome {
            views,
            agreement,
            seconds: started.elapsed().as_secs_f64(),
            folder: set.folder,
        }))
    }
}

/// Copy of a set in a temporary folder inside the output folder: its files move up once it has
/// depth, so that an interrupt leaves nothing that looks like a set.
struct StagedSet {
    staging: StagingFolder, // dropped before its folder
    output: NewFolder,
}

impl StagedSet {
    /// Moves the files to the output folder, the manifest last. Returns that folder.
    fn publish(self) -> io::Result<PathBuf> {
        let [manifest, _] = DEPTH_SET.map(Path::new);
        let entries = std::fs::read_dir(self.staging.path())?;
        let mut names: Vec<OsString> = entries
            .map(|entry| entry.map(|entry| entry.file_name()))
            .collect::<io::Result<_>>()?;
        names.sort_by_key(|name| name == manifest);
        for name in names {
            std::fs::rename(
                self.staging.path().join(&name),
                self.output.path.join(&name),
            )?;
        }
        Ok(self.output.path.clone())
    }
}

/// Output folder; if it is new and nothing was written to it, it is removed again.
struct NewFolder {
    path: PathBuf,
    is_new: bool,
}

impl NewFolder {
    fn create(path: &Path) -> io::Result<Self> {
        let is_new = !path.exists();
        std::fs::create_dir_all(path)?;
        Ok(Self {
            path: path.into(),
            is_new,
        })
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        if self.is_new {
            let _ = std::fs::remove_dir(&self.path); // an error if it is not empty
        }
    }
}

/// Files of a set with estimated depth.
const DEPTH_SET: [&str; 2] = ["transforms.json", "headbox-depth/index.json"];

/// Writes a copy of a set without lens distortion and without depth. Returns the copy, its original
/// views and its folder.
fn copy_set(
    folder: &Path,
    output: &Path,
    args: &SetArgs,
    bar: &Bar,
) -> anyhow::Result<(ImageSet, Vec<View>, StagedSet)> {
    if DEPTH_SET.iter().all(|name| output.join(name).exists()) {
        let output = output.display();
        bail!(
            "{output}: already holds a set with estimated depth; use it (headbox images {output}), \
             estimate its depth again (headbox images {output} --depth), or give another folder"
        );
    }
    let cannot_write = || format!("{} cannot be written to", output.display());
    files::check_folder(output).with_context(cannot_write)?;
    if std::fs::read_dir(output).is_ok_and(|mut entries| entries.next().is_some()) {
        bail!(
            "{}: is not empty; give a new folder for the set",
            output.display()
        );
    }
    let set = args.open_registered(folder)?;
    let views: Vec<View> = set
        .views
        .into_iter()
        .filter(|view| view.pinhole().is_some())
        .collect();
    let output = NewFolder::create(output).with_context(cannot_write)?;
    let staging = StagingFolder::create_in(&output.path).with_context(cannot_write)?;
    bar.begin("writing pictures", "views", views.len() as u64);
    write_set(&views, staging.path(), &mut |_| bar.advance(1))?;
    bar.finish();
    let set = ImageSet::open(staging.path(), &ImageSetOptions::default())?;
    Ok((set, views, StagedSet { staging, output }))
}

impl Outcome {
    pub(super) fn print(&self) {
        let Self {
            views,
            agreement,
            seconds,
            folder,
        } = self;
        println!(
            "{}: depth found for {:.1} % of the pixels of {views} views in {seconds:.1} s",
            folder.display(),
            agreement.estimated_share() * 100.0
        );
        if agreement.known > 0 {
            let [one, two, five] = agreement.shares_within().map(|share| share * 100.0);
            println!(
                "  known depth {:.1} % of its pixels found: {one:.1} % of them within 1 %, {two:.1} % within 2 %, {five:.1} % within 5 %, \
                 half of them within {:.2} %",
                agreement.covered_share() * 100.0,
                agreement.median_error() * 100.0
            );
        }
    }

    pub(super) fn json(&self) -> Value {
        let Self {
            views,
            agreement,
            seconds,
            folder,
        } = self;
        let known = (agreement.known > 0).then(|| {
            let [one, two, five] = agreement.shares_within();
            json!({
                "covered": agreement.covered_share(), "within_1_percent": one, "within_2_percent": two, "within_5_percent": five,
                "median": agreement.median_error(),
            })
        });
        json!({
            "folder": folder.to_string_lossy(), "views": views, "share": agreement.estimated_share(), "seconds": seconds, "known": known,
        })
    }
}
