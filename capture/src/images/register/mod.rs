//! Colour registered with depth (S12): where a sensor's colour camera was, what lens it has, how it exposed.
//!
//! Raw RGB-D frames hold two pictures of two cameras: colour has another focal length than depth, stands beside it, opens its
//! shutter at another moment, and its exposure and white balance follow what it sees. Files say little of this. All of it follows from the
//! pictures: a point of the depth image, seen by the colour cameras of two frames, has one colour. [`estimate`] minimises
//! the difference over many pairs of frames ([`photometric`]), and keeps what it found only if points that it did not use
//! agree better for it. [`View::load`] then brings the depth into the colour picture ([`reproject`]).

mod evidence;
mod exposure;
mod photometric;
mod reproject;
mod solve;

use super::{ImageSet, ImagesError, Lens, LoadedView, Pinhole, Pose, View};
use evidence::Evidence;
use photometric::Problem;
use rayon::prelude::*;

/// The camera that took a view's colours, where that is not the camera of its depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    /// Its lens.
    pub lens: Pinhole,
    /// Where it was, world metres.
    pub pose: Pose,
    /// How much brighter its levels are than the set's, a channel.
    pub gain: [f32; 3],
}

/// What was found of a set's colour cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct RegistrationReport {
    /// Mean difference of levels (of 255) between frames, at points that were not used to estimate: as the set says, with one lens and place
    /// for all frames, and with a place for each.
    pub levels: [f64; 3],
    /// What is applied.
    pub kept: Kept,
    /// The focal length that the set says, and the one found, pixels.
    pub focal_px: [f64; 2],
    /// How far colour cameras are from depth cameras: mean angle, degrees, and mean distance, metres.
    pub moved: [f64; 2],
    /// The least and the largest exposure of a view, over the mean.
    pub gain: [f32; 2],
}

/// Which of the estimates is applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// Colour and depth are registered as the set says.
    AsGiven,
    /// One lens and one place beside the depth camera.
    OneForAll,
    /// One lens, and a place for each view.
    EachView,
}

/// More views than this are taken as they are: their evidence would not fit into a GB.
const MOST_VIEWS: usize = 3000;

/// Pairs of views without so much common evidence prove nothing.
const LEAST_PAIRS: usize = 4;

/// Whether an estimate is kept: if it lowers the mean difference of levels by a tenth, and by more than rounding to levels could.
fn is_better(levels: f64, before: f64) -> bool {
    levels < before * 0.9 && levels < before - 0.25
}

/// What was found, and the registration of each view of a set.
type Estimate = (RegistrationReport, Vec<Option<Registration>>);

/// Estimates where the colours of a set were taken from, and how exposed; `look` is told of each view that was loaded.
/// Sets without overlapping pinhole views with depth, or whose views are registered already, give `None`.
///
/// # Errors
/// [`ImagesError`] of the first view that cannot be loaded.
fn estimate(set: &ImageSet, look: &(dyn Fn(&str) + Sync)) -> Result<Option<Estimate>, ImagesError> {
    let chosen: Vec<usize> = (0..set.views.len())
        .filter(|&i| {
            let view = &set.views[i];
            view.has_own_depth() && view.registration.is_none() && matches!(view.lens, Lens::Pinhole(_))
        })
        .collect();
    // One lens for all: what a set of several cameras has in common is not theirs.
    let same = chosen.windows(2).all(|pair| {
        let [a, b] = [&set.views[pair[0]], &set.views[pair[1]]];
        a.lens == b.lens && a.size_px == b.size_px
    });
    if chosen.len() < 3 || chosen.len() > MOST_VIEWS || !same {
        return Ok(None);
    }
    let evidence: Result<Vec<Evidence>, ImagesError> = chosen
        .par_iter()
        .map(|&i| {
            let view = &set.views[i];
            let loaded = view.load()?;
            look(&view.name);
            Ok(Evidence::of(&loaded))
        })
        .collect();
    let Some(problem) = Problem::new(evidence?, set.views[chosen[0]].lens) else { return Ok(None) };
    if problem.pairs().len() < LEAST_PAIRS {
        return Ok(None);
    }
    let given = problem.as_given();
    let one = problem.one_for_all(&given);
    let each = problem.each_view(&one);
    let levels = [&given, &one, &each].map(|state| problem.unseen_levels(state));
    let mut kept = (Kept::AsGiven, &given, levels[0]);
    for (name, state, level) in [(Kept::OneForAll, &one, levels[1]), (Kept::EachView, &each, levels[2])] {
        if is_better(level, kept.2) {
            kept = (name, state, level);
        }
    }
    let (kept, state, _) = kept;
    let gains = exposure::estimate(&problem, state);
    let mut registrations = problem.registrations(state, &gains);
    if kept == Kept::AsGiven {
        for (registration, &i) in registrations.iter_mut().zip(&chosen) {
            let view = &set.views[i];
            if let Lens::Pinhole(lens) = view.lens.ideal() {
                *registration = Registration { lens, pose: view.pose, gain: registration.gain };
            }
        }
    }
    let (low, high) = gains.iter().flatten().fold((f32::MAX, 0.0f32), |(low, high), &g| (low.min(g), high.max(g)));
    let report = RegistrationReport {
        levels,
        kept,
        focal_px: [problem.given_focal_px(), registrations[0].lens.focal_px[0]],
        moved: problem.moved(state),
        gain: [low, high],
    };
    let mut all = vec![None; set.views.len()];
    for (&i, registration) in chosen.iter().zip(registrations) {
        all[i] = Some(registration);
    }
    Ok(Some((report, all)))
}

impl ImageSet {
    /// Estimates registration and exposure, and applies them to the views.
    ///
    /// # Errors
    /// See [`estimate`].
    pub fn register(&mut self, look: &(dyn Fn(&str) + Sync)) -> Result<Option<RegistrationReport>, ImagesError> {
        let Some((report, registrations)) = estimate(self, look)? else { return Ok(None) };
        for (view, registration) in self.views.iter_mut().zip(registrations) {
            view.registration = registration;
        }
        Ok(Some(report))
    }
}

impl View {
    /// Where its colours were taken from, world metres.
    pub fn color_pose(&self) -> Pose {
        self.registration.map_or(self.pose, |registration| registration.pose)
    }
}

impl Registration {
    /// Brings the depth of a view, its lens ideal, into its colour picture, takes the distortion that was found from the colours, and
    /// evens out their exposure.
    pub(super) fn apply(&self, mut view: LoadedView) -> LoadedView {
        for pixel in &mut view.color {
            for (level, gain) in pixel.iter_mut().zip(self.gain) {
                *level = (f32::from(*level) / gain + 0.5).min(255.0) as u8;
            }
        }
        let lens = Lens::Pinhole(self.lens);
        if lens == view.lens && self.pose == view.pose {
            return view;
        }
        let depth = reproject::depth(&view, lens.ideal(), &self.pose);
        let color = LoadedView { lens, pose: self.pose, depth: Vec::new(), ..view }.undistorted();
        LoadedView { depth, ..color }
    }
}

#[cfg(test)]
mod tests;
