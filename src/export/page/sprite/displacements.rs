//! Displacements as what they are more than their neighbours say (`field.js` reads them).

use headbox_sprite::{Displacement, DisplacementFormat};

/// The stored numbers of a displacement, one byte of all after the other, lowest first: the zigzag
/// of each less its expectation, which is the median of the number on the left, the one above, and
/// left + above - above left (that of JPEG-LS: one of the two beside edges). Floating-point numbers
/// count as the integers that their bits are.
pub(super) fn rests(displacement: &Displacement) -> Vec<u8> {
    let width = displacement.size().0 as usize;
    let stored = displacement.stored_bytes();
    let (size, numbers): (usize, Vec<i32>) = match displacement.format() {
        DisplacementFormat::I8 => (
            1,
            stored
                .iter()
                .map(|byte| i32::from(byte.cast_signed()))
                .collect(),
        ),
        DisplacementFormat::I16 => (
            2,
            stored
                .as_chunks::<2>()
                .0
                .iter()
                .map(|two| i32::from(i16::from_le_bytes(*two)))
                .collect(),
        ),
        DisplacementFormat::F32 => (
            4,
            stored
                .as_chunks::<4>()
                .0
                .iter()
                .map(|four| i32::from_le_bytes(*four))
                .collect(),
        ),
    };
    // Numbers are added as their own size wraps.
    let unused = 32 - 8 * size as u32;
    let rest = |(i, number): (usize, &i32)| {
        let off = number.wrapping_sub(expected(&numbers, width, i)) << unused >> unused;
        (off << 1 ^ off >> 31).to_le_bytes()
    };
    let rests: Vec<[u8; 4]> = numbers.iter().enumerate().map(rest).collect();
    (0..size)
        .flat_map(|byte| rests.iter().map(move |rest| rest[byte]))
        .collect()
}

fn expected(numbers: &[i32], width: usize, i: usize) -> i32 {
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
    fn read(rests: &[u8], width: usize, count: usize, size: usize) -> Vec<i32> {
        let unused = 32 - 8 * size as u32;
        let mut numbers: Vec<i32> = Vec::new();
        for i in 0..count {
            let zigzag = (0..size).fold(0u32, |sum, byte| {
                sum | u32::from(rests[byte * count + i]) << (8 * byte)
            });
            let off = (zigzag >> 1).cast_signed() ^ -((zigzag & 1).cast_signed());
            numbers.push(expected(&numbers, width, i).wrapping_add(off) << unused >> unused);
        }
        numbers
    }

    #[test]
    fn stored_numbers_come_back_in_every_format() {
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
                let rests = rests(&displacement);
                assert_eq!(rests.len(), displacement.stored_bytes().len());
                let size = rests.len() / values.len();
                let read = read(&rests, width as usize, values.len(), size);
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
        let rests = rests(&displacement);
        assert!((0..64 * 64).all(|i| i / 64 == 0 || i % 64 == 0 || rests[i] == 0));
    }
}
