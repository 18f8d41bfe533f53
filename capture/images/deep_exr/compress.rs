//! Compressions that OpenEXR allows for deep data. Both first split bytes into those at even and at
//! odd positions, then take differences.

use flate2::Compression;
use flate2::read::{ZlibDecoder, ZlibEncoder};
use std::io::Read;

/// Compression of deep data, row by row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeepCompression {
    /// Uncompressed.
    None,
    /// Run-length encoding.
    Rle,
    /// Deflate, one scanline per block.
    #[default]
    Zips,
}

/// Deflate level, 0..=9.
const DEFLATE_LEVEL: u32 = 4;

impl DeepCompression {
    pub(super) fn from_code(code: u8) -> Option<Self> {
        [Self::None, Self::Rle, Self::Zips]
            .get(usize::from(code))
            .copied()
    }

    pub(super) fn code(self) -> u8 {
        self as u8
    }

    /// Compresses bytes; data that would not shrink is returned unchanged.
    pub(super) fn pack(self, raw: &[u8]) -> Vec<u8> {
        let packed = match self {
            Self::None => return raw.to_vec(),
            Self::Rle => encode_runs(&split_bytes(raw)),
            Self::Zips => {
                let mut packed = Vec::new();
                let split = split_bytes(raw);
                match ZlibEncoder::new(split.as_slice(), Compression::new(DEFLATE_LEVEL))
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

    /// Inverts [`Self::pack`]; never unpacks more than the expected `length` bytes.
    pub(super) fn unpack(self, packed: &[u8], length: usize) -> Result<Vec<u8>, String> {
        if packed.len() == length {
            return Ok(packed.to_vec());
        }
        let mut bytes = Vec::new();
        match self {
            Self::None => {}
            Self::Rle => bytes = decode_runs(packed, length),
            Self::Zips => {
                let read = ZlibDecoder::new(packed)
                    .take(length as u64 + 1)
                    .read_to_end(&mut bytes);
                read.map_err(|cause| format!("has damaged ZIP data: {cause}"))?;
            }
        }
        if bytes.len() == length {
            Ok(join_bytes(bytes))
        } else {
            Err(format!(
                "does not unpack to the {length} bytes in its header"
            ))
        }
    }
}

/// Moves even positions before odd ones, then replaces each byte by its difference from the one
/// before, plus 128.
fn split_bytes(raw: &[u8]) -> Vec<u8> {
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

/// Inverts [`split_bytes`].
fn join_bytes(mut bytes: Vec<u8>) -> Vec<u8> {
    for i in 1..bytes.len() {
        bytes[i] = bytes[i].wrapping_add(bytes[i - 1]).wrapping_sub(128);
    }
    let half = bytes.len().div_ceil(2);
    (0..bytes.len())
        .map(|i| bytes[i / 2 + if i % 2 == 0 { 0 } else { half }])
        .collect()
}

/// Shortest run that is worth a pair of bytes, and the longest that fits one.
const RUN: std::ops::RangeInclusive<usize> = 3..=128;

/// Encodes runs as a count (the length minus one) and a byte, and literals as the negative count
/// and the bytes.
fn encode_runs(bytes: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    let run_length = |i: usize| {
        bytes[i..]
            .iter()
            .take(*RUN.end())
            .take_while(|&&byte| byte == bytes[i])
            .count()
    };
    let mut i = 0;
    while i < bytes.len() {
        let run = run_length(i);
        if run >= *RUN.start() {
            packed.extend([(run - 1) as u8, bytes[i]]);
            i += run;
            continue;
        }
        let start = i;
        while i < bytes.len() && i - start < 127 && run_length(i) < *RUN.start() {
            i += 1;
        }
        packed.push((i - start).wrapping_neg() as u8);
        packed.extend(&bytes[start..i]);
    }
    packed
}

/// Inverts [`encode_runs`]; stops after more than `length` bytes.
fn decode_runs(mut packed: &[u8], length: usize) -> Vec<u8> {
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
