//! Opening of image sets, with notes on standard error.

use super::args::{StrictArgs, refuse_misplaced};
use super::messages::UsageError;
use super::output::{print_notes, print_warnings};
use super::progress::Bar;
use clap::Args;
use headbox_core::files::protect_input;
use headbox_core::progress::Progress;
use headbox_images::{
    ImageSet, ImageSetOptions, RefinementReport, RefinementStep, RegistrationModel,
    RegistrationReport, RegistrationStep,
};
use headbox_photos::cache;
use std::path::Path;

/// Options of opening image sets.
#[derive(Args, Clone, Copy, Default)]
pub(super) struct SetArgs {
    /// Use colour cameras and exposures exactly as in the files, instead of registering colours
    /// with depth and equalising exposures by the images; registration and depth samples are cached
    /// in the user's cache folder, 4 GB at most
    #[arg(long)]
    no_registration: bool,
    /// Refine slightly wrong poses with the depth of neighbouring views (point-to-plane ICP over
    /// the whole set), if held-out points then lie nearer to their surfaces; cached like the
    /// registration
    #[arg(long)]
    refine_poses: bool,
    #[command(flatten)]
    pub(super) strict: StrictArgs,
}

impl SetArgs {
    /// Refuses the flags of image sets if the input is not one.
    pub(super) fn refuse_without_set(self, is_set: bool) -> Result<(), UsageError> {
        let flags = [
            ("--no-registration", self.no_registration),
            ("--refine-poses", self.refine_poses),
        ];
        let flags = flags.map(|(flag, is_given)| (flag, is_given && !is_set));
        refuse_misplaced("folders of images", flags)
    }

    /// Returns the same options without strict reading.
    pub(super) fn lenient(self) -> Self {
        Self {
            strict: StrictArgs::default(),
            ..self
        }
    }

    /// Opens a set, refines its poses if requested, and prints notes on standard error.
    pub(super) fn open(&self, folder: &Path) -> anyhow::Result<ImageSet> {
        let mut set = ImageSet::open(folder, &ImageSetOptions::default())?;
        for view in &set.views {
            let depth = view.depth.as_ref().map(|depth| &depth.path);
            [Some(&view.color), depth, view.mask.as_ref()]
                .into_iter()
                .flatten()
                .for_each(|file| protect_input(file));
        }
        let name = folder.display().to_string();
        self.strict.report(&name, &set.notes)?;
        if self.refine_poses {
            refine(&mut set)?;
        }
        Ok(set)
    }

    /// Opens a set, warns if neighbours disagree, and registers its colours with its depth unless
    /// its unit is in doubt.
    pub(super) fn open_registered(&self, folder: &Path) -> anyhow::Result<ImageSet> {
        let mut set = self.open(folder)?;
        if self.compare_neighbors(&set)? {
            self.register(&mut set)?;
        }
        Ok(set)
    }

    /// Warns if neighbours with depth of their own disagree. Returns true unless the unit of depth
    /// is in doubt, so that colours cannot be registered.
    pub(super) fn compare_neighbors(&self, set: &ImageSet) -> anyhow::Result<bool> {
        if set.views_with_depth().next().is_none() || set.has_estimated_depth() {
            return Ok(true);
        }
        let folder = cache::folder(cache::IMAGES);
        let (doubts, cached) = cache::compare_neighbors(set, folder.as_deref())?;
        print_notes(&cached.note);
        print_warnings(doubts.warnings);
        if doubts.is_unit_doubtful && !self.no_registration {
            eprintln!("note: colours are not registered with depth, because its unit is in doubt");
        }
        Ok(!doubts.is_unit_doubtful)
    }

    /// Registers a set's colour cameras with its depth cameras, unless refused.
    pub(super) fn register(&self, set: &mut ImageSet) -> anyhow::Result<()> {
        if self.no_registration {
            return Ok(());
        }
        let bar = Bar::new();
        let on_step = |step| match step {
            RegistrationStep::LoadingStarted(views) => {
                bar.begin("registering colour with depth", "views", views as u64);
            }
            RegistrationStep::ViewLoaded => bar.advance(1),
        };
        let folder = cache::folder(cache::IMAGES);
        let (report, cached) = cache::register(set, folder.as_deref(), &on_step)?;
        bar.finish();
        print_notes(&cached.note);
        if let Some(report) = &report {
            eprintln!("{}", describe_registration(report));
        }
        Ok(())
    }
}

/// Refines the poses of a set and prints the result on standard error.
fn refine(set: &mut ImageSet) -> anyhow::Result<()> {
    let bar = Bar::new();
    let on_step = |step| match step {
        RefinementStep::LoadingStarted(views) => bar.begin("loading depth", "views", views as u64),
        RefinementStep::SolvingStarted(rounds) => {
            bar.begin("refining poses", "rounds", rounds as u64);
        }
        RefinementStep::ViewLoaded | RefinementStep::RoundSolved => bar.advance(1),
    };
    let folder = cache::folder(cache::IMAGES);
    let (report, cached) = cache::refine_poses(set, folder.as_deref(), &on_step)?;
    bar.finish();
    print_notes(&cached.note);
    let text = report.as_ref().map_or_else(
        || "poses: kept as given, for no two views with depth of their own see the same".into(),
        describe_refinement,
    );
    eprintln!("{text}");
    Ok(())
}

/// Describes the result of refining poses, in a sentence.
fn describe_refinement(report: &RefinementReport) -> String {
    let [given, refined] = report.surface_distance.map(|share| share * 100.0);
    let [before, after] = report.levels;
    let found = format!(
        "points that were not used lie {given:.3} % of their distance off their neighbours' surfaces as given and {refined:.3} % refined, and \
         levels there differ by {before:.2} and {after:.2} ({} pairs of {} views)",
        report.pairs, report.views
    );
    if !report.is_applied {
        return format!("poses: kept as given: {found}");
    }
    let [turned, moved] = report.movement;
    format!(
        "poses: refined by {turned:.3} degrees and {:.1} mm on average: {found}",
        moved * 1000.0
    )
}

/// Describes the registration of a set's colour cameras, in a sentence or two.
fn describe_registration(report: &RegistrationReport) -> String {
    let [given, one, each] = report.levels;
    let exposure = format!(
        "exposures are evened out, from {:.2} to {:.2} of the mean",
        report.gain[0], report.gain[1]
    );
    let part = if report.sampled_views < report.views {
        format!(
            "{} of {} views, which represent all,",
            report.sampled_views, report.views
        )
    } else {
        "views".into()
    };
    let tried = format!(
        "colours of the same points in {part} differ by {given:.2} of 255 levels with the cameras as given, {one:.2} with another \
         colour camera, {each:.2} with one for each view"
    );
    match report.applied {
        RegistrationModel::AsGiven => {
            format!("registration: colour and depth are kept as given ({tried}); {exposure}")
        }
        RegistrationModel::SharedOffset | RegistrationModel::PerView => format!(
            "registration: colours were taken by another camera than depth: {tried}. Its focal length is {:.1} px, not {:.1}, \
             and it is turned by {:.2} degrees and moved by {:.1} cm on average; {exposure}. --no-registration leaves all as given",
            report.focal_px[1],
            report.focal_px[0],
            report.offset[0],
            report.offset[1] * 100.0
        ),
    }
}
