//! Export of sprites as images: PNG for colour, EXR for depth.

use crate::SpriteWithDepth;
use headbox_core::files::write_whole;
use headbox_core::image::codec;
use headbox_images::{self as images, DepthPicture};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Error of writing an image file.
#[derive(Debug, thiserror::Error)]
pub enum ImageFileError {
    /// Writing failed.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: io::Error,
    },
}

/// Writes depth as an EXR file with the single 32-bit channel `Z`.
///
/// # Errors
/// [`ImageFileError::Io`].
pub fn write_depth_exr(depth: &DepthPicture, path: &Path) -> Result<(), ImageFileError> {
    images::write_depth_exr(depth, path).map_err(|source| ImageFileError::Io {
        path: path.into(),
        source,
    })
}

impl SpriteWithDepth {
    /// Returns the eye depth of each cell of the displacement grid, metres; NaN where the surface
    /// is not in front of the eye.
    pub fn depth_picture(&self) -> DepthPicture {
        let (width, height) = self.displacement().size();
        let depth = |(x, y)| self.eye_depth(x, y).map_or(f32::NAN, |depth| depth as f32);
        let values = (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(depth)
            .collect();
        DepthPicture {
            width,
            height,
            values,
        }
    }

    /// Writes colour (PNG, straight alpha) and eye depth (EXR, metres), which
    /// [`crate::DepthImport`] can read again.
    ///
    /// # Errors
    /// [`ImageFileError::Io`].
    pub fn export(&self, color_png: &Path, depth_exr: &Path) -> Result<(), ImageFileError> {
        let color = self.sprite().color();
        let png = codec::png(
            color.as_raw(),
            color.width(),
            color.height(),
            image::ExtendedColorType::Rgba8,
        );
        let write = |bytes: Vec<u8>| write_whole(color_png, |writer| writer.write_all(&bytes));
        png.map_err(io::Error::other)
            .and_then(write)
            .map_err(|source| ImageFileError::Io {
                path: color_png.into(),
                source,
            })?;
        write_depth_exr(&self.depth_picture(), depth_exr)
    }
}
