//! Poses that are slightly wrong, refined from depth (S12's images in practice): point-to-plane ICP between all neighbours at once.
//!
//! A point that one view sees lies on the surface that another sees where it projects to (Blais and Levine 1995): how far it lies off that
//! surface's plane (Chen and Medioni 1992) is linear in small movements of both views. All pairs of neighbours ([`overlap`]) give such
//! equations ([`equations`]), which are solved together, so that no drift adds up along a sequence ([`solve`]), again and again as
//! points find better partners. What depth does not tell (a flat wall may slide along itself) and the place of the whole stay as
//! the set says. Every fourth point is kept from the equations: poses are replaced only if these lie nearer to their neighbours' surfaces for it,
//! and colours there differ less, if they tell anything ([`judge`]).
//! Distances are taken on small depth pictures ([`range`]), a few dozen kB a view.

mod equations;
mod judge;
mod overlap;
mod range;
mod solve;
#[cfg(test)]
mod tests;

use super::pose::mean_apart;
use super::{ImageSet, ImagesError, Pose};
use equations::Neighbors;
use range::RangeGrid;
use rayon::prelude::*;

/// What refining a set's poses found.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinementReport {
    /// How far points lie off the surfaces of neighbouring views, a share of their distance, over points that were not used to refine: with the
    /// poses as given, and refined. The mean over pairs of their medians.
    pub apart: [f64; 2],
    /// By how much grey levels (of 255) differ at these points, which nothing was refined by.
    pub levels: [f64; 2],
    /// Whether the refined poses are applied.
    pub is_kept: bool,
    /// How far views were moved: mean angle, degrees, and mean distance, metres.
    pub moved: [f64; 2],
    /// Pairs of neighbours that were compared.
    pub pairs: usize,
    /// Views in these pairs.
    pub views: usize,
}

/// How far a refinement is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RefinementStep {
    /// So many views are to be loaded now.
    Loads(usize),
    /// Another one was.
    Loaded,
    /// So many rounds of equations are to be solved at most.
    Solves(usize),
    /// Another round was.
    Solved,
}

/// Rounds of partners and equations at most.
const ROUNDS: usize = 30;

/// Rounds end when no view turns by more than this, radians, nor moves by more, a share of the distance of what is seen.
const AT_REST: f64 = 1e-5;

impl ImageSet {
    /// Refines the poses of the views with depth of their own, and applies them if that is better; `look` is told how far it is.
    /// `None` for sets without overlapping views of such depth, or whose colours are registered already (which starts from poses).
    ///
    /// # Errors
    /// [`ImagesError`] of the first view that cannot be loaded.
    pub fn refine_poses(
        &mut self,
        look: &(dyn Fn(RefinementStep) + Sync),
    ) -> Result<Option<RefinementReport>, ImagesError> {
        let chosen: Vec<usize> = (0..self.views.len())
            .filter(|&i| self.views[i].has_own_depth())
            .collect();
        if chosen.len() < 2 || self.views.iter().any(|view| view.registration.is_some()) {
            return Ok(None);
        }
        look(RefinementStep::Loads(chosen.len()));
        let load = |&i: &usize| {
            let loaded = self.views[i].load()?;
            look(RefinementStep::Loaded);
            Ok(RangeGrid::of(&loaded))
        };
        let grids: Vec<RangeGrid> = chosen
            .par_iter()
            .map(load)
            .collect::<Result<_, ImagesError>>()?;
        let given: Vec<Pose> = chosen.iter().map(|&i| self.views[i].pose).collect();
        let Some((report, poses)) = refined(&grids, &given, self.depth_noise(), look) else {
            return Ok(None);
        };
        if report.is_kept {
            chosen
                .iter()
                .zip(poses)
                .for_each(|(&i, pose)| self.views[i].pose = pose);
        }
        Ok(Some(report))
    }
}

/// Poses of depth pictures, refined from those given; `None` if none overlap. `noise`: standard deviation of inverse depth, 1/m.
fn refined(
    grids: &[RangeGrid],
    given: &[Pose],
    noise: f32,
    look: &(dyn Fn(RefinementStep) + Sync),
) -> Option<(RefinementReport, Vec<Pose>)> {
    let depth_m = range::median_depth(grids)?;
    let pairs = overlap::pairs(grids, given, depth_m);
    if pairs.is_empty() {
        return None;
    }
    let neighbors = Neighbors {
        grids,
        pairs: &pairs,
        noise: f64::from(noise),
    };
    look(RefinementStep::Solves(ROUNDS));
    let mut poses = given.to_vec();
    let order = solve::Order::of(grids.len(), &pairs);
    for _ in 0..ROUNDS {
        let step = order.solve(
            &neighbors.equations(&poses),
            &solve::prior(&poses, given, depth_m),
        );
        look(RefinementStep::Solved);
        poses
            .iter_mut()
            .zip(&step)
            .for_each(|(pose, step)| *pose = solve::moved(pose, step));
        let largest = |range: std::ops::Range<usize>| {
            step.iter()
                .flat_map(|s| &s[range.clone()])
                .fold(0.0, |m: f64, s| m.max(s.abs()))
        };
        if largest(0..3) < AT_REST && largest(3..6) < AT_REST * depth_m {
            break;
        }
    }
    let [before, after] = [given, &poses].map(|poses| neighbors.judged(poses));
    let pixel_rad = grids.iter().map(|grid| grid.pixel_rad).sum::<f64>() / grids.len() as f64;
    let mut in_pairs = pairs.as_flattened().to_vec();
    in_pairs.sort_unstable();
    in_pairs.dedup();
    let report = RefinementReport {
        apart: [before.apart, after.apart],
        levels: [before.levels, after.levels],
        is_kept: after.is_better_than(&before, pixel_rad),
        moved: mean_apart(poses.iter().copied().zip(given.iter().copied())),
        pairs: pairs.len(),
        views: in_pairs.len(),
    };
    Some((report, poses))
}
