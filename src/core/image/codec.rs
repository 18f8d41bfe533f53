//! Decoding and encoding of image files in memory. Only this module calls the codecs: they are
//! generic over their source and would be compiled again for each.

use ::image::codecs::png::PngEncoder;
use ::image::{
    DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageError, ImageFormat,
    ImageReader, Limits,
};
use std::io::Cursor;
use std::path::Path;

/// Largest number of pixels of an image; larger ones are refused before their pixels are decoded.
/// Scans have textures of 16384 x 16384 pixels, 1 GiB at four bytes.
pub const MAX_PIXELS: u64 = 16_384 * 16_384;

/// Largest number of bytes that a decoder may allocate: 16 bytes (four 32-bit floats) for each of
/// [`MAX_PIXELS`].
pub const MAX_BYTES: u64 = MAX_PIXELS * 16;

/// Error of reading or writing an image file.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// I/O error.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// Decoder or encoder error.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// EXR decoder error.
    #[error("not a readable EXR file: {0}")]
    Exr(#[source] exr::error::Error),
    /// Too many pixels.
    #[error("{width}x{height} pixels, more than {MAX_PIXELS} in all")]
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
}

impl From<exr::error::Error> for PictureError {
    fn from(error: exr::error::Error) -> Self {
        match error {
            exr::error::Error::Io(error) => Self::Io(error),
            error => Self::Exr(error),
        }
    }
}

/// Reads an image file of any supported format; its decoder may allocate `most_bytes`.
///
/// # Errors
/// [`PictureError`].
pub fn read(path: &Path, most_bytes: u64) -> Result<DynamicImage, PictureError> {
    decode(&std::fs::read(path)?, Some(path), most_bytes)
}

/// Reads the number of bits per channel of an image file.
///
/// # Errors
/// [`PictureError`].
pub fn bits_per_channel(path: &Path) -> Result<u16, PictureError> {
    let kind = ImageReader::open(path)?
        .with_guessed_format()?
        .into_decoder()?
        .color_type();
    Ok(kind.bits_per_pixel() / u16::from(kind.channel_count()))
}

/// Decodes an image in memory. Formats without a signature (TGA) are only recognised by the
/// extension of `name`.
///
/// # Errors
/// [`PictureError`].
pub fn decode(
    bytes: &[u8],
    name: Option<&Path>,
    most_bytes: u64,
) -> Result<DynamicImage, PictureError> {
    let mut reader = ImageReader::new(Cursor::new(bytes));
    if let Some(format) = name.and_then(|name| ImageFormat::from_path(name).ok()) {
        reader.set_format(format);
    }
    let mut reader = reader.with_guessed_format()?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(most_bytes);
    reader.limits(limits);
    let decoder = reader.into_decoder()?;
    let (width, height) = decoder.dimensions();
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(PictureError::TooLarge { width, height });
    }
    Ok(DynamicImage::from_decoder(decoder)?)
}

/// Encodes pixels, row by row in the layout of `kind`, as a PNG file.
///
/// # Errors
/// [`PictureError::Image`] if they are not `width * height` pixels, or have none.
pub fn png(
    pixels: &[u8],
    width: u32,
    height: u32,
    kind: ExtendedColorType,
) -> Result<Vec<u8>, PictureError> {
    let bytes = u64::from(width) * u64::from(height) * u64::from(kind.bits_per_pixel()) / 8;
    if bytes != pixels.len() as u64 {
        let kind = ::image::error::ParameterErrorKind::DimensionMismatch;
        return Err(ImageError::Parameter(::image::error::ParameterError::from_kind(kind)).into());
    }
    let mut file = Vec::new();
    PngEncoder::new(&mut file).write_image(pixels, width, height, kind)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let pixels: Vec<u8> = (0..5 * 3 * 4).map(|i| i * 4).collect();
        let file = png(&pixels, 5, 3, ExtendedColorType::Rgba8).expect("fits");
        assert_eq!(
            decode(&file, None, MAX_BYTES)
                .expect("a picture")
                .to_rgba8()
                .into_raw(),
            pixels
        );
        assert!(
            png(&pixels, 5, 2, ExtendedColorType::Rgba8).is_err(),
            "too many pixels"
        );
        assert!(matches!(
            decode(&file[..20], None, MAX_BYTES),
            Err(PictureError::Image(_))
        ));
        let folder = tempfile::tempdir().expect("a folder");
        assert!(matches!(
            read(&folder.path().join("none.png"), MAX_BYTES),
            Err(PictureError::Io(_))
        ));
    }

    #[test]
    fn more_pixels_than_memory_are_refused() {
        let mut file = png(&[0; 4], 1, 1, ExtendedColorType::Rgba8).expect("fits");
        // Width and height in the header, whose checksum is mended.
        file[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
        let checksum = crc32(&file[12..29]);
        file[29..33].copy_from_slice(&checksum.to_be_bytes());
        assert!(matches!(
            decode(&file, None, MAX_BYTES),
            Err(PictureError::TooLarge { width: 65_536, .. })
        ));
    }

    fn crc32(bytes: &[u8]) -> u32 {
        let step = |crc: u32, byte: &u8| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
            })
        };
        !bytes.iter().fold(u32::MAX, step)
    }
}
