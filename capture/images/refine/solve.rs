//! The equations of all views together: a sparse matrix of blocks, solved by Cholesky's decomposition.

use super::Pose;
use super::equations::{Block, OF_PAIR, OF_VIEW};
use glam::{DMat3, DQuat, DVec3};
use nalgebra::DMatrix;
use nalgebra_sparse::factorization::CscCholesky;
use nalgebra_sparse::{CooMatrix, CscMatrix};

/// How far views may well be off, radians, and a share of the distance of what is seen: ten pixels of usual pictures. So where a view was
/// given counts a hundredth of what a point does; it says where the whole stands, and what depth does not tell.
const PRIOR: f64 = 0.03;

/// What holds a view where it was given: for each of its unknowns a weight, and what it is by now.
pub(super) type Prior = Vec<[[f64; 2]; OF_VIEW]>;

/// A view's small turn and step, world axes.
pub(super) type Step = [f64; OF_VIEW];

/// The prior of views that were given elsewhere.
pub(super) fn prior(poses: &[Pose], given: &[Pose], depth_m: f64) -> Prior {
    let weights = [PRIOR, PRIOR * depth_m].map(|sigma| 1.0 / (sigma * sigma));
    let of_view = |(pose, given): (&Pose, &Pose)| {
        let turned = DQuat::from_mat3(&(pose.world_from_eye * given.world_from_eye.transpose()))
            .to_scaled_axis();
        let [turned, stepped] = [turned, pose.eye - given.eye].map(|change| change.to_array());
        std::array::from_fn(|i| {
            if i < 3 {
                [weights[0], turned[i]]
            } else {
                [weights[1], stepped[i - 3]]
            }
        })
    };
    poses.iter().zip(given).map(of_view).collect()
}

/// A pose after a small turn and step.
pub(super) fn moved(pose: &Pose, step: &Step) -> Pose {
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(&step[..3])));
    let [x, y] = [
        turn * pose.world_from_eye.x_axis,
        turn * pose.world_from_eye.y_axis,
    ]
    .map(DVec3::normalize);
    // Roundings of many turns do not add up.
    let y = (y - x * x.dot(y)).normalize();
    Pose {
        eye: pose.eye + DVec3::from_slice(&step[3..]),
        world_from_eye: DMat3::from_cols(x, y, x.cross(y)),
    }
}

/// In which order views stand in the equations: neighbours near each other, so that the decomposition fills little (Cuthill and McKee
/// 1969, reversed).
pub(super) struct Order {
    /// The place of each view.
    places: Vec<usize>,
}

impl Order {
    /// Of so many views, of which some are compared.
    pub(super) fn of(views: usize, pairs: &[[usize; 2]]) -> Self {
        let mut beside = vec![Vec::new(); views];
        for &[a, b] in pairs {
            beside[a].push(b);
            beside[b].push(a);
        }
        let degree = |&view: &usize| (beside[view].len(), view);
        let mut starts: Vec<usize> = (0..views).collect();
        starts.sort_by_key(degree);
        let (mut order, mut is_in) = (Vec::with_capacity(views), vec![false; views]);
        for start in starts {
            if std::mem::replace(&mut is_in[start], true) {
                continue;
            }
            let mut next = order.len();
            order.push(start);
            while next < order.len() {
                let mut fresh: Vec<usize> = beside[order[next]]
                    .iter()
                    .copied()
                    .filter(|&view| !is_in[view])
                    .collect();
                fresh.sort_by_key(degree);
                fresh.iter().for_each(|&view| is_in[view] = true);
                order.append(&mut fresh);
                next += 1;
            }
        }
        let mut places = vec![0; views];
        order
            .iter()
            .rev()
            .enumerate()
            .for_each(|(place, &view)| places[view] = place);
        Self { places }
    }

    /// The steps x that solve (A + prior) x = -b; none where rounding leaves nothing to solve.
    pub(super) fn solve(&self, blocks: &[Block], prior: &Prior) -> Vec<Step> {
        let count = self.places.len() * OF_VIEW;
        let (mut matrix, mut right) = (CooMatrix::new(count, count), DMatrix::zeros(count, 1));
        let at = |view: usize, unknown: usize| self.places[view] * OF_VIEW + unknown;
        for (view, unknowns) in prior.iter().enumerate() {
            for (unknown, [weight, value]) in unknowns.iter().enumerate() {
                let i = at(view, unknown);
                matrix.push(i, i, *weight);
                right[(i, 0)] -= weight * value;
            }
        }
        for block in blocks {
            let places: [usize; OF_PAIR] =
                std::array::from_fn(|i| at(block.views[i / OF_VIEW], i % OF_VIEW));
            for (i, row) in block.matrix.iter().enumerate() {
                right[(places[i], 0)] -= block.gradient[i];
                matrix.push(places[i], places[i], row[i]);
                for (j, value) in row.iter().enumerate().skip(i + 1) {
                    matrix.push(places[i], places[j], *value);
                    matrix.push(places[j], places[i], *value);
                }
            }
        }
        let solved = CscCholesky::factor(&CscMatrix::from(&matrix))
            .ok()
            .map(|factor| factor.solve(&right));
        let step = |view: usize| {
            std::array::from_fn(|unknown| {
                solved
                    .as_ref()
                    .map_or(0.0, |solved| solved[(at(view, unknown), 0)])
            })
        };
        (0..self.places.len()).map(step).collect()
    }
}
