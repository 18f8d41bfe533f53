//! Readers of depth files, by their endings: EXR, TIFF, NPY, COLMAP's maps, and images of integers.

mod colmap_map;
mod npy;
mod wide_tiff;

use crate::ImagesError;
use crate::depth::{DepthPicture, extension};
use headbox_core::image::codec::{self, MAX_PIXELS};
use headbox_core::image::exr_channels::ExrParts;
use image::DynamicImage;
use std::path::Path;

/// Interpretation of a depth file.
pub(crate) struct DepthFormat<'a> {
    /// Factor of integers, or `None` if the largest integer of the file's type is 1.
    pub(crate) unit: Option<f32>,
    /// Factor of floating-point numbers.
    pub(crate) float_unit: f32,
    /// True if integers of 8 bits are accepted.
    pub(crate) eight_bits: bool,
    /// True if the smallest and the largest integer are depths.
    pub(crate) are_shares: bool,
    /// Channel of an EXR or a colour image.
    pub(crate) channel: Option<&'a str>,
}

/// Stored values of a depth file, row-major.
struct StoredDepth {
    width: u32,
    height: u32,
    values: StoredValues,
}

enum StoredValues {
    Integers { values: Vec<u32>, bits: u8 },
    Floats(Vec<f32>),
}

/// Reads a depth file.
pub(crate) fn read(path: &Path, format: &DepthFormat) -> Result<DepthPicture, ImagesError> {
    let stored = match extension(path).as_str() {
        "exr" => read_exr(path, format.channel)?,
        "npy" => npy::read(path)?,
        "bin" => return colmap_map::read(path),
        "tif" | "tiff" => match wide_tiff::read(path)? {
            Some(stored) => stored,
            None => read_picture(path, format)?,
        },
        _ => read_picture(path, format)?,
    };
    let values = match stored.values {
        StoredValues::Floats(values) => values
            .into_iter()
            .map(|value| value * format.float_unit)
            .collect(),
        StoredValues::Integers { bits: 8, .. } if !format.eight_bits => {
            return Err(ImagesError::invalid_picture(
                path,
                "has depth in 8 bits, too few for parallax; use 16 bits or EXR",
            ));
        }
        StoredValues::Integers { values, bits } => {
            let largest = u32::MAX >> (32 - u32::from(bits));
            let is_unknown =
                |v: u32| !format.are_shares && (v == 0 || (!format.eight_bits && v == largest));
            let unit = format.unit.unwrap_or(1.0 / largest as f32);
            let value = |v: u32| {
                if is_unknown(v) {
                    f32::NAN
                } else {
                    v as f32 * unit
                }
            };
            values.into_iter().map(value).collect()
        }
    };
    Ok(DepthPicture {
        width: stored.width,
        height: stored.height,
        values,
    })
}

/// Reads the width and height of a depth file from its header; `None` for kinds that have none.
pub(crate) fn read_size(path: &Path) -> Result<Option<[u32; 2]>, ImagesError> {
    match extension(path).as_str() {
        "npy" => npy::read_size(path).map(Some),
        "bin" => Ok(None),
        "tif" | "tiff" => wide_tiff::read_size(path).map(Some),
        _ => crate::views::color_images::read_size(path).map(Some),
    }
}

fn read_exr(path: &Path, channel: Option<&str>) -> Result<StoredDepth, ImagesError> {
    let bad = |cause: String| ImagesError::invalid_picture(path, cause);
    let failed = |error| ImagesError::picture(path, error);
    let parts = ExrParts::read(path).map_err(failed)?;
    let found = channel.map_or_else(|| parts.depth(), |name| parts.find(name));
    let found = found.ok_or_else(|| {
        let missing = channel.map_or_else(
            || "has no channel with depth, such as Z, Y or R".into(),
            |name| format!("has no channel {name}"),
        );
        bad(format!("{missing}; its channels are {}", parts.describe()))
    })?;
    let values = parts.decode_one(path, found).map_err(failed)?;
    // Depth in red, green and blue alike is common; a picture is not depth.
    if let (None, Some(others)) = (channel, parts.green_and_blue(found)) {
        for other in others {
            let same = parts.decode_one(path, other).map_err(failed)?;
            let differs = |(a, b): (&f32, &f32)| a != b && !(a.is_nan() && b.is_nan());
            if values.iter().zip(&same).any(differs) {
                return Err(bad(format!(
                    "has colours and no channel with depth; its channels are {}",
                    parts.describe()
                )));
            }
        }
    }
    let [width, height] = parts.size_px(found);
    Ok(StoredDepth {
        width,
        height,
        values: StoredValues::Floats(values),
    })
}

/// Reads an image of integers: grey, or colour whose channels are equal.
fn read_picture(path: &Path, format: &DepthFormat) -> Result<StoredDepth, ImagesError> {
    let bad = |cause: String| ImagesError::invalid_picture(path, cause);
    let decoded = codec::read(path, 8 * MAX_PIXELS);
    let image = decoded
        .map_err(|error| match extension(path).as_str() {
            "png" | "jpg" | "jpeg" | "tif" | "tiff" | "bmp" | "tga" | "webp" | "gif" => {
                ImagesError::picture(path, error)
            }
            _ => bad(format!("cannot be read as depth ({error}); {EXPECTED}")),
        })?
        .image;
    let [width, height] = [image.width(), image.height()];
    let selected = format.channel.filter(|_| image.color().has_color());
    let (values, bits) = match (&image, selected) {
        (DynamicImage::ImageLuma8(grey), _) => (widened(grey.as_raw()), 8),
        (DynamicImage::ImageLuma16(grey), _) => (widened(grey.as_raw()), 16),
        (DynamicImage::ImageLumaA8(grey), _) => (equal_channels::<_, 2>(grey.as_raw(), 1), 8),
        (DynamicImage::ImageLumaA16(grey), _) => (equal_channels::<_, 2>(grey.as_raw(), 1), 16),
        (DynamicImage::ImageRgb16(_) | DynamicImage::ImageRgba16(_), Some(name)) => {
            let channel = ["R", "G", "B", "A"].iter().position(|known| *known == name);
            let channel =
                channel.ok_or_else(|| bad(format!("has no channel {name}, only R, G, B and A")))?;
            let pixels = image.to_rgba16();
            let values = pixels.pixels().map(|pixel| u32::from(pixel.0[channel]));
            (Some(values.collect()), 16)
        }
        (DynamicImage::ImageRgb8(color), _) => (equal_channels::<_, 3>(color.as_raw(), 3), 8),
        (DynamicImage::ImageRgba8(color), _) => (equal_channels::<_, 4>(color.as_raw(), 3), 8),
        (DynamicImage::ImageRgb16(color), _) => (equal_channels::<_, 3>(color.as_raw(), 3), 16),
        (DynamicImage::ImageRgba16(color), _) => (equal_channels::<_, 4>(color.as_raw(), 3), 16),
        _ => (None, 0),
    };
    let values = values.ok_or_else(|| {
        bad(format!(
            "is not a depth image: its pixels have different colours; {EXPECTED}"
        ))
    })?;
    Ok(StoredDepth {
        width,
        height,
        values: StoredValues::Integers { values, bits },
    })
}

/// Kinds of depth files, for messages.
const EXPECTED: &str = "expected 8 or 16 bits of grey, EXR, TIFF or NPY";

fn widened<T: Copy + Into<u32>>(values: &[T]) -> Option<Vec<u32>> {
    Some(values.iter().map(|&value| value.into()).collect())
}

/// Returns the first of `N` channels if the first `equal` ones are equal in every pixel. Pixels
/// whose last channel, alpha, is 0 have value 0: unknown.
fn equal_channels<T: Copy + Into<u32> + PartialEq, const N: usize>(
    samples: &[T],
    equal: usize,
) -> Option<Vec<u32>> {
    let pixels = samples.as_chunks::<N>().0;
    let is_grey = |pixel: &[T; N]| pixel[..equal].iter().all(|level| *level == pixel[0]);
    let has_alpha = equal < N;
    let value = |pixel: &[T; N]| {
        if has_alpha && pixel[N - 1].into() == 0 {
            0
        } else {
            pixel[0].into()
        }
    };
    pixels
        .iter()
        .all(is_grey)
        .then(|| pixels.iter().map(value).collect())
}

#[cfg(test)]
mod tests;
