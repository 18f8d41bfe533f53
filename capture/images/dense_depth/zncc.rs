//! How alike two pictures are about a pixel: zero-mean normalised cross-correlation over a patch that a plane carries from one to the
//! other, weighted toward pixels that look like the middle one (bilaterally, as Yoon and Kweon 2006 have it for disparities).

use super::picture::Grey;
use super::relative::Seen;
use fearless_simd::{Simd, SimdCvtFloat, SimdCvtTruncate, f32x16, prelude::*, u32x16};
use std::sync::LazyLock;

/// Pixels of a patch: six by six, every other one, without the corners.
pub(super) const SAMPLES: usize = 32;

/// Samples at a time.
const LANES: usize = 16;

/// Where they are, pixels right and down of the middle one.
pub(super) const PLACES: [[f32; SAMPLES]; 2] = places();

/// The cost of what cannot be compared, and the most that anything costs.
pub(super) const WORST: f32 = 2.0;

/// Variance of levels that is taken for noise: patches whose own is not far above agree with nothing.
pub(super) const NOISE: f32 = 2.0;

/// Levels by which a sample differs from the middle one when its weight has fallen to 1/sqrt(e), and the same of its distance in pixels.
pub(super) const SIMILAR_LEVELS: f64 = 18.0;
pub(super) const NEAR_PX: f64 = 5.0;

const fn places() -> [[f32; SAMPLES]; 2] {
    let (mut places, mut i, mut k) = ([[0.0; SAMPLES]; 2], 0, 0);
    while i < 36 {
        let (column, row) = (i % 6, i / 6);
        if !((column == 0 || column == 5) && (row == 0 || row == 5)) {
            places[0][k] = (2 * column - 5) as f32;
            places[1][k] = (2 * row - 5) as f32;
            k += 1;
        }
        i += 1;
    }
    places
}

/// exp(-d^2 / 2 s^2) of every difference of levels, and of every sample's distance.
struct Falloff {
    of_levels: [f32; 256],
    of_places: [f32; SAMPLES],
}

static FALLOFF: LazyLock<Falloff> = LazyLock::new(|| {
    let gauss =
        |squared: f64, deviation: f64| (-squared / (2.0 * deviation * deviation)).exp() as f32;
    let distance = |k: usize| f64::from(PLACES[0][k]).powi(2) + f64::from(PLACES[1][k]).powi(2);
    Falloff {
        of_levels: std::array::from_fn(|levels| gauss((levels * levels) as f64, SIMILAR_LEVELS)),
        of_places: std::array::from_fn(|k| gauss(distance(k), NEAR_PX)),
    }
});

/// A patch of the picture whose depth is wanted.
pub(super) struct Patch {
    /// Of each sample; their sum is 1.
    weights: [f32; SAMPLES],
    /// Weight times level.
    weighted: [f32; SAMPLES],
    mean: f32,
    variance: f32,
}

impl Patch {
    pub(super) fn new(picture: &Grey, x: usize, y: usize) -> Self {
        let falloff = &*FALLOFF;
        let (x, y) = (x as i32, y as i32);
        let middle = picture.level(x, y);
        let (mut weights, mut levels) = ([0.0; SAMPLES], [0.0; SAMPLES]);
        let mut total = 0.0;
        for k in 0..SAMPLES {
            let level = picture.level(x + PLACES[0][k] as i32, y + PLACES[1][k] as i32);
            levels[k] = f32::from(level);
            weights[k] =
                falloff.of_levels[usize::from(level.abs_diff(middle))] * falloff.of_places[k];
            total += weights[k];
        }
        // Nothing within the window may look like its middle.
        let scale = 1.0 / total.max(1e-12);
        let (mut weighted, mut mean, mut square) = ([0.0; SAMPLES], 0.0, 0.0);
        for k in 0..SAMPLES {
            weights[k] *= scale;
            weighted[k] = weights[k] * levels[k];
            mean += weighted[k];
            square += weighted[k] * levels[k];
        }
        Self {
            weights,
            weighted,
            mean,
            variance: (square - mean * mean).max(0.0),
        }
    }

    /// 1 minus the correlation with what another picture shows of the plane, 0 to [`WORST`].
    #[inline(always)]
    pub(super) fn cost<S: Simd>(&self, simd: S, seen: &Seen, other: &Grey) -> f32 {
        let (px, py) = (seen.at.x / seen.at.z, seen.at.y / seen.at.z);
        // Not a number fails as well.
        let inside = seen.at.z > 0.0
            && px >= 0.0
            && py >= 0.0
            && px < other.width as f32
            && py < other.height as f32;
        if !inside || other.nothing[py as usize * other.width + px as usize] {
            return WORST;
        }
        let (mut sum, mut square, mut cross) = (
            f32x16::splat(simd, 0.0),
            f32x16::splat(simd, 0.0),
            f32x16::splat(simd, 0.0),
        );
        let (right, lower) = (
            f32x16::splat(simd, other.width as f32 - 1.0),
            f32x16::splat(simd, other.height as f32 - 1.0),
        );
        let zero = f32x16::splat(simd, 0.0);
        for first in [0, LANES] {
            let lanes = first..first + LANES;
            let dx = f32x16::from_slice(simd, &PLACES[0][lanes.clone()]);
            let dy = f32x16::from_slice(simd, &PLACES[1][lanes.clone()]);
            let w = dx * seen.right.z + dy * seen.down.z + seen.at.z;
            if !w.simd_gt(zero).all_true() {
                return WORST;
            }
            let scale = f32x16::splat(simd, 1.0) / w;
            let x = (dx * seen.right.x + dy * seen.down.x + seen.at.x) * scale - 0.5;
            let y = (dx * seen.right.y + dy * seen.down.y + seen.at.y) * scale - 0.5;
            let (x, y) = (x.max(zero).min(right), y.max(zero).min(lower));
            let level = bilinear(simd, other, x, y);
            let weight = f32x16::from_slice(simd, &self.weights[lanes.clone()]) * level;
            sum += weight;
            square += weight * level;
            cross += f32x16::from_slice(simd, &self.weighted[lanes]) * level;
        }
        let (mean, square, cross) = (total(sum), total(square), total(cross));
        let variance = (square - mean * mean).max(0.0);
        let covariance = cross - mean * self.mean;
        let correlation = covariance / ((variance + NOISE) * (self.variance + NOISE)).sqrt();
        (1.0 - correlation).clamp(0.0, WORST)
    }
}

/// Levels at positions within the picture, centres of pixels at whole numbers.
#[inline(always)]
fn bilinear<S: Simd>(simd: S, picture: &Grey, x: f32x16<S>, y: f32x16<S>) -> f32x16<S> {
    let (column, row) = (x.floor(), y.floor());
    let (u, v) = (x - column, y - row);
    let index = u32x16::truncate_from(row) * picture.width as u32 + u32x16::truncate_from(column);
    let index = index.to_array();
    let mut quads = [0u32; LANES];
    for k in 0..LANES {
        if let Some(&quad) = picture.quads.get(index[k] as usize) {
            quads[k] = quad;
        }
    }
    let quads = u32x16::load_array(simd, quads);
    let byte = u32x16::splat(simd, 255);
    let own = float(quads & byte);
    let after = float((quads >> 8) & byte);
    let below = float((quads >> 16) & byte);
    let last = float(quads >> 24);
    let upper = own + (after - own) * u;
    let lower = below + (last - below) * u;
    upper + (lower - upper) * v
}

/// Of numbers below 2^31, which signed conversion is quicker for.
#[inline(always)]
fn float<S: Simd>(v: u32x16<S>) -> f32x16<S> {
    f32x16::float_from(v.bitcast::<fearless_simd::i32x16<S>>())
}

/// The sum over lanes, in one order at every level.
#[inline(always)]
fn total<S: Simd>(v: f32x16<S>) -> f32 {
    let lanes = v.to_array();
    let mut half = [0.0; 8];
    for k in 0..8 {
        half[k] = lanes[k] + lanes[k + 8];
    }
    let four = [
        half[0] + half[4],
        half[1] + half[5],
        half[2] + half[6],
        half[3] + half[7],
    ];
    (four[0] + four[2]) + (four[1] + four[3])
}
