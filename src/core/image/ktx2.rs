//! KTX2 files with Basis Universal textures, as `KHR_texture_basisu` of glTF has them.

use super::codec::{MAX_PIXELS, PictureError};
use crate::memory::{self, Reservation};
use ::image::{DynamicImage, RgbaImage};
use basisu::{DecodeFlags, TargetFormat, Transcoder};

/// First bytes of a KTX2 file.
pub(super) const SIGNATURE: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";

/// Position of the level index: offset, length and decoded length of each level, 64 bits each.
const LEVEL_INDEX: usize = 80;

/// Decodes the largest level, at most `most_bytes` bytes of it.
///
/// # Errors
/// [`PictureError::TooLarge`], and [`PictureError::Malformed`] also for textures that are not
/// compressed by Basis Universal.
pub(super) fn decode(
    bytes: &[u8],
    most_bytes: u64,
) -> Result<(DynamicImage, Reservation), PictureError> {
    let malformed = |cause: &str| PictureError::Malformed(cause.into());
    let word = |at: usize| {
        let bytes = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    };
    let (Some(format), Some(width), Some(height)) = (word(12), word(20), word(24)) else {
        return Err(malformed("the KTX2 header is cut short"));
    };
    let (Some(low), Some(high)) = (word(LEVEL_INDEX + 16), word(LEVEL_INDEX + 20)) else {
        return Err(malformed("the KTX2 level index is cut short"));
    };
    if format != 0 {
        let cause = format!(
            "the KTX2 texture has Vulkan format {format}; only those compressed by Basis Universal \
             can be read"
        );
        return Err(PictureError::Malformed(cause));
    }
    let pixels = u64::from(width) * u64::from(height);
    let decoded = u64::from(high) << 32 | u64::from(low);
    if pixels > MAX_PIXELS.min(most_bytes / 4) || decoded > most_bytes {
        return Err(PictureError::TooLarge { width, height });
    }
    // The compressed blocks, the pixels and a copy of them.
    let memory = memory::reserve(decoded.saturating_add(8 * pixels))?;
    let texture = Transcoder::new(bytes)
        .map_err(|_| malformed("the KTX2 texture is damaged, or not by Basis Universal"))?;
    let pixels = texture
        .transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE)
        .map_err(|cause| PictureError::Malformed(format!("KTX2: {cause:?}")))?;
    RgbaImage::from_raw(width, height, pixels)
        .map(|image| (DynamicImage::ImageRgba8(image), memory))
        .ok_or_else(|| malformed("the KTX2 texture has too few pixels"))
}
