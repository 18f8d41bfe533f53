//! Reader of grey TIFF files with 32 or 64 bits, signed or floating-point numbers, which the image
//! decoder lacks.

use super::{StoredDepth, StoredValues};
use crate::ImagesError;
use headbox_core::image::codec::MAX_PIXELS;
use headbox_core::panics;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

/// Largest number of bytes that a byte of a compressed file can hold.
const MAX_COMPRESSION: u64 = 4096;

/// Reads a grey file of more than 16 bits, or of 16 bits that are not unsigned integers; `None` if
/// it is of another kind.
pub(super) fn read(path: &Path) -> Result<Option<StoredDepth>, ImagesError> {
    let bad = |cause: String| ImagesError::invalid_picture(path, cause);
    let failed = |error: TiffError| match error {
        TiffError::IoError(cause) => ImagesError::io(path, cause),
        error => bad(format!("is a TIFF that cannot be read: {error}")),
    };
    let Some(mut decoder) = open(path)? else {
        return Ok(None);
    };
    let (width, height) = decoder.dimensions().map_err(failed)?;
    let bits = match decoder.colortype().map_err(failed)? {
        ColorType::Gray(bits @ (16 | 32 | 64)) => bits,
        _ => return Ok(None),
    };
    // Signed integers and floating-point numbers.
    let formats = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat);
    let formats = formats.map_err(failed)?.unwrap_or_default();
    if bits == 16 && !formats.iter().any(|format| [2, 3].contains(format)) {
        return Ok(None);
    }
    let pixels = u64::from(width) * u64::from(height);
    let bytes = pixels * u64::from(bits / 8);
    let length = std::fs::metadata(path)
        .map_err(|cause| ImagesError::io(path, cause))?
        .len();
    let compression = decoder
        .find_tag_unsigned::<u16>(Tag::Compression)
        .map_err(failed)?;
    let most = if compression.unwrap_or(1) == 1 {
        1
    } else {
        MAX_COMPRESSION
    };
    if pixels > MAX_PIXELS || bytes > length.saturating_mul(most) {
        return Err(bad(format!(
            "has a header of {width}x{height} pixels, more than its {length} bytes can hold"
        )));
    }
    let mut limits = Limits::default();
    limits.decoding_buffer_size = bytes as usize;
    limits.intermediate_buffer_size = bytes as usize;
    let mut decoder = decoder.with_limits(limits);
    let decoded = panics::catch(|| decoder.read_image()).map_err(bad)?;
    let integers = |values: Vec<u32>| StoredValues::Integers { values, bits: 32 };
    let wide = |value: u64| u32::try_from(value).unwrap_or(u32::MAX);
    let values = match decoded.map_err(failed)? {
        DecodingResult::F16(values) => {
            StoredValues::Floats(values.into_iter().map(f32::from).collect())
        }
        DecodingResult::F32(values) => StoredValues::Floats(values),
        DecodingResult::F64(values) => {
            StoredValues::Floats(values.into_iter().map(|value| value as f32).collect())
        }
        DecodingResult::U32(values) => integers(values),
        // Negative values are unknown, as 0 is.
        DecodingResult::I32(values) => integers(
            values
                .into_iter()
                .map(|value| value.max(0) as u32)
                .collect(),
        ),
        DecodingResult::I16(values) => StoredValues::Integers {
            values: values
                .into_iter()
                .map(|value| value.max(0).unsigned_abs().into())
                .collect(),
            bits: 15,
        },
        DecodingResult::U64(values) => integers(values.into_iter().map(wide).collect()),
        DecodingResult::I64(values) => integers(
            values
                .into_iter()
                .map(|value| wide(value.max(0) as u64))
                .collect(),
        ),
        _ => return Ok(None),
    };
    let count = match &values {
        StoredValues::Integers { values, .. } => values.len(),
        StoredValues::Floats(values) => values.len(),
    };
    if count as u64 != pixels {
        return Err(bad("is a TIFF with more than one value per pixel".into()));
    }
    Ok(Some(StoredDepth {
        width,
        height,
        values,
    }))
}

/// Reads the width and height.
pub(super) fn read_size(path: &Path) -> Result<[u32; 2], ImagesError> {
    let size = open(path)?.and_then(|mut decoder| decoder.dimensions().ok());
    size.map_or_else(
        || crate::views::color_images::read_size(path),
        |(width, height)| Ok([width, height]),
    )
}

/// Opens a file; `None` if the decoder does not support it.
fn open(path: &Path) -> Result<Option<Decoder<BufReader<File>>>, ImagesError> {
    let file = File::open(path).map_err(|cause| ImagesError::io(path, cause))?;
    let opened = panics::catch(|| Decoder::new(BufReader::new(file)));
    Ok(opened.ok().and_then(Result::ok))
}
