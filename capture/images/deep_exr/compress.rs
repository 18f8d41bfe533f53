//! The compressions that OpenEXR allows for deep data. Both begin by taking bytes apart into those at even and at odd
//! places, and then differences.

use flate2::Compression;
use flate2::read::{ZlibDecoder, ZlibEncoder};
use std::io::Read;

/// How deep data is packed, row by row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeepCompression {
    /// Not at all.
    None,
    /// Runs of bytes.
    Rle,
    /// Deflate.
    #[default]
    Zips,
}

/// Deflate's effort, of 9.
const EFFORT: u32 = 4;

impl DeepCompression {
    pub(super) fn from_code(code: u8) -> Option<Self> {
        [Self::None, Self::Rle, Self::Zips]
            .get(usize::from(code))
            .copied()
    }

    pub(super) fn code(self) -> u8 {
        self as u8
    }

    /// Bytes that are no longer than `raw`: what does not shrink is left as it is.
    pub(super) fn pack(self, raw: &[u8]) -> Vec<u8> {
        let packed = match self {
            Self::None => return raw.to_vec(),
            Self::Rle => runs(&apart(raw)),
            Self::Zips => {
                let mut packed = Vec::new();
                let apart = apart(raw);
                match ZlibEncoder::new(apart.as_slice(), Compression::new(EFFORT))
                    .read_to_end(&mut packed)
                {
                    Ok(_) => packed,
                    Err(_) => return raw.to_vec(),
                }
            }
        };
        if packed.len() < raw.len() {
            packed
        } else {
            raw.to_vec()
        }
    }

    /// The inverse of [`Self::pack`]; `length` bytes are expected, and no more are ever unpacked.
    pub(super) fn unpack(self, packed: &[u8], length: usize) -> Result<Vec<u8>, String> {
        if packed.len() == length {
            return Ok(packed.to_vec());
        }
        let mut bytes = Vec::new();
        match self {
            Self::None => {}
            Self::Rle => bytes = unrun(packed, length),
            Self::Zips => {
                let read = ZlibDecoder::new(packed)
                    .take(length as u64 + 1)
                    .read_to_end(&mut bytes);
                read.map_err(|cause| format!("its ZIP data is damaged: {cause}"))?;
            }
        }
        if bytes.len() == length {
            Ok(together(bytes))
        } else {
            Err(format!(
                "does not unpack to the {length} bytes that it says"
            ))
        }
    }
}

/// Even places first, then odd ones; then each byte as its difference from the one before, plus 128.
fn apart(raw: &[u8]) -> Vec<u8> {
    let mut bytes: Vec<u8> = raw
        .iter()
        .step_by(2)
        .chain(raw.iter().skip(1).step_by(2))
        .copied()
        .collect();
    for i in (1..bytes.len()).rev() {
        bytes[i] = bytes[i].wrapping_sub(bytes[i - 1]).wrapping_add(128);
    }
    bytes
}

fn together(mut bytes: Vec<u8>) -> Vec<u8> {
    for i in 1..bytes.len() {
        bytes[i] = bytes[i].wrapping_add(bytes[i - 1]).wrapping_sub(128);
    }
    let half = bytes.len().div_ceil(2);
    (0..bytes.len())
        .map(|i| bytes[i / 2 + if i % 2 == 0 { 0 } else { half }])
        .collect()
}

/// The shortest run that is worth a pair of bytes, and the longest that one holds.
const RUN: std::ops::RangeInclusive<usize> = 3..=128;

/// A count (one less than the run's length) and a byte for a run; minus the count and as many bytes for others.
fn runs(bytes: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    let run_at = |i: usize| {
        bytes[i..]
            .iter()
            .take(*RUN.end())
            .take_while(|&&byte| byte == bytes[i])
            .count()
    };
    let mut i = 0;
    while i < bytes.len() {
        let run = run_at(i);
        if run >= *RUN.start() {
            packed.extend([(run - 1) as u8, bytes[i]]);
            i += run;
            continue;
        }
        let start = i;
        while i < bytes.len() && i - start < 127 && run_at(i) < *RUN.start() {
            i += 1;
        }
        packed.push((i - start).wrapping_neg() as u8);
        packed.extend(&bytes[start..i]);
    }
    packed
}

fn unrun(mut packed: &[u8], length: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    while let [count, rest @ ..] = packed {
        let count = *count as i8;
        if count < 0 {
            let own = rest.len().min(usize::from(count.unsigned_abs()));
            bytes.extend(&rest[..own]);
            packed = &rest[own..];
        } else {
            let [byte, rest @ ..] = rest else { break };
            bytes.resize(bytes.len() + count as usize + 1, *byte);
            packed = rest;
        }
        if bytes.len() > length {
            break;
        }
    }
    bytes
}
