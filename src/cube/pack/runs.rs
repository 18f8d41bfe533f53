//! Run-length encoding of the number of samples per pixel of a segment.
//!
//! Row after row and pixel after pixel: the number of samples, after a 0 the number of pixels more
//! that hold none; each number in groups of seven bits from the lowest, all bytes but its last with
//! the highest bit set. At the end bytes of 0 fill up to a multiple of four. The length of all that
//! comes first, as a little-endian `u32`.

use super::PackedSegment;
use crate::model::validate::MAX_FACE_SIZE_PX;
use headbox_core::container::{FileError, Section};

/// The counts of a segment.
pub(crate) fn encode(segment: &PackedSegment) -> Vec<u8> {
    let mut bytes = vec![0; 4];
    let mut empty = 0u32;
    for counts in segment.row_counts.chunks_exact(segment.width as usize + 1) {
        for ends in counts.windows(2) {
            let count = ends[1].saturating_sub(ends[0]);
            if count == 0 {
                empty += 1;
                continue;
            }
            put_run(&mut bytes, &mut empty);
            put(&mut bytes, count);
        }
    }
    put_run(&mut bytes, &mut empty);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let length = (bytes.len() - 4) as u32;
    bytes[..4].copy_from_slice(&length.to_le_bytes());
    bytes
}

fn put_run(bytes: &mut Vec<u8>, empty: &mut u32) {
    if *empty > 0 {
        bytes.push(0);
        put(bytes, *empty - 1);
        *empty = 0;
    }
}

fn put(bytes: &mut Vec<u8>, mut number: u32) {
    while number >= 128 {
        bytes.push(number as u8 | 128);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Reads running counts as a segment of this size keeps them.
pub(crate) fn decode(
    section: &mut Section,
    width: u32,
    height: u32,
) -> Result<Vec<u32>, FileError> {
    let length: Vec<u32> = section.array(1)?;
    let bytes: Vec<u8> = section.array(length[0] as usize)?;
    let wrong = |section: &Section| section.damaged("counts of all pixels", "too few or too many");
    let mut counts = Vec::new();
    if width.max(height) > MAX_FACE_SIZE_PX {
        return Err(section.damaged("a rectangle on a face", format!("{width}x{height} pixels")));
    }
    let (mut bytes, mut empty) = (bytes.into_iter(), 0);
    for _ in 0..height {
        let mut sum = 0u32;
        for column in 0..=width {
            if column == 0 {
                counts.push(sum);
                continue;
            }
            if empty == 0 {
                let count = take(&mut bytes).ok_or_else(|| wrong(section))?;
                match count {
                    0 => {
                        empty = take(&mut bytes)
                            .and_then(|n| n.checked_add(1))
                            .ok_or_else(|| wrong(section))?;
                    }
                    count => sum = sum.checked_add(count).ok_or_else(|| wrong(section))?,
                }
            }
            empty = empty.saturating_sub(1);
            counts.push(sum);
        }
    }
    match empty == 0 && bytes.len() < 4 && bytes.all(|byte| byte == 0) {
        true => Ok(counts),
        false => Err(wrong(section)),
    }
}

fn take(bytes: &mut impl Iterator<Item = u8>) -> Option<u32> {
    let mut number = 0u32;
    for shift in (0..35).step_by(7) {
        let byte = bytes.next()?;
        let part = u32::from(byte & 127);
        if shift == 28 && part > 15 {
            return None;
        }
        number |= part << shift;
        if byte < 128 {
            return Some(number);
        }
    }
    None
}
