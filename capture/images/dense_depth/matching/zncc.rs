//! Matching cost: zero-mean normalised cross-correlation over a patch that a plane warps from one
//! image to the other, weighted toward pixels similar to the central one (bilateral weights, as
//! Yoon and Kweon 2006 have for disparities).

use super::picture::Grey;
use super::relative::WarpedPlane;
use fearless_simd::{Simd, SimdCvtFloat, SimdCvtTruncate, f32x16, prelude::*, u32x16};
use headbox_core::image::texels;
use std::sync::LazyLock;

/// Number of pixels of a patch: six by six, every other one, without the corners.
pub(crate) const SAMPLES: usize = 32;

/// Number of samples per SIMD vector.
const LANES: usize = 16;

/// Offsets of the samples from the central pixel, right and down.
pub(crate) const OFFSETS: [[f32; SAMPLES]; 2] = offsets();

/// Maximum cost, also of patches that cannot be compared.
pub(crate) const WORST: f32 = 2.0;

/// Variance of levels attributed to noise: patches with hardly more variance match poorly.
pub(crate) const NOISE: f32 = 2.0;

/// Standard deviations of the Gaussian weights: difference from the central level, and distance in
/// pixels.
pub(crate) const SIMILAR_LEVELS: f64 = 18.0;
pub(crate) const NEAR_PX: f64 = 5.0;

const fn offsets() -> [[f32; SAMPLES]; 2] {
    let mut offsets = [[0.0; SAMPLES]; 2];
    let mut i = 0;
    let mut k = 0;
    while i < 36 {
        let column = i % 6;
        let row = i / 6;
        if !((column == 0 || column == 5) && (row == 0 || row == 5)) {
            offsets[0][k] = (2 * column - 5) as f32;
            offsets[1][k] = (2 * row - 5) as f32;
            k += 1;
        }
        i += 1;
    }
    offsets
}

/// Gaussian weights exp(-d^2 / 2 s^2) by difference of levels and by sample.
struct Falloff {
    by_level: [f32; 256],
    by_sample: [f32; SAMPLES],
}

static FALLOFF: LazyLock<Falloff> = LazyLock::new(|| {
    let gauss =
        |squared: f64, deviation: f64| (-squared / (2.0 * deviation * deviation)).exp() as f32;
    let distance = |k: usize| f64::from(OFFSETS[0][k]).powi(2) + f64::from(OFFSETS[1][k]).powi(2);
    Falloff {
        by_level: std::array::from_fn(|levels| gauss((levels * levels) as f64, SIMILAR_LEVELS)),
        by_sample: std::array::from_fn(|k| gauss(distance(k), NEAR_PX)),
    }
});

/// Patch of the image whose depth is estimated.
pub(crate) struct Patch {
    /// Weights of the samples, normalised to a sum of 1.
    weights: [f32; SAMPLES],
    /// Weight times level.
    weighted: [f32; SAMPLES],
    mean: f32,
    variance: f32,
}

impl Patch {
    pub(crate) fn new(picture: &Grey, x: usize, y: usize) -> Self {
        let falloff = &*FALLOFF;
        let x = x as i32;
        let y = y as i32;
        let middle = picture.level(x, y);
        let mut weights = [0.0; SAMPLES];
        let mut levels = [0.0; SAMPLES];
        let mut total = 0.0;
        for k in 0..SAMPLES {
            let level = picture.level(x + OFFSETS[0][k] as i32, y + OFFSETS[1][k] as i32);
            levels[k] = f32::from(level);
            weights[k] =
                falloff.by_level[usize::from(level.abs_diff(middle))] * falloff.by_sample[k];
            total += weights[k];
        }
        // All weights may vanish.
        let scale = 1.0 / total.max(1e-12);
        let mut weighted = [0.0; SAMPLES];
        let mut mean = 0.0;
        let mut square = 0.0;
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

    /// Returns true if the patch has more contrast than noise.
    pub(crate) fn has_texture(&self) -> bool {
        self.variance > NOISE
    }

    /// Returns 1 minus the correlation with the warped patch in another image, 0 to [`WORST`].
    #[inline(always)]
    pub(crate) fn cost<S: Simd>(&self, simd: S, plane: &WarpedPlane, other: &Grey) -> f32 {
        let px = plane.center.x / plane.center.z;
        let py = plane.center.y / plane.center.z;
        // False for NaN.
        let inside = plane.center.z > 0.0
            && px >= 0.0
            && py >= 0.0
            && px < other.width as f32
            && py < other.height as f32;
        if !inside || other.background[py as usize * other.width + px as usize] {
            return WORST;
        }
        let mut sum = f32x16::splat(simd, 0.0);
        let mut square = f32x16::splat(simd, 0.0);
        let mut cross = f32x16::splat(simd, 0.0);
        let right = f32x16::splat(simd, other.width as f32 - 1.0);
        let lower = f32x16::splat(simd, other.height as f32 - 1.0);
        let zero = f32x16::splat(simd, 0.0);
        for first in [0, LANES] {
            let lanes = first..first + LANES;
            let dx = f32x16::from_slice(simd, &OFFSETS[0][lanes.clone()]);
            let dy = f32x16::from_slice(simd, &OFFSETS[1][lanes.clone()]);
            let w = dx * plane.right.z + dy * plane.down.z + plane.center.z;
            if !w.simd_gt(zero).all_true() {
                return WORST;
            }
            let scale = f32x16::splat(simd, 1.0) / w;
            let x = (dx * plane.right.x + dy * plane.down.x + plane.center.x) * scale - 0.5;
            let y = (dx * plane.right.y + dy * plane.down.y + plane.center.y) * scale - 0.5;
            let x = x.max(zero).min(right);
            let y = y.max(zero).min(lower);
            let level = bilinear(simd, other, x, y);
            let weight = f32x16::from_slice(simd, &self.weights[lanes.clone()]) * level;
            sum += weight;
            square += weight * level;
            cross += f32x16::from_slice(simd, &self.weighted[lanes]) * level;
        }
        let mean = reduce_add(sum);
        let square = reduce_add(square);
        let cross = reduce_add(cross);
        let variance = (square - mean * mean).max(0.0);
        let covariance = cross - mean * self.mean;
        let correlation = covariance / ((variance + NOISE) * (self.variance + NOISE)).sqrt();
        (1.0 - correlation).clamp(0.0, WORST)
    }
}

/// Samples levels bilinearly at positions within the image, pixel centres at integers.
#[inline(always)]
fn bilinear<S: Simd>(simd: S, picture: &Grey, x: f32x16<S>, y: f32x16<S>) -> f32x16<S> {
    let column = x.floor();
    let row = y.floor();
    let u = x - column;
    let v = y - row;
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
    let four = [
        to_float(quads & byte),
        to_float((quads >> 8) & byte),
        to_float((quads >> 16) & byte),
        to_float(quads >> 24),
    ];
    texels::bilinear(four, [u, v])
}

/// Converts numbers below 2^31 by the faster signed conversion.
#[inline(always)]
fn to_float<S: Simd>(v: u32x16<S>) -> f32x16<S> {
    f32x16::float_from(v.bitcast::<fearless_simd::i32x16<S>>())
}

/// Returns the sum over lanes, in the same order at every SIMD level.
#[inline(always)]
fn reduce_add<S: Simd>(v: f32x16<S>) -> f32 {
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
