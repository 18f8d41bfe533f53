//! List of recently opened files, stored between runs in a small JSON file.

use crate::playback::thumbnails::ThumbnailCache;
use crate::source::Thumbnail;
use egui::{Context, TextureHandle};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Recently opened files, newest first.
#[derive(Default)]
pub(crate) struct RecentFiles {
    paths: Vec<PathBuf>,
    /// File of the list.
    file: Option<PathBuf>,
    cache: ThumbnailCache,
    /// Thumbnails that were looked for, by path.
    textures: HashMap<PathBuf, Option<TextureHandle>>,
}

impl RecentFiles {
    /// Maximum number of files in the list.
    const MAX_FILES: usize = 8;

    /// Reads the stored list; empty if there is no file or it is not such a list.
    pub(crate) fn read(file: Option<PathBuf>) -> Self {
        let text = file
            .as_ref()
            .and_then(|file| std::fs::read_to_string(file).ok());
        let stored: Vec<PathBuf> = text
            .and_then(|text| serde_json::from_str(&text).ok())
            .unwrap_or_default();
        let mut paths = Vec::new();
        for path in stored.iter().map(|path| canonical(path)) {
            if paths.len() < Self::MAX_FILES && !paths.contains(&path) {
                paths.push(path);
            }
        }
        Self {
            paths,
            file,
            ..Self::default()
        }
    }

    /// Sets the cache in which thumbnails are found and kept.
    pub(crate) fn set_cache(&mut self, cache: ThumbnailCache) {
        self.cache = cache;
    }

    /// Keeps the thumbnail of a file.
    pub(crate) fn keep_thumbnail(&mut self, path: &Path, thumbnail: &Thumbnail) {
        if let Some(key) = ThumbnailCache::file_key(path) {
            self.cache.write(&key, thumbnail);
            self.textures.remove(&canonical(path));
        }
    }

    /// Files of the list that still exist, with their thumbnails.
    pub(crate) fn with_thumbnails(
        &mut self,
        ctx: &Context,
    ) -> Vec<(PathBuf, Option<TextureHandle>)> {
        let paths: Vec<_> = self.paths().map(Path::to_owned).collect();
        let with_thumbnail = |path: PathBuf| {
            let texture = self.textures.entry(path.clone()).or_insert_with(|| {
                let thumbnail = self.cache.read(&ThumbnailCache::file_key(&path)?)?;
                thumbnail.texture(ctx, &format!("thumbnail {}", path.display()))
            });
            let texture = texture.clone();
            (path, texture)
        };
        paths.into_iter().map(with_thumbnail).collect()
    }

    /// Files of the list that still exist.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.paths
            .iter()
            .map(PathBuf::as_path)
            .filter(|path| path.exists())
    }

    /// Puts a file first, and stores the list. Errors are ignored: the list is only a convenience.
    pub(crate) fn add(&mut self, path: &Path) {
        let path = canonical(path);
        self.paths.retain(|known| *known != path);
        self.paths.insert(0, path);
        self.paths.truncate(Self::MAX_FILES);
        if let (Some(file), Ok(text)) = (&self.file, serde_json::to_string(&self.paths)) {
            let _ = file.parent().map(std::fs::create_dir_all);
            let _ = std::fs::write(file, text);
        }
    }
}

/// Canonical path of a file; the absolute path if the file no longer exists.
fn canonical(path: &Path) -> PathBuf {
    std::fs::canonicalize(path)
        .or_else(|_| std::path::absolute(path))
        .unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_file_is_first_and_stored() {
        let dir = tempfile::tempdir().unwrap();
        let dir_path = canonical(dir.path());
        let kept = dir_path.join("state/recent.json");
        let path = |i: usize| dir_path.join(format!("{i}.ldi"));
        (0..10).for_each(|i| std::fs::write(path(i), "").unwrap());
        let mut recent = RecentFiles::read(Some(kept.clone()));
        (0..10).for_each(|i| recent.add(&path(i)));
        recent.add(&path(5));
        std::fs::remove_file(path(9)).unwrap();
        let found: Vec<_> = RecentFiles::read(Some(kept.clone()))
            .paths()
            .map(Path::to_owned)
            .collect();
        assert_eq!(
            found,
            [5, 8, 7, 6, 4, 3, 2].map(path),
            "without the one that is gone"
        );
        std::fs::write(&kept, "{").unwrap();
        assert_eq!(RecentFiles::read(Some(kept)).paths().count(), 0);
    }
    #[test]
    fn one_file_has_one_entry_for_all_its_names() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("room.ldi");
        std::fs::write(&file, "").unwrap();
        std::fs::create_dir(dir.path().join("folder")).unwrap();
        let kept = dir.path().join("recent.json");
        let mut recent = RecentFiles::read(Some(kept.clone()));
        recent.add(&file);
        recent.add(&dir.path().join("folder/../room.ldi"));
        recent.add(&dir.path().join("./room.ldi"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&file, dir.path().join("link.ldi")).unwrap();
            recent.add(&dir.path().join("link.ldi"));
        }
        assert_eq!(recent.paths().collect::<Vec<_>>(), [canonical(&file)]);
        // Older lists may have several paths for one file.
        let ways = ["room.ldi", "folder/../room.ldi"].map(|way| dir.path().join(way));
        std::fs::write(&kept, serde_json::to_string(&ways).unwrap()).unwrap();
        assert_eq!(RecentFiles::read(Some(kept)).paths().count(), 1);
    }
}
