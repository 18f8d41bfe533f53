//! Cache of thumbnails between runs: small PNG files in the user's cache folder, bounded in bytes.

use crate::playback::export;
use crate::source::Thumbnail;
use headbox_core::files;
use headbox_core::image::codec;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Size of the thumbnail of a frame, pixels.
const SIZE_PX: [usize; 2] = [200, 150];

/// The cache; without a folder, it is always empty.
#[derive(Clone, Debug, Default)]
pub(crate) struct ThumbnailCache {
    folder: Option<PathBuf>,
}

impl ThumbnailCache {
    /// Maximum size of all files, bytes: about two hundred thumbnails.
    const MAX_BYTES: u64 = 8 << 20;
    /// Maximum size of one file and of its pixels, bytes: a larger one is not ours.
    const MAX_FILE_BYTES: u64 = 1 << 20;

    pub(crate) fn new(folder: Option<PathBuf>) -> Self {
        Self { folder }
    }

    /// Key of a file in its present state: path, modification time and size.
    pub(crate) fn file_key(path: &Path) -> Option<String> {
        let path = fs::canonicalize(path).ok()?;
        Some(format!("{} {}", path.display(), state(&path)?))
    }

    /// Key of an entry of the start page, as this program renders it.
    pub(crate) fn entry_key(id: &str) -> Option<String> {
        Some(format!("{id} {}", state(&std::env::current_exe().ok()?)?))
    }

    /// Reads the thumbnail of a key, and marks it as used. A damaged one counts as absent.
    pub(crate) fn read(&self, key: &str) -> Option<Thumbnail> {
        let path = self.path(key)?;
        if fs::metadata(&path).ok()?.len() > Self::MAX_FILE_BYTES {
            return None;
        }
        let image = codec::read(&path, Self::MAX_FILE_BYTES).ok()?.image;
        // If the time cannot be set, the file is only removed a little earlier.
        let _ = File::options()
            .append(true)
            .open(&path)
            .and_then(|file| file.set_modified(SystemTime::now()));
        Some(Thumbnail {
            width: image.width(),
            height: image.height(),
            pixels: codec::rgba8_pixels(&image),
        })
    }

    /// Writes the thumbnail of a key, and removes those used least recently beyond the limit.
    /// Errors are ignored: the cache is only a convenience.
    pub(crate) fn write(&self, key: &str, thumbnail: &Thumbnail) {
        if let Some(path) = self.path(key)
            && export::write_png(&path, thumbnail.width as usize, &thumbnail.pixels).is_ok()
        {
            self.evict_to(Self::MAX_BYTES);
        }
    }

    fn path(&self, key: &str) -> Option<PathBuf> {
        let folder = self.folder.as_ref()?;
        let path = folder.join(file_name(key));
        files::refuse_links(folder, &path).ok().map(|()| path)
    }

    /// Removes our least recently used files until no more than `max_bytes` are left.
    fn evict_to(&self, max_bytes: u64) {
        let entries = self
            .folder
            .iter()
            .filter_map(|folder| fs::read_dir(folder).ok());
        let files = entries.flatten().flatten().filter_map(|entry| {
            let is_ours = is_file_name(&entry.file_name().to_string_lossy());
            let data = entry
                .metadata()
                .ok()
                .filter(|data| is_ours && data.is_file())?;
            Some((data.modified().ok()?, data.len(), entry.path()))
        });
        let mut files: Vec<_> = files.collect();
        files.sort();
        let mut bytes: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, size, path) in files {
            if bytes <= max_bytes {
                break;
            }
            if fs::remove_file(path).is_ok() {
                bytes -= size;
            }
        }
    }
}

/// Modification time and size of a file.
fn state(path: &Path) -> Option<String> {
    let data = fs::metadata(path).ok()?;
    let modified = data.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
    Some(format!("{} {}", modified.as_nanos(), data.len()))
}

/// File name of a key: its digest.
fn file_name(key: &str) -> String {
    format!("{}.png", digest(key))
}

fn is_file_name(name: &str) -> bool {
    let digest = name.strip_suffix(".png");
    digest.is_some_and(|text| text.len() == 32 && text.bytes().all(|b| b.is_ascii_hexdigit()))
}

/// Digest of a text, 32 hexadecimal digits (FNV-1a with 128 bits): the same in all versions.
pub(crate) fn digest(text: &str) -> String {
    const BASIS: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
    const PRIME: u128 = (1 << 88) + 0x13b;
    let hash = text.bytes().fold(BASIS, |hash, byte| {
        (hash ^ u128::from(byte)).wrapping_mul(PRIME)
    });
    format!("{hash:032x}")
}

/// Thumbnail of a frame `width` pixels wide: its middle, 4:3, as means over rectangles.
pub(crate) fn of_frame(width: usize, pixels: &[[u8; 4]]) -> Option<Thumbnail> {
    let height = pixels.len().checked_div(width)?;
    let [columns, rows] = SIZE_PX;
    // The largest rectangle of 4:3 in the middle.
    let crop_width = width.min(height * columns / rows);
    let crop_height = height.min(width * rows / columns);
    if crop_width < columns || crop_height < rows {
        return None;
    }
    let [left, top] = [(width - crop_width) / 2, (height - crop_height) / 2];
    let mut thumbnail = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        let y = top + row * crop_height / rows..top + (row + 1) * crop_height / rows;
        for column in 0..columns {
            let x =
                left + column * crop_width / columns..left + (column + 1) * crop_width / columns;
            let count = (y.len() * x.len()) as u32;
            let mut sums = [0; 3];
            for pixel in y
                .clone()
                .flat_map(|y| &pixels[y * width + x.start..y * width + x.end])
            {
                (0..3).for_each(|i| sums[i] += u32::from(pixel[i]));
            }
            let [r, g, b] = sums.map(|sum| (sum / count) as u8);
            thumbnail.push([r, g, b, u8::MAX]);
        }
    }
    Some(Thumbnail {
        width: columns as u32,
        height: rows as u32,
        pixels: thumbnail,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn thumbnail(value: u8) -> Thumbnail {
        Thumbnail {
            width: 4,
            height: 3,
            pixels: vec![[value, 0, 0, 255]; 12],
        }
    }

    #[test]
    fn digest_is_fnv_1a() {
        // From the definition of the hash: the basis, and the value of "a".
        assert_eq!(digest(""), "6c62272e07bb014262b821756295c58d");
        assert_eq!(digest("a"), "d228cb696f1a8caf78912b704e4a8964");
    }

    #[test]
    fn changed_file_has_no_thumbnail() {
        let dir = tempfile::tempdir().unwrap();
        let cache = ThumbnailCache::new(Some(dir.path().join("cache")));
        let file = dir.path().join("room.ldi");
        fs::write(&file, "1").unwrap();
        let key = ThumbnailCache::file_key(&file).unwrap();
        assert_eq!(cache.read(&key), None);
        cache.write(&key, &thumbnail(7));
        assert_eq!(cache.read(&key), Some(thumbnail(7)));
        fs::write(&file, "12").unwrap();
        let changed = ThumbnailCache::file_key(&file).unwrap();
        assert_eq!(cache.read(&changed), None);
        assert_eq!(ThumbnailCache::file_key(&dir.path().join("none")), None);
    }

    #[test]
    fn damaged_thumbnail_counts_as_absent() {
        let dir = tempfile::tempdir().unwrap();
        let cache = ThumbnailCache::new(Some(dir.path().into()));
        cache.write("a", &thumbnail(1));
        fs::write(dir.path().join(file_name("a")), "no PNG").unwrap();
        assert_eq!(cache.read("a"), None);
        assert_eq!(ThumbnailCache::default().read("a"), None);
    }

    #[test]
    fn least_recently_used_thumbnails_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        let cache = ThumbnailCache::new(Some(dir.path().into()));
        let keys = ["a", "b", "c"];
        for (i, key) in keys.into_iter().enumerate() {
            cache.write(key, &thumbnail(i as u8));
            let time = UNIX_EPOCH + Duration::from_secs(1000 + i as u64);
            let file = File::options()
                .append(true)
                .open(dir.path().join(file_name(key)));
            file.unwrap().set_modified(time).unwrap();
        }
        let other = dir.path().join("holiday.png");
        fs::write(&other, [0; 9999]).unwrap();
        assert!(cache.read("a").is_some(), "used now");
        let size = |key| fs::metadata(dir.path().join(file_name(key))).unwrap().len();
        cache.evict_to(size("a") + size("c"));
        let left: Vec<_> = keys
            .into_iter()
            .filter(|key| cache.read(key).is_some())
            .collect();
        assert_eq!(left, ["a", "c"]);
        assert!(other.exists(), "not ours");
    }

    #[test]
    fn thumbnail_of_frame_is_its_middle() {
        // 400x600: the middle 400x300 is green.
        let green = |i: usize| (150..450).contains(&(i / 400));
        let pixels: Vec<_> = (0..400 * 600)
            .map(|i| if green(i) { [0, 200, 0, 0] } else { [255; 4] })
            .collect();
        let thumbnail = of_frame(400, &pixels).unwrap();
        assert_eq!([thumbnail.width, thumbnail.height], [200, 150]);
        assert!(
            thumbnail
                .pixels
                .iter()
                .all(|pixel| *pixel == [0, 200, 0, 255])
        );
        assert_eq!(of_frame(100, &vec![[0; 4]; 100 * 600]), None, "too small");
        assert_eq!(of_frame(0, &[]), None);
    }
}
