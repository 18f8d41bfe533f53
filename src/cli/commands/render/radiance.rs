//! The light that a capture's levels stand for: shown at another exposure, or written as it is.

use crate::output::cannot_write;
use exr::prelude::{Image, SpecificChannels, WritableImage};
use headbox_core::files::write_whole;
use headbox_core::tone::ToneMap;
use headbox_cube::model::info::CaptureInfo;
use image::RgbImage;
use std::path::Path;

/// Relation of a capture's 8-bit levels to linear radiance.
#[derive(Clone, Copy)]
pub(super) struct StoredLevels {
    tone: ToneMap,
    exposure: f32,
}

impl StoredLevels {
    pub(super) fn of(info: &CaptureInfo) -> Self {
        Self {
            tone: info.tone,
            exposure: info.exposure,
        }
    }

    /// Table of levels `stops` brighter than captured, clipped at white.
    pub(super) fn brighter(self, stops: f32) -> [u8; 256] {
        let level = |level: u8| ToneMap::SrgbClipped.level(self.tone.exposed(level) * stops.exp2());
        std::array::from_fn(|i| level(i as u8))
    }

    /// Writes a frame as linear radiance, in the unit of the scene's light.
    pub(super) fn save(self, path: &Path, frame: &RgbImage) -> anyhow::Result<()> {
        let radiance: Vec<[f32; 3]> = frame
            .pixels()
            .map(|pixel| {
                pixel
                    .0
                    .map(|level| self.tone.exposed(level) / self.exposure)
            })
            .collect();
        save_radiance(path, frame.dimensions(), &radiance)
    }
}

/// Returns true if a file name requests radiance instead of levels.
pub(crate) fn is_radiance(path: &Path) -> bool {
    path.extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case("exr"))
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
    let picture = Image::from_channels((width, height), SpecificChannels::rgb(pixel));
    write_whole(path, |writer| {
        picture
            .write()
            .to_buffered(writer)
            .map_err(std::io::Error::other)
    })
    .map_err(|error| cannot_write(path, error))
}
