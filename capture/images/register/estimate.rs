//! Registration of a set: the model is chosen on a subset of a large set and applied to all of it.
//!
//! One lens and one offset from the depth cameras, once estimated, hold for every view. Only a pose
//! or an exposure for each view needs all views, and the subset shows whether they are needed. So a
//! set that was rendered, or registered by other programs, is recognised from a few dozen of its
//! views, whatever its size.

use super::calibration::Calibration;
use super::photometric::PhotometricProblem;
use super::view_samples::{MAX_COLUMNS, ViewSamples};
use super::{
    Exposure, ImageSet, ImagesError, Lens, Pinhole, Pose, Registration, RegistrationModel,
    RegistrationReport, RegistrationStep, exposure, subset,
};
use rayon::prelude::*;

/// Number of groups of neighbours in the subset; smaller sets are used completely.
pub(super) const GROUPS: usize = 12;

/// Maximum number of views with individual estimates: the samples of more would not fit into a GB.
const MAX_VIEWS: usize = 2500;

/// Approximate maximum number of points of all views for individual estimates, and minimum columns
/// of points of each view.
const MAX_POINTS: f64 = 400_000.0;
const MIN_COLUMNS: u32 = 16;

/// Minimum number of overlapping pairs of views.
const MIN_PAIRS: usize = 4;

/// Returns true if an estimate lowers the mean difference of levels by a tenth, and by more than
/// the rounding of levels.
pub(super) fn is_better(levels: f64, before: f64) -> bool {
    levels < before * 0.9 && levels < before - 0.25
}

/// Largest ratio of the focal lengths of the colour and the depth camera of a sensor, either way.
const MAX_FOCAL_RATIO: f64 = 1.5;

/// Returns true if an estimate may be a camera of the sensor. One that shrinks all images to a point
/// has no differences at all.
pub(super) fn is_plausible(estimate: &Calibration, given: &Pinhole) -> bool {
    let ratio = estimate.focal_px / given.focal_px[0];
    (1.0 / MAX_FOCAL_RATIO..=MAX_FOCAL_RATIO).contains(&ratio)
}

/// Report, and the registration of each view of a set.
pub(super) type Estimate = (RegistrationReport, Vec<Option<Registration>>);

/// Loads samples of some views, by index, with a maximum number of columns of points.
type LoadSamples<'a> = dyn Fn(&[usize], u32) -> Result<Vec<ViewSamples>, ImagesError> + 'a;

/// Estimates the colour cameras and exposures of a set; `on_step` reports progress. Returns `None`
/// for sets without overlapping pinhole views with depth, or whose views are already registered.
///
/// # Errors
/// [`ImagesError`] of the first view that cannot be loaded.
pub(super) fn estimate(
    set: &ImageSet,
    groups: usize,
    on_step: &(dyn Fn(RegistrationStep) + Sync),
) -> Result<Option<Estimate>, ImagesError> {
    let chosen: Vec<usize> = (0..set.views.len())
        .filter(|&i| {
            let view = &set.views[i];
            view.has_own_depth()
                && view.registration.is_none()
                && matches!(view.lens, Lens::Pinhole(_))
        })
        .collect();
    // The estimate assumes a single camera.
    let is_one_camera = chosen.windows(2).all(|pair| {
        let [a, b] = [&set.views[pair[0]], &set.views[pair[1]]];
        a.lens == b.lens && a.size_px == b.size_px
    });
    if chosen.len() < 3 || !is_one_camera {
        return Ok(None);
    }
    let Lens::Pinhole(given) = set.views[chosen[0]].lens.ideal() else {
        return Ok(None);
    };
    let load = |indices: &[usize], columns: u32| {
        on_step(RegistrationStep::LoadingStarted(indices.len()));
        let sample = |&index: &usize| {
            let view = &set.views[chosen[index]];
            let loaded = view.load()?;
            on_step(RegistrationStep::ViewLoaded);
            Ok(ViewSamples::new(&loaded, columns))
        };
        indices.par_iter().map(sample).collect()
    };
    let poses: Vec<Pose> = chosen.iter().map(|&i| set.views[i].pose).collect();
    let Some((report, registrations)) = estimate_views(&poses, given, groups, &load)? else {
        return Ok(None);
    };
    let mut all = vec![None; set.views.len()];
    for (&i, registration) in chosen.iter().zip(registrations) {
        all[i] = Some(registration);
    }
    Ok(Some((report, all)))
}

/// Estimates the colour cameras of views with one lens.
pub(super) fn estimate_views(
    poses: &[Pose],
    given: Pinhole,
    groups: usize,
    load: &LoadSamples,
) -> Result<Option<(RegistrationReport, Vec<Registration>)>, ImagesError> {
    let samples = load_subset(poses, groups, load)?;
    let sampled_views = samples.len();
    let problem = PhotometricProblem::new(samples, given);
    if problem.pairs.len() < MIN_PAIRS {
        return Ok(None);
    }
    let initial = problem.initial_calibration();
    let shared = problem.estimate_shared_offset(&initial);
    let [given_levels, shared_levels] = [&initial, &shared].map(|it| problem.validate(it));
    let is_worse = shared_levels > given_levels || !is_plausible(&shared, &given);
    let per_view = problem.estimate_per_view(if is_worse { &initial } else { &shared });
    let levels = [given_levels, shared_levels, problem.validate(&per_view)];
    let mut best = (RegistrationModel::AsGiven, &initial, levels[0]);
    for (model, estimate, level) in [
        (RegistrationModel::SharedOffset, &shared, levels[1]),
        (RegistrationModel::PerView, &per_view, levels[2]),
    ] {
        if is_better(level, best.2) && is_plausible(estimate, &given) {
            best = (model, estimate, level);
        }
    }
    let (mut applied, estimate, _) = best;
    let exposures = exposure::estimate(&problem, estimate);
    let offset = estimate.mean_offset(problem.poses());
    let (estimate, exposures) = if sampled_views == poses.len() {
        (estimate.clone(), exposures)
    } else {
        if poses.len() > MAX_VIEWS && applied == RegistrationModel::PerView {
            applied = if is_better(levels[1], levels[0]) && is_plausible(&shared, &given) {
                RegistrationModel::SharedOffset
            } else {
                RegistrationModel::AsGiven
            };
        }
        let common = if applied == RegistrationModel::AsGiven {
            &initial
        } else {
            &shared
        };
        let all = common.transfer(&initial, poses.iter().copied());
        let has_exposures = exposures.iter().any(|it| *it != Exposure::EVEN);
        let needs_all_views = applied == RegistrationModel::PerView || has_exposures;
        if needs_all_views && poses.len() <= MAX_VIEWS {
            estimate_all_views(all, applied, poses.len(), given, load)?
        } else {
            (all, vec![Exposure::EVEN; poses.len()])
        }
    };
    let gains = exposures.iter().flat_map(|exposure| exposure.gain);
    let (low, high) = gains.fold((f32::MAX, 0.0f32), |(low, high), gain| {
        (low.min(gain), high.max(gain))
    });
    let mut registrations = estimate.to_registrations(&exposures);
    if applied == RegistrationModel::AsGiven {
        // Restores the given cameras to the last digit.
        for (registration, pose) in registrations.iter_mut().zip(poses) {
            *registration = Registration {
                lens: given,
                pose: *pose,
                exposure: registration.exposure,
            };
        }
    }
    let report = RegistrationReport {
        levels,
        applied,
        focal_px: [given.focal_px[0], registrations[0].lens.focal_px[0]],
        offset,
        gain: [low, high],
        sampled_views,
        views: poses.len(),
    };
    Ok(Some((report, registrations)))
}

/// Loads samples of the representative subset.
fn load_subset(
    poses: &[Pose],
    groups: usize,
    load: &LoadSamples,
) -> Result<Vec<ViewSamples>, ImagesError> {
    // For hardly larger sets, loading all views once is as fast.
    if poses.len() <= 2 * groups * subset::GROUP_SIZE {
        return load(&(0..poses.len()).collect::<Vec<_>>(), MAX_COLUMNS);
    }
    let firsts = subset::first_views(poses.len(), groups);
    let mut samples = load(&firsts, MAX_COLUMNS)?;
    let depth_m =
        samples.iter().map(|view| view.depth_m).sum::<f64>() / samples.len().max(1) as f64;
    let mut others = subset::complete_groups(poses, &firsts, depth_m);
    others.retain(|index| !firsts.contains(index));
    samples.extend(load(&others, MAX_COLUMNS)?);
    Ok(samples)
}

/// Estimates the exposure of every view, and its pose if `applied` has one, starting from the
/// shared offset.
fn estimate_all_views(
    common: Calibration,
    applied: RegistrationModel,
    count: usize,
    given: Pinhole,
    load: &LoadSamples,
) -> Result<(Calibration, Vec<Exposure>), ImagesError> {
    // Assumes an aspect ratio of four to three.
    let columns = (MAX_POINTS / count as f64 * 4.0 / 3.0).sqrt() as u32;
    let samples = load(
        &(0..count).collect::<Vec<_>>(),
        columns.clamp(MIN_COLUMNS, MAX_COLUMNS),
    )?;
    let problem = PhotometricProblem::new(samples, given);
    let estimate = if applied == RegistrationModel::PerView {
        problem.estimate_per_view(&common)
    } else {
        common
    };
    let exposures = exposure::estimate(&problem, &estimate);
    Ok((estimate, exposures))
}
