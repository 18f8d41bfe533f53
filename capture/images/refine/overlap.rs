//! Selection of pairs of overlapping views: near ones, which overlap most, and far ones, which tie
//! the set together.

use super::super::register::rank_others;
use super::Pose;
use super::range::RangeGrid;
use rayon::prelude::*;

/// Number of nearest views that are tested for overlap.
const MAX_TESTED: usize = 32;

/// Number of nearest and of farthest overlapping views that become partners of a view.
const PARTNERS_PER_KIND: usize = 4;

/// Minimum fraction of one view's points that an overlapping view sees.
const MIN_OVERLAP: f64 = 0.3;

/// Distance of the cells sampled for overlap.
const STEP: u32 = 6;

/// Maximum relative depth difference of points on one surface.
pub(super) const SAME_SURFACE: f64 = 0.1;

/// Returns the pairs of overlapping views, in ascending order without duplicates.
pub(super) fn find_pairs(grids: &[RangeGrid], poses: &[Pose], depth_m: f64) -> Vec<[usize; 2]> {
    let partners = |i: usize| {
        let overlaps =
            |j: &usize| overlap((&grids[i], &poses[i]), (&grids[*j], &poses[*j])) >= MIN_OVERLAP;
        let tested = rank_others(poses, i, depth_m).into_iter().take(MAX_TESTED);
        let overlapping: Vec<usize> = tested.filter(overlaps).collect();
        let near = overlapping.len().min(PARTNERS_PER_KIND);
        let far = overlapping
            .len()
            .saturating_sub(PARTNERS_PER_KIND)
            .max(near);
        overlapping[..near]
            .iter()
            .chain(&overlapping[far..])
            .map(|&j| [i.min(j), i.max(j)])
            .collect::<Vec<_>>()
    };
    let mut pairs: Vec<[usize; 2]> = (0..poses.len())
        .into_par_iter()
        .flat_map_iter(partners)
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Returns the fraction of one view's points that another sees.
fn overlap((from, pose): (&RangeGrid, &Pose), (to, other): (&RangeGrid, &Pose)) -> f64 {
    let mut points = 0u32;
    let mut visible = 0u32;
    for row in (STEP / 2..from.size[1]).step_by(STEP as usize) {
        for column in (STEP / 2..from.size[0]).step_by(STEP as usize) {
            let Some(facet) = from.facet(column, row) else {
                continue;
            };
            points += 1;
            let projected = to.project(other.to_eye(pose.to_world(facet.point)));
            visible += u32::from(projected.is_some_and(|(surface, depth)| {
                (surface.depth / depth - 1.0).abs() < SAME_SURFACE
            }));
        }
    }
    f64::from(visible) / f64::from(points.max(1))
}
