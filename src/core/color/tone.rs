//! Tone curves: from exposed radiance to 8 bits.

use crate::color::{linear_from_srgb8, srgb8_from_linear};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Tone curve, applied per channel to linear radiance times exposure (1 is white) before it is
/// stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToneMap {
    /// Clips at 1 and encodes by the curve of sRGB.
    #[default]
    SrgbClipped,
    /// Compresses by `x (1 + x / w^2) / (1 + x)`, which reaches 1 at [`ToneMap::BRIGHTEST`] = w
    /// (Reinhard et al. 2002, "Photographic tone reproduction", equation 4), clips there, and
    /// encodes by the curve of sRGB. The stored image is viewable, and [`ToneMap::exposed`]
    /// restores the light: a step of 8 bits is 2.3 % at white, 3.0 % at twice white and 7.3 % at
    /// the brightest level (0.9 % at white without compression).
    SrgbCompressed,
}

impl ToneMap {
    /// Largest radiance that [`Self::SrgbCompressed`] distinguishes from brighter ones: four stops
    /// above white.
    pub const BRIGHTEST: f32 = 16.0;

    /// Returns the stored level of exposed radiance; NaN becomes 0.
    pub fn level(self, exposed: f32) -> u8 {
        srgb8_from_linear(match self {
            Self::SrgbClipped => exposed,
            Self::SrgbCompressed => {
                let x = exposed.clamp(0.0, Self::BRIGHTEST);
                x * (1.0 + x / Self::BRIGHTEST.powi(2)) / (1.0 + x)
            }
        })
    }

    /// Returns the stored levels of three channels.
    pub fn levels(self, exposed: Vec3) -> [u8; 3] {
        exposed.to_array().map(|c| self.level(c))
    }

    /// Returns the exposed light of a stored level.
    pub fn exposed(self, level: u8) -> f32 {
        let y = linear_from_srgb8(level);
        match self {
            Self::SrgbClipped => y,
            Self::SrgbCompressed => {
                // The positive root of x^2 / w^2 + (1 - y) x - y = 0, without cancellation.
                let square = Self::BRIGHTEST.powi(2);
                2.0 * y / (1.0 - y + ((1.0 - y).powi(2) + 4.0 * y / square).sqrt())
            }
        }
    }
}

impl fmt::Display for ToneMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SrgbClipped => f.write_str("sRGB, cut off at white"),
            Self::SrgbCompressed => {
                write!(
                    f,
                    "sRGB, compressed, cut off {} stops above white",
                    Self::BRIGHTEST.log2()
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_round_trip_through_light() {
        for tone in [ToneMap::SrgbClipped, ToneMap::SrgbCompressed] {
            assert!(
                (0..=255).all(|level| tone.level(tone.exposed(level)) == level),
                "{tone}"
            );
        }
    }

    #[test]
    fn level_steps_match_documentation() {
        let step = |around: f32| {
            let tone = ToneMap::SrgbCompressed;
            let level = tone.level(around);
            (tone.exposed(level) - tone.exposed(level - 1)) / tone.exposed(level)
        };
        for (light, share) in [(1.0, 0.0233), (2.0, 0.0302), (ToneMap::BRIGHTEST, 0.0731)] {
            assert!(
                (step(light) / share - 1.0).abs() < 0.01,
                "{light}: {}",
                step(light)
            );
        }
    }

    #[test]
    fn nan_is_black_and_overflow_is_white() {
        for tone in [ToneMap::SrgbClipped, ToneMap::SrgbCompressed] {
            assert_eq!(
                [f32::NAN, -1.0, 0.0].map(|x| tone.level(x)),
                [0; 3],
                "{tone}"
            );
            assert_eq!(
                [f32::INFINITY, f32::MAX, 17.0].map(|x| tone.level(x)),
                [255; 3],
                "{tone}"
            );
        }
        assert_eq!(ToneMap::SrgbCompressed.exposed(255), ToneMap::BRIGHTEST);
    }
}
