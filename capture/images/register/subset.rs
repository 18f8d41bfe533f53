//! Representative subset of a large set: small groups of neighbouring views, evenly spread.
//!
//! Estimation needs views that see the same points from different poses: neighbours do, single
//! views from all over the set rarely do. Groups from all over the set favour no part of it.

use super::Pose;

/// Members of a group besides its first view, as ranks by distance from it: near ones overlap most,
/// farther ones have more parallax.
const RANKS: [usize; 3] = [1, 7, 23];

/// Number of views of a group.
pub(super) const GROUP_SIZE: usize = 1 + RANKS.len();

/// Returns the distance of two views: distance of the eyes over the scene's depth, plus the angle
/// between the axes, radians.
fn view_distance(a: &Pose, b: &Pose, depth_m: f64) -> f64 {
    a.eye.distance(b.eye) / depth_m
        + a.world_from_eye
            .z_axis
            .angle_between(b.world_from_eye.z_axis)
}

/// Returns the indices of all views but `own`, the nearest first; on a tie, the lower index first.
pub(crate) fn rank_others(poses: &[Pose], own: usize, depth_m: f64) -> Vec<usize> {
    let mut ranked: Vec<(f64, usize)> = (0..poses.len())
        .filter(|&i| i != own)
        .map(|i| (view_distance(&poses[own], &poses[i], depth_m), i))
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    ranked.into_iter().map(|(_, i)| i).collect()
}

/// Returns the first view of each group, evenly spread over the order of `count` views.
pub(super) fn first_views(count: usize, groups: usize) -> Vec<usize> {
    (0..groups)
        .map(|group| (2 * group + 1) * count / (2 * groups))
        .collect()
}

/// Completes the groups of first views; the result is in ascending order without duplicates.
pub(super) fn complete_groups(poses: &[Pose], firsts: &[usize], depth_m: f64) -> Vec<usize> {
    let mut chosen: std::collections::BTreeSet<usize> = firsts.iter().copied().collect();
    for &first in firsts {
        let mut others = rank_others(poses, first, depth_m);
        others.retain(|i| !chosen.contains(i));
        chosen.extend(RANKS.iter().filter_map(|&rank| others.get(rank - 1)));
    }
    chosen.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn groups_near_and_spread() {
        let pose = |i: usize| Pose {
            eye: DVec3::X * (i % 40) as f64 + DVec3::Y * (i / 40) as f64,
            world_from_eye: DMat3::IDENTITY,
        };
        let poses: Vec<Pose> = (0..1000).map(pose).collect();
        let firsts = first_views(poses.len(), 12);
        let chosen = complete_groups(&poses, &firsts, 3.0);
        assert_eq!(chosen.len(), 12 * GROUP_SIZE);
        assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]));
        let nearest = |i: &usize| {
            let others = firsts
                .iter()
                .map(|first| poses[*first].eye.distance(poses[*i].eye));
            others.fold(f64::INFINITY, f64::min)
        };
        assert!(
            chosen.iter().all(|i| nearest(i) < 4.0),
            "the 23rd nearest is three steps away, or four at a border"
        );
        for part in 0..4 {
            assert!(
                chosen
                    .iter()
                    .any(|i| (part * 250..(part + 1) * 250).contains(i))
            );
        }
        // Hardly more views than requested.
        assert!(complete_groups(&poses[..5], &[0, 2], 3.0).len() <= 5);
    }
}
