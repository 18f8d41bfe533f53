//! Predictive encoding of displacements (`field.js` decodes it).

use crate::page::{byte_planes, zigzag};
use headbox_sprite::{Displacement, DisplacementFormat};

/// Encodes the stored numbers of a displacement as zigzagged differences from their predictions, in
/// byte planes, lowest first. The prediction is that of JPEG-LS: the median of the left number, the
/// one above, and left + above - above left. Floating-point numbers are treated as the integers of
/// their bits.
pub(super) fn encode(displacement: &Displacement) -> Vec<u8> {
    let width = displacement.size().0 as usize;
    let stored = displacement.stored_bytes();
    let (pairs, fours) = (stored.as_chunks().0.iter(), stored.as_chunks().0.iter());
    let (size, numbers): (usize, Vec<i32>) = match displacement.format() {
        DisplacementFormat::I8 => (
            1,
            stored
                .iter()
                .map(|byte| byte.cast_signed().into())
                .collect(),
        ),
        DisplacementFormat::I16 => (
            2,
            pairs.map(|two| i16::from_le_bytes(*two).into()).collect(),
        ),
        DisplacementFormat::F32 => (4, fours.map(|four| i32::from_le_bytes(*four)).collect()),
    };
    // Differences wrap at the size of the numbers.
    let unused = 32 - 8 * size as u32;
    let residual = |(i, number): (usize, &i32)| {
        let off = number.wrapping_sub(predict(&numbers, width, i)) << unused >> unused;
        zigzag(off)
    };
    let residuals: Vec<u32> = numbers.iter().enumerate().map(residual).collect();
    byte_planes(&residuals, size)
}

fn predict(numbers: &[i32], width: usize, i: usize) -> i32 {
    match (i % width, i / width) {
        (0, 0) => 0,
        (0, _) => numbers[i - width],
        (_, 0) => numbers[i - 1],
        _ => {
            let [left, above, above_left] =
                [numbers[i - 1], numbers[i - width], numbers[i - width - 1]];
            let (low, high) = (left.min(above), left.max(above));
            i64::from(left)
                .saturating_add(i64::from(above) - i64::from(above_left))
                .clamp(low.into(), high.into()) as i32
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::random::Rng;

    /// Decodes as `field.js` does.
    fn read(residuals: &[u8], width: usize, count: usize, size: usize) -> Vec<i32> {
        let unused = 32 - 8 * size as u32;
        let mut numbers: Vec<i32> = Vec::new();
        for i in 0..count {
            let zigzag = (0..size).fold(0u32, |sum, byte| {
                sum | u32::from(residuals[byte * count + i]) << (8 * byte)
            });
            let off = (zigzag >> 1).cast_signed() ^ -((zigzag & 1).cast_signed());
            numbers.push(predict(&numbers, width, i).wrapping_add(off) << unused >> unused);
        }
        numbers
    }

    #[test]
    fn displacements_round_trip_in_every_format() {
        let mut random = Rng::keyed(20);
        let (width, height) = (37, 19);
        let wild: Vec<f32> = (0..width * height)
            .map(|_| random.below(1 << 20) as f32 / 7.0 - 7e4)
            .collect();
        let plane: Vec<f32> = (0..width * height)
            .map(|i| (i % width) as f32 * 0.25 - (i / width) as f32)
            .collect();
        for format in [
            DisplacementFormat::I8,
            DisplacementFormat::I16,
            DisplacementFormat::F32,
        ] {
            for values in [&wild, &plane] {
                let displacement = Displacement::new(width, height, values, format).unwrap();
                let residuals = encode(&displacement);
                assert_eq!(residuals.len(), displacement.stored_bytes().len());
                let size = residuals.len() / values.len();
                let read = read(&residuals, width as usize, values.len(), size);
                let bytes: Vec<u8> = read
                    .iter()
                    .flat_map(|number| number.to_le_bytes()[..size].to_vec())
                    .collect();
                assert_eq!(bytes, displacement.stored_bytes(), "{format:?}");
            }
        }
    }

    #[test]
    fn displacement_prediction_round_trips() {
        // Whole numbers up to 127, which 8 bits keep as they are.
        let slope: Vec<f32> = (0..64 * 64)
            .map(|i| (2 * (i % 64) + 1) as f32 - (i / 64) as f32)
            .collect();
        let displacement = Displacement::new(64, 64, &slope, DisplacementFormat::I8).unwrap();
        let residuals = encode(&displacement);
        assert!((0..64 * 64).all(|i| i / 64 == 0 || i % 64 == 0 || residuals[i] == 0));
    }
}
