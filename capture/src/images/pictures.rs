//! Colour pictures of image sets.

use super::ImagesError;
use super::depth::{MAX_PIXELS, extension};
use crate::material::srgb8_from_linear;
use crate::picture;
use crate::words::of_exr;
use exr::meta::MetaData;
use std::path::Path;

/// Width, height, and row-major sRGB with straight alpha.
pub type ColorPicture = (u32, u32, Vec<[u8; 4]>);

/// Reads a picture: 8-bit sRGB as it is, EXR from linear, premultiplied.
///
/// # Errors
/// [`ImagesError`] that names the file.
pub fn read_color(path: &Path) -> Result<ColorPicture, ImagesError> {
    if extension(path) == "exr" { read_exr(path) } else { read_other(path) }
}

/// Width and height of a picture without decoding it.
///
/// # Errors
/// [`ImagesError`] that names the file.
pub(super) fn read_size(path: &Path) -> Result<[u32; 2], ImagesError> {
    let bad = |cause: String| ImagesError::Picture { path: path.into(), cause };
    if extension(path) == "exr" {
        let meta = MetaData::read_from_file(path, false).map_err(|error| bad(error.to_string()))?;
        let size = meta.headers.first().map(|header| header.layer_size);
        return size.map(|size| [size.x() as u32, size.y() as u32]).ok_or_else(|| bad("has no layer".into()));
    }
    let reader = image::ImageReader::open(path).map_err(|cause| ImagesError::io(path, cause))?;
    let (width, height) = reader.into_dimensions().map_err(|error| bad(error.to_string()))?;
    Ok([width, height])
}

fn read_other(path: &Path) -> Result<ColorPicture, ImagesError> {
    let decoded = picture::read(path, 8 * MAX_PIXELS as u64).map_err(|error| ImagesError::picture(path, error))?;
    let picture = decoded.into_rgba8();
    let (width, height) = picture.dimensions();
    Ok((width, height, picture.pixels().map(|pixel| pixel.0).collect()))
}

fn read_exr(path: &Path) -> Result<ColorPicture, ImagesError> {
    let bad = |cause: String| ImagesError::Picture { path: path.into(), cause };
    let [width, height] = read_size(path)?;
    if width as usize * height as usize > MAX_PIXELS {
        return Err(bad(format!("has more than {MAX_PIXELS} pixels")));
    }
    let image = exr::prelude::read_first_rgba_layer_from_file(
        path,
        |size, _| (size.x(), vec![[0u8; 4]; size.x() * size.y()]),
        |(stride, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| {
            let straight = |c: f32| srgb8_from_linear(if a > 0.0 { c / a } else { c });
            let alpha = (a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
            pixels[at.y() * *stride + at.x()] = [straight(r), straight(g), straight(b), alpha];
        },
    );
    let image = image.map_err(|error| bad(of_exr(&error)))?;
    Ok((width, height, image.layer_data.channel_data.pixels.1))
}
