//! Tone curves: from exposed radiance to 8 bits.

use crate::color::linear_from_srgb8;
use crate::color::srgb_table::SrgbTable;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Tone curve, applied per channel to linear radiance times exposure (1 is white) before it is
/// stored as 8-bit sRGB. All curves are invertible below their maximum ([`ToneMap::exposed`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToneMap {
    /// Linear up to [`ToneMap::SHOULDER`], so that most surfaces keep their colour; brighter light
    /// is compressed and reaches white at [`ToneMap::BRIGHTEST`]. Like the curve of Khronos PBR
    /// Neutral, but per channel, so that it can be inverted, and with a finite maximum: with `s =
    /// 1 - SHOULDER`, `t = (x - SHOULDER) / s` and `w = (BRIGHTEST - SHOULDER) / s`, it is
    /// `SHOULDER + s t (1 + t / w^2) / (1 + t)`.
    Neutral,
    /// Linear up to white, clipped there. The curve of photographs and of files that do not name
    /// one.
    #[default]
    SrgbClipped,
    /// Compressed by `x (1 + x / w^2) / (1 + x)`, which reaches 1 at [`ToneMap::BRIGHTEST`] = w
    /// (Reinhard et al. 2002, "Photographic tone reproduction", equation 4). Keeps light for later
    /// exposure: a step of 8 bits is 2.3 % at white, 3.0 % at twice white and 7.3 % at the maximum
    /// (0.9 % at white without compression).
    SrgbCompressed,
}

crate::named_variants!(ToneMap {
    Neutral => "neutral",
    SrgbClipped => "linear",
    SrgbCompressed => "hdr",
});

impl ToneMap {
    /// Largest exposed radiance that a compressing curve distinguishes from brighter ones: four
    /// stops above white.
    pub const BRIGHTEST: f32 = 16.0;

    /// Exposed radiance from which [`Self::Neutral`] compresses; that of Khronos PBR Neutral.
    pub const SHOULDER: f32 = 0.76;

    /// Returns the exposed radiance from which a curve compresses, and the one that it maps to
    /// white. Between them every curve is `shoulder + s t (1 + t / w^2) / (1 + t)` with `s = 1 -
    /// shoulder`, `t = (x - shoulder) / s` and `w = (brightest - shoulder) / s`.
    pub fn range(self) -> [f32; 2] {
        match self {
            Self::Neutral => [Self::SHOULDER, Self::BRIGHTEST],
            Self::SrgbClipped => [1.0, 1.0],
            Self::SrgbCompressed => [0.0, Self::BRIGHTEST],
        }
    }

    /// Returns the curve of a scene without light, which has no highlights: linear in place of
    /// neutral.
    pub fn without_highlights(self) -> Self {
        match self {
            Self::Neutral => Self::SrgbClipped,
            tone => tone,
        }
    }

    /// Applies the curve, without sRGB encoding: linear light as shown on a display, where 1 is
    /// white. Not clamped where the curve is linear.
    pub fn compressed(self, exposed: f32) -> f32 {
        let [shoulder, brightest] = self.range();
        let x = exposed.clamp(0.0, brightest);
        if x > shoulder {
            let s = 1.0 - shoulder;
            shoulder + s * compress((x - shoulder) / s, (brightest - shoulder) / s)
        } else {
            exposed
        }
    }

    /// Returns the stored level of exposed radiance: [`Self::compressed`] in sRGB. NaN becomes 0.
    pub fn level(self, exposed: f32) -> u8 {
        SrgbTable::get(self).encode(exposed)
    }

    /// Returns [`Self::level`] of three channels.
    pub fn levels(self, exposed: Vec3) -> [u8; 3] {
        exposed.to_array().map(|c| self.level(c))
    }

    /// Returns the exposed light that `level` stands for.
    pub fn exposed(self, level: u8) -> f32 {
        let [shoulder, brightest] = self.range();
        let y = linear_from_srgb8(level);
        if y > shoulder {
            let s = 1.0 - shoulder;
            shoulder + s * expand((y - shoulder) / s, (brightest - shoulder) / s)
        } else {
            y
        }
    }

    /// Returns a table from stored levels to levels `stops` brighter, under this curve, or under
    /// the neutral one if this one keeps light for later exposure.
    pub fn brighter_levels(self, stops: f64) -> [u8; 256] {
        let shown = match self {
            Self::SrgbCompressed => Self::Neutral,
            tone => tone,
        };
        let gain = stops.exp2() as f32;
        std::array::from_fn(|level| shown.level(self.exposed(level as u8) * gain))
    }
}

/// Compresses 0..=`brightest` to 0..=1, with a slope of 1 at 0 (Reinhard et al. 2002, equation 4).
fn compress(x: f32, brightest: f32) -> f32 {
    x * (1.0 + x / brightest.powi(2)) / (1.0 + x)
}

/// Inverts [`compress`]: the positive root of `x^2 / w^2 + (1 - y) x - y = 0`, without subtracting
/// nearly equal numbers.
fn expand(y: f32, brightest: f32) -> f32 {
    2.0 * y / (1.0 - y + ((1.0 - y).powi(2) + 4.0 * y / brightest.powi(2)).sqrt())
}

impl fmt::Display for ToneMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Neutral => f.write_str("sRGB, highlights compressed"),
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
        for tone in ToneMap::ALL {
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
        for tone in ToneMap::ALL {
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
        for tone in [ToneMap::Neutral, ToneMap::SrgbCompressed] {
            let brightest = tone.exposed(255);
            assert!(
                (brightest / ToneMap::BRIGHTEST - 1.0).abs() < 1e-4,
                "{tone}: {brightest}"
            );
        }
    }

    #[test]
    fn neutral_keeps_surfaces_and_separates_highlights() {
        let [neutral, linear] = [ToneMap::Neutral, ToneMap::SrgbClipped];
        for exposed in [0.0, 0.18, 0.5, 0.75] {
            assert_eq!(neutral.level(exposed), linear.level(exposed), "{exposed}");
        }
        let levels = [0.76, 0.8, 1.0, 1.5, 2.0, 4.0, 8.0].map(|x| neutral.level(x));
        assert!(
            levels.windows(2).all(|pair| pair[0] < pair[1]),
            "{levels:?}"
        );
        let slope = (neutral.exposed(226) - neutral.exposed(225))
            / (linear.exposed(226) - linear.exposed(225));
        assert!(
            (slope - 1.0).abs() < 0.05,
            "no kink at the shoulder: {slope}"
        );
    }
}
