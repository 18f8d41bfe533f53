//! Colour images of image sets.

use super::ImagesError;
use super::depth::extension;
use super::exr_layer::ExrLayer;
use exr::meta::MetaData;
use headbox_core::color::srgb8_from_linear;
use headbox_core::image::codec::{self, MAX_PIXELS};
use std::path::Path;

/// Width, height, and pixels: row-major sRGB with straight alpha.
pub type ColorPicture = (u32, u32, Vec<[u8; 4]>);

/// Reads an image: 8-bit sRGB unchanged, EXR converted from linear premultiplied colour.
///
/// # Errors
/// [`ImagesError`] that names the file.
pub fn read_color(path: &Path) -> Result<ColorPicture, ImagesError> {
    if extension(path) == "exr" {
        read_exr(path)
    } else {
        read_integers(path)
    }
}

/// Names of the red, green, blue and alpha channels; [`CONSTANT_ZERO`] and [`CONSTANT_ONE`] stand
/// for constants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ColorChannels(pub [String; 4]);

impl Default for ColorChannels {
    fn default() -> Self {
        Self(USUAL.map(str::to_owned))
    }
}

/// Channel names of images that are not EXR.
const USUAL: [&str; 4] = ["R", "G", "B", "A"];

/// Seurat's name of a constant channel of 0.
const CONSTANT_ZERO: &str = "CONSTANT_ZERO";

/// Seurat's name of a constant channel of 1.
const CONSTANT_ONE: &str = "CONSTANT_ONE";

/// Lookup of a channel's samples by name: 0..=1, or linear light.
type ChannelLookup = Box<dyn Fn(&str) -> Option<Vec<f32>>>;

/// Reads an image like [`read_color`], with its channels selected by name.
///
/// # Errors
/// [`ImagesError`] that names the file, also if it lacks a channel.
pub(super) fn read_channels(
    path: &Path,
    channels: &ColorChannels,
) -> Result<ColorPicture, ImagesError> {
    let is_exr = extension(path) == "exr";
    let (width, height, find): (u32, u32, ChannelLookup) = if is_exr {
        let layer = ExrLayer::read(path)?;
        let width = layer.width;
        let height = layer.height;
        let find = move |name: &str| {
            layer
                .channel(name)
                .map(|samples| samples.values_as_f32().collect())
        };
        (width, height, Box::new(find))
    } else {
        let (width, height, pixels) = read_integers(path)?;
        let find = move |name: &str| {
            let channel = USUAL.iter().position(|known| *known == name)?;
            Some(
                pixels
                    .iter()
                    .map(|pixel| f32::from(pixel[channel]) / 255.0)
                    .collect(),
            )
        };
        (width, height, Box::new(find))
    };
    let count = width as usize * height as usize;
    let samples = |name: &String| match name.as_str() {
        CONSTANT_ZERO => Ok(vec![0.0; count]),
        CONSTANT_ONE => Ok(vec![1.0; count]),
        _ => {
            let missing = || format!("has no channel {name}");
            find(name).ok_or_else(|| ImagesError::invalid_picture(path, missing()))
        }
    };
    let [r, g, b, a] = &channels.0;
    let [r, g, b, a] = [samples(r)?, samples(g)?, samples(b)?, samples(a)?];
    let pixel = if is_exr { from_linear } else { from_shares };
    let pixels = (0..count).map(|i| pixel([r[i], g[i], b[i], a[i]]));
    Ok((width, height, pixels.collect()))
}

/// Converts premultiplied linear light to 8-bit sRGB with straight alpha.
fn from_linear([r, g, b, a]: [f32; 4]) -> [u8; 4] {
    let straight = |c: f32| srgb8_from_linear(if a > 0.0 { c / a } else { c });
    [
        straight(r),
        straight(g),
        straight(b),
        (a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8,
    ]
}

/// Converts fractions of 1 to 8 bits.
fn from_shares(shares: [f32; 4]) -> [u8; 4] {
    shares.map(|share| (share * 255.0).round() as u8)
}

/// Reads the width and height of an image without decoding it.
///
/// # Errors
/// [`ImagesError`] that names the file.
pub(super) fn read_size(path: &Path) -> Result<[u32; 2], ImagesError> {
    if extension(path) == "exr" {
        let meta = codec::read_exr(|| MetaData::read_from_file(path, false))
            .map_err(|error| ImagesError::picture(path, error))?;
        let size = meta.headers.first().map(|header| header.layer_size);
        return size
            .map(|size| [size.x() as u32, size.y() as u32])
            .ok_or_else(|| ImagesError::invalid_picture(path, "has no layer"));
    }
    let reader = image::ImageReader::open(path).map_err(|cause| ImagesError::io(path, cause))?;
    let (width, height) = reader
        .into_dimensions()
        .map_err(|error| ImagesError::picture(path, error.into()))?;
    Ok([width, height])
}

fn read_integers(path: &Path) -> Result<ColorPicture, ImagesError> {
    let decoded =
        codec::read(path, 8 * MAX_PIXELS).map_err(|error| ImagesError::picture(path, error))?;
    // A file that is cut short is noted when the set is opened.
    let picture = decoded.image.into_rgba8();
    let (width, height) = picture.dimensions();
    let pixels = picture.pixels().map(|pixel| pixel.0).collect();
    Ok((width, height, pixels))
}

fn read_exr(path: &Path) -> Result<ColorPicture, ImagesError> {
    let [width, height] = read_size(path)?;
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        let cause = format!("has more than {MAX_PIXELS} pixels");
        return Err(ImagesError::invalid_picture(path, cause));
    }
    let image = codec::read_exr(|| {
        exr::prelude::read_first_rgba_layer_from_file(
            path,
            |size, _| (size.x(), vec![[0u8; 4]; size.x() * size.y()]),
            |(stride, pixels), pixel, (r, g, b, a): (f32, f32, f32, f32)| {
                pixels[pixel.y() * *stride + pixel.x()] = from_linear([r, g, b, a]);
            },
        )
    });
    let image = image.map_err(|error| ImagesError::picture(path, error))?;
    Ok((width, height, image.layer_data.channel_data.pixels.1))
}
