//! Table lookup from exposed radiance to 8-bit sRGB under a tone curve, without power functions and
//! divisions.

use crate::color::srgb8_from_linear;
use crate::color::tone::ToneMap;
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, u32x16};
use std::sync::LazyLock;

/// Start of the table; below it, sRGB is 0: every curve reaches half a level at 1.5e-4 or more.
const FIRST_BITS: u32 = (1.0f32 / 8192.0).to_bits();
/// Bits per entry: with 128 entries per octave, at most one of the 256 levels begins inside an
/// entry.
const SHIFT: u32 = 16;
/// Mask of the bits inside an entry.
const LOW_BITS: u32 = (1 << SHIFT) - 1;
const ENTRIES: usize = ((ToneMap::BRIGHTEST.to_bits() - FIRST_BITS) >> SHIFT) as usize + 1;

/// Table of a tone curve, with an entry for each range of values with the same leading bits. The
/// highest byte is the level of the first value; the others are the offset of the first value with
/// the next level, or the length of the range if all values have one level.
pub struct SrgbTable {
    entries: Box<[u32; ENTRIES]>,
}

static NEUTRAL: LazyLock<SrgbTable> = LazyLock::new(|| SrgbTable::new(ToneMap::Neutral));
static CLIPPED: LazyLock<SrgbTable> = LazyLock::new(|| SrgbTable::new(ToneMap::SrgbClipped));
static COMPRESSED: LazyLock<SrgbTable> = LazyLock::new(|| SrgbTable::new(ToneMap::SrgbCompressed));

impl SrgbTable {
    /// Returns the table of a tone curve.
    pub fn get(tone: ToneMap) -> &'static Self {
        match tone {
            ToneMap::Neutral => &NEUTRAL,
            ToneMap::SrgbClipped => &CLIPPED,
            ToneMap::SrgbCompressed => &COMPRESSED,
        }
    }

    fn new(tone: ToneMap) -> Self {
        let level = |bits: u32| srgb8_from_linear(tone.compressed(f32::from_bits(bits)));
        let entry = |i: usize| {
            let first = FIRST_BITS + ((i as u32) << SHIFT);
            let first_level = level(first);
            // Bisection over the bits, which are ordered like the values.
            let (mut same, mut next) = (first, first + (1 << SHIFT));
            while next - same > 1 {
                let middle = same.midpoint(next);
                if level(middle) == first_level {
                    same = middle;
                } else {
                    next = middle;
                }
            }
            u32::from(first_level) << 24 | (next - first)
        };
        Self {
            entries: Box::new(std::array::from_fn(entry)),
        }
    }

    /// Returns the stored level of exposed radiance; NaN becomes 0.
    #[inline(always)]
    pub fn encode(&self, exposed: f32) -> u8 {
        // NaN becomes the first value of the table, whose level is 0.
        let value = exposed.max(f32::from_bits(FIRST_BITS));
        let bits = value.min(ToneMap::BRIGHTEST).to_bits() - FIRST_BITS;
        let entry = self.entry(bits >> SHIFT);
        (entry >> 24) as u8 + u8::from(bits & LOW_BITS >= entry & 0xff_ffff)
    }

    /// Same as [`Self::encode`] for the first `count` of sixteen lanes.
    #[inline(always)]
    pub fn encode_sixteen<S: Simd>(&self, simd: S, exposed: f32x16<S>, count: usize) -> u32x16<S> {
        let first = f32x16::splat(simd, f32::from_bits(FIRST_BITS));
        // False for NaN.
        let value = exposed
            .simd_gt(first)
            .select(exposed, first)
            .min(ToneMap::BRIGHTEST);
        let bits = value.bitcast::<u32x16<S>>() - FIRST_BITS;
        let mut entries = (bits >> SHIFT).to_array();
        for entry in entries.iter_mut().take(count) {
            *entry = self.entry(*entry);
        }
        let entries = u32x16::load_array(simd, entries);
        let one = u32x16::splat(simd, 1);
        (entries >> 24)
            + (bits & LOW_BITS)
                .simd_ge(entries & 0xff_ffff)
                .select(one, u32x16::splat(simd, 0))
    }

    #[inline(always)]
    fn entry(&self, number: u32) -> u32 {
        // The index is always in range (the brightest value has the last entry); the bound replaces
        // a panicking check.
        self.entries[(number as usize).min(ENTRIES - 1)]
    }
}

/// Same as [`crate::color::srgb8_from_linear`], by the table.
#[inline]
pub fn encode_srgb(linear: f32) -> u8 {
    CLIPPED.encode(linear)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::dispatch;

    /// Asserts that the table, by scalars and by lanes, gives a level.
    fn assert_level(tone: ToneMap, value: f32, level: u8) {
        let table = SrgbTable::get(tone);
        let lanes = dispatch!(fearless_simd::Level::new(), simd => {
            table.encode_sixteen(simd, f32x16::splat(simd, value), 8).to_array()[7]
        });
        let found = (table.encode(value), lanes, tone.level(value));
        assert_eq!(found, (level, u32::from(level), level), "{value} {tone}");
    }

    /// Level by the functions that the table replaces.
    fn computed_level(tone: ToneMap, value: f32) -> u8 {
        srgb8_from_linear(tone.compressed(value))
    }

    #[test]
    fn table_matches_tone_curve() {
        let hard = [
            0.0,
            -1.0,
            f32::NAN,
            1.0,
            ToneMap::SHOULDER,
            ToneMap::BRIGHTEST,
            f32::MAX,
            f32::INFINITY,
            f32::NEG_INFINITY,
            0.003_130_8,
        ];
        for tone in ToneMap::ALL {
            for value in (0..20.0f32.to_bits())
                .step_by(997)
                .map(f32::from_bits)
                .chain(hard)
            {
                assert_level(tone, value, computed_level(tone, value));
            }
        }
    }

    /// Maximum distance from a threshold at which a computed level may lie on its other side, in
    /// adjacent floats: rounding makes the compressing curves fall there. Of all floats up to 16,
    /// one differs for the neutral curve and 31 for the compressed one, 15 floats away at most.
    fn rounding(tone: ToneMap) -> u32 {
        match tone {
            ToneMap::SrgbClipped => 0,
            ToneMap::Neutral | ToneMap::SrgbCompressed => 15,
        }
    }

    #[test]
    fn table_matches_tone_curve_at_every_threshold() {
        /// Number of adjacent floats on either side of a threshold.
        const NEAR: u32 = 200;
        for tone in ToneMap::ALL {
            for level in 1..=255 {
                let (mut below, mut at) = (0, ToneMap::BRIGHTEST.to_bits());
                while at - below > 1 {
                    let middle = below.midpoint(at);
                    if tone.level(f32::from_bits(middle)) < level {
                        below = middle;
                    } else {
                        at = middle;
                    }
                }
                for bits in at - NEAR..at + NEAR {
                    let value = f32::from_bits(bits);
                    let expected = if bits < at { level - 1 } else { level };
                    assert_level(tone, value, expected);
                    if bits.abs_diff(at) > rounding(tone) {
                        assert_eq!(computed_level(tone, value), expected, "{value} {tone}");
                    }
                }
            }
        }
    }
}
