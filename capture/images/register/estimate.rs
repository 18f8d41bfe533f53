//! From a set to what its views are registered by: judged by a part of a large set, applied to all of it.
//!
//! One lens and one place beside the depth cameras, once found, hold for every view. Only a place for each view, or an exposure of each,
//! asks all views; that they are called for, the part has shown by then. So a set that was rendered, or registered by others, is known as
//! such from a few dozen of its views, whatever its size.

use super::evidence::{COLUMNS, Evidence};
use super::photometric::Problem;
use super::state::State;
use super::{
    ImageSet, ImagesError, Kept, Lens, Pinhole, Pose, Registration, RegistrationReport,
    RegistrationStep,
};
use crate::register::{exposure, part};
use rayon::prelude::*;

/// Groups of neighbours that speak for a set; smaller sets speak for themselves.
pub(super) const GROUPS: usize = 12;

/// More views than this are not asked each: their evidence would not fit into a GB.
const MOST_VIEWS: usize = 2500;

/// Points of all views together that a place for each of them is found from, if they are many; of each, columns at least.
const MOST_POINTS: f64 = 400_000.0;
const LEAST_COLUMNS: u32 = 16;

/// Pairs of views without so much common evidence prove nothing.
const LEAST_PAIRS: usize = 4;

/// Whether an estimate is kept: if it lowers the mean difference of levels by a tenth, and by more than rounding to levels could.
pub(super) fn is_better(levels: f64, before: f64) -> bool {
    levels < before * 0.9 && levels < before - 0.25
}

/// What was found, and the registration of each view of a set.
pub(super) type Estimate = (RegistrationReport, Vec<Option<Registration>>);

/// Loads what is needed of some of a set's views.
type Load<'a> = dyn Fn(&[usize], u32) -> Result<Vec<Evidence>, ImagesError> + 'a;

/// Estimates where the colours of a set were taken from, and how exposed; `look` is told how far that is.
/// Sets without overlapping pinhole views with depth, or whose views are registered already, give `None`.
///
/// # Errors
/// [`ImagesError`] of the first view that cannot be loaded.
pub(super) fn estimate(
    set: &ImageSet,
    groups: usize,
    look: &(dyn Fn(RegistrationStep) + Sync),
) -> Result<Option<Estimate>, ImagesError> {
    let chosen: Vec<usize> = (0..set.views.len())
        .filter(|&i| {
            let view = &set.views[i];
            view.has_own_depth()
                && view.registration.is_none()
                && matches!(view.lens, Lens::Pinhole(_))
        })
        .collect();
    // One lens for all: what a set of several cameras has in common is not theirs.
    let same = chosen.windows(2).all(|pair| {
        let [a, b] = [&set.views[pair[0]], &set.views[pair[1]]];
        a.lens == b.lens && a.size_px == b.size_px
    });
    if chosen.len() < 3 || !same {
        return Ok(None);
    }
    let Lens::Pinhole(given) = set.views[chosen[0]].lens.ideal() else {
        return Ok(None);
    };
    let load = |numbers: &[usize], columns: u32| {
        look(RegistrationStep::Begins(numbers.len()));
        let evidence = |&number: &usize| {
            let view = &set.views[chosen[number]];
            let loaded = view.load()?;
            look(RegistrationStep::Loaded);
            Ok(Evidence::of(&loaded, columns))
        };
        numbers.par_iter().map(evidence).collect()
    };
    let poses: Vec<Pose> = chosen.iter().map(|&i| set.views[i].pose).collect();
    let Some((report, registrations)) = of_views(&poses, given, groups, &load)? else {
        return Ok(None);
    };
    let mut all = vec![None; set.views.len()];
    for (&i, registration) in chosen.iter().zip(registrations) {
        all[i] = Some(registration);
    }
    Ok(Some((report, all)))
}

/// Of views of one lens.
pub(super) fn of_views(
    poses: &[Pose],
    given: Pinhole,
    groups: usize,
    load: &Load,
) -> Result<Option<(RegistrationReport, Vec<Registration>)>, ImagesError> {
    let evidence = judges(poses, groups, load)?;
    let judged = evidence.len();
    let problem = Problem::new(evidence, given);
    if problem.pairs().len() < LEAST_PAIRS {
        return Ok(None);
    }
    let asked = problem.as_given();
    let one = problem.one_for_all(&asked);
    let each = problem.each_view(&one);
    let levels = [&asked, &one, &each].map(|state| problem.unseen_levels(state));
    let mut kept = (Kept::AsGiven, &asked, levels[0]);
    for (name, state, level) in [
        (Kept::OneForAll, &one, levels[1]),
        (Kept::EachView, &each, levels[2]),
    ] {
        if is_better(level, kept.2) {
            kept = (name, state, level);
        }
    }
    let (mut kept, state, _) = kept;
    let gains = exposure::estimate(&problem, state);
    let moved = state.moved_from(problem.poses());
    let (state, gains) = if judged == poses.len() {
        (state.clone(), gains)
    } else {
        if poses.len() > MOST_VIEWS && kept == Kept::EachView {
            kept = if is_better(levels[1], levels[0]) {
                Kept::OneForAll
            } else {
                Kept::AsGiven
            };
        }
        let common = if kept == Kept::AsGiven { &asked } else { &one };
        let all = common.of_others(&asked, poses.iter().copied());
        let vary = gains.as_flattened().iter().any(|&gain| gain != 1.0);
        match (kept == Kept::EachView || vary) && poses.len() <= MOST_VIEWS {
            true => each_asked(all, kept, poses.len(), given, load)?,
            false => (all, vec![[1.0; 3]; poses.len()]),
        }
    };
    let (low, high) = gains
        .iter()
        .flatten()
        .fold((f32::MAX, 0.0f32), |(low, high), &g| {
            (low.min(g), high.max(g))
        });
    let mut registrations = state.registrations(&gains);
    if kept == Kept::AsGiven {
        // To the last digit.
        for (registration, pose) in registrations.iter_mut().zip(poses) {
            *registration = Registration {
                lens: given,
                pose: *pose,
                gain: registration.gain,
            };
        }
    }
    let focal_px = [
        given.focal_px[0],
        registrations
            .first()
            .map_or(given.focal_px[0], |first| first.lens.focal_px[0]),
    ];
    let report = RegistrationReport {
        levels,
        kept,
        focal_px,
        moved,
        gain: [low, high],
        judged,
        views: poses.len(),
    };
    Ok(Some((report, registrations)))
}

/// Evidence of the views that speak for all.
fn judges(poses: &[Pose], groups: usize, load: &Load) -> Result<Vec<Evidence>, ImagesError> {
    // Of hardly more than that, all are as quickly asked, twice.
    if poses.len() <= 2 * groups * part::GROUP {
        return load(&(0..poses.len()).collect::<Vec<_>>(), COLUMNS);
    }
    let firsts = part::firsts(poses.len(), groups);
    let mut known = load(&firsts, COLUMNS)?;
    let depth_m = known.iter().map(|view| view.depth_m).sum::<f64>() / known.len().max(1) as f64;
    let mut others = part::groups(poses, &firsts, depth_m);
    others.retain(|number| !firsts.contains(number));
    known.extend(load(&others, COLUMNS)?);
    Ok(known)
}

/// Each view's own place, if that is `kept`, and exposure, beginning with what is common to all.
fn each_asked(
    common: State,
    kept: Kept,
    count: usize,
    given: Pinhole,
    load: &Load,
) -> Result<(State, Vec<[f32; 3]>), ImagesError> {
    // Of pictures that are four by three.
    let columns = (MOST_POINTS / count as f64 * 4.0 / 3.0).sqrt() as u32;
    let evidence = load(
        &(0..count).collect::<Vec<_>>(),
        columns.clamp(LEAST_COLUMNS, COLUMNS),
    )?;
    let problem = Problem::new(evidence, given);
    let state = if kept == Kept::EachView {
        problem.each_view(&common)
    } else {
        common
    };
    let gains = exposure::estimate(&problem, &state);
    Ok((state, gains))
}
