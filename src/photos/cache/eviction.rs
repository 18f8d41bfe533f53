//! Size limit of the cache: least recently used files are removed, except those in use.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Maximum number of bytes of our files in a folder, unless files in use take more.
pub const MOST_BYTES: u64 = 4_000_000_000;

/// File extensions that may be removed.
const ENDINGS: [&str; 4] = ["samples", "registration", "poses", "truth"];

/// Lock on a cached file: neither this process nor another of ours removes it until this is
/// dropped.
#[derive(Debug)]
pub struct FileLock(#[expect(dead_code, reason = "the lock goes with the file")] File);

impl FileLock {
    /// Locks a file and marks it as used now.
    ///
    /// # Errors
    /// If the file cannot be opened or locked.
    pub fn of(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        file.lock_shared()?;
        // If the time cannot be set, the file is only removed a little earlier.
        let _ = file.set_modified(SystemTime::now());
        Ok(Self(file))
    }
}

/// Removes our least recently used files in a folder until no more than `most` bytes are left,
/// except files in use. Returns the number of removed files. Files that cannot be removed stay.
pub fn evict_to(folder: &Path, most: u64) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return 0;
    };
    let mut kept: Vec<(SystemTime, u64, PathBuf)> = entries
        .flatten()
        .filter(|entry| is_ours(&entry.path()))
        .filter_map(|entry| {
            let metadata = entry.metadata().ok().filter(std::fs::Metadata::is_file)?;
            Some((metadata.modified().ok()?, metadata.len(), entry.path()))
        })
        .collect();
    kept.sort();
    let mut bytes: u64 = kept.iter().map(|(_, bytes, _)| bytes).sum();
    let mut removed = 0;
    for (_, size, path) in kept {
        if bytes <= most {
            break;
        }
        let is_free = File::open(&path).is_ok_and(|file| file.try_lock().is_ok());
        if is_free && std::fs::remove_file(&path).is_ok() {
            bytes -= size;
            removed += 1;
        }
    }
    removed
}

/// Returns true if a file has a name made by [`super::file_name`].
fn is_ours(path: &Path) -> bool {
    let digest = path.file_stem().and_then(|stem| stem.to_str());
    let is_digest = digest
        .is_some_and(|digest| digest.len() == 32 && digest.bytes().all(|b| b.is_ascii_hexdigit()));
    is_digest
        && path
            .extension()
            .is_some_and(|ending| ENDINGS.iter().any(|known| ending == *known))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn least_recently_used_removed_unless_in_use() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |number: u64| folder.path().join(format!("{number:032x}.samples"));
        for number in 0..5 {
            std::fs::write(file(number), [0; 100]).expect("written");
            let time = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000 + number);
            File::open(file(number))
                .and_then(|file| file.set_modified(time))
                .expect("a time");
        }
        let others = ["picture.png", "0123.samples", &format!("{:032x}.ldi", 7)]
            .map(|name| folder.path().join(name));
        others
            .iter()
            .for_each(|other| std::fs::write(other, [0; 1000]).expect("written"));
        let left = || {
            (0..5)
                .filter(|number| file(*number).exists())
                .collect::<Vec<u64>>()
        };
        assert_eq!(
            (evict_to(folder.path(), 500), left().len()),
            (0, 5),
            "they fit"
        );
        let held = FileLock::of(&file(1)).expect("in use");
        drop(FileLock::of(&file(0)).expect("used now"));
        assert_eq!(evict_to(folder.path(), 250), 3);
        assert_eq!(left(), [0, 1], "0 was used last, 1 is in use");
        assert_eq!((evict_to(folder.path(), 0), left()), (1, vec![1]));
        drop(held);
        assert_eq!((evict_to(folder.path(), 0), left()), (1, vec![]));
        assert!(
            others.iter().all(|other| other.exists()),
            "what is not ours"
        );
        assert_eq!(evict_to(&folder.path().join("nowhere"), 0), 0);
        assert!(FileLock::of(&file(0)).is_err());
    }
}
