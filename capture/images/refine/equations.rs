//! Point-to-plane matches between views and their normal equations.

use super::Pose;
use super::overlap::SAME_SURFACE;
use super::range::{Facet, RangeGrid};
use glam::DVec3;
use headbox_core::statistics::median;
use rayon::prelude::*;

/// Number of unknowns of a view: a small turn about its eye (radians) and a small step (metres), in
/// world axes.
pub(super) const VIEW_UNKNOWNS: usize = 6;

/// Number of unknowns of a pair of views.
pub(super) const PAIR_UNKNOWNS: usize = 2 * VIEW_UNKNOWNS;

/// Contribution of a pair of views to the normal equations.
pub(super) struct PosePairBlock {
    pub(super) views: [usize; 2],
    /// Upper triangle of J^T W J.
    pub(super) matrix: [[f64; PAIR_UNKNOWNS]; PAIR_UNKNOWNS],
    /// J^T W r.
    pub(super) gradient: [f64; PAIR_UNKNOWNS],
}

/// Depth images and the pairs of them that are aligned.
pub(super) struct IcpProblem<'a> {
    pub(super) grids: &'a [RangeGrid],
    pub(super) pairs: &'a [[usize; 2]],
    /// Standard deviation of inverse depth, 1/m.
    pub(super) noise: f64,
}

/// Distance of the sampled cells, in columns and rows.
const STEP: u32 = 2;

/// One in this number of points is excluded from the equations, for validation.
const VALIDATION_STRIDE: u32 = 4;

/// Minimum cosine between the normals of matching points: 60 degrees.
const MIN_NORMAL_COSINE: f64 = 0.5;

/// Tukey's constant: 95 % as efficient as least squares for normal errors.
const TUKEY: f64 = 4.685;

/// Ratio of standard deviation to median absolute error for normal errors.
const SIGMA_PER_MEDIAN: f64 = 1.4826;

/// Minimum standard deviation of a pair, pixels: smaller ones come from the choice of partners.
const MIN_SIGMA_PX: f64 = 0.05;

/// A point, world metres, matched to the plane of another view.
struct PlaneMatch {
    point: DVec3,
    normal: DVec3,
    /// Signed distance of the point in front of the plane, metres.
    distance: f64,
    /// Scale of the error, metres: a pixel and the sensor's noise combined.
    unit: f64,
}

impl IcpProblem<'_> {
    /// Returns the equations of all pairs, in their order.
    pub(super) fn equations(&self, poses: &[Pose]) -> Vec<PosePairBlock> {
        self.pairs
            .par_iter()
            .map(|&pair| self.block(pair, poses))
            .collect()
    }

    /// Visits the surfaces of a view and their cells: the validation points, or the others.
    pub(super) fn for_each_facet(
        &self,
        view: usize,
        validation: bool,
        mut visit: impl FnMut([u32; 2], Facet),
    ) {
        let grid = &self.grids[view];
        for row in (0..grid.size[1]).step_by(STEP as usize) {
            for column in (0..grid.size[0]).step_by(STEP as usize) {
                // Staggered from row to row.
                let is_validation =
                    (column / STEP + 2 * (row / STEP)).is_multiple_of(VALIDATION_STRIDE);
                if is_validation == validation
                    && let Some(facet) = grid.facet(column, row)
                {
                    visit([column, row], facet);
                }
            }
        }
    }

    /// Matches points of `from` with planes of `to`.
    fn matches(&self, [from, to]: [usize; 2], poses: &[Pose]) -> Vec<PlaneMatch> {
        let grid = &self.grids[to];
        let own = &poses[from];
        let pose = &poses[to];
        let mut matches = Vec::new();
        self.for_each_facet(from, false, |_, Facet { point, normal, .. }| {
            let world = own.to_world(point);
            let Some((facet, depth)) = grid.project(pose.to_eye(world)) else {
                return;
            };
            let plane_normal = pose.world_from_eye * facet.normal;
            let is_same = (facet.depth / depth - 1.0).abs() < SAME_SURFACE
                && plane_normal.dot(own.world_from_eye * normal) > MIN_NORMAL_COSINE;
            if is_same {
                let distance = (world - pose.to_world(facet.point)).dot(plane_normal);
                let unit = (depth * grid.pixel_rad).hypot(self.noise * depth * depth);
                matches.push(PlaneMatch {
                    point: world,
                    normal: plane_normal,
                    distance,
                    unit,
                });
            }
        });
        matches
    }

    fn block(&self, [a, b]: [usize; 2], poses: &[Pose]) -> PosePairBlock {
        let mut block = PosePairBlock {
            views: [a, b],
            matrix: [[0.0; PAIR_UNKNOWNS]; PAIR_UNKNOWNS],
            gradient: [0.0; PAIR_UNKNOWNS],
        };
        let both = [[a, b], [b, a]].map(|direction| self.matches(direction, poses));
        let errors = both
            .iter()
            .flatten()
            .map(|matched| (matched.distance / matched.unit).abs());
        let sigma = median(errors).unwrap_or(0.0) * SIGMA_PER_MEDIAN;
        let max_error = TUKEY * sigma.max(MIN_SIGMA_PX);
        // `first` is the index of the view of the points; the other view has the planes.
        for (matches, first) in both.iter().zip([0, 1]) {
            let eyes = [a, b].map(|view| poses[view].eye);
            for matched in matches {
                let error = matched.distance / matched.unit / max_error;
                if error.abs() < 1.0 {
                    block.add(
                        matched,
                        eyes,
                        first,
                        ((1.0 - error * error) / matched.unit).powi(2),
                    );
                }
            }
        }
        block
    }
}

impl PosePairBlock {
    /// Adds an equation: moving the view of the point along the plane's normal increases the
    /// distance, moving the view of the plane decreases it.
    fn add(&mut self, matched: &PlaneMatch, eyes: [DVec3; 2], first: usize, weight: f64) {
        let mut row = [0.0; PAIR_UNKNOWNS];
        for (view, eye) in eyes.into_iter().enumerate() {
            let sign = if view == first { 1.0 } else { -1.0 };
            let turn = (matched.point - eye).cross(matched.normal) * sign;
            row[view * VIEW_UNKNOWNS..][..3].copy_from_slice(&turn.to_array());
            row[view * VIEW_UNKNOWNS + 3..][..3]
                .copy_from_slice(&(matched.normal * sign).to_array());
        }
        for i in 0..PAIR_UNKNOWNS {
            let scaled = row[i] * weight;
            self.gradient[i] += scaled * matched.distance;
            for j in i..PAIR_UNKNOWNS {
                self.matrix[i][j] += scaled * row[j];
            }
        }
    }
}
