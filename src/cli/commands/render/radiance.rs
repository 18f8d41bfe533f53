//! Linear radiance as OpenEXR pictures.

use crate::output::{cannot_write, has_extension};
use exr::prelude::{Encoding, Image, LineOrder, SpecificChannels, WritableImage};
use headbox_core::files::write_whole;
use std::path::Path;

/// Returns true if a file name requests radiance instead of levels.
pub(crate) fn is_radiance(path: &Path) -> bool {
    has_extension(path, "exr")
}

/// Writes linear radiance, row by row from the top, as an OpenEXR picture.
pub(crate) fn save_radiance(
    path: &Path,
    size: (u32, u32),
    radiance: &[[f32; 3]],
) -> anyhow::Result<()> {
    let (width, height) = (size.0 as usize, size.1 as usize);
    let pixel = |at: exr::math::Vec2<usize>| {
        let [r, g, b] = radiance
            .get(at.y() * width + at.x())
            .copied()
            .unwrap_or_default();
        (r, g, b)
    };
    // Blocks in a fixed order, so that the bytes do not depend on threads.
    let encoding = Encoding {
        line_order: LineOrder::Increasing,
        ..Encoding::FAST_LOSSLESS
    };
    let channels = SpecificChannels::rgb(pixel);
    let picture = Image::from_encoded_channels((width, height), encoding, channels);
    write_whole(path, |writer| {
        picture
            .write()
            .to_buffered(writer)
            .map_err(std::io::Error::other)
    })
    .map_err(|error| cannot_write(path, error))
}
