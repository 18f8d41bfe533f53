//! The files opened last, kept from run to run in a small JSON file.

use std::path::{Path, PathBuf};

/// Files opened last, newest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Recent {
    paths: Vec<PathBuf>,
    /// File of the list.
    file: Option<PathBuf>,
}

impl Recent {
    /// More are forgotten.
    const MOST: usize = 8;

    /// The list as it was kept; empty if there is none, or something else is in its place.
    pub(crate) fn read(file: Option<PathBuf>) -> Self {
        let text = file
            .as_ref()
            .and_then(|file| std::fs::read_to_string(file).ok());
        let kept: Vec<PathBuf> = text
            .and_then(|text| serde_json::from_str(&text).ok())
            .unwrap_or_default();
        let mut paths = Vec::new();
        for path in kept.iter().map(|path| canonical(path)) {
            if paths.len() < Self::MOST && !paths.contains(&path) {
                paths.push(path);
            }
        }
        Self { paths, file }
    }

    /// Those that still exist.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.paths
            .iter()
            .map(PathBuf::as_path)
            .filter(|path| path.exists())
    }

    /// Puts a file first. That the list cannot be kept costs a convenience, nothing else.
    pub(crate) fn add(&mut self, path: &Path) {
        let path = canonical(path);
        self.paths.retain(|known| *known != path);
        self.paths.insert(0, path);
        self.paths.truncate(Self::MOST);
        if let (Some(file), Ok(text)) = (&self.file, serde_json::to_string(&self.paths)) {
            let _ = file.parent().map(std::fs::create_dir_all);
            let _ = std::fs::write(file, text);
        }
    }
}

/// One name for one file, by whatever way it was opened; of a file that is gone, its whole path.
fn canonical(path: &Path) -> PathBuf {
    let whole = || std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    std::fs::canonicalize(path).unwrap_or_else(|_| whole())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_comes_first_once_and_is_remembered() {
        let dir = tempfile::tempdir().unwrap();
        let dir_path = canonical(dir.path());
        let kept = dir_path.join("state/recent.json");
        let path = |i: usize| dir_path.join(format!("{i}.ldi"));
        (0..10).for_each(|i| std::fs::write(path(i), "").unwrap());
        let mut recent = Recent::read(Some(kept.clone()));
        (0..10).for_each(|i| recent.add(&path(i)));
        recent.add(&path(5));
        std::fs::remove_file(path(9)).unwrap();
        let found: Vec<_> = Recent::read(Some(kept.clone()))
            .paths()
            .map(Path::to_owned)
            .collect();
        assert_eq!(
            found,
            [5, 8, 7, 6, 4, 3, 2].map(path),
            "without the one that is gone"
        );
        std::fs::write(&kept, "{").unwrap();
        assert_eq!(Recent::read(Some(kept)).paths().count(), 0);
    }
    #[test]
    fn one_file_is_one_entry_by_whatever_name_it_is_opened() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("room.ldi");
        std::fs::write(&file, "").unwrap();
        std::fs::create_dir(dir.path().join("folder")).unwrap();
        let kept = dir.path().join("recent.json");
        let mut recent = Recent::read(Some(kept.clone()));
        recent.add(&file);
        recent.add(&dir.path().join("folder/../room.ldi"));
        recent.add(&dir.path().join("./room.ldi"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&file, dir.path().join("link.ldi")).unwrap();
            recent.add(&dir.path().join("link.ldi"));
        }
        assert_eq!(recent.paths().collect::<Vec<_>>(), [canonical(&file)]);
        // Lists that were kept before say it in several ways.
        let ways = ["room.ldi", "folder/../room.ldi"].map(|way| dir.path().join(way));
        std::fs::write(&kept, serde_json::to_string(&ways).unwrap()).unwrap();
        assert_eq!(Recent::read(Some(kept)).paths().count(), 1);
    }
}
