//! Run-length encoding of the number of samples per pixel of a segment.
//!
//! The stream starts with its length in bytes, a little-endian `u32`. Then follows, pixel by pixel
//! in row-major order, the number of samples; a 0 is followed by the number of further empty
//! pixels. Each number is a LEB128 integer: groups of seven bits from the lowest, all bytes but the
//! last with the highest bit set. Zero bytes pad the stream to a multiple of four.

use super::PackedSegment;
use crate::model::validate::MAX_FACE_SIZE_PX;
use headbox_core::container::{FileError, Section};

/// Encodes the counts of a segment.
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
            write_empty_run(&mut bytes, &mut empty);
            write_number(&mut bytes, count);
        }
    }
    write_empty_run(&mut bytes, &mut empty);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let length = (bytes.len() - 4) as u32;
    bytes[..4].copy_from_slice(&length.to_le_bytes());
    bytes
}

fn write_empty_run(bytes: &mut Vec<u8>, empty: &mut u32) {
    if *empty > 0 {
        bytes.push(0);
        write_number(bytes, *empty - 1);
        *empty = 0;
    }
}

fn write_number(bytes: &mut Vec<u8>, mut number: u32) {
    while number >= 128 {
        bytes.push(number as u8 | 128);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Decodes the running counts of a segment of this size, as in [`PackedSegment::row_counts`].
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
        counts.push(sum);
        for _ in 0..width {
            if empty == 0 {
                let count = read_number(&mut bytes).ok_or_else(|| wrong(section))?;
                if count == 0 {
                    empty = read_number(&mut bytes)
                        .and_then(|n| n.checked_add(1))
                        .ok_or_else(|| wrong(section))?;
                } else {
                    sum = sum.checked_add(count).ok_or_else(|| wrong(section))?;
                }
            }
            empty = empty.saturating_sub(1);
            counts.push(sum);
        }
    }
    if empty == 0 && bytes.len() < 4 && bytes.all(|byte| byte == 0) {
        Ok(counts)
    } else {
        Err(wrong(section))
    }
}

fn read_number(bytes: &mut impl Iterator<Item = u8>) -> Option<u32> {
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
