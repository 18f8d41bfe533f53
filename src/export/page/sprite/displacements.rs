//! Displacements as what they are more than their neighbours say (`field.js` reads them).

use crate::sprite::{Displacement, DisplacementFormat};

/// The stored numbers of a displacement, one byte of all after the other, lowest first: the zigzag of each less its expectation,
/// which is the median of the number on the left, the one above, and left + above - above left (that of JPEG-LS: exact on planes,
/// one of the two beside edges). Floating-point numbers count as the integers that their bits are.
pub(super) fn rests(displacement: &Displacement) -> Vec<u8> {
    let width = displacement.size().0 as usize;
    let stored = displacement.stored_bytes();
    let (size, numbers): (usize, Vec<i32>) = match displacement.format() {
        DisplacementFormat::I8 => (1, stored.iter().map(|byte| i32::from(byte.cast_signed())).collect()),
        DisplacementFormat::I16 => {
            (2, stored.as_chunks::<2>().0.iter().map(|two| i32::from(i16::from_le_bytes(*two))).collect())
        }
        DisplacementFormat::F32 => (4, stored.as_chunks::<4>().0.iter().map(|four| i32::from_le_bytes(*four)).collect()),
    };
    // Numbers are added as their own size wraps.
    let unused = 32 - 8 * size as u32;
    let rest = |(i, number): (usize, &i32)| {
        let off = number.wrapping_sub(expected(&numbers, width, i)) << unused >> unused;
        (off << 1 ^ off >> 31).to_le_bytes()
    };
    let rests: Vec<[u8; 4]> = numbers.iter().enumerate().map(rest).collect();
    (0..size).flat_map(|byte| rests.iter().map(move |rest| rest[byte])).collect()
}

fn expected(numbers: &[i32], width: usize, i: usize) -> i32 {
    match (i % width, i / width) {
        (0, 0) => 0,
        (0, _) => numbers[i - width],
        (_, 0) => numbers[i - 1],
        _ => {
            let [left, above, above_left] = [numbers[i - 1], numbers[i - width], numbers[i - width - 1]];
            let (low, high) = (left.min(above), left.max(above));
            i64::from(left).saturating_add(i64::from(above) - i64::from(above_left)).clamp(low.into(), high.into()) as i32
        }
    }
}
