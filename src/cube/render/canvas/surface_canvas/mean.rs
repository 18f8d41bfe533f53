//! Resolving of sums: the mean colour of a surface, and the blend of surfaces behind one another.

use super::surroundings;
use crate::render::canvas::linear::LinearLight;
use crate::render::footprint::tent::ONE;
use fearless_simd::{Simd, SimdCvtFloat, SimdCvtTruncate, f32x8, prelude::*, u32x8};

/// Pixels of a row that are processed at once.
pub(super) const BLOCK: usize = 8;

/// Weight at which a surface is opaque: inside a surface, rounded weights add up to slightly less
/// than [`ONE`].
pub(crate) const OPAQUE: u32 = 120;

/// Weight up to which coverage equals weight, so that sparse surfaces cover what their alphas say.
/// Above it coverage rises faster, to 1 at [`OPAQUE`] (docs/decisions/0071).
pub(crate) const RAMP_START: u32 = 96;

/// Rise of the coverage, 0..255, with the weight between [`RAMP_START`] and [`OPAQUE`].
const RAMP: f32 = 255.0 * (ONE - RAMP_START) as f32 / (ONE * (OPAQUE - RAMP_START)) as f32;

const _: () = assert!(OPAQUE < ONE, "a complete surface is opaque");

/// Sums of red, green and blue times weight, and of weight, for the pixels of a block. Integers, so
/// that the order of additions does not matter. A pixel can hold 131,000 splats of weight 1; where
/// many samples share one, each weighs down to a 28th of that. The weight has the bits of
/// [`surroundings`].
pub(super) type Sums = [[u32; BLOCK]; 4];

pub(super) const NO_SUMS: Sums = [[0; BLOCK]; 4];

/// Computes mean colour and coverage, 0..255, for the pixels of a block; 0 where the weight is 0.
/// Among the samples of a surface, half of the weight covers a pixel.
#[inline(always)]
pub(super) fn means<S: Simd>(simd: S, sums: &Sums) -> u32x8<S> {
    let bits = u32x8::load_array(simd, sums[3]);
    let integer_weight = bits & !surroundings::MASK;
    let weight = f32x8::float_from(integer_weight);
    let reciprocal = f32x8::splat(simd, 1.0) / weight.max(1.0);
    let red = mean(simd, &sums[0], reciprocal);
    let green = mean(simd, &sums[1], reciprocal);
    let blue = mean(simd, &sums[2], reciprocal);
    let proportional = weight * (255.0 / ONE as f32);
    let ramp = 255.0 - (OPAQUE as f32 - weight) * RAMP;
    let share = u32x8::truncate_from(proportional.max(ramp).min(255.0) + 0.5);
    let share = (share << surroundings::are_surrounded(simd, bits)).min(255);
    let color = red | (green << 8) | (blue << 16) | (share << 24);
    integer_weight
        .simd_eq(0)
        .select(u32x8::splat(simd, 0), color)
}

#[inline(always)]
fn mean<S: Simd>(simd: S, sum: &[u32; BLOCK], reciprocal: f32x8<S>) -> u32x8<S> {
    u32x8::truncate_from(
        (f32x8::float_from(u32x8::load_array(simd, *sum)) * reciprocal + 0.5).min(255.0),
    )
}

/// Blends three surfaces, the nearest first, each with the coverage, 0..255, that it would have
/// alone.
///
/// The second surface often ends in this pixel only because its part behind the front one was not
/// captured, and the weights of its tents fall toward that border. It is therefore assumed to lie
/// in the part of the pixel that the front surface leaves open: otherwise the sky shines through
/// every crown of leaves along its branches (docs/decisions/0049).
#[inline(always)]
pub(super) fn blend_surfaces([front, second, rest]: [[u8; 4]; 3], light: &LinearLight) -> [u8; 4] {
    let front_share = front[3];
    let second_share = second[3].min(255 - front_share);
    let rest_share = rest[3].min(255 - front_share - second_share);
    let rgb = |[r, g, b, _]: [u8; 4]| [r, g, b];
    let shares = [front_share, second_share, rest_share];
    let [r, g, b] = light.mix([front, second, rest].map(rgb), shares.map(u32::from));
    [r, g, b, front_share + second_share + rest_share]
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::dispatch;
    use headbox_core::simd;

    #[test]
    fn means_are_rounded_to_nearest_at_every_level() {
        let coverages = [
            (1u32, 2),
            (2, 4),
            (7, 14),
            (64, 128),
            (96, 191),
            (97, 194),
            (108, 223),
            (119, 252),
            (120, 255),
            (128, 255),
            (9_999, 255),
        ];
        for (weight, coverage) in coverages {
            let reds: [u32; BLOCK] = std::array::from_fn(|i| 255 * weight / 7 * i as u32);
            let blues = [255 * weight; BLOCK];
            for level in simd::levels() {
                let sums = [reds, [weight; BLOCK], blues, [weight; BLOCK]];
                let colors = dispatch!(level, simd => means(simd, &sums).to_array());
                for (color, red) in colors.into_iter().zip(reds) {
                    let [r, g, b, share] = color.to_le_bytes();
                    // Half a level, and single-precision error.
                    assert!(
                        (f64::from(r) - f64::from(red) / f64::from(weight)).abs() <= 0.5 + 1e-4,
                        "{red} / {weight}"
                    );
                    assert_eq!((g, b, share), (1, 255, coverage));
                }
            }
        }
        assert_eq!(
            dispatch!(simd::level(), simd => means(simd, &NO_SUMS).to_array()),
            [0; BLOCK]
        );
    }

    #[test]
    fn second_surface_fills_remaining_coverage() {
        let light = LinearLight::tables();
        let [red, green, blue] =
            [[200, 0, 0], [0, 200, 0], [0, 0, 200]].map(|[r, g, b]| move |share| [r, g, b, share]);
        assert_eq!(
            blend_surfaces([red(255), green(255), blue(255)], light),
            red(255)
        );
        assert_eq!(blend_surfaces([red(0), green(0), blue(0)], light)[3], 0);
        let [r, g, b, share] = blend_surfaces([red(100), green(255), blue(255)], light);
        assert!(share == 255 && r > 0 && g > r && b == 0);
        let [r, g, b, share] = blend_surfaces([red(100), green(20), blue(50)], light);
        assert!(share == 170 && r > b && b > g && g > 0);
    }
}
