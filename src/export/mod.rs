//! To where headbox is not installed: a page, an engine, a splat viewer, a film package.

mod atlas;
pub mod deep;
pub mod film;
pub mod glb;
pub mod las;
mod mesh;
pub mod of_sprites;
pub mod page;
pub mod panorama;
mod pieces;
pub mod ply;
mod sheets;
mod spherical;
pub mod splats;
mod stacks;
pub mod stereo;
mod surfels;

use crate::capture::picture::PictureError;
use crate::capture::{Camera, CameraError};
use crate::frame::Frame;
use crate::packed::{PackError, PackedCube};
use crate::render::Renderer;
use image::codecs::jpeg::JpegEncoder;
use std::io;

/// Why something could not be exported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// There is nothing to show.
    #[error("there is nothing in it to export: no depth pixel, no picture on a plane and no environment")]
    Empty,
    /// It would be larger than what its readers can open.
    #[error(
        "the export would have at least {} MB, and such files may have {} MB; capture with a smaller --face-size, or with --error-px",
        bytes >> 20, limit >> 20
    )]
    TooLarge {
        /// Bytes that it would have.
        bytes: u64,
        /// Bytes that it may have.
        limit: u64,
    },
    /// Sprites are of no one view.
    #[error(
        "its sprites were taken from several places, and only sprites of one eye can be exported; export them one by one"
    )]
    Eyes,
    /// It could not be written.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// There is no camera for a picture of it.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A picture could not be encoded.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// It could not be packed again.
    #[error(transparent)]
    Pack(#[from] PackError),
}

/// Pixels of a poster.
pub(crate) const POSTER_PX: [u32; 2] = [800, 500];

/// A JPEG file of what the centre of the headbox sees where there is most to see.
pub(crate) fn poster(cube: &PackedCube) -> Result<Vec<u8>, ExportError> {
    let ahead = cube.info.ahead.unwrap_or(glam::DVec3::NEG_Z);
    let up = cube.info.up.unwrap_or(glam::DVec3::Y);
    let camera = Camera::look_at(cube.center(), cube.center() + ahead, up, 60.0, POSTER_PX)?;
    jpeg(Renderer::new().render(cube, &camera, &Default::default()))
}

/// A JPEG file of a frame, for a poster.
pub(crate) fn jpeg(frame: &Frame) -> Result<Vec<u8>, ExportError> {
    const QUALITY: u8 = 75;
    let picture = frame.to_rgb().map_err(io::Error::other)?;
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, QUALITY).encode_image(&picture).map_err(PictureError::from)?;
    Ok(file)
}
