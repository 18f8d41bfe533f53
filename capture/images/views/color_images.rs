//! Colour images of image sets.

use crate::ImagesError;
use crate::depth::extension;
use headbox_core::color::srgb8_from_linear;
use headbox_core::image::codec::{self, MAX_PIXELS};
use headbox_core::image::exr_channels::ExrParts;
use headbox_core::image::orientation;
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
type ChannelLookup<'a> = Box<dyn Fn(&str) -> Result<Option<Vec<f32>>, ImagesError> + 'a>;

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
        let failed = |error| ImagesError::picture(path, error);
        let parts = ExrParts::read(path).map_err(failed)?;
        let first = channels.0.iter().find_map(|name| parts.find(name));
        let [width, height] = first.map_or(parts.first_size_px(), |it| parts.size_px(it));
        let find = move |name: &str| {
            let channel = parts.find(name)?;
            let has_size = parts.size_px(channel) == [width, height];
            has_size.then(|| parts.decode_one(path, channel))
        };
        let find = move |name: &str| find(name).transpose().map_err(failed);
        (width, height, Box::new(find))
    } else {
        let (width, height, pixels) = read_integers(path)?;
        let find = move |name: &str| {
            let channel = USUAL.iter().position(|known| *known == name);
            let share = |channel| move |pixel: &[u8; 4]| f32::from(pixel[channel]) / 255.0;
            Ok(channel.map(|channel| pixels.iter().map(share(channel)).collect()))
        };
        (width, height, Box::new(find))
    };
    let count = width as usize * height as usize;
    let samples = |name: &String| match name.as_str() {
        CONSTANT_ZERO => Ok(vec![0.0; count]),
        CONSTANT_ONE => Ok(vec![1.0; count]),
        _ => {
            let missing = || format!("has no channel {name}");
            find(name)?.ok_or_else(|| ImagesError::invalid_picture(path, missing()))
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
pub(crate) fn read_size(path: &Path) -> Result<[u32; 2], ImagesError> {
    // Opening a FIFO would wait for its writer.
    if path.exists() && !path.is_file() {
        let cause = "is not a regular file";
        return Err(ImagesError::invalid_picture(path, cause));
    }
    if extension(path) == "exr" {
        let parts = ExrParts::read(path).map_err(|error| ImagesError::picture(path, error))?;
        return Ok(parts.first_size_px());
    }
    codec::read_size(path).map_err(|error| ImagesError::picture(path, error))
}

/// Reads the size of the image that a camera with this principal point took, pixels: that of the
/// upright image if the file is stored on its side, by its EXIF orientation, and the principal
/// point lies nearer to the centre of the upright one.
///
/// # Errors
/// See [`read_size`].
pub(crate) fn read_camera_size(
    path: &Path,
    principal_px: [f64; 2],
) -> Result<[u32; 2], ImagesError> {
    let stored = read_size(path)?;
    let upright = [stored[1], stored[0]];
    let distance = |size: [u32; 2]| {
        let axis = |k: usize| principal_px[k] - f64::from(size[k]) / 2.0;
        axis(0).hypot(axis(1))
    };
    let is_upright =
        distance(upright) < distance(stored) && orientation::swaps_sides(orientation::read(path));
    Ok(if is_upright { upright } else { stored })
}

fn read_integers(path: &Path) -> Result<ColorPicture, ImagesError> {
    let decoded =
        codec::read(path, 8 * MAX_PIXELS).map_err(|error| ImagesError::picture(path, error))?;
    // A file that is cut short is noted when the set is opened.
    let (width, height) = (decoded.image.width(), decoded.image.height());
    Ok((width, height, codec::rgba8_pixels(&decoded.image)))
}

/// Reads the colours of an EXR, also those of a layer ([`ExrParts::color`]).
fn read_exr(path: &Path) -> Result<ColorPicture, ImagesError> {
    let failed = |error| ImagesError::picture(path, error);
    let bad = |cause: String| ImagesError::invalid_picture(path, cause);
    let parts = ExrParts::read(path).map_err(failed)?;
    let found = parts.color().ok_or_else(|| {
        bad(format!(
            "has no channels R, G and B, nor Y alone; its channels are {}",
            parts.describe()
        ))
    })?;
    let channels: Vec<_> = found.into_iter().flatten().collect();
    let _memory = parts.reserve(channels[0], 16).map_err(failed)?;
    let [width, height] = parts.size_px(channels[0]);
    let stride = width as usize;
    let mut light = vec![[0.0, 0.0, 0.0, 1.0]; stride * height as usize];
    let decoded = parts.decode(path, &channels, &mut |channel, [x, y], row| {
        let start = y * stride + x;
        for (pixel, value) in light[start..start + row.len()].iter_mut().zip(row) {
            pixel[channel] = *value;
        }
    });
    decoded.map_err(failed)?;
    let colors = light.iter_mut().filter_map(|it| it.first_chunk_mut());
    parts.convert_to_rec709(channels[0], colors);
    Ok((width, height, light.into_iter().map(from_linear).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exr_of_other_primaries_is_converted() {
        use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage};
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.exr");
        // Rec. 709 red in ACES 2065-1, half covered.
        let red = (0.2199_f32, 0.0449_f32, 0.0088_f32, 0.5_f32);
        let infinite = (f32::INFINITY, f32::INFINITY, f32::INFINITY, 1.0);
        let color = |at: Vec2<usize>| if at.x() == 0 { red } else { infinite };
        let mut image = Image::from_channels((2, 1), SpecificChannels::rgba(color));
        image.attributes.chromaticities = Some(exr::meta::attribute::Chromaticities {
            red: Vec2(0.7347, 0.2653),
            green: Vec2(0.0, 1.0),
            blue: Vec2(0.0001, -0.077),
            white: Vec2(0.32168, 0.33767),
        });
        image.write().to_file(&path).expect("written");
        let (_, _, pixels) = read_color(&path).expect("a picture");
        let [r, g, b, a] = pixels[0];
        assert!(r >= 254 && g < 16 && b < 16 && a == 128, "{:?}", pixels[0]);
        assert_eq!(pixels[1], [255; 4]);
    }
}
