//! Linear light to 8-bit sRGB by a table: the same bytes as [`srgb8_from_linear`] without its power function.

use crate::capture::srgb8_from_linear;
use std::sync::LazyLock;

/// Below this, sRGB is 0: the curve reaches half a level at 1.5e-4.
const FIRST_BITS: u32 = (1.0f32 / 8192.0).to_bits();
/// 128 entries an octave: at most one of the 256 levels begins inside an entry.
const SHIFT: u32 = 16;
const ENTRIES: usize = ((1.0f32.to_bits() - FIRST_BITS) >> SHIFT) as usize + 1;

/// For each run of values with the same leading bits: the level of its first, and the value from which the next one holds.
pub(super) struct SrgbTable {
    entries: Box<[(u8, f32); ENTRIES]>,
}

static TABLE: LazyLock<SrgbTable> = LazyLock::new(|| SrgbTable {
    entries: Box::new(std::array::from_fn(|i| {
        let first = FIRST_BITS + ((i as u32) << SHIFT);
        let level = srgb8_from_linear(f32::from_bits(first));
        // Bisection over the bits, which are ordered as the values are.
        let (mut same, mut next) = (first, first + (1 << SHIFT));
        while next - same > 1 {
            let middle = same.midpoint(next);
            *(if srgb8_from_linear(f32::from_bits(middle)) == level { &mut same } else { &mut next }) = middle;
        }
        (level, f32::from_bits(next))
    })),
});

impl SrgbTable {
    /// The table.
    pub(super) fn get() -> &'static Self {
        &TABLE
    }

    /// The nearest 8-bit sRGB value of linear light; values outside 0..1 are clamped, NaN becomes 0.
    #[inline(always)]
    pub(super) fn encode(&self, linear: f32) -> u8 {
        let bits = if linear > 0.0 { linear.min(1.0).to_bits() } else { 0 };
        if bits < FIRST_BITS {
            return 0;
        }
        // The bound is never met (1 has the last entry), but spares a check.
        let (level, next) = self.entries[(((bits - FIRST_BITS) >> SHIFT) as usize).min(ENTRIES - 1)];
        level + u8::from(level < 255 && f32::from_bits(bits) >= next)
    }
}

/// The same bytes as [`srgb8_from_linear`], by the table.
#[inline(always)]
pub(crate) fn encode_srgb(linear: f32) -> u8 {
    SrgbTable::get().encode(linear)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_agrees_with_the_curve() {
        let table = SrgbTable::get();
        for bits in (0..1.5f32.to_bits()).step_by(997) {
            let value = f32::from_bits(bits);
            assert_eq!(table.encode(value), srgb8_from_linear(value), "{value}");
        }
        for value in [0.0, -1.0, f32::NAN, 1.0, f32::INFINITY, 0.003_130_8] {
            assert_eq!(table.encode(value), srgb8_from_linear(value), "{value}");
        }
    }
}
