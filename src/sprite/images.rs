//! Depth pictures in files, and sprites back to pictures: PNG for colour, EXR for depth.

use super::SpriteWithDepth;
use crate::capture::picture::{self, PictureError};
use crate::files::write_atomically;
use exr::meta::MetaData;
use exr::prelude::{Image, ReadChannels, ReadLayers, SpecificChannels, WritableImage, read};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Why a picture could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageFileError {
    /// Reading or writing failed.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was wrong.
        source: io::Error,
    },
    /// Not a picture of the kind that was expected.
    #[error("{}: {message}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What was wrong.
        message: String,
    },
}

/// Pixels of the largest depth picture that is read, 8,192 x 8,192. A header that promises more is not believed: memory is
/// taken before the first pixel is read.
const MAX_PIXELS: usize = 1 << 26;

/// A depth per pixel, whatever it means.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthPicture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row-major.
    pub values: Vec<f32>,
}

impl DepthPicture {
    /// Reads depth from EXR (channel `Z`, or else `Y`, `R`, or the only one) or from a grey picture of 8 or 16 bits such
    /// as PNG. Each stored value is multiplied by `unit`: metres per value (0.001 for millimetres in 16-bit PNG), or
    /// 1/65535 for window depth in 16 bits. In integer pictures 0 means unknown and becomes NaN.
    ///
    /// # Errors
    /// See [`ImageFileError`].
    pub fn read(path: &Path, unit: f32) -> Result<Self, ImageFileError> {
        let is_exr = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"));
        if is_exr { read_exr(path, unit) } else { read_grey(path, unit) }
    }

    /// Writes an EXR file with the single 32-bit channel `Z`.
    ///
    /// # Errors
    /// [`ImageFileError::Io`].
    pub fn write_exr(&self, path: &Path) -> Result<(), ImageFileError> {
        let width = self.width as usize;
        let value = |x: usize, y: usize| self.values.get(y * width + x).copied().unwrap_or(f32::NAN);
        let channels = SpecificChannels::build()
            .with_channel("Z")
            .with_pixel_fn(|at: exr::math::Vec2<usize>| (value(at.x(), at.y()),));
        let image = Image::from_channels((width, self.height as usize), channels);
        let write =
            |writer: &mut io::BufWriter<&std::fs::File>| image.write().to_buffered(writer).map_err(io::Error::other);
        write_atomically(path, write).map_err(|source| ImageFileError::Io { path: path.into(), source })
    }
}

impl SpriteWithDepth {
    /// Eye depth per pixel of the displacement grid, metres; NaN where it is not in front of the eye.
    pub fn depth_picture(&self) -> DepthPicture {
        let (width, height) = self.displacement().size();
        let depth = |(x, y)| self.eye_depth(x, y).map_or(f32::NAN, |depth| depth as f32);
        let values = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(depth).collect();
        DepthPicture { width, height, values }
    }

    /// Writes colour (PNG, straight alpha) and eye depth (EXR, metres): what [`super::DepthImport`] takes back.
    ///
    /// # Errors
    /// [`ImageFileError::Io`].
    pub fn export(&self, color_png: &Path, depth_exr: &Path) -> Result<(), ImageFileError> {
        let color = self.sprite().color();
        let png = picture::png(color.as_raw(), color.width(), color.height(), image::ExtendedColorType::Rgba8);
        let write = |bytes: Vec<u8>| write_atomically(color_png, |writer| writer.write_all(&bytes));
        png.map_err(io::Error::other)
            .and_then(write)
            .map_err(|source| ImageFileError::Io { path: color_png.into(), source })?;
        self.depth_picture().write_exr(depth_exr)
    }
}

fn read_exr(path: &Path, unit: f32) -> Result<DepthPicture, ImageFileError> {
    let bad = |message: String| ImageFileError::Format { path: path.into(), message };
    let meta = MetaData::read_from_file(path, false).map_err(|error| bad(error.to_string()))?;
    if meta.headers.iter().any(|header| header.layer_size.area() > MAX_PIXELS) {
        return Err(bad(format!("has more than {MAX_PIXELS} pixels")));
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|error| bad(error.to_string()))?;
    let channels = &image.layer_data.channel_data.list;
    let named = |name: &str| channels.iter().find(|channel| channel.name == *name);
    let only = if channels.len() == 1 { channels.first() } else { None };
    let channel = named("Z").or_else(|| named("Y")).or_else(|| named("R")).or(only);
    let channel = channel.ok_or_else(|| bad("has no channel Z, Y or R to take depth from".into()))?;
    let size = image.layer_data.size;
    let values = channel.sample_data.values_as_f32().map(|value| value * unit).collect();
    Ok(DepthPicture { width: size.x() as u32, height: size.y() as u32, values })
}

fn read_grey(path: &Path, unit: f32) -> Result<DepthPicture, ImageFileError> {
    let bad = |message: String| ImageFileError::Format { path: path.into(), message };
    let image = picture::read(path, 2 * MAX_PIXELS as u64).map_err(|error| match error {
        PictureError::Io(source) => ImageFileError::Io { path: path.into(), source },
        error => bad(error.to_string()),
    })?;
    let values: Vec<u16> = match &image {
        image::DynamicImage::ImageLuma8(grey) => grey.as_raw().iter().map(|&v| u16::from(v)).collect(),
        image::DynamicImage::ImageLuma16(grey) => grey.as_raw().clone(),
        _ => return Err(bad("depth must be a grey picture of 8 or 16 bits, or EXR".into())),
    };
    let value = |v: u16| if v == 0 { f32::NAN } else { f32::from(v) * unit };
    let values = values.into_iter().map(value).collect();
    Ok(DepthPicture { width: image.width(), height: image.height(), values })
}
