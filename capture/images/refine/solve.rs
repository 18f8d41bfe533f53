//! Normal equations of all views: a sparse block matrix, solved by Cholesky decomposition.

use super::Pose;
use super::equations::{PAIR_UNKNOWNS, PosePairBlock, VIEW_UNKNOWNS};
use glam::{DMat3, DQuat, DVec3};
use nalgebra::DMatrix;
use nalgebra_sparse::factorization::CscCholesky;
use nalgebra_sparse::{CooMatrix, CscMatrix};

/// Prior standard deviation of a view, radians and relative to the median depth: ten pixels of
/// typical images. The given pose thus has a hundredth of the weight of a point; it fixes the
/// position of the whole set and the degrees of freedom that depth leaves open.
const PRIOR_SIGMA: f64 = 0.03;

/// Prior toward the given poses: weight and current value of each unknown of each view.
pub(super) type Prior = Vec<[[f64; 2]; VIEW_UNKNOWNS]>;

/// Small turn and step of a view, world axes.
pub(super) type PoseStep = [f64; VIEW_UNKNOWNS];

/// Returns the prior of poses toward the given ones.
pub(super) fn prior(poses: &[Pose], given: &[Pose], depth_m: f64) -> Prior {
    let weights = [PRIOR_SIGMA, PRIOR_SIGMA * depth_m].map(|sigma| 1.0 / (sigma * sigma));
    let view_prior = |(pose, given): (&Pose, &Pose)| {
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
    poses.iter().zip(given).map(view_prior).collect()
}

/// Applies a small turn and step to a pose.
pub(super) fn apply_step(pose: &Pose, step: &PoseStep) -> Pose {
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(&step[..3])));
    let [x, y] = [
        turn * pose.world_from_eye.x_axis,
        turn * pose.world_from_eye.y_axis,
    ]
    .map(DVec3::normalize);
    // Orthonormalised, so that rounding errors do not accumulate.
    let y = (y - x * x.dot(y)).normalize();
    Pose {
        eye: pose.eye + DVec3::from_slice(&step[3..]),
        world_from_eye: DMat3::from_cols(x, y, x.cross(y)),
    }
}

/// Elimination order of the views: neighbours near each other, so that the decomposition has little
/// fill-in (reverse Cuthill-McKee, 1969).
pub(super) struct EliminationOrder {
    /// Position of each view.
    positions: Vec<usize>,
}

impl EliminationOrder {
    /// Orders views by the pairs among them.
    pub(super) fn new(views: usize, pairs: &[[usize; 2]]) -> Self {
        let mut neighbors = vec![Vec::new(); views];
        for &[a, b] in pairs {
            neighbors[a].push(b);
            neighbors[b].push(a);
        }
        let degree = |&view: &usize| (neighbors[view].len(), view);
        let mut starts: Vec<usize> = (0..views).collect();
        starts.sort_by_key(degree);
        let mut order = Vec::with_capacity(views);
        let mut is_ordered = vec![false; views];
        for start in starts {
            if std::mem::replace(&mut is_ordered[start], true) {
                continue;
            }
            let mut next = order.len();
            order.push(start);
            while next < order.len() {
                let mut added: Vec<usize> = neighbors[order[next]]
                    .iter()
                    .copied()
                    .filter(|&view| !is_ordered[view])
                    .collect();
                added.sort_by_key(degree);
                added.iter().for_each(|&view| is_ordered[view] = true);
                order.append(&mut added);
                next += 1;
            }
        }
        let mut positions = vec![0; views];
        order
            .iter()
            .rev()
            .enumerate()
            .for_each(|(position, &view)| positions[view] = position);
        Self { positions }
    }

    /// Solves (A + prior) x = -b for the steps x; they are zero if rounding makes the matrix
    /// singular.
    pub(super) fn solve(&self, blocks: &[PosePairBlock], prior: &Prior) -> Vec<PoseStep> {
        let count = self.positions.len() * VIEW_UNKNOWNS;
        let mut matrix = CooMatrix::new(count, count);
        let mut right = DMatrix::zeros(count, 1);
        let index = |view: usize, unknown: usize| self.positions[view] * VIEW_UNKNOWNS + unknown;
        for (view, unknowns) in prior.iter().enumerate() {
            for (unknown, [weight, value]) in unknowns.iter().enumerate() {
                let i = index(view, unknown);
                matrix.push(i, i, *weight);
                right[(i, 0)] -= weight * value;
            }
        }
        for block in blocks {
            let indices: [usize; PAIR_UNKNOWNS] =
                std::array::from_fn(|i| index(block.views[i / VIEW_UNKNOWNS], i % VIEW_UNKNOWNS));
            for (i, row) in block.matrix.iter().enumerate() {
                right[(indices[i], 0)] -= block.gradient[i];
                matrix.push(indices[i], indices[i], row[i]);
                for (j, value) in row.iter().enumerate().skip(i + 1) {
                    matrix.push(indices[i], indices[j], *value);
                    matrix.push(indices[j], indices[i], *value);
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
                    .map_or(0.0, |solved| solved[(index(view, unknown), 0)])
            })
        };
        (0..self.positions.len()).map(step).collect()
    }
}
