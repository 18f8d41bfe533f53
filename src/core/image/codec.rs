//! Decoding and encoding of image files in memory. Only this module calls the codecs: they are
//! generic over their source and would be compiled again for each.
//!
//! A decoder that panics on a malformed file is a defect of its crate, but no reason to end the
//! program: [`decode`] turns the panic into [`PictureError::Malformed`].

use super::png_chunks;
use crate::memory::{self, OverBudget, Reservation};
use crate::panics;
use ::image::codecs::png::PngEncoder;
use ::image::{
    DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageError, ImageFormat,
    ImageReader, Limits,
};
use std::ffi::OsStr;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::Path;

/// Largest number of pixels of an image; larger ones are refused before their pixels are decoded.
/// Scans have textures of 16384 x 16384 pixels, 1 GiB at four bytes.
pub const MAX_PIXELS: u64 = 16_384 * 16_384;

/// Largest number of bytes that a decoder may allocate: 16 bytes (four 32-bit floats) for each of
/// [`MAX_PIXELS`].
pub const MAX_BYTES: u64 = MAX_PIXELS * 16;

/// Marker at the end of a JPEG file.
const END_OF_JPEG: &[u8] = b"\xff\xd9";

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
    /// An intact EXR file that its decoder does not support.
    #[error(
        "an intact EXR file of a kind that is not read ({0}); save it as a flat file without subsampled channels"
    )]
    ExrKind(String),
    /// A file that its decoder cannot handle.
    #[error("malformed: {0}")]
    Malformed(String),
    /// Not enough memory.
    #[error(transparent)]
    OverBudget(#[from] OverBudget),
    /// Too many pixels.
    #[error("{width}x{height} pixels, more than {MAX_PIXELS} in all")]
    TooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
}

impl PictureError {
    /// Returns true if the file is not at fault: it needs more memory than the budget has left.
    #[must_use]
    pub fn is_over_budget(&self) -> bool {
        match self {
            Self::OverBudget(_) => true,
            Self::Io(error) => error.kind() == std::io::ErrorKind::OutOfMemory,
            _ => false,
        }
    }
}

impl From<exr::error::Error> for PictureError {
    fn from(error: exr::error::Error) -> Self {
        match error {
            exr::error::Error::Io(error) => Self::Io(error),
            exr::error::Error::NotSupported(kind) => Self::ExrKind(kind.into()),
            error => Self::Exr(error),
        }
    }
}

/// A decoded image.
#[derive(Debug)]
pub struct Decoded {
    /// Pixels; those that the file lacks have any colour.
    pub image: DynamicImage,
    /// Missing part of a JPEG file that is cut short, such as "rows 40 to 95 are missing".
    pub damage: Option<String>,
    /// The memory of the pixels, and as much as a copy in eight bits has.
    pub memory: Reservation,
}

/// Reads an image file of any supported format; its decoder may allocate `most_bytes`.
///
/// # Errors
/// [`PictureError`].
pub fn read(path: &Path, most_bytes: u64) -> Result<Decoded, PictureError> {
    decode(&memory::read_file(path)?, Some(path), most_bytes)
}

/// Decodes an image in memory. Formats without a signature (TGA) are only recognised by the
/// extension of `name`.
///
/// # Errors
/// [`PictureError`].
pub fn decode(bytes: &[u8], name: Option<&Path>, most_bytes: u64) -> Result<Decoded, PictureError> {
    let palette = png_chunks::chunks(bytes).find(|(kind, _)| kind == b"PLTE");
    if let Some((_, palette)) = palette
        && palette.len() % 3 != 0
    {
        let length = palette.len();
        let cause = format!("the palette has {length} bytes, not three for each colour");
        return Err(PictureError::Malformed(cause));
    }
    let (image, memory) = decode_pixels(bytes, name, most_bytes)?;
    let damage = is_cut_short(bytes).then(|| describe_damage(&image, bytes, name, most_bytes));
    Ok(Decoded {
        image,
        damage,
        memory,
    })
}

/// Calls a function of the EXR decoder.
///
/// # Errors
/// [`PictureError`].
pub fn read_exr<T>(read: impl FnOnce() -> exr::error::Result<T>) -> Result<T, PictureError> {
    Ok(panics::catch(read).map_err(PictureError::Malformed)??)
}

fn decode_pixels(
    bytes: &[u8],
    name: Option<&Path>,
    most_bytes: u64,
) -> Result<(DynamicImage, Reservation), PictureError> {
    if bytes.starts_with(super::ktx2::SIGNATURE) {
        let decode = || super::ktx2::decode(bytes, most_bytes);
        return panics::catch(decode).unwrap_or_else(|panic| Err(PictureError::Malformed(panic)));
    }
    let decode = || {
        let mut reader = ImageReader::new(Cursor::new(bytes));
        if let Some(format) = name.and_then(|name| ImageFormat::from_path(name).ok()) {
            reader.set_format(format);
        }
        let mut reader = reader.with_guessed_format()?;
        let mut limits = Limits::default();
        limits.max_alloc = Some(most_bytes);
        reader.limits(limits);
        let mut decoder = reader.into_decoder()?;
        let (width, height) = decoder.dimensions();
        let pixels = u64::from(width) * u64::from(height);
        if pixels > MAX_PIXELS {
            return Err(PictureError::TooLarge { width, height });
        }
        let memory = memory::reserve(decoder.total_bytes() + 4 * pixels)?;
        // A frame of a GIF may be larger than the image.
        let mut limits = Limits::default();
        let allowed = memory.allowed();
        limits.max_alloc = Some(most_bytes.min(allowed));
        decoder.set_limits(limits)?;
        match DynamicImage::from_decoder(decoder) {
            Ok(image) => Ok((image, memory)),
            Err(ImageError::Limits(_)) if allowed < most_bytes => Err(memory.exceeded().into()),
            Err(error) => Err(error.into()),
        }
    };
    panics::catch(decode).unwrap_or_else(|panic| Err(PictureError::Malformed(panic)))
}

/// Reads the width and height of an image file, pixels, without decoding it.
///
/// # Errors
/// [`PictureError`].
pub fn read_size(path: &Path) -> Result<[u32; 2], PictureError> {
    let read = || {
        // Files often have the extension of another format.
        let reader = ImageReader::open(path)?.with_guessed_format()?;
        Ok(reader.into_dimensions()?.into())
    };
    panics::catch(read).unwrap_or_else(|panic| Err(PictureError::Malformed(panic)))
}

/// Returns true if a JPEG file lacks its end. Its decoder passes over that; those of other formats
/// return an error.
#[must_use]
pub fn is_cut_short(bytes: &[u8]) -> bool {
    let Some(mut rest) = bytes.strip_prefix(b"\xff\xd8") else {
        return false;
    };
    // Segments up to the first scan; those before it may hold whole JPEG files as thumbnails.
    while let [0xff, kind, high, low, ..] = *rest {
        match kind {
            0xff => rest = &rest[1..],
            0xda => break,
            _ => {
                let length = usize::from(u16::from_be_bytes([high, low]));
                rest = rest.get(2 + length..).unwrap_or(&[]);
            }
        }
    }
    !rest.windows(2).any(|pair| pair == END_OF_JPEG)
}

/// Returns true if a JPEG file lacks its end. Reads the last bytes of the file, and all of it only
/// if they do not show its end. A file that cannot be read is not cut short.
#[must_use]
pub fn is_file_cut_short(path: &Path) -> bool {
    const TAIL: u64 = 4096;
    let is_jpeg = |ending: &OsStr| {
        ["jpg", "jpeg"]
            .iter()
            .any(|it| ending.eq_ignore_ascii_case(it))
    };
    if !path.extension().is_some_and(is_jpeg) {
        return false;
    }
    let is_cut = || -> std::io::Result<bool> {
        let mut file = std::fs::File::open(path)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
        let mut tail = Vec::new();
        file.take(TAIL).read_to_end(&mut tail)?;
        let has_end = tail.windows(2).any(|bytes| bytes == END_OF_JPEG);
        Ok(!has_end && is_cut_short(&std::fs::read(path)?))
    };
    is_cut().unwrap_or(false)
}

/// Describes the rows that a file that is cut short lacks: those that depend on what comes after
/// its end.
fn describe_damage(
    image: &DynamicImage,
    bytes: &[u8],
    name: Option<&Path>,
    most_bytes: u64,
) -> String {
    let with_filler = [bytes, &[0x55; 4096]].concat();
    let other = decode_pixels(&with_filler, name, most_bytes);
    let row_bytes = image.as_bytes().len() / (image.height() as usize).max(1);
    let first_difference = other.ok().and_then(|(other, _)| {
        let mut pairs = image.as_bytes().iter().zip(other.as_bytes());
        pairs.position(|(a, b)| a != b)
    });
    match first_difference {
        Some(position) => {
            let (first, last) = (position / row_bytes.max(1), image.height() - 1);
            format!("cut short: rows {first} to {last} are missing")
        }
        None => "cut short".into(),
    }
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

/// Returns the pixels of a picture as RGBA of 8 bits.
pub fn rgba8_pixels(image: &DynamicImage) -> Vec<[u8; 4]> {
    // `to_rgba8` converts each value to `f32` and back.
    match image {
        DynamicImage::ImageLuma8(image) => {
            let rgba = |&::image::Luma([l]): &_| [l, l, l, u8::MAX];
            image.pixels().map(rgba).collect()
        }
        DynamicImage::ImageRgb8(image) => {
            let rgba = |&::image::Rgb([r, g, b]): &_| [r, g, b, u8::MAX];
            image.pixels().map(rgba).collect()
        }
        DynamicImage::ImageRgba8(image) => image.pixels().map(|pixel| pixel.0).collect(),
        _ => image.to_rgba8().pixels().map(|pixel| pixel.0).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_equal_those_of_the_image_crate() {
        let bytes = || (0..=255).map(|i: u8| i.wrapping_mul(7)).collect();
        let rgb = |bytes: Vec<u8>| ::image::RgbImage::from_vec(17, 5, bytes[..255].to_vec());
        let images = [
            ::image::GrayImage::from_vec(16, 16, bytes()).map(DynamicImage::from),
            ::image::GrayAlphaImage::from_vec(8, 16, bytes()).map(DynamicImage::from),
            rgb(bytes()).map(DynamicImage::from),
            ::image::RgbaImage::from_vec(8, 8, bytes()).map(DynamicImage::from),
        ];
        for image in images {
            let image = image.expect("fits");
            assert_eq!(rgba8_pixels(&image).as_flattened(), &*image.to_rgba8());
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let pixels: Vec<u8> = (0..5 * 3 * 4).map(|i| i * 4).collect();
        let file = png(&pixels, 5, 3, ExtendedColorType::Rgba8).expect("fits");
        assert_eq!(
            decode(&file, None, MAX_BYTES)
                .expect("a picture")
                .image
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
        let checksum = crc32fast::hash(&file[12..29]);
        file[29..33].copy_from_slice(&checksum.to_be_bytes());
        assert!(matches!(
            decode(&file, None, MAX_BYTES),
            Err(PictureError::TooLarge { width: 65_536, .. })
        ));
    }

    #[test]
    fn palette_of_four_bytes_is_refused() {
        let mut file = png(&[0; 4], 1, 1, ExtendedColorType::Rgba8).expect("fits");
        let palette = b"\0\0\0\x04PLTE\0\0\0\0";
        let checksum = crc32fast::hash(&palette[4..]).to_be_bytes();
        file.splice(33..33, [&palette[..], &checksum].concat());
        let error = decode(&file, None, MAX_BYTES).expect_err("is malformed");
        assert!(error.to_string().contains("4 bytes"), "{error}");
    }

    #[test]
    fn cut_jpeg_is_reported_with_its_rows() {
        let pixels: Vec<u8> = (0..64 * 64 * 3).map(|i| (i * i / 7) as u8).collect();
        let mut file = Vec::new();
        ::image::codecs::jpeg::JpegEncoder::new(&mut file)
            .write_image(&pixels, 64, 64, ExtendedColorType::Rgb8)
            .expect("fits");
        let whole = decode(&file, None, MAX_BYTES).expect("a picture");
        assert_eq!(whole.damage, None);
        let cut = decode(&file[..file.len() * 3 / 4], None, MAX_BYTES).expect("a picture");
        let damage = cut.damage.expect("is reported");
        let first: usize = damage
            .split(' ')
            .find_map(|word| word.parse().ok())
            .expect("a row");
        assert!((24..=56).contains(&first), "{damage}");
        let row = 64 * 3;
        assert_eq!(
            cut.image.as_bytes()[..first * row],
            whole.image.as_bytes()[..first * row]
        );
    }

    #[test]
    fn png_without_end_is_refused() {
        let file = png(&[0; 4], 1, 1, ExtendedColorType::Rgba8).expect("fits");
        assert!(decode(&file[..file.len() - 12], None, MAX_BYTES).is_err());
        assert_eq!(decode(&file, None, MAX_BYTES).expect("whole").damage, None);
    }
}
