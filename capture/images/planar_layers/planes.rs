//! Dominant planes: those with which most depths agree, found one after the other by random samples (RANSAC, Fischler and Bolles 1981) of three
//! neighbouring pixels.

use super::canvas::Canvas;
use glam::{DMat3, DVec3};
use headbox_core::random::Rng;
use rayon::prelude::*;

/// A plane: inverse depth, 1/m, is affine in the canvas' pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine {
    /// What a pixel to the right adds, what one down adds, and what the canvas' upper left corner has.
    pub(super) coefficients: DVec3,
}

/// Depths that are looked at.
const MOST_SAMPLES: usize = 8192;

/// Triples that are tried for each plane.
const DRAWS: u64 = 1500;

/// The three pixels of a sample lie within this share of the canvas' longer side: neighbours belong to one surface.
const NEAR: f64 = 0.15;

/// Draws for a second or third pixel, until one lies near.
const TRIES: usize = 24;

/// Least squares over what agrees, until that hardly changes.
const REFINEMENTS: usize = 6;

/// Of all depths the least share that must agree with a plane.
const LEAST_SHARE: f64 = 0.02;

/// What is so many times as far from a plane as what lies on it belongs to another: no second plane is fitted to a plane's rest.
const APART: f64 = 2.0;

/// Of a depth.
struct Sample {
    at: [f64; 2],
    pub inverse_depth: f64,
}

impl Affine {
    /// Inverse depth at a position, 1/m.
    #[inline]
    pub(super) fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.coefficients.dot(DVec3::new(x, y, 1.0))
    }

    /// Through three samples; `None` if they lie in a row.
    fn through(samples: [&Sample; 3]) -> Option<Self> {
        let row = |k: usize| DVec3::new(samples[k].at[0], samples[k].at[1], 1.0);
        let rows = DMat3::from_cols(row(0), row(1), row(2)).transpose();
        let values = DVec3::from_array(samples.map(|sample| sample.inverse_depth));
        (rows.determinant().abs() > 1.0).then(|| Self {
            coefficients: rows.inverse() * values,
        })
    }

    /// Least squares, about the mean; a constant where the samples lie in a row. `None` without samples.
    fn fit<'a>(samples: impl Iterator<Item = &'a Sample> + Clone) -> Option<Self> {
        let count = samples.clone().count();
        if count == 0 {
            return None;
        }
        let sum = samples.clone().fold(DVec3::ZERO, |sum, s| {
            sum + DVec3::new(s.at[0], s.at[1], s.inverse_depth)
        });
        let mean = sum / count as f64;
        let (mut xx, mut xy, mut yy, mut xq, mut yq) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for sample in samples {
            let off = DVec3::new(sample.at[0], sample.at[1], sample.inverse_depth) - mean;
            xx += off.x * off.x;
            xy += off.x * off.y;
            yy += off.y * off.y;
            xq += off.x * off.z;
            yq += off.y * off.z;
        }
        let determinant = xx * yy - xy * xy;
        let (a, b) = match determinant > 1e-9 * (xx + yy).powi(2) {
            true => (
                (xq * yy - yq * xy) / determinant,
                (yq * xx - xq * xy) / determinant,
            ),
            false => (0.0, 0.0),
        };
        Some(Self {
            coefficients: DVec3::new(a, b, mean.z - a * mean.x - b * mean.y),
        })
    }

    /// By how many pixels of parallax a point that a pixel shows is nearer than the plane.
    pub(super) fn off_px(&self, canvas: &Canvas, pixel: usize, inverse_depth: f32) -> f64 {
        (f64::from(inverse_depth) - self.at(canvas.center(pixel))) * canvas.px_per_inverse_depth
    }

    /// Unit normal and signed distance of the world's origin, metres.
    pub(super) fn in_world(&self, canvas: &Canvas) -> (DVec3, f64) {
        let camera = &canvas.camera;
        let [cx, cy] = camera.principal_px();
        // The inverse depth of an eye-space direction (x, y, -1) is its product with m; so m . P = 1 for the plane's points P.
        let [a, b, _] = self.coefficients.to_array();
        let m = DVec3::new(
            a * camera.focal_px(),
            -b * camera.focal_px(),
            -self.at([cx, cy]),
        );
        let normal = camera.world_from_eye() * m / m.length();
        (normal, -1.0 / m.length() - normal.dot(camera.eye()))
    }
}

/// At most `count` planes, the one with which most depths agree first; at least one where there is depth.
pub(super) fn dominant(canvas: &Canvas, count: usize) -> Vec<Affine> {
    let everywhere: Vec<usize> = (0..canvas.inverse_depth.len()).collect();
    let all = samples(canvas, &everywhere);
    let mut left: Vec<&Sample> = all.iter().collect();
    let mut planes = Vec::new();
    while planes.len() < count {
        let Some((plane, support)) = best(canvas, &left, planes.len() as u64) else {
            break;
        };
        if !planes.is_empty() && (support as f64) < LEAST_SHARE * all.len() as f64 {
            break;
        }
        planes.push(plane);
        let apart = APART * canvas.on_plane_px / canvas.px_per_inverse_depth;
        left.retain(|sample| (plane.at(sample.at) - sample.inverse_depth).abs() > apart);
    }
    planes
}

/// The plane with which most depths of some pixels agree; `None` if they have none.
pub(super) fn of_pixels(canvas: &Canvas, pixels: &[usize], seed: u64) -> Option<Affine> {
    let samples = samples(canvas, pixels);
    best(canvas, &samples.iter().collect::<Vec<_>>(), seed).map(|(plane, _)| plane)
}

/// Of pixels with depth every so manieth.
fn samples(canvas: &Canvas, pixels: &[usize]) -> Vec<Sample> {
    let known: Vec<usize> = pixels
        .iter()
        .copied()
        .filter(|&p| canvas.inverse_depth[p] > 0.0)
        .collect();
    let sample = |k: usize| {
        let pixel = known[k * known.len() / MOST_SAMPLES.min(known.len())];
        Sample {
            at: canvas.center(pixel),
            inverse_depth: f64::from(canvas.inverse_depth[pixel]),
        }
    };
    (0..MOST_SAMPLES.min(known.len())).map(sample).collect()
}

/// The plane with which most samples agree, and how many.
fn best(canvas: &Canvas, samples: &[&Sample], seed: u64) -> Option<(Affine, usize)> {
    let tolerance = canvas.on_plane_px / canvas.px_per_inverse_depth;
    let agrees = |plane: &Affine, sample: &Sample| {
        (plane.at(sample.at) - sample.inverse_depth).abs() <= tolerance
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
        let triple = triple(&mut random, samples, reach)?;
        let plane = Affine::through(triple)?;
        Some((support(&plane), std::cmp::Reverse(draw), plane))
    });
    let first = drawn
        .max_by_key(|(support, draw, _)| (*support, *draw))
        .map(|(_, _, plane)| plane);
    let mut plane = first.or_else(|| Affine::fit(samples.iter().copied()))?;
    let mut most = support(&plane);
    for _ in 0..REFINEMENTS {
        let Some(refined) = Affine::fit(
            samples
                .iter()
                .copied()
                .filter(|sample| agrees(&plane, sample)),
        ) else {
            break;
        };
        let found = support(&refined);
        if found < most {
            break;
        }
        (plane, most) = (refined, found);
    }
    Some((plane, most))
}

/// A sample and two more near it.
fn triple<'a>(random: &mut Rng, samples: &[&'a Sample], reach: f64) -> Option<[&'a Sample; 3]> {
    let first = *samples.get(random.below(samples.len() as u64) as usize)?;
    let mut near = || {
        (0..TRIES)
            .map(|_| samples[random.below(samples.len() as u64) as usize])
            .find(|sample| {
                let off = [0, 1].map(|axis| (sample.at[axis] - first.at[axis]).abs());
                off[0].max(off[1]) <= reach && off != [0.0; 2]
            })
    };
    Some([first, near()?, near()?])
}
