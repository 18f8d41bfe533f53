//! Points of one view and the planes of another: equations of how they come together.

use super::Pose;
use super::overlap::SAME_SURFACE;
use super::range::{Facet, RangeGrid};
use glam::DVec3;
use headbox_core::statistics::median;
use rayon::prelude::*;

/// Unknowns of a view: a small turn about its eye (radians), and a small step (metres), in world axes.
pub(super) const OF_VIEW: usize = 6;

/// Unknowns of a pair of views.
pub(super) const OF_PAIR: usize = 2 * OF_VIEW;

/// What a pair of views adds to the normal equations.
pub(super) struct Block {
    pub(super) views: [usize; 2],
    /// J^T W J, the upper triangle.
    pub(super) matrix: [[f64; OF_PAIR]; OF_PAIR],
    /// J^T W r.
    pub(super) gradient: [f64; OF_PAIR],
}

/// Depth pictures, and which of them are compared.
pub(super) struct Neighbors<'a> {
    pub(super) grids: &'a [RangeGrid],
    pub(super) pairs: &'a [[usize; 2]],
    /// Standard deviation of inverse depth, 1/m.
    pub(super) noise: f64,
}

/// Cells from one point to the next, both ways.
const STEP: u32 = 2;

/// One point in so many judges the poses that the others lead to.
const UNSEEN: u32 = 4;

/// The normals of a point and of its partner are at most 60 degrees apart.
const LEAST_COSINE: f64 = 0.5;

/// Tukey's constant: 95 % as efficient as least squares where errors are normal.
const TUKEY: f64 = 4.685;

/// From a median of absolute errors to the standard deviation of normal ones.
const SIGMA_OF_MEDIAN: f64 = 1.4826;

/// A pair's standard deviation is no less, pixels: below it partners, not places, differ.
const LEAST_SIGMA_PX: f64 = 0.05;

/// A point, world metres, and the plane that another view sees there.
struct Match {
    point: DVec3,
    normal: DVec3,
    /// How far the point lies before the plane, metres.
    distance: f64,
    /// What counts as an error of one, metres: a pixel, and the sensor's noise.
    unit: f64,
}

impl Neighbors<'_> {
    /// The equations of all pairs, in their order.
    pub(super) fn equations(&self, poses: &[Pose]) -> Vec<Block> {
        self.pairs
            .par_iter()
            .map(|&pair| self.block(pair, poses))
            .collect()
    }

    /// Cells of a view, and the surfaces in them: those that judge, or the others.
    pub(super) fn each_facet(
        &self,
        view: usize,
        unseen: bool,
        mut visit: impl FnMut([u32; 2], Facet),
    ) {
        let grid = &self.grids[view];
        for row in (0..grid.size[1]).step_by(STEP as usize) {
            for column in (0..grid.size[0]).step_by(STEP as usize) {
                // Others from row to row.
                let judges = (column / STEP + 2 * (row / STEP)).is_multiple_of(UNSEEN);
                if judges == unseen
                    && let Some(facet) = grid.facet(column, row)
                {
                    visit([column, row], facet);
                }
            }
        }
    }

    /// Points of `from` with partners in `to`.
    fn matches(&self, [from, to]: [usize; 2], poses: &[Pose]) -> Vec<Match> {
        let (grid, own, pose) = (&self.grids[to], &poses[from], &poses[to]);
        let mut matches = Vec::new();
        self.each_facet(from, false, |_, Facet { point, normal, .. }| {
            let world = own.to_world(point);
            let Some((facet, depth)) = grid.seen_at(pose.to_eye(world)) else {
                return;
            };
            let there = pose.world_from_eye * facet.normal;
            let is_same = (facet.depth / depth - 1.0).abs() < SAME_SURFACE
                && there.dot(own.world_from_eye * normal) > LEAST_COSINE;
            if is_same {
                let distance = (world - pose.to_world(facet.point)).dot(there);
                let unit = (depth * grid.pixel_rad).hypot(self.noise * depth * depth);
                matches.push(Match {
                    point: world,
                    normal: there,
                    distance,
                    unit,
                });
            }
        });
        matches
    }

    fn block(&self, [a, b]: [usize; 2], poses: &[Pose]) -> Block {
        let mut block = Block {
            views: [a, b],
            matrix: [[0.0; OF_PAIR]; OF_PAIR],
            gradient: [0.0; OF_PAIR],
        };
        let both = [[a, b], [b, a]].map(|direction| self.matches(direction, poses));
        let errors = both
            .iter()
            .flatten()
            .map(|found| (found.distance / found.unit).abs());
        let sigma = median(errors).unwrap_or(0.0) * SIGMA_OF_MEDIAN;
        let most = TUKEY * sigma.max(LEAST_SIGMA_PX);
        // The view of the points comes first, that of the planes second.
        for (matches, first) in both.iter().zip([0, 1]) {
            let eyes = [a, b].map(|view| poses[view].eye);
            for found in matches {
                let error = found.distance / found.unit / most;
                if error.abs() < 1.0 {
                    block.add(
                        found,
                        eyes,
                        first,
                        ((1.0 - error * error) / found.unit).powi(2),
                    );
                }
            }
        }
        block
    }
}

impl Block {
    /// Adds an equation: moving the view of the point along the plane's normal adds to its distance, moving that of the plane takes from it.
    fn add(&mut self, found: &Match, eyes: [DVec3; 2], first: usize, weight: f64) {
        let mut row = [0.0; OF_PAIR];
        for (view, eye) in eyes.into_iter().enumerate() {
            let sign = if view == first { 1.0 } else { -1.0 };
            let turn = (found.point - eye).cross(found.normal) * sign;
            row[view * OF_VIEW..][..3].copy_from_slice(&turn.to_array());
            row[view * OF_VIEW + 3..][..3].copy_from_slice(&(found.normal * sign).to_array());
        }
        for i in 0..OF_PAIR {
            let scaled = row[i] * weight;
            self.gradient[i] += scaled * found.distance;
            for j in i..OF_PAIR {
                self.matrix[i][j] += scaled * row[j];
            }
        }
    }
}
