//! Table lookup from linear light to 8-bit sRGB: the same bytes as [`srgb8_from_linear`] without
//! its power function.

use crate::color::srgb8_from_linear;
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, u32x16};
use std::sync::LazyLock;

/// Start of the table; below it, sRGB is 0: the curve reaches half a level at 1.5e-4.
const FIRST_BITS: u32 = (1.0f32 / 8192.0).to_bits();
/// Bits per entry: with 128 entries per octave, at most one of the 256 levels begins inside an
/// entry.
const SHIFT: u32 = 16;
/// Mask of the bits inside an entry.
const LOW_BITS: u32 = (1 << SHIFT) - 1;
const ENTRIES: usize = ((1.0f32.to_bits() - FIRST_BITS) >> SHIFT) as usize + 1;

/// Table with an entry for each range of values with the same leading bits. The highest byte is the
/// level of the first value; the others are the offset of the first value with the next level, or
/// the length of the range if all values have one level.
pub struct SrgbTable {
    entries: Box<[u32; ENTRIES]>,
}

static TABLE: LazyLock<SrgbTable> = LazyLock::new(|| SrgbTable {
    entries: Box::new(std::array::from_fn(|i| {
        let first = FIRST_BITS + ((i as u32) << SHIFT);
        let level = srgb8_from_linear(f32::from_bits(first));
        // Bisection over the bits, which are ordered like the values.
        let (mut same, mut next) = (first, first + (1 << SHIFT));
        while next - same > 1 {
            let middle = same.midpoint(next);
            if srgb8_from_linear(f32::from_bits(middle)) == level {
                same = middle;
            } else {
                next = middle;
            }
        }
        u32::from(level) << 24 | (next - first)
    })),
});

impl SrgbTable {
    /// Returns the table.
    pub fn get() -> &'static Self {
        &TABLE
    }

    /// Returns the nearest 8-bit sRGB value of linear light; values outside 0..1 are clamped, NaN
    /// becomes 0.
    #[inline(always)]
    fn encode(&self, linear: f32) -> u8 {
        // NaN becomes the first value of the table, whose level is 0.
        let bits = linear.max(f32::from_bits(FIRST_BITS)).min(1.0).to_bits() - FIRST_BITS;
        let entry = self.entry(bits >> SHIFT);
        (entry >> 24) as u8 + u8::from(bits & LOW_BITS >= entry & 0xff_ffff)
    }

    /// Same as [`encode_srgb`] for the first `count` of sixteen lanes.
    #[inline(always)]
    pub fn encode_sixteen<S: Simd>(&self, simd: S, linear: f32x16<S>, count: usize) -> u32x16<S> {
        let first = f32x16::splat(simd, f32::from_bits(FIRST_BITS));
        // False for NaN.
        let value = linear.simd_gt(first).select(linear, first).min(1.0);
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
        // The index is always in range (1 has the last entry); the bound replaces a panicking
        // check.
        self.entries[(number as usize).min(ENTRIES - 1)]
    }
}

/// Same as [`srgb8_from_linear`], by the table.
#[inline]
pub fn encode_srgb(linear: f32) -> u8 {
    SrgbTable::get().encode(linear)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::dispatch;

    #[test]
    fn table_matches_curve() {
        let table = SrgbTable::get();
        let sixteen = |value: f32| {
            dispatch!(fearless_simd::Level::new(), simd => {
                table.encode_sixteen(simd, f32x16::splat(simd, value), 8).to_array()[7]
            })
        };
        let hard = [
            0.0,
            -1.0,
            f32::NAN,
            1.0,
            f32::INFINITY,
            f32::NEG_INFINITY,
            0.003_130_8,
        ];
        for value in (0..1.5f32.to_bits())
            .step_by(997)
            .map(f32::from_bits)
            .chain(hard)
        {
            let level = srgb8_from_linear(value);
            assert_eq!(
                (table.encode(value), sixteen(value)),
                (level, u32::from(level)),
                "{value}"
            );
        }
    }
}
