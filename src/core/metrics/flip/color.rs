//! Color space and color difference of FLIP, and the errors of a row.
//!
//! The paper blurs in YCxCz, which is linear in XYZ over the white point except for the scales 116,
//! 500 and 200 and an offset. Since the filters are linear and sum to 1, scales and offset are
//! omitted here: *opponent color* is luminance Y, red-green X - Y and blue-yellow Y - Z, with X, Y,
//! Z relative to white.

use fearless_simd::{Level, dispatch, prelude::*};
use glam::{DMat3, DVec3};

use super::math::{cbrt, pow};
use crate::color::linear_from_srgb8;

/// Exponent of the color difference (q_c).
const COLOR_EXPONENT: f32 = 0.7;
/// Color differences below this share of the largest one (p_c) are stretched over 0..[`KNEE`]
/// (p_t).
const KNEE_SHARE: f32 = 0.4;
const KNEE: f32 = 0.95;

/// XYZ of the sRGB primaries under D65, as columns, in the digits of the authors' evaluator.
const XYZ_FROM_RGB: DMat3 = DMat3::from_cols(
    DVec3::new(
        10135552.0 / 24577794.0,
        2613072.0 / 12288897.0,
        1425312.0 / 73733382.0,
    ),
    DVec3::new(
        8788810.0 / 24577794.0,
        8788810.0 / 12288897.0,
        8788810.0 / 73733382.0,
    ),
    DVec3::new(
        4435075.0 / 24577794.0,
        887015.0 / 12288897.0,
        70074185.0 / 73733382.0,
    ),
);

/// Row filtered by the contrast sensitivity of the eye: planes of padded rows.
pub(super) struct FilteredRow {
    /// Blurred opponent color: luminance, red-green, blue-yellow.
    pub(super) opponent: [Vec<f32>; 3],
    /// First derivatives of luminance: across, down.
    pub(super) slope: [Vec<f32>; 2],
    /// Second derivatives of luminance: across, down.
    pub(super) curvature: [Vec<f32>; 2],
}

/// Three values for each pixel of a vector.
type Triple<V> = [V; 3];

/// Conversions between sRGB, linear RGB, opponent color and XYZ relative to white; rows of
/// matrices.
///
/// Vector code below has no closures and no `array::map`: those are compiled for the baseline
/// instruction set unless they happen to be inlined (docs/decisions/0004).
pub(super) struct ColorSpace {
    /// Linear light of the 8-bit sRGB values.
    pub(super) linear_from_srgb8: [f32; 256],
    opponent_from_rgb: [[f32; 3]; 3],
    rgb_from_opponent: [[f32; 3]; 3],
    relative_xyz_from_rgb: [[f32; 3]; 3],
    /// Largest color difference of any two sRGB colors: that of green and blue.
    largest_difference: f32,
}

impl ColorSpace {
    pub(super) fn new(level: Level) -> Self {
        let white = XYZ_FROM_RGB * DVec3::ONE;
        let relative_xyz_from_rgb = DMat3::from_diagonal(white.recip()) * XYZ_FROM_RGB;
        let opponent_from_relative_xyz = DMat3::from_cols(
            DVec3::new(0.0, 1.0, 0.0),
            DVec3::new(1.0, -1.0, 1.0),
            DVec3::new(0.0, 0.0, -1.0),
        );
        let opponent_from_rgb = opponent_from_relative_xyz * relative_xyz_from_rgb;
        let mut space = Self {
            linear_from_srgb8: std::array::from_fn(|value| linear_from_srgb8(value as u8)),
            opponent_from_rgb: rows(opponent_from_rgb),
            rgb_from_opponent: rows(opponent_from_rgb.inverse()),
            relative_xyz_from_rgb: rows(relative_xyz_from_rgb),
            largest_difference: 0.0,
        };
        space.largest_difference = dispatch!(level, simd => space.green_blue_difference(simd));
        space
    }

    /// Converts rows of linear red, green and blue (whole vectors) to opponent color, in place.
    #[inline(always)]
    pub(super) fn rows_to_opponent<S: Simd>(
        &self,
        simd: S,
        [red, green, blue]: Triple<&mut [f32]>,
    ) {
        for i in (0..red.len()).step_by(S::f32s::LEN) {
            let lanes = i..i + S::f32s::LEN;
            let r = S::f32s::from_slice(simd, &red[lanes.clone()]);
            let g = S::f32s::from_slice(simd, &green[lanes.clone()]);
            let b = S::f32s::from_slice(simd, &blue[lanes.clone()]);
            let [luminance, red_green, blue_yellow] =
                transform::<S>(&self.opponent_from_rgb, [r, g, b]);
            luminance.store_slice(&mut red[lanes.clone()]);
            red_green.store_slice(&mut green[lanes.clone()]);
            blue_yellow.store_slice(&mut blue[lanes]);
        }
    }

    /// Converts blurred opponent color to CIELAB with the Hunt effect (chroma counts less in the
    /// dark); colors that the blur has moved outside of the display's gamut are clamped to it
    /// first.
    #[inline(always)]
    fn hunt_lab<S: Simd>(&self, simd: S, opponent: Triple<S::f32s>) -> Triple<S::f32s> {
        let [r, g, b] = transform::<S>(&self.rgb_from_opponent, opponent);
        let rgb = [
            unit_clamp(simd, r),
            unit_clamp(simd, g),
            unit_clamp(simd, b),
        ];
        let [x, y, z] = transform::<S>(&self.relative_xyz_from_rgb, rgb);
        let (x, y, z) = (lab_curve::<S>(x), lab_curve::<S>(y), lab_curve::<S>(z));
        let lightness = y * 116.0 - 16.0;
        let hunt = lightness * 0.01;
        [lightness, (x - y) * 500.0 * hunt, (y - z) * 200.0 * hunt]
    }

    /// Computes the compressed color difference: HyAB (city block in lightness, Euclidean in
    /// chroma).
    #[inline(always)]
    fn difference<S: Simd>(&self, simd: S, a: Triple<S::f32s>, b: Triple<S::f32s>) -> S::f32s {
        let (a, b) = (self.hunt_lab(simd, a), self.hunt_lab(simd, b));
        let hyab = (a[0] - b[0]).abs() + length::<S>(a[1] - b[1], a[2] - b[2]);
        pow(simd, hyab, S::f32s::splat(simd, COLOR_EXPONENT))
    }

    /// Maps [`ColorSpace::difference`] to 0..=1; differences below the knee get most of the range.
    #[inline(always)]
    fn color_error<S: Simd>(&self, simd: S, a: Triple<S::f32s>, b: Triple<S::f32s>) -> S::f32s {
        let difference = self.difference(simd, a, b);
        let knee = KNEE_SHARE * self.largest_difference;
        let below = difference * (KNEE / knee);
        let above = (difference - knee) * ((1.0 - KNEE) / (self.largest_difference - knee)) + KNEE;
        difference.simd_lt(knee).select(below, above)
    }

    #[inline(always)]
    fn green_blue_difference<S: Simd>(&self, simd: S) -> f32 {
        let [y, x, z] = &self.opponent_from_rgb;
        let green = [
            S::f32s::splat(simd, y[1]),
            S::f32s::splat(simd, x[1]),
            S::f32s::splat(simd, z[1]),
        ];
        let blue = [
            S::f32s::splat(simd, y[2]),
            S::f32s::splat(simd, x[2]),
            S::f32s::splat(simd, z[2]),
        ];
        self.difference(simd, green, blue)[0]
    }
}

/// Computes the FLIP errors of a row, 0..=1.
#[inline(always)]
pub(super) fn row_errors<S: Simd>(
    simd: S,
    space: &ColorSpace,
    reference: &FilteredRow,
    test: &FilteredRow,
    errors: &mut [f32],
) {
    let lanes = S::f32s::LEN;
    let one = S::f32s::splat(simd, 1.0);
    for (i, out) in errors.chunks_exact_mut(lanes).enumerate() {
        let first = i * lanes;
        let color_error = space.color_error(
            simd,
            opponent(simd, reference, first),
            opponent(simd, test, first),
        );
        let edge = magnitude(simd, &reference.slope, first) - magnitude(simd, &test.slope, first);
        let point =
            magnitude(simd, &reference.curvature, first) - magnitude(simd, &test.curvature, first);
        // The paper's exponent of the feature difference, q_f, is 1/2.
        let feature_error = (edge.abs().max(point.abs()) * std::f32::consts::FRAC_1_SQRT_2)
            .sqrt()
            .min(one);
        unit_clamp(simd, pow(simd, color_error, one - feature_error)).store_slice(out);
    }
}

/// Loads the blurred color of the pixels from `first` on.
#[inline(always)]
fn opponent<S: Simd>(simd: S, row: &FilteredRow, first: usize) -> Triple<S::f32s> {
    let [luminance, red_green, blue_yellow] = &row.opponent;
    [
        load(simd, luminance, first),
        load(simd, red_green, first),
        load(simd, blue_yellow, first),
    ]
}

/// Computes the length of a gradient.
#[inline(always)]
fn magnitude<S: Simd>(simd: S, [across, down]: &[Vec<f32>; 2], first: usize) -> S::f32s {
    length::<S>(load(simd, across, first), load(simd, down, first))
}

#[inline(always)]
fn load<S: Simd>(simd: S, plane: &[f32], first: usize) -> S::f32s {
    S::f32s::from_slice(simd, &plane[first..first + S::f32s::LEN])
}

#[inline(always)]
fn unit_clamp<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    x.max(S::f32s::splat(simd, 0.0))
        .min(S::f32s::splat(simd, 1.0))
}

/// Compressive function of CIELAB: a cube root, and its tangent below (6/29)^3.
#[inline(always)]
fn lab_curve<S: Simd>(x: S::f32s) -> S::f32s {
    const DELTA: f32 = 6.0 / 29.0;
    let linear = x * (1.0 / (3.0 * DELTA * DELTA)) + 4.0 / 29.0;
    x.simd_gt(DELTA * DELTA * DELTA)
        .select(cbrt::<S>(x), linear)
}

#[inline(always)]
fn length<S: Simd>(x: S::f32s, y: S::f32s) -> S::f32s {
    (x * x + y * y).sqrt()
}

#[inline(always)]
fn transform<S: Simd>([a, b, c]: &[[f32; 3]; 3], v: Triple<S::f32s>) -> Triple<S::f32s> {
    [dot::<S>(a, v), dot::<S>(b, v), dot::<S>(c, v)]
}

#[inline(always)]
fn dot<S: Simd>(row: &[f32; 3], [x, y, z]: Triple<S::f32s>) -> S::f32s {
    x * row[0] + y * row[1] + z * row[2]
}

fn rows(matrix: DMat3) -> [[f32; 3]; 3] {
    [0, 1, 2].map(|row| matrix.row(row).as_vec3().to_array())
}
