//! Whether poses are better: by points that no equation has, and by the colours there, which no equation has either.
//!
//! A sensor's depth errs in ways that are alike in all views (its lens bends what is flat), and poses that suit these errors can be worse than those
//! given. Colours tell.

use super::Pose;
use super::equations::Neighbors;
use super::overlap::SAME_SURFACE;
use headbox_core::statistics::median;
use rayon::prelude::*;

/// How well neighbours agree with some poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Judged {
    /// How far points lie off their neighbours' surfaces, a share of their distance.
    pub(super) apart: f64,
    /// By how much colours differ there, levels of 255.
    pub(super) levels: f64,
}

/// Poses are better if points lie nearer by a tenth, and by more than this share of a pixel: what differs less are roundings and
/// the curvature of surfaces, which small depth pictures do not have.
const LEAST_GAIN_PX: f64 = 0.05;

/// Colours that differ by less than this, levels, can hardly differ less: there is little to see, or they are the same by now.
const TELLING_LEVELS: f64 = 1.0;

/// Levels by which such colours may differ more: they are rounded.
const SAME_LEVEL: f64 = 0.05;

/// Other colours may differ by no more than this share of what they did. In small pictures a loss shows little: a sensor's
/// frames whose colours differed by 0.995 of it here agreed less at full size.
const MOST_COLOR_SHARE: f64 = 0.97;

impl Judged {
    /// Whether these poses are better than others; `pixel_rad` is how wide a pixel is.
    pub(super) fn is_better_than(&self, other: &Self, pixel_rad: f64) -> bool {
        let nearer =
            self.apart < other.apart * 0.9 && other.apart - self.apart > LEAST_GAIN_PX * pixel_rad;
        let most_levels = match other.levels < TELLING_LEVELS {
            true => other.levels + SAME_LEVEL,
            false => other.levels * MOST_COLOR_SHARE,
        };
        nearer && self.levels <= most_levels
    }
}

impl Neighbors<'_> {
    /// The means over pairs of their medians, from which neither what is hidden nor single views can hide.
    pub(super) fn judged(&self, poses: &[Pose]) -> Judged {
        let of_pair = |&[a, b]: &[usize; 2]| {
            let (mut shares, mut levels) = (Vec::new(), Vec::new());
            for (from, to) in [(a, b), (b, a)] {
                self.each_facet(from, true, |cell, facet| {
                    let eye = poses[to].to_eye(poses[from].to_world(facet.point));
                    let Some((there, depth)) = self.grids[to].seen_at(eye) else {
                        return;
                    };
                    shares.push(((eye - there.point).dot(there.normal) / depth).abs());
                    if (there.depth / depth - 1.0).abs() < SAME_SURFACE
                        && let Some(level) = self.grids[to].level_at(eye)
                    {
                        levels.push((level - self.grids[from].level(cell)).abs());
                    }
                });
            }
            [median(shares), median(levels)]
        };
        // In the order of pairs: a sum in the order of threads would round otherwise.
        let medians: Vec<[Option<f64>; 2]> = self.pairs.par_iter().map(of_pair).collect();
        let mean = |which: usize| {
            let known = || medians.iter().filter_map(|medians| medians[which]);
            known().sum::<f64>() / known().count().max(1) as f64
        };
        Judged {
            apart: mean(0),
            levels: mean(1),
        }
    }
}
