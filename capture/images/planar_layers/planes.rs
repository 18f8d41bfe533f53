//! Dominant planes, found one after the other by RANSAC (Fischler and Bolles 1981) on three
//! neighbouring pixels.

use super::canvas::Canvas;
use glam::{DMat3, DVec3};
use headbox_core::random::Rng;
use rayon::prelude::*;

/// A plane as an affine function of the canvas' pixels: inverse depth, 1/m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine {
    /// Change per pixel to the right, change per pixel down, and value at the canvas' upper left
    /// corner.
    pub(super) coefficients: DVec3,
}

/// Maximum number of sampled depths.
const MAX_SAMPLES: usize = 8192;

/// Number of triples tried for each plane.
const DRAWS: u64 = 1500;

/// Maximum distance of the three pixels relative to the canvas' longer side: near pixels often
/// belong to one surface.
const NEAR: f64 = 0.15;

/// Maximum number of draws for a second or third pixel near the first.
const TRIES: usize = 24;

/// Maximum number of least-squares refinements over the inliers.
const REFINEMENTS: usize = 6;

/// Minimum fraction of all depths that are inliers of a plane.
const MIN_INLIERS: f64 = 0.02;

/// Distance from a plane, in tolerances, from which depths are left for further planes: no second
/// plane is fitted to the residuals of the first.
const SEPARATION: f64 = 2.0;

/// Sampled depth.
struct DepthSample {
    position: [f64; 2],
    inverse_depth: f64,
}

impl Affine {
    /// Returns the inverse depth at a position, 1/m.
    #[inline]
    pub(super) fn inverse_depth(&self, [x, y]: [f64; 2]) -> f64 {
        self.coefficients.dot(DVec3::new(x, y, 1.0))
    }

    /// Creates the plane through three samples; `None` if they are collinear.
    fn from_three(samples: [&DepthSample; 3]) -> Option<Self> {
        let row = |k: usize| DVec3::new(samples[k].position[0], samples[k].position[1], 1.0);
        let rows = DMat3::from_cols(row(0), row(1), row(2)).transpose();
        let values = DVec3::from_array(samples.map(|sample| sample.inverse_depth));
        (rows.determinant().abs() > 1.0).then(|| Self {
            coefficients: rows.inverse() * values,
        })
    }

    /// Fits a plane by least squares about the mean; constant if the samples are collinear. `None`
    /// without samples.
    fn fit<'a>(samples: impl Iterator<Item = &'a DepthSample> + Clone) -> Option<Self> {
        let count = samples.clone().count();
        if count == 0 {
            return None;
        }
        let sum = samples.clone().fold(DVec3::ZERO, |sum, s| {
            sum + DVec3::new(s.position[0], s.position[1], s.inverse_depth)
        });
        let mean = sum / count as f64;
        let mut xx = 0.0;
        let mut xy = 0.0;
        let mut yy = 0.0;
        let mut xq = 0.0;
        let mut yq = 0.0;
        for sample in samples {
            let [x, y] = sample.position;
            let offset = DVec3::new(x, y, sample.inverse_depth) - mean;
            xx += offset.x * offset.x;
            xy += offset.x * offset.y;
            yy += offset.y * offset.y;
            xq += offset.x * offset.z;
            yq += offset.y * offset.z;
        }
        let determinant = xx * yy - xy * xy;
        let [a, b] = if determinant > 1e-9 * (xx + yy).powi(2) {
            [
                (xq * yy - yq * xy) / determinant,
                (yq * xx - xq * xy) / determinant,
            ]
        } else {
            [0.0; 2]
        };
        Some(Self {
            coefficients: DVec3::new(a, b, mean.z - a * mean.x - b * mean.y),
        })
    }

    /// Returns the signed distance of a pixel's depth in front of the plane, pixels of parallax.
    pub(super) fn distance_px(&self, canvas: &Canvas, pixel: usize, inverse_depth: f32) -> f64 {
        (f64::from(inverse_depth) - self.inverse_depth(canvas.center(pixel)))
            * canvas.px_per_inverse_depth
    }

    /// Converts to a unit normal and the signed distance of the world's origin, metres.
    pub(super) fn to_world(self, canvas: &Canvas) -> (DVec3, f64) {
        let camera = &canvas.camera;
        let [cx, cy] = camera.principal_px();
        // The inverse depth of an eye-space direction (x, y, -1) is its product with m; so m . P =
        // 1 for the plane's points P.
        let [a, b, _] = self.coefficients.to_array();
        let m = DVec3::new(
            a * camera.focal_px(),
            -b * camera.focal_px(),
            -self.inverse_depth([cx, cy]),
        );
        let normal = camera.world_from_eye() * m / m.length();
        (normal, -1.0 / m.length() - normal.dot(camera.eye()))
    }
}

/// Finds at most `count` planes, the one with most inliers first; at least one if there is depth.
pub(super) fn find_dominant(canvas: &Canvas, count: usize) -> Vec<Affine> {
    let everywhere: Vec<usize> = (0..canvas.inverse_depth.len()).collect();
    let all = sample_depths(canvas, &everywhere);
    let mut left: Vec<&DepthSample> = all.iter().collect();
    let mut planes = Vec::new();
    while planes.len() < count {
        let Some((plane, support)) = find_best(canvas, &left, planes.len() as u64) else {
            break;
        };
        if !planes.is_empty() && (support as f64) < MIN_INLIERS * all.len() as f64 {
            break;
        }
        planes.push(plane);
        let separation = SEPARATION * canvas.on_plane_px / canvas.px_per_inverse_depth;
        left.retain(|sample| {
            (plane.inverse_depth(sample.position) - sample.inverse_depth).abs() > separation
        });
    }
    planes
}

/// Finds the plane with most inliers among some pixels; `None` if they have no depth.
pub(super) fn find_in_pixels(canvas: &Canvas, pixels: &[usize], seed: u64) -> Option<Affine> {
    let samples = sample_depths(canvas, pixels);
    find_best(canvas, &samples.iter().collect::<Vec<_>>(), seed).map(|(plane, _)| plane)
}

/// Samples pixels with depth evenly.
fn sample_depths(canvas: &Canvas, pixels: &[usize]) -> Vec<DepthSample> {
    let known: Vec<usize> = pixels
        .iter()
        .copied()
        .filter(|&p| canvas.inverse_depth[p] > 0.0)
        .collect();
    let sample = |k: usize| {
        let pixel = known[k * known.len() / MAX_SAMPLES.min(known.len())];
        DepthSample {
            position: canvas.center(pixel),
            inverse_depth: f64::from(canvas.inverse_depth[pixel]),
        }
    };
    (0..MAX_SAMPLES.min(known.len())).map(sample).collect()
}

/// Finds the plane with most inliers, and their number.
fn find_best(canvas: &Canvas, samples: &[&DepthSample], seed: u64) -> Option<(Affine, usize)> {
    let tolerance = canvas.on_plane_px / canvas.px_per_inverse_depth;
    let agrees = |plane: &Affine, sample: &DepthSample| {
        (plane.inverse_depth(sample.position) - sample.inverse_depth).abs() <= tolerance
    };
    let support = |plane: &Affine| {
        samples
            .iter()
            .filter(|sample| agrees(plane, sample))
            .count()
    };
    let reach = NEAR * canvas.width.max(canvas.height) as f64;
    let drawn = (0..DRAWS).into_par_iter().filter_map(|draw| {
        let mut random = Rng::new(seed << 32 | draw);
        let triple = draw_triple(&mut random, samples, reach)?;
        let plane = Affine::from_three(triple)?;
        Some((support(&plane), std::cmp::Reverse(draw), plane))
    });
    let first = drawn
        .max_by_key(|(support, draw, _)| (*support, *draw))
        .map(|(_, _, plane)| plane);
    let mut plane = first.or_else(|| Affine::fit(samples.iter().copied()))?;
    let mut inliers = support(&plane);
    for _ in 0..REFINEMENTS {
        let Some(refined) = Affine::fit(
            samples
                .iter()
                .copied()
                .filter(|sample| agrees(&plane, sample)),
        ) else {
            break;
        };
        let refined_inliers = support(&refined);
        if refined_inliers < inliers {
            break;
        }
        plane = refined;
        inliers = refined_inliers;
    }
    Some((plane, inliers))
}

/// Draws a sample and two more near it.
fn draw_triple<'a>(
    random: &mut Rng,
    samples: &[&'a DepthSample],
    reach: f64,
) -> Option<[&'a DepthSample; 3]> {
    let first = *samples.get(random.below(samples.len() as u64) as usize)?;
    let mut near = || {
        (0..TRIES)
            .map(|_| samples[random.below(samples.len() as u64) as usize])
            .find(|sample| {
                let offset =
                    [0, 1].map(|axis| (sample.position[axis] - first.position[axis]).abs());
                offset[0].max(offset[1]) <= reach && offset != [0.0; 2]
            })
    };
    Some([first, near()?, near()?])
}
