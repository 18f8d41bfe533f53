//! Files that the window writes: frames as PNG, cameras and paths as JSON. A file is written
//! completely or not at all.

use headbox_core::files;
use headbox_core::image::codec;
use image::ExtendedColorType;
use std::fs::{self, OpenOptions};
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
    let png = codec::png(pixels.as_flattened(), w, h, ExtendedColorType::Rgba8);
    let png = png.map_err(io::Error::other)?;
    files::write_whole(path, |file| file.write_all(&png))
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
/// Another process may take the name: only [`write_new`] and [`create_new_folder`] claim it.
pub(crate) fn free_name(dir: &Path, stem: &str, extension: &str) -> PathBuf {
    let name = |number: u32| dir.join(format!("{stem}-{number:04}.{extension}"));
    (1..u32::MAX)
        .map(name)
        .find(|path| path.symlink_metadata().is_err())
        .unwrap_or_else(|| name(u32::MAX))
}

/// Creates an empty file of the first free name, as [`free_name`], so that nobody else takes it.
///
/// # Errors
/// The error of the system.
pub(crate) fn claim_free_name(dir: &Path, stem: &str, extension: &str) -> io::Result<PathBuf> {
    loop {
        let path = free_name(dir, stem, extension);
        match write_new(&path, |_| Ok(())) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            claimed => return claimed.map(|()| path),
        }
    }
}

/// Writes a file that does not exist yet through `write`. Of several calls at once for one path,
/// one succeeds.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] if there is a file; the error of the system or of `write`,
/// which leaves nothing behind.
pub(crate) fn write_new(
    path: &Path,
    write: impl FnOnce(&Path) -> io::Result<()>,
) -> io::Result<()> {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    // The empty file claims the name.
    OpenOptions::new().write(true).create_new(true).open(path)?;
    write(path).inspect_err(|_| {
        // The error of writing is the one to report.
        let _ = fs::remove_file(path);
    })
}

/// Creates a folder that does not exist yet, and its parents.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] if there is something; the error of the system.
pub(crate) fn create_new_folder(path: &Path) -> io::Result<()> {
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    fs::create_dir(path)
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
            fs::read_dir(path.parent().unwrap()).unwrap().count(),
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
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn file_names_are_numbered() {
        let dir = tempfile::tempdir().unwrap();
        let first = free_name(dir.path(), "frame", "png");
        assert!(first.ends_with("frame-0001.png"));
        fs::write(&first, "").unwrap();
        assert!(free_name(dir.path(), "frame", "png").ends_with("frame-0002.png"));
    }

    #[test]
    fn new_file_is_written_once() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("new/frame-0001.png");
        let save = || write_new(&path, |path| write_json(path, &1));
        let results = std::thread::scope(|scope| {
            let saves: Vec<_> = (0..8).map(|_| scope.spawn(save)).collect();
            saves
                .into_iter()
                .map(|save| save.join().unwrap())
                .collect::<Vec<_>>()
        });
        assert_eq!(results.iter().filter(|result| result.is_ok()).count(), 1);
        let others = results.into_iter().filter_map(Result::err);
        others.for_each(|error| assert_eq!(error.kind(), io::ErrorKind::AlreadyExists));
        assert_eq!(fs::read_to_string(&path).unwrap(), "1\n");
        assert!(create_new_folder(&path).is_err());
    }

    #[test]
    fn names_claimed_at_once_differ() {
        let dir = tempfile::tempdir().unwrap();
        let claim = || claim_free_name(dir.path(), "window", "png").unwrap();
        let names = std::thread::scope(|scope| {
            let claims: Vec<_> = (0..8).map(|_| scope.spawn(claim)).collect();
            let names = claims.into_iter().map(|claim| claim.join().unwrap());
            names.collect::<std::collections::BTreeSet<_>>()
        });
        assert_eq!(names.len(), 8);
    }

    #[test]
    fn a_failed_new_file_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frame.png");
        assert!(write_new(&path, |path| write_png(path, 0, &[])).is_err());
        assert!(!path.exists());
    }
}
