//! `headbox images`: description and checks of an image set.

mod depth;

use crate::commands::capture::Preset;
use crate::commands::capture::deep::{self as capture_deep, is_deep_picture};
use crate::commands::images::depth::{DepthArgs, Outcome};
use crate::image_set::SetArgs;
use crate::output::{print_json, print_warnings};
use crate::progress::{Bar, duration};
use anyhow::bail;
use clap::Args;
use glam::DVec3;
use headbox_core::progress::Progress;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes;
use headbox_images::{
    AlignStep, Alignment, CheckReport, ImageSet, ImagesError, Lens, Residual, View, align, check,
};
use headbox_ldi::from_images::ImageSetCapture;
use headbox_photos::voxel_colouring::{Colouring, PhotographsJob};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(crate) struct ImagesCommand {
    /// Folder of images with known cameras (Seurat, nerfstudio, COLMAP, RGB-D frames, Middlebury,
    /// panoramas), its manifest.json or transforms.json, or a deep EXR
    folder: PathBuf,
    /// Estimate the camera poses of photographs with COLMAP, if installed, and store its model in
    /// their folder as sparse/0
    #[arg(long)]
    align: bool,
    #[command(flatten)]
    depth: DepthArgs,
    #[command(flatten)]
    set: SetArgs,
    /// Number of pairs of neighbouring views to compare; 0 skips the comparison
    #[arg(long, value_name = "N", default_value_t = PAIRS)]
    pairs: usize,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Default number of pairs of neighbours that are compared.
const PAIRS: usize = 16;

/// Method of capturing a set: by its depth or, where no view has any, by voxel colouring.
pub(super) enum SetJob {
    Depth(ImageSetCapture),
    Photographs {
        job: PhotographsJob,
        /// Factor by which photographs are reduced.
        reduction: u32,
    },
}

impl SetJob {
    pub(super) fn suggest(set: &ImageSet) -> Self {
        match set.views_with_depth().next() {
            Some(_) => Self::Depth(ImageSetCapture::suggest(set)),
            None => Self::Photographs {
                job: PhotographsJob::suggest(set),
                reduction: Preset::Best.reduction(),
            },
        }
    }

    /// Centre of the headbox, world metres.
    pub(super) fn centre(&mut self) -> &mut DVec3 {
        match self {
            Self::Depth(job) => &mut job.centre,
            Self::Photographs { job, .. } => &mut job.centre,
        }
    }

    pub(super) fn half_size_m(&mut self) -> &mut f64 {
        match self {
            Self::Depth(job) => &mut job.half_size_m,
            Self::Photographs { job, .. } => &mut job.half_size_m,
        }
    }

    /// Views that are captured.
    pub(super) fn views<'a>(&self, set: &'a ImageSet) -> Vec<&'a View> {
        match self {
            Self::Depth(_) => set.views_with_depth().collect(),
            Self::Photographs { .. } => set.views.iter().collect(),
        }
    }

    pub(super) fn run(&self, set: &ImageSet, bar: &Bar) -> Result<CubeSamples, ImagesError> {
        match self {
            Self::Depth(job) => job.run(set, &self.views(set), bar),
            Self::Photographs { job, reduction } => {
                let views = self.views(set);
                print_warnings(job.left_out(&views));
                let colouring = job.prepare(set, &views, *reduction)?;
                announce(&colouring, *reduction, &set.folder);
                Ok(colouring.run(bar))
            }
        }
    }
}

/// Prints how long voxel colouring of photographs reduced by a factor will take, unless it is
/// short, and what takes less time or is sharper.
fn announce(colouring: &Colouring, reduction: u32, folder: &Path) {
    /// Time that is not worth announcing, seconds.
    const SHORT_S: f64 = 5.0;
    let seconds = colouring.estimate().as_secs_f64();
    if seconds < SHORT_S {
        return;
    }
    let coarser = [("good", Preset::Good), ("draft", Preset::Draft)].map(|(name, preset)| {
        let share = f64::from(reduction) / f64::from(preset.reduction());
        (share < 1.0).then(|| {
            let coarse_s = duration(seconds * share.powi(3));
            format!("; about {coarse_s} with `capture --quality {name}`")
        })
    });
    eprintln!(
        "estimate: about {} for faces of {} px{}",
        duration(seconds),
        colouring.face_size_px(),
        coarser.into_iter().flatten().collect::<String>()
    );
    eprintln!(
        "note: photographs without depth give a coarse model. For sharper surfaces find their depth first, with headbox \
         images {0} --depth; or show them from near their cameras, with headbox sprite {0}",
        folder.display()
    );
}

/// Captures the cube LDI of a folder of images with the suggested parameters.
pub(super) fn cube_from_folder(folder: &Path, set: &SetArgs, bar: &Bar) -> anyhow::Result<CubeLdi> {
    cube_from_set(&set.open_registered(folder)?, bar)
}

/// Same as [`cube_from_folder`], for an open set.
pub(super) fn cube_from_set(set: &ImageSet, bar: &Bar) -> anyhow::Result<CubeLdi> {
    let ldi = SetJob::suggest(set).run(set, bar)?;
    Ok(planes::pack(
        ldi,
        SplatIndexLayout::Normal,
        Split::Auto,
        planes::DEFAULT_ERROR_PX,
    )?)
}

/// Returns the views with depth; an error if there is none.
pub(super) fn views_with_depth(set: &ImageSet) -> anyhow::Result<Vec<&View>> {
    let views: Vec<&View> = set.views_with_depth().collect();
    if views.is_empty() {
        bail!(
            "{}: none of its {} views has depth",
            set.folder.display(),
            set.views.len()
        );
    }
    Ok(views)
}

/// Returns true if a command's argument names an image set instead of a scene.
pub(super) fn is_image_set(name: &str) -> bool {
    let path = Path::new(name);
    let is_manifest = || path.extension().is_some_and(|it| it == "json") && path.is_file();
    !name.starts_with("builtin:") && (path.is_dir() || is_manifest())
}

impl ImagesCommand {
    /// Creates the command `headbox images FOLDER`.
    pub(super) fn new(folder: &Path, json: bool) -> Self {
        Self {
            folder: folder.into(),
            align: false,
            depth: DepthArgs::default(),
            set: SetArgs::default(),
            pairs: PAIRS,
            json,
        }
    }

    pub(crate) fn run(&self) -> anyhow::Result<()> {
        if is_deep_picture(&self.folder.to_string_lossy()) {
            return capture_deep::describe(&self.folder, self.json);
        }
        if self.align {
            self.align()?;
        }
        let found = self.depth.run(&self.folder, &self.set)?;
        let set = match &found {
            // Its notes are on the depth that was estimated on request.
            Some(found) => self.set.lenient().open(&found.folder)?,
            None => self.set.open(&self.folder)?,
        };
        let pairs = self
            .pairs
            .min(set.views_with_depth().count().saturating_sub(1));
        let bar = Bar::new();
        bar.begin("comparing neighbours", "views", pairs as u64 + 1);
        let report = if self.pairs == 0 {
            CheckReport::default()
        } else {
            check(&set, self.pairs, &mut |_| bar.advance(1))?
        };
        bar.finish();
        print_warnings(&report.warnings);
        if self.json {
            self.print_json(&set, &report, found.as_ref());
        } else {
            if let Some(found) = &found {
                found.print();
            }
            self.print(&set, &report);
        }
        Ok(())
    }

    fn align(&self) -> anyhow::Result<()> {
        let bar = Bar::new();
        let mut at = None;
        let aligned = align(&self.folder, &mut |step, done, all| {
            let what = match step {
                AlignStep::Features => "points of pictures",
                AlignStep::Matches => "points of pairs",
                AlignStep::Poses => "where pictures were taken",
            };
            let before = match at {
                Some((known, before)) if known == (step, all) => before,
                _ => {
                    bar.begin(what, "steps", all as u64);
                    0
                }
            };
            bar.advance(done.saturating_sub(before) as u64);
            at = Some(((step, all), done.max(before)));
        })?;
        bar.finish();
        let Alignment {
            posed,
            photographs,
            model,
        } = aligned;
        eprintln!(
            "note: estimated the poses of {posed} of {photographs} photographs: {}",
            model.display()
        );
        Ok(())
    }

    fn print_json(&self, set: &ImageSet, report: &CheckReport, found: Option<&Outcome>) {
        let file = |p: DVec3| set.frame.file_from_world(p).to_array();
        let views: Vec<_> = set
            .views
            .iter()
            .map(|view| {
                json!({
                    "name": view.name, "size": view.size_px, "eye": file(view.pose.eye),
                    "has_depth": view.depth.is_some(),
                })
            })
            .collect();
        let residuals: Vec<_> = report
            .residuals
            .iter()
            .map(|r| {
                json!({
                    "from": r.from, "to": r.to, "overlap": r.overlap, "relative_depth": r.relative_depth,
                    "color_levels": r.color_levels,
                })
            })
            .collect();
        print_json(&json!({
            "kind": "images", "format": set.format, "views": views, "with_depth": set.views_with_depth().count(),
            "median_depth_m": report.median_depth_m, "depth_share": report.depth_share, "residuals": residuals,
            "warnings": report.warnings, "notes": set.notes,
            "found_depth": found.map(Outcome::json),
        }));
    }

    fn print(&self, set: &ImageSet, report: &CheckReport) {
        println!(
            "{}: {}, {} views",
            set.folder.display(),
            set.format,
            set.views.len()
        );
        let with_depth = set.views_with_depth().count();
        let panoramas = set
            .views
            .iter()
            .filter(|view| view.lens == Lens::Equirectangular)
            .count();
        let sizes: BTreeSet<[u32; 2]> = set.views.iter().map(|view| view.size_px).collect();
        let sizes: Vec<String> = sizes
            .iter()
            .take(4)
            .map(|[w, h]| format!("{w}x{h}"))
            .collect();
        println!(
            "  pictures    {} px, {panoramas} panoramas, {with_depth} with depth",
            sizes.join(", ")
        );
        let (low, high) = extent(set);
        println!(
            "  eyes        from {} to {} (the file's axes and unit)",
            format_point(low),
            format_point(high)
        );
        if with_depth > 0 && self.pairs > 0 {
            let half = if report.median_depth_m.is_nan() {
                String::new()
            } else {
                format!(", half of it within {:.2} m", report.median_depth_m)
            };
            println!(
                "  depth       known for {:.1} % of the pixels{half}",
                report.depth_share * 100.0
            );
        }
        print_neighbors(&report.residuals);
        if !set.views.is_empty() {
            println!(
                "capture it: headbox capture {} -o F.ldi",
                set.folder.display()
            );
        }
    }
}

/// Prints the agreement of neighbours that see the same surfaces.
fn print_neighbors(compared: &[Residual]) {
    let mut seen: Vec<&Residual> = compared
        .iter()
        .filter(|residual| !residual.relative_depth.is_nan())
        .collect();
    seen.sort_by(|a, b| a.relative_depth.total_cmp(&b.relative_depth));
    match seen.last() {
        Some(worst) => println!(
            "  neighbours  depths agree within {:.2} % (median of {} pairs), worst {:.2} % ({} and {})",
            seen[seen.len() / 2].relative_depth * 100.0,
            seen.len(),
            worst.relative_depth * 100.0,
            worst.from,
            worst.to
        ),
        None if compared.is_empty() => {}
        None => println!(
            "  neighbours  none of {} pairs see the same",
            compared.len()
        ),
    }
}

/// Corners of the eyes' bounding box, in the file's axes and unit.
fn extent(set: &ImageSet) -> (DVec3, DVec3) {
    let eyes = set
        .views
        .iter()
        .map(|view| set.frame.file_from_world(view.pose.eye));
    let empty = (DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY));
    eyes.fold(empty, |(low, high), eye| (low.min(eye), high.max(eye)))
}

fn format_point(p: DVec3) -> String {
    format!("{:.3},{:.3},{:.3}", p.x, p.y, p.z)
}
