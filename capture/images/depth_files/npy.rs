//! Reader of NPY files, arrays of NumPy: version 1 to 3, integers and floating-point numbers of
//! either byte order, rows or columns first.

use super::{StoredDepth, StoredValues};
use crate::ImagesError;
use exr::prelude::f16;
use headbox_core::image::codec::MAX_PIXELS;
use std::fs::File;
use std::io::Read;
use std::path::Path;

const MAGIC: &[u8] = b"\x93NUMPY";

/// Largest header that is read for the size alone, bytes.
const MAX_HEADER: u64 = 1 << 16;

/// Type, order and shape of an array.
struct Header {
    /// `i`, `u` or `f`.
    kind: u8,
    /// Bytes of a number.
    bytes: usize,
    is_big_endian: bool,
    columns_first: bool,
    width: usize,
    height: usize,
    /// Position of the first number in the file.
    start: usize,
}

/// Reads an array of two dimensions, rows and columns; more of length 1 are dropped.
pub(super) fn read(path: &Path) -> Result<StoredDepth, ImagesError> {
    let bad = |cause: String| ImagesError::invalid_picture(path, cause);
    let bytes = std::fs::read(path).map_err(|cause| ImagesError::io(path, cause))?;
    let header = parse_header(&bytes).map_err(bad)?;
    let [width, height] = [header.width, header.height];
    let data = &bytes[header.start..];
    // Pixels are limited, so that the product fits.
    if data.len() != width * height * header.bytes {
        return Err(bad(format!(
            "has {} bytes of numbers, but its header says {width}x{height} of {} bytes",
            data.len(),
            header.bytes
        )));
    }
    let number = |i: usize| {
        let stored = &data[i * header.bytes..][..header.bytes];
        let mut word = [0; 8];
        word[..header.bytes].copy_from_slice(stored);
        if header.is_big_endian {
            word[..header.bytes].reverse();
        }
        word
    };
    let position = |i: usize| {
        if header.columns_first {
            i % width * height + i / width
        } else {
            i
        }
    };
    let words = (0..width * height).map(|i| number(position(i)));
    let values = if header.kind == b'f' {
        StoredValues::Floats(words.map(|word| float(word, header.bytes)).collect())
    } else {
        let is_signed = header.kind == b'i';
        let values = words.map(|word| integer(word, header.bytes, is_signed));
        StoredValues::Integers {
            values: values.collect(),
            bits: (header.bytes.min(4) * 8) as u8,
        }
    };
    Ok(StoredDepth {
        width: width as u32,
        height: height as u32,
        values,
    })
}

/// Reads the width and height.
pub(super) fn read_size(path: &Path) -> Result<[u32; 2], ImagesError> {
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_HEADER).read_to_end(&mut start))
        .map_err(|cause| ImagesError::io(path, cause))?;
    let header = parse_header(&start).map_err(|cause| ImagesError::invalid_picture(path, cause))?;
    Ok([header.width as u32, header.height as u32])
}

fn float(word: [u8; 8], bytes: usize) -> f32 {
    let [a, b, c, d, ..] = word;
    match bytes {
        2 => f16::from_le_bytes([a, b]).to_f32(),
        4 => f32::from_le_bytes([a, b, c, d]),
        _ => f64::from_le_bytes(word) as f32,
    }
}

/// Returns an integer; 0, unknown, if it is negative; the largest if it is beyond 32 bits.
fn integer(word: [u8; 8], bytes: usize, is_signed: bool) -> u32 {
    let value = u64::from_le_bytes(word);
    let is_negative = is_signed && value >> (bytes * 8 - 1) != 0;
    if is_negative {
        0
    } else {
        u32::try_from(value).unwrap_or(u32::MAX)
    }
}

fn parse_header(bytes: &[u8]) -> Result<Header, String> {
    let damaged = || "is not an NPY file, or a damaged one".to_owned();
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(damaged)?;
    let (start, length) = match rest {
        [1, _, a, b, ..] => (10, usize::from(u16::from_le_bytes([*a, *b]))),
        [2 | 3, _, a, b, c, d, ..] => (12, u32::from_le_bytes([*a, *b, *c, *d]) as usize),
        [version, ..] => return Err(format!("has version {version} of NPY; expected 1 to 3")),
        [] => return Err(damaged()),
    };
    let end = start + length;
    let text = bytes.get(start..end).ok_or_else(damaged)?;
    let text = std::str::from_utf8(text).map_err(|_| damaged())?;
    // The header is a dictionary of Python:
    // {'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }
    let field = |key: &str| {
        let after = text.split_once(&format!("'{key}'"))?.1;
        Some(after.trim_start().strip_prefix(':')?.trim_start())
    };
    let descr = field("descr").ok_or_else(damaged)?;
    let columns_first = field("fortran_order")
        .ok_or_else(damaged)?
        .starts_with("True");
    let shape = field("shape").and_then(|text| text.strip_prefix('('));
    let shape = shape
        .and_then(|text| text.split_once(')'))
        .ok_or_else(damaged)?
        .0;
    let lengths: Option<Vec<usize>> = shape
        .split(',')
        .map(str::trim)
        .filter(|length| !length.is_empty())
        .map(|length| length.parse().ok())
        .collect();
    let lengths = lengths.ok_or_else(damaged)?;
    let quoted = descr
        .strip_prefix('\'')
        .and_then(|text| text.split_once('\''));
    let type_name = quoted.map_or("a structure", |(name, _)| name);
    let (kind, size, is_big_endian) = match type_name.as_bytes() {
        [
            order @ (b'<' | b'>' | b'|' | b'='),
            kind @ (b'i' | b'u' | b'f'),
            size,
        ] => (*kind, usize::from(size.wrapping_sub(b'0')), *order == b'>'),
        _ => (0, 0, false),
    };
    if !(matches!(size, 1 | 2 | 4 | 8) && !(kind == b'f' && size == 1)) {
        return Err(format!(
            "has numbers of type {type_name}; expected integers, or floating-point numbers of 16, 32 or 64 bits"
        ));
    }
    let mut sides = lengths.clone();
    while sides.len() > 2 {
        let unit = sides.iter().position(|&side| side == 1);
        let unit = unit.ok_or_else(|| {
            format!("has the shape ({shape}); expected rows and columns: one depth per pixel")
        })?;
        sides.remove(unit);
    }
    let [height, width] = sides[..] else {
        return Err(format!(
            "has the shape ({shape}); expected rows and columns: one depth per pixel"
        ));
    };
    let pixels = width.checked_mul(height).map(|pixels| pixels as u64);
    if !pixels.is_some_and(|pixels| (1..=MAX_PIXELS).contains(&pixels)) {
        return Err(format!(
            "has the shape ({shape}); expected 1 to {MAX_PIXELS} pixels"
        ));
    }
    Ok(Header {
        kind,
        bytes: size,
        is_big_endian,
        columns_first,
        width,
        height,
        start: end,
    })
}
