//! Validation of refined poses by points excluded from the equations, and by their colours, which
//! are not in the equations either.
//!
//! A sensor's depth has errors common to all views (its lens bends flat surfaces), and poses that
//! fit these errors can be worse than the given ones. Colours reveal it.

use super::Pose;
use super::equations::IcpProblem;
use super::overlap::SAME_SURFACE;
use headbox_core::statistics::median;
use rayon::prelude::*;

/// Disagreement of neighbouring views under given poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ValidationError {
    /// Distance of points from their neighbours' surfaces, relative to their depth.
    pub(super) surface_distance: f64,
    /// Colour difference at these points, levels of 255.
    pub(super) levels: f64,
}

/// Minimum improvement, pixels, in addition to a tenth of the distance: smaller differences come
/// from rounding and from the curvature of surfaces, which small depth images lack.
const MIN_GAIN_PX: f64 = 0.05;

/// Colour difference, levels, below which colours can hardly improve: there is little texture, or
/// they are already equal.
const DISCRIMINATIVE_LEVELS: f64 = 1.0;

/// Tolerance for an increase of such differences, levels: they are rounded.
const ROUNDING_LEVELS: f64 = 0.05;

/// Maximum ratio of larger colour differences after and before. Small images hide losses: a
/// sensor's frames with a ratio of 0.995 here agreed less at full size.
const MAX_COLOR_RATIO: f64 = 0.97;

impl ValidationError {
    /// Returns true if these poses are better than others; `pixel_rad` is the size of a pixel,
    /// radians.
    pub(super) fn is_better_than(&self, other: &Self, pixel_rad: f64) -> bool {
        let is_nearer = self.surface_distance < other.surface_distance * 0.9
            && other.surface_distance - self.surface_distance > MIN_GAIN_PX * pixel_rad;
        let max_levels = if other.levels < DISCRIMINATIVE_LEVELS {
            other.levels + ROUNDING_LEVELS
        } else {
            other.levels * MAX_COLOR_RATIO
        };
        is_nearer && self.levels <= max_levels
    }
}

impl IcpProblem<'_> {
    /// Returns the means over pairs of their medians: robust against occlusion within a pair,
    /// sensitive to a single bad view.
    pub(super) fn validate(&self, poses: &[Pose]) -> ValidationError {
        let compare_pair = |&[a, b]: &[usize; 2]| {
            let mut distances = Vec::new();
            let mut levels = Vec::new();
            for (from, to) in [(a, b), (b, a)] {
                self.for_each_facet(from, true, |cell, facet| {
                    let eye = poses[to].to_eye(poses[from].to_world(facet.point));
                    let Some((surface, depth)) = self.grids[to].project(eye) else {
                        return;
                    };
                    distances.push(((eye - surface.point).dot(surface.normal) / depth).abs());
                    if (surface.depth / depth - 1.0).abs() < SAME_SURFACE
                        && let Some(level) = self.grids[to].level_at(eye)
                    {
                        levels.push((level - self.grids[from].level(cell)).abs());
                    }
                });
            }
            [median(distances), median(levels)]
        };
        // Summed in the order of pairs, so that rounding does not depend on threads.
        let medians: Vec<[Option<f64>; 2]> = self.pairs.par_iter().map(compare_pair).collect();
        let mean = |which: usize| {
            let known = || medians.iter().filter_map(|medians| medians[which]);
            known().sum::<f64>() / known().count().max(1) as f64
        };
        ValidationError {
            surface_distance: mean(0),
            levels: mean(1),
        }
    }
}
