//! Exports for use without headbox: HTML pages, engines, splat viewers, compositing and film.

pub mod deep;
pub mod film;
pub mod from_sprites;
pub mod mesh;
pub mod page;
mod pieces;
pub mod points;
mod stacks;

use headbox_core::camera::{Camera, CameraError};
use headbox_core::frame::Frame;
use headbox_core::image::codec::PictureError;
use headbox_cube::pack::{CubeLdi, PackError};
use headbox_cube::render::Renderer;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::io;

/// Error of an export.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The capture is empty.
    #[error(
        "there is nothing in it to export: no depth pixel, no picture on a plane and no environment"
    )]
    Empty,
    /// The file would be larger than readers can open.
    #[error(
        "the export would have at least {} MB, and such files may have {} MB; capture with a smaller --face-size, or with --error-px",
        bytes >> 20, limit >> 20
    )]
    TooLarge {
        /// Size of the file, bytes.
        bytes: u64,
        /// Limit, bytes.
        limit: u64,
    },
    /// The export would take more memory than most machines have.
    #[error(
        "it has {} MB, and only captures of up to {} MB are exported so, which takes up to nine times their memory; capture with a \
         smaller --face-size, or with --error-px",
        bytes >> 20, limit >> 20
    )]
    CaptureTooLarge {
        /// Size of the capture, bytes.
        bytes: u64,
        /// Limit, bytes.
        limit: u64,
    },
    /// No file can be as small as the budget.
    #[error(
        "the budget is too small: the smallest file has {:.3} MB; give a larger --mb",
        *least_bytes as f64 / 1e6
    )]
    Budget {
        /// Size of the smallest file, bytes.
        least_bytes: u64,
    },
    /// The sprites were taken from several positions.
    #[error(
        "its sprites were taken from several places, and only sprites of one eye can be exported; export them one by one"
    )]
    Eyes,
    /// The file cannot be written.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// No camera can be placed for an image.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// An image cannot be encoded.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The cube cannot be packed again.
    #[error(transparent)]
    Pack(#[from] PackError),
}

/// Largest capture, bytes, for exports that hold the whole output in memory. Exports that write
/// sample by sample have no limit.
const MAX_IN_MEMORY_BYTES: u64 = 1 << 30;

/// Rejects a capture that is too large for exports in memory.
fn check_memory(cube: &CubeLdi) -> Result<(), ExportError> {
    let bytes = cube.bytes() as u64;
    if bytes > MAX_IN_MEMORY_BYTES {
        return Err(ExportError::CaptureTooLarge {
            bytes,
            limit: MAX_IN_MEMORY_BYTES,
        });
    }
    Ok(())
}

/// Size of a poster image, pixels.
pub(crate) const POSTER_PX: [u32; 2] = [800, 500];

/// Renders the capture's default view from the centre of the headbox as a JPEG file.
pub fn poster(cube: &CubeLdi) -> Result<Vec<u8>, ExportError> {
    let ahead = cube.info.ahead.unwrap_or(glam::DVec3::NEG_Z);
    let up = cube.info.up.unwrap_or(glam::DVec3::Y);
    let camera = Camera::look_at(cube.center(), cube.center() + ahead, up, 60.0, POSTER_PX)?;
    jpeg(Renderer::new().render(cube, &camera, &Default::default()))
}

/// Encodes a frame as a JPEG file, for a poster.
pub(crate) fn jpeg(frame: &Frame) -> Result<Vec<u8>, ExportError> {
    const QUALITY: u8 = 75;
    let picture = frame.to_rgb().map_err(io::Error::other)?;
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, QUALITY)
        .encode_image(&picture)
        .map_err(PictureError::from)?;
    Ok(file)
}

/// Encodes texels as a PNG file with adaptive filters.
fn png(
    texels: &[[u8; 4]],
    [width, height]: [u32; 2],
    effort: CompressionType,
) -> Result<Vec<u8>, ExportError> {
    let mut file = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut file, effort, FilterType::Adaptive);
    let written = encoder.write_image(
        texels.as_flattened(),
        width,
        height,
        ExtendedColorType::Rgba8,
    );
    written.map_err(PictureError::from)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::glb::{self, GlbBudget};
    use headbox_core::progress::Silent;
    use headbox_cube::pack::{PlaneSet, SplatIndexLayout};

    /// Memory that nobody touches is not there.
    fn of_texels(count: usize) -> CubeLdi {
        CubeLdi {
            info: Default::default(),
            face_size_px: 8,
            layout: SplatIndexLayout::Normal,
            segments: Vec::new(),
            environment: headbox_core::environment::Environment::default(),
            planes: PlaneSet {
                texels: vec![[0; 4]; count],
                ..PlaneSet::default()
            },
        }
    }

    #[test]
    fn oversized_captures_are_refused() {
        let cube = of_texels((1 << 28) + 1);
        let mut out = Vec::new();
        let errors = [
            glb::write(&cube, GlbBudget::default(), &Silent, &mut out).map(drop),
            deep::write(&cube, deep::Faces::All, &Silent, &mut out).map(drop),
            deep::write_layers(&cube, deep::Faces::All, 2, &Silent, &mut out).map(drop),
        ];
        for error in errors {
            assert!(
                error
                    .unwrap_err()
                    .to_string()
                    .contains("it has 1024 MB, and only captures of up to 1024 MB")
            );
        }
        let mut cube = of_texels((1 << 30) + 1);
        // Something is there.
        cube.planes.tiles.push(bytemuck::Zeroable::zeroed());
        let error = page::Page::new(&cube, "large", &Silent)
            .map(drop)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("at least 1024 MB, and such files may have 1024 MB") && out.is_empty(),
            "{error}"
        );
    }
}
