//! The environment in a file: a PNG of the six faces, one below the other.
//!
//! Files of the first versions have the bare texels. Those cannot begin like a PNG: the fourth byte
//! is an alpha of 0 or 255, that of a PNG is "G".

use super::Environment;
use crate::container::{FileError, Section};
use crate::image::{codec, png_chunks};
use ::image::{DynamicImage, ExtendedColorType};
use std::io;

/// Largest number of bytes that a byte of a PNG can hold.
const MAX_COMPRESSION: u64 = 1032;

impl Environment {
    /// Encodes the texels for a section of a file; nothing if there are none.
    ///
    /// # Errors
    /// If the texels are not six faces of the size.
    pub fn to_section(&self) -> io::Result<Vec<u8>> {
        if self.texels.is_empty() {
            return Ok(Vec::new());
        }
        let pixels = bytemuck::cast_slice(&self.texels);
        let [width, height] = [self.size_px, self.size_px.saturating_mul(6)];
        codec::png(pixels, width, height, ExtendedColorType::Rgba8).map_err(io::Error::other)
    }

    /// Reads and validates an environment with faces of `size_px` texels from a section that
    /// [`Self::to_section`] encoded, or that has bare texels.
    ///
    /// # Errors
    /// [`FileError::Damaged`].
    pub fn from_section(mut section: Section, size_px: u32) -> Result<Self, FileError> {
        let texels = if section.rest().starts_with(png_chunks::SIGNATURE) {
            Self::decode_texels(&section, size_px)?
        } else {
            let size = size_px as usize;
            let texels = section.array(size.saturating_mul(size).saturating_mul(6))?;
            section.end()?;
            texels
        };
        let environment = Self { size_px, texels };
        environment
            .validate()
            .map_err(|error| section.damaged("an environment", error.to_string()))?;
        Ok(environment)
    }

    fn decode_texels(section: &Section, size_px: u32) -> Result<Vec<[u8; 4]>, FileError> {
        let texel_bytes = u64::from(size_px).pow(2).saturating_mul(24);
        let most_bytes = texel_bytes.min(section.rest().len() as u64 * MAX_COMPRESSION);
        let decoded = codec::decode(section.rest(), None, most_bytes)
            .map_err(|error| section.damaged("a PNG of the environment", error.to_string()))?;
        match decoded.image {
            DynamicImage::ImageRgba8(image) if image.width() == size_px => {
                Ok(bytemuck::pod_collect_to_vec(image.as_raw()))
            }
            other => Err(section.damaged(
                format!("a PNG with alpha, {size_px} pixels wide"),
                format!("{:?}, {} pixels wide", other.color(), other.width()),
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::by_direction;
    use super::*;
    use crate::container::{Container, ContainerWriter, FileKind};

    fn section(bytes: Vec<u8>) -> Section {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("section");
        let mut writer = ContainerWriter::new(FileKind::CUBE_LDI);
        writer.section("bytes", move || Ok(bytes));
        writer.write(&path).expect("written");
        Container::open(&path, FileKind::CUBE_LDI)
            .and_then(|file| file.section("bytes"))
            .expect("read")
    }

    /// A smooth sky above texels that no miss reached.
    fn sky(size_px: u32) -> Environment {
        by_direction(size_px, |direction| {
            let level = (127.5 + 127.0 * direction.y) as u8;
            [level, level, 255, if direction.y < 0.0 { 0 } else { 255 }]
        })
    }

    #[test]
    fn environment_round_trips_and_is_small() {
        for size_px in [1, 3, 128] {
            let bytes = sky(size_px).to_section().expect("encoded");
            let read = Environment::from_section(section(bytes), size_px).expect("read");
            assert_eq!(read, sky(size_px));
        }
        let even = by_direction(512, |_| [9, 99, 199, 255]);
        let bytes = even.to_section().expect("encoded");
        let read = Environment::from_section(section(bytes), 512).expect("the most compressed");
        assert_eq!(read, even);
        let bare = 6 * 128 * 128 * 4;
        assert!(sky(128).to_section().expect("encoded").len() < bare / 4);
    }

    #[test]
    fn no_environment_is_no_bytes() {
        let bytes = Environment::default().to_section().expect("encoded");
        assert!(bytes.is_empty());
        let read = Environment::from_section(section(bytes), 0).expect("read");
        assert_eq!(read, Environment::default());
    }

    #[test]
    fn bare_texels_of_first_versions_are_read() {
        let bytes = bytemuck::cast_slice(&sky(4).texels).to_vec();
        let read = Environment::from_section(section(bytes), 4).expect("read");
        assert_eq!(read, sky(4));
    }

    #[test]
    fn wrong_sizes_and_damage_are_refused() {
        let bytes = || sky(4).to_section().expect("encoded");
        let refused = |bytes, size_px| Environment::from_section(section(bytes), size_px).is_err();
        assert!(refused(bytes(), 3));
        assert!(refused(bytes(), 5));
        assert!(refused(bytes(), u32::MAX));
        assert!(refused(bytes()[..60].to_vec(), 4));
        let gray = codec::png(&[9; 96], 4, 24, ExtendedColorType::L8).expect("encoded");
        assert!(refused(gray, 4));
    }
}
