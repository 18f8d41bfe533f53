//! Pose refinement from depth (S12's images in practice): point-to-plane ICP between all
//! neighbouring views at once.
//!
//! A point of one view lies on the surface that another view sees where it projects to (Blais and
//! Levine 1995); its distance from that surface's plane (Chen and Medioni 1992) is linear in small
//! movements of both views. All pairs of overlapping views ([`overlap`]) contribute such equations
//! ([`equations`]), which are solved together, so that no drift accumulates along a sequence
//! ([`solve`]), and again as points find better partners. Degrees of freedom that depth leaves open
//! (a flat wall may slide along itself) and the position of the whole set stay as given. Every
//! fourth point is excluded from the equations: poses are replaced only if these validation points
//! lie nearer to their neighbours' surfaces and the colours there differ less, if they are
//! discriminative ([`validate`]). Distances are measured on small depth images ([`range`]) of a few
//! dozen kB per view.

mod equations;
mod overlap;
mod range;
mod solve;
#[cfg(test)]
mod tests;
mod validate;

use super::cameras::pose::mean_difference;
use super::{ImageSet, ImagesError, Pose};
use equations::IcpProblem;
use range::RangeGrid;
use rayon::prelude::*;

/// Result of refining a set's poses.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinementReport {
    /// Distance of the validation points from the surfaces of neighbouring views, relative to their
    /// depth, with the given and with the refined poses: the mean over pairs of their medians.
    pub surface_distance: [f64; 2],
    /// Difference of grey levels (0..=255) at these points, which is not minimised.
    pub levels: [f64; 2],
    /// True if the refined poses are applied.
    pub is_applied: bool,
    /// Movement of the views: mean angle, degrees, and mean distance, metres.
    pub movement: [f64; 2],
    /// Number of compared pairs of neighbours.
    pub pairs: usize,
    /// Number of views in these pairs.
    pub views: usize,
}

/// Progress of a refinement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RefinementStep {
    /// Loading of this number of views starts.
    LoadingStarted(usize),
    /// A view was loaded.
    ViewLoaded,
    /// At most this number of rounds of equations starts.
    SolvingStarted(usize),
    /// A round was solved.
    RoundSolved,
}

/// Maximum number of rounds of matching and solving.
const MAX_ROUNDS: usize = 30;

/// Convergence threshold: maximum turn of a view in a round, radians, and movement relative to the
/// median depth.
const CONVERGED: f64 = 1e-5;

impl ImageSet {
    /// Refines the poses of the views with measured depth and applies them if they are better;
    /// `on_step` reports progress. Returns `None` for sets without overlapping views with such
    /// depth, or whose colours are already registered (registration starts from the poses).
    ///
    /// # Errors
    /// [`ImagesError`] of the first view that cannot be loaded.
    pub fn refine_poses(
        &mut self,
        on_step: &(dyn Fn(RefinementStep) + Sync),
    ) -> Result<Option<RefinementReport>, ImagesError> {
        let chosen: Vec<usize> = (0..self.views.len())
            .filter(|&i| self.views[i].has_own_depth())
            .collect();
        if chosen.len() < 2 || self.views.iter().any(|view| view.registration.is_some()) {
            return Ok(None);
        }
        on_step(RefinementStep::LoadingStarted(chosen.len()));
        let load = |&i: &usize| {
            let loaded = self.views[i].load()?;
            on_step(RefinementStep::ViewLoaded);
            Ok(RangeGrid::new(&loaded))
        };
        let grids: Vec<RangeGrid> = chosen
            .par_iter()
            .map(load)
            .collect::<Result<_, ImagesError>>()?;
        let given: Vec<Pose> = chosen.iter().map(|&i| self.views[i].pose).collect();
        let Some((report, poses)) = refine(&grids, &given, self.depth_noise(), on_step) else {
            return Ok(None);
        };
        if report.is_applied {
            chosen
                .iter()
                .zip(poses)
                .for_each(|(&i, pose)| self.views[i].pose = pose);
        }
        Ok(Some(report))
    }
}

/// Refines given poses of depth images; `None` if none overlap. `noise` is the standard deviation
/// of inverse depth, 1/m.
fn refine(
    grids: &[RangeGrid],
    given: &[Pose],
    noise: f32,
    on_step: &(dyn Fn(RefinementStep) + Sync),
) -> Option<(RefinementReport, Vec<Pose>)> {
    let depth_m = range::median_depth(grids)?;
    let pairs = overlap::find_pairs(grids, given, depth_m);
    if pairs.is_empty() {
        return None;
    }
    let problem = IcpProblem {
        grids,
        pairs: &pairs,
        noise: f64::from(noise),
    };
    on_step(RefinementStep::SolvingStarted(MAX_ROUNDS));
    let mut poses = given.to_vec();
    let order = solve::EliminationOrder::new(grids.len(), &pairs);
    for _ in 0..MAX_ROUNDS {
        let step = order.solve(
            &problem.equations(&poses),
            &solve::prior(&poses, given, depth_m),
        );
        on_step(RefinementStep::RoundSolved);
        poses
            .iter_mut()
            .zip(&step)
            .for_each(|(pose, step)| *pose = solve::apply_step(pose, step));
        let largest = |range: std::ops::Range<usize>| {
            step.iter()
                .flat_map(|s| &s[range.clone()])
                .fold(0.0, |m: f64, s| m.max(s.abs()))
        };
        if largest(0..3) < CONVERGED && largest(3..6) < CONVERGED * depth_m {
            break;
        }
    }
    let [before, after] = [given, &poses].map(|poses| problem.validate(poses));
    let pixel_rad = grids.iter().map(|grid| grid.pixel_rad).sum::<f64>() / grids.len() as f64;
    let mut paired_views = pairs.as_flattened().to_vec();
    paired_views.sort_unstable();
    paired_views.dedup();
    let report = RefinementReport {
        surface_distance: [before.surface_distance, after.surface_distance],
        levels: [before.levels, after.levels],
        is_applied: after.is_better_than(&before, pixel_rad),
        movement: mean_difference(poses.iter().copied().zip(given.iter().copied())),
        pairs: pairs.len(),
        views: paired_views.len(),
    };
    Some((report, poses))
}
