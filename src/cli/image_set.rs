//! Opening folders of images, and the notes on them.

use super::progress::Bar;
use super::words::UsageError;
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
    /// Follow paths in a manifest that lead out of its folder
    #[arg(long)]
    pub(super) allow_outside: bool,
    /// Take colours as registered with depth and equally exposed, as the files say, without asking
    /// the pictures; what these say is kept in the user's cache folder, as samples of their depth
    /// are, 4 GB at most
    #[arg(long)]
    no_registration: bool,
    /// Refine poses that are slightly wrong by the depth of neighbours (point-to-plane ICP over the
    /// whole set), where that brings points that were not used nearer to their surfaces; kept in
    /// the cache folder likewise
    #[arg(long)]
    refine_poses: bool,
}

impl SetArgs {
    /// Refuses what is said where there is no image set.
    pub(super) fn only_for_sets(self, is_set: bool) -> Result<(), UsageError> {
        let flags = [
            ("--allow-outside", self.allow_outside),
            ("--no-registration", self.no_registration),
            ("--refine-poses", self.refine_poses),
        ];
        match flags.into_iter().find(|(_, is_given)| *is_given && !is_set) {
            Some((flag, _)) => Err(UsageError(format!("{flag} is for folders of images"))),
            None => Ok(()),
        }
    }

    /// Opens a set, refines its poses if that is asked for, and says on standard error what was
    /// met.
    pub(super) fn open(&self, folder: &Path) -> anyhow::Result<ImageSet> {
        let mut set = ImageSet::open(
            folder,
            &ImageSetOptions {
                allow_outside: self.allow_outside,
            },
        )?;
        for view in &set.views {
            let depth = view.depth.as_ref().map(|depth| &depth.path);
            [Some(&view.color), depth, view.mask.as_ref()]
                .into_iter()
                .flatten()
                .for_each(|file| protect_input(file));
        }
        for note in &set.notes {
            eprintln!("note: {note}");
        }
        if self.refine_poses {
            refine(&mut set)?;
        }
        Ok(set)
    }

    /// Opens a set and finds out where its colours were taken from.
    pub(super) fn open_registered(&self, folder: &Path) -> anyhow::Result<ImageSet> {
        let mut set = self.open(folder)?;
        self.register(&mut set)?;
        Ok(set)
    }

    /// Finds out where a set's colours were taken from.
    pub(super) fn register(&self, set: &mut ImageSet) -> anyhow::Result<()> {
        if !self.no_registration {
            let bar = Bar::new();
            let look = |step| match step {
                RegistrationStep::LoadingStarted(views) => {
                    bar.begin("registering colour with depth", "views", views as u64);
                }
                RegistrationStep::ViewLoaded => bar.advance(1),
            };
            let (report, was) =
                cache::register(set, cache::folder(cache::IMAGES).as_deref(), &look)?;
            bar.finish();
            was.note.iter().for_each(|note| eprintln!("note: {note}"));
            if let Some(report) = &report {
                eprintln!("{}", registration_words(report));
            }
        }
        Ok(())
    }
}

/// Refines the poses of a set and says on standard error what it brought.
fn refine(set: &mut ImageSet) -> anyhow::Result<()> {
    let bar = Bar::new();
    let look = |step| match step {
        RefinementStep::LoadingStarted(views) => bar.begin("loading depth", "views", views as u64),
        RefinementStep::SolvingStarted(rounds) => {
            bar.begin("refining poses", "rounds", rounds as u64);
        }
        RefinementStep::ViewLoaded | RefinementStep::RoundSolved => bar.advance(1),
    };
    let (report, was) = cache::refine_poses(set, cache::folder(cache::IMAGES).as_deref(), &look)?;
    bar.finish();
    was.note.iter().for_each(|note| eprintln!("note: {note}"));
    eprintln!(
        "{}",
        report
            .as_ref()
            .map_or_else(|| NOT_REFINED.into(), refinement_words)
    );
    Ok(())
}

/// Note on sets whose poses cannot be refined.
const NOT_REFINED: &str =
    "poses: kept as given, for no two views with depth of their own see the same";

/// Describes the result of refining poses, in a sentence.
fn refinement_words(report: &RefinementReport) -> String {
    let [given, refined] = report.surface_distance.map(|share| share * 100.0);
    let [before, after] = report.levels;
    let found = format!(
        "points that were not used lie {given:.3} % of their distance off their neighbours' surfaces as given and {refined:.3} % refined, and \
         levels there differ by {before:.2} and {after:.2} ({} pairs of {} views)",
        report.pairs, report.views
    );
    match report.is_applied {
        false => format!("poses: kept as given: {found}"),
        true => {
            let [turned, moved] = report.movement;
            format!(
                "poses: refined by {turned:.3} degrees and {:.1} mm on average: {found}",
                moved * 1000.0
            )
        }
    }
}

/// Describes the registration of a set's colour cameras, in a sentence or two.
fn registration_words(report: &RegistrationReport) -> String {
    let [given, one, each] = report.levels;
    let exposure = format!(
        "exposures are evened out, from {:.2} to {:.2} of the mean",
        report.gain[0], report.gain[1]
    );
    let part = match report.sampled_views < report.views {
        true => format!(
            "{} of {} views, which speak for all,",
            report.sampled_views, report.views
        ),
        false => "views".into(),
    };
    let tried = format!(
        "{part} differ by {given:.2} levels as given, {one:.2} with one colour camera, {each:.2} with one for each view"
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
