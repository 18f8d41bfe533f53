//! Files that the window writes: frames as PNG, cameras and paths as JSON. A file is written
//! completely or not at all.

use headbox_core::files;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes `pixels` (sRGB, 8 bits per channel, straight alpha, row 0 on top) as a PNG file.
///
/// # Errors
/// The error of the system or of the encoder.
pub(crate) fn write_png(path: &Path, width: usize, pixels: &[[u8; 4]]) -> io::Result<()> {
    let height = pixels.len().checked_div(width).unwrap_or(0);
    let too_large = |_| {
        io::Error::new(
            io::ErrorKind::InvalidInput,
            "the image is too large for a PNG file",
        )
    };
    let (w, h) = (
        u32::try_from(width).map_err(too_large)?,
        u32::try_from(height).map_err(too_large)?,
    );
    files::write_whole(path, |file| {
        let encoder = image::codecs::png::PngEncoder::new(file);
        let kind = image::ExtendedColorType::Rgba8;
        image::ImageEncoder::write_image(encoder, bytemuck::cast_slice(pixels), w, h, kind)
            .map_err(io::Error::other)
    })
}

/// Writes `value` as indented JSON.
///
/// # Errors
/// The error of the system.
pub(crate) fn write_json(path: &Path, value: &impl serde::Serialize) -> io::Result<()> {
    files::write_whole(path, |file| {
        serde_json::to_writer_pretty(&mut *file, value)?;
        file.write_all(b"\n")
    })
}

/// Returns the path `stem-0001.extension` in `dir`, with the first number that does not exist.
pub(crate) fn free_name(dir: &Path, stem: &str, extension: &str) -> PathBuf {
    let name = |number: u32| dir.join(format!("{stem}-{number:04}.{extension}"));
    (1..u32::MAX)
        .map(name)
        .find(|path| !path.exists())
        .unwrap_or_else(|| name(u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_files_hold_the_pixels() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("new/frame.png");
        let pixels = [
            [1, 2, 3, 255],
            [4, 5, 6, 255],
            [7, 8, 9, 255],
            [10, 11, 12, 255],
            [0; 4],
            [255; 4],
        ];
        write_png(&path, 3, &pixels).unwrap();
        let back = image::open(&path).unwrap().into_rgba8();
        assert_eq!((back.width(), back.height()), (3, 2));
        assert_eq!(back.into_raw(), bytemuck::cast_slice::<_, u8>(&pixels));
        assert_eq!(
            std::fs::read_dir(path.parent().unwrap()).unwrap().count(),
            1,
            "no temporary file stays"
        );
    }

    #[test]
    fn a_failed_write_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        assert!(
            write_png(&dir.path().join("x.png"), 0, &[]).is_err(),
            "an image without pixels"
        );
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn file_names_are_numbered() {
        let dir = tempfile::tempdir().unwrap();
        let first = free_name(dir.path(), "frame", "png");
        assert!(first.ends_with("frame-0001.png"));
        std::fs::write(&first, "").unwrap();
        assert!(free_name(dir.path(), "frame", "png").ends_with("frame-0002.png"));
    }
}
