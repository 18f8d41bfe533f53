//! Which views of a large set speak for all of it: small groups of neighbours, evenly spread.
//!
//! Views prove something where they see the same from elsewhere. Single views picked here and there would not; neighbours do, and groups
//! from all over the set do not speak for one of its corners.

use super::Pose;

/// Views of a group beside its first, by how near they are to it: near ones see the same, farther ones see it from elsewhere.
const RANKS: [usize; 3] = [1, 7, 23];

/// Views of a group.
pub(super) const GROUP: usize = 1 + RANKS.len();

/// How far apart two views are: steps over the depth of what is seen, and turns, radians.
pub(crate) fn apart(a: &Pose, b: &Pose, depth_m: f64) -> f64 {
    a.eye.distance(b.eye) / depth_m
        + a.world_from_eye
            .z_axis
            .angle_between(b.world_from_eye.z_axis)
}

/// The first of each of so many groups of `count` views, evenly spread over their order.
pub(super) fn firsts(count: usize, groups: usize) -> Vec<usize> {
    (0..groups)
        .map(|group| (2 * group + 1) * count / (2 * groups))
        .collect()
}

/// The groups of first views, in ascending order, none twice.
pub(super) fn groups(poses: &[Pose], firsts: &[usize], depth_m: f64) -> Vec<usize> {
    let mut chosen: std::collections::BTreeSet<usize> = firsts.iter().copied().collect();
    for &first in firsts {
        let mut others: Vec<(f64, usize)> = (0..poses.len())
            .filter(|i| !chosen.contains(i))
            .map(|i| (apart(&poses[first], &poses[i], depth_m), i))
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        chosen.extend(
            RANKS
                .iter()
                .filter_map(|&rank| others.get(rank - 1))
                .map(|&(_, i)| i),
        );
    }
    chosen.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    #[test]
    fn groups_are_of_neighbours_from_all_over_the_set() {
        let pose = |i: usize| Pose {
            eye: DVec3::X * (i % 40) as f64 + DVec3::Y * (i / 40) as f64,
            world_from_eye: DMat3::IDENTITY,
        };
        let poses: Vec<Pose> = (0..1000).map(pose).collect();
        let firsts = firsts(poses.len(), 12);
        let chosen = groups(&poses, &firsts, 3.0);
        assert_eq!(chosen.len(), 12 * GROUP);
        assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]));
        let nearest = |i: &usize| {
            let others = firsts
                .iter()
                .map(|first| poses[*first].eye.distance(poses[*i].eye));
            others.fold(f64::INFINITY, f64::min)
        };
        assert!(
            chosen.iter().all(|i| nearest(i) < 4.0),
            "the 23rd nearest is three steps away, or four at a rim"
        );
        for part in 0..4 {
            assert!(
                chosen
                    .iter()
                    .any(|i| (part * 250..(part + 1) * 250).contains(i))
            );
        }
        // Where there are hardly more than are asked for.
        assert!(groups(&poses[..5], &[0, 2], 3.0).len() <= 5);
    }
}
