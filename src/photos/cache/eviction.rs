//! Size limit of the cache: least recently used files are removed, except those in use.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Bytes of what is kept in a folder, unless what is in use takes more.
pub const MOST_BYTES: u64 = 4_000_000_000;

/// The endings of files that are removed to make room.
const ENDINGS: [&str; 4] = ["samples", "registration", "poses", "truth"];

/// A kept file that is in use: it is not removed until this is dropped, by this program or another
/// of ours.
#[derive(Debug)]
pub struct InUse(#[expect(dead_code, reason = "the lock goes with the file")] File);

impl InUse {
    /// Takes note that a file is used, and used now.
    ///
    /// # Errors
    /// If the file cannot be opened or locked.
    pub fn of(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        file.lock_shared()?;
        // Where times cannot be set, the file goes a little earlier.
        let _ = file.set_modified(SystemTime::now());
        Ok(Self(file))
    }
}

/// Removes those of our files in a folder that were used longest ago until no more than `most`
/// bytes are left, but none that is in use; returns how many were removed. What cannot be removed
/// stays.
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
    for (_, of_file, path) in kept {
        if bytes <= most {
            break;
        }
        let is_free = File::open(&path).is_ok_and(|file| file.try_lock().is_ok());
        if is_free && std::fs::remove_file(&path).is_ok() {
            bytes -= of_file;
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
        let held = InUse::of(&file(1)).expect("in use");
        drop(InUse::of(&file(0)).expect("used now"));
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
        assert!(InUse::of(&file(0)).is_err());
    }
}
