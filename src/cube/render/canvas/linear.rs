//! Blending by coverage in linear light, on 8-bit sRGB colours.
//!
//! Radiance of a partly covered pixel adds up linearly. Blended as sRGB values, dark rims over a
//! bright background are too dark (docs/decisions/0046).

use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use std::sync::LazyLock;

/// The two sRGB transfer curves as tables, 12 bits for linear light.
pub struct LinearLight {
    linear: [u16; 256],
    srgb: [u8; LinearLight::MAX as usize + 1],
}

static RECIPROCALS: [u64; 256] = reciprocals();

/// Bit position of alpha in a colour in memory order.
pub(crate) const ALPHA_SHIFT: u32 = u32::from_ne_bytes([0, 0, 0, 1]).trailing_zeros();

static TABLES: LazyLock<LinearLight> = LazyLock::new(|| LinearLight {
    linear: std::array::from_fn(|c| {
        (linear_from_srgb8(c as u8) * f32::from(LinearLight::MAX) + 0.5) as u16
    }),
    srgb: std::array::from_fn(|v| srgb8_from_linear(v as f32 / f32::from(LinearLight::MAX))),
});

impl LinearLight {
    /// Linear light of white.
    pub const MAX: u16 = 4095;

    /// Returns the tables.
    pub fn tables() -> &'static Self {
        &TABLES
    }

    /// Converts linear light to sRGB; more than [`Self::MAX`] is white.
    #[inline(always)]
    pub fn srgb(&self, linear: u32) -> u8 {
        self.srgb[(linear as usize).min(usize::from(Self::MAX))]
    }

    /// Computes the mean of colours with integer weights whose sum is 1 to 255.
    #[inline(always)]
    pub fn mix<const N: usize>(&self, colors: [[u8; 3]; N], weights: [u32; N]) -> [u8; 3] {
        let total = weights.iter().sum::<u32>().max(1);
        let reciprocal = RECIPROCALS[(total as usize).min(RECIPROCALS.len() - 1)];
        let mut mixed = [0; 3];
        for (channel, mixed) in mixed.iter_mut().enumerate() {
            let mut sum = total / 2;
            for (color, weight) in colors.iter().zip(weights) {
                sum += u32::from(self.linear[usize::from(color[channel])]) * weight;
            }
            // sum / total, as sum is below 2^21.
            *mixed =
                self.srgb[((u64::from(sum) * reciprocal) >> 32) as usize & usize::from(Self::MAX)];
        }
        mixed
    }

    /// Composites a straight colour over another, each with its coverage, 0..255.
    #[inline(always)]
    pub fn over(&self, front: [u8; 4], behind: [u8; 4]) -> [u8; 4] {
        let share = u32::from(front[3]);
        let rest = ((255 - share) * u32::from(behind[3]) + 127) / 255;
        let rgb = |[r, g, b, _]: [u8; 4]| [r, g, b];
        let [r, g, b] = self.mix([rgb(front), rgb(behind)], [share, rest]);
        [r, g, b, (share + rest) as u8]
    }
}

/// Divides a premultiplied channel by alpha > 0, rounded to nearest.
#[inline(always)]
pub(crate) fn unpremultiply(c: u8, alpha: u8) -> u8 {
    let half = u64::from(alpha / 2);
    (((u64::from(c) * 255 + half) * RECIPROCALS[usize::from(alpha)]) >> 32).min(255) as u8
}

/// Returns 2^32 / divisor, rounded up, for the divisors below 256; 0 for 0. `n * reciprocal >> 32`
/// is `n / divisor` for all n below 2^24: n times the excess, which is less than 1, stays below
/// 2^32 / divisor.
const fn reciprocals() -> [u64; 256] {
    let mut reciprocals = [0; 256];
    let mut divisor = 1;
    while divisor < 256 {
        reciprocals[divisor] = (1u64 << 32).div_ceil(divisor as u64);
        divisor += 1;
    }
    reciprocals
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colour_mixed_with_itself_is_unchanged() {
        for c in 0..=255 {
            for shares in [[1, 0], [77, 13], [0, 255], [128, 127]] {
                assert_eq!(LinearLight::tables().mix([[c; 3], [c; 3]], shares), [c; 3]);
            }
        }
    }

    #[test]
    fn unpremultiply_is_exact_division() {
        for alpha in 1..=255u8 {
            for c in 0..=255u8 {
                let exact = (u32::from(c) * 255 + u32::from(alpha / 2)) / u32::from(alpha);
                assert_eq!(u32::from(unpremultiply(c, alpha)), exact.min(255));
            }
        }
    }

    /// Step of 12-bit linear light in the darkest colours, rounded up: 0.8 levels.
    const MIX_LEVELS: f32 = 1.0;

    #[test]
    fn mixes_add_linear_light() {
        for (a, b, share) in [(0, 255, 128), (30, 210, 51), (200, 90, 204), (4, 9, 100)] {
            let exact = (linear_from_srgb8(a) * share as f32
                + linear_from_srgb8(b) * (255 - share) as f32)
                / 255.0;
            let mixed = LinearLight::tables().mix([[a; 3], [b; 3]], [share, 255 - share])[1];
            assert!(
                (f32::from(mixed) - f32::from(srgb8_from_linear(exact))).abs() <= MIX_LEVELS,
                "{a}, {b}: {mixed}"
            );
        }
        assert_eq!(
            LinearLight::tables().over([10, 20, 30, 0], [40, 50, 60, 255]),
            [40, 50, 60, 255]
        );
        assert_eq!(
            LinearLight::tables().over([10, 20, 30, 255], [40, 50, 60, 255]),
            [10, 20, 30, 255]
        );
        assert_eq!(LinearLight::tables().over([0; 4], [0; 4])[3], 0);
    }
}
