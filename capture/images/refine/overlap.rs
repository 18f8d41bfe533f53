//! Which views are compared: of those that see the same, near ones, which see most of it, and far ones, which tie the set together.

use super::super::register::apart;
use super::Pose;
use super::range::RangeGrid;
use rayon::prelude::*;

/// So many of the views nearest to one are asked what they see of it.
const ASKED: usize = 32;

/// Partners of a view: so many of the nearest that overlap, and as many of the farthest.
const OF_EACH_KIND: usize = 4;

/// Views overlap if one sees this share of some points of the other.
const LEAST_OVERLAP: f64 = 0.3;

/// Cells from one point to the next that overlap is judged by.
const STEP: u32 = 6;

/// Points are of one surface if their depths differ by less than this share.
pub(super) const SAME_SURFACE: f64 = 0.1;

/// Pairs of views that overlap, in ascending order, none twice.
pub(super) fn pairs(grids: &[RangeGrid], poses: &[Pose], depth_m: f64) -> Vec<[usize; 2]> {
    let partners = |i: usize| {
        let mut ranked: Vec<(f64, usize)> = (0..poses.len())
            .filter(|&j| j != i)
            .map(|j| (apart(&poses[i], &poses[j], depth_m), j))
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ranked.truncate(ASKED);
        let overlaps =
            |j: usize| overlap((&grids[i], &poses[i]), (&grids[j], &poses[j])) >= LEAST_OVERLAP;
        let seen: Vec<usize> = ranked
            .into_iter()
            .map(|(_, j)| j)
            .filter(|&j| overlaps(j))
            .collect();
        let near = seen.len().min(OF_EACH_KIND);
        let far = seen.len().saturating_sub(OF_EACH_KIND).max(near);
        seen[..near]
            .iter()
            .chain(&seen[far..])
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

/// The share of one view's points that another sees.
fn overlap((from, pose): (&RangeGrid, &Pose), (to, other): (&RangeGrid, &Pose)) -> f64 {
    let (mut points, mut seen) = (0u32, 0u32);
    for row in (STEP / 2..from.size[1]).step_by(STEP as usize) {
        for column in (STEP / 2..from.size[0]).step_by(STEP as usize) {
            let Some(facet) = from.facet(column, row) else {
                continue;
            };
            points += 1;
            let found = to.seen_at(other.to_eye(pose.to_world(facet.point)));
            seen +=
                u32::from(found.is_some_and(|(there, depth)| {
                    (there.depth / depth - 1.0).abs() < SAME_SURFACE
                }));
        }
    }
    f64::from(seen) / f64::from(points.max(1))
}
