//! Temporary files and folders: removed when they are dropped, when the process is interrupted,
//! and, after a process that was killed, by the next one that writes to the same folder.
//!
//! A process locks its temporary files and folders while it writes to them. The system ends the
//! locks of a process with it, so whatever can be locked is abandoned, on this machine or another.

use super::{lock, parent_folder};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Existing temporary files and folders, to be removed if the process is interrupted.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Folders that this process has searched for abandoned files.
static SEARCHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Beginning and end of the names of temporary files; between them are the process and a number.
const NAME: [&str; 2] = [".headbox-", ".part"];

/// Removes all unfinished files; for a process that is about to end.
pub fn remove_unfinished() {
    for path in lock(&UNFINISHED).iter() {
        remove(path);
    }
}

/// Removes a temporary file or folder. One that cannot be removed is left.
fn remove(path: &Path) {
    let is_folder = path.symlink_metadata().is_ok_and(|found| found.is_dir());
    let _ = if is_folder {
        fs::remove_dir_all(path)
    } else {
        fs::remove_file(path)
    };
}

/// Temporary file, removed when this is dropped unless it has been renamed by then.
pub(super) struct Unfinished {
    path: PathBuf,
    file: File,
}

impl Unfinished {
    /// Creates a temporary file in the folder of `path`.
    pub(super) fn create_next_to(path: &Path) -> io::Result<Self> {
        let create = |path: &Path| {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create_new(true).open(path)
        };
        let (path, file) = create_in(parent_folder(path), create, |file| Some(file))?;
        Ok(Self { path, file })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn file(&self) -> &File {
        &self.file
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        lock(&UNFINISHED).remove(&self.path);
        // A renamed file no longer exists, and the first error is the one to report.
        let _ = fs::remove_file(&self.path);
    }
}

/// Temporary folder, removed with its files when this is dropped.
#[derive(Debug)]
pub struct StagingFolder {
    path: PathBuf,
    /// Lock on the folder, where the system can lock one.
    _lock: Option<File>,
}

impl StagingFolder {
    /// Creates a temporary folder in a folder.
    ///
    /// # Errors
    /// Error of creating it.
    pub fn create_in(folder: &Path) -> io::Result<Self> {
        let create = |path: &Path| fs::create_dir(path).map(|()| File::open(path).ok());
        let (path, lock) = create_in(folder, create, Option::as_ref)?;
        Ok(Self { path, _lock: lock })
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for StagingFolder {
    fn drop(&mut self) {
        lock(&UNFINISHED).remove(&self.path);
        remove(&self.path);
    }
}

/// Creates something temporary in a folder, and locks its file.
fn create_in<T>(
    folder: &Path,
    create: impl Fn(&Path) -> io::Result<T>,
    file: impl Fn(&T) -> Option<&File>,
) -> io::Result<(PathBuf, T)> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    remove_abandoned(folder);
    let [beginning, end] = NAME;
    loop {
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("{beginning}{}-{number}{end}", std::process::id());
        let path = folder.join(name);
        // Locked while the file is created: an interrupt finds either no file or its name.
        let mut unfinished = lock(&UNFINISHED);
        let created = match create(&path) {
            Ok(created) => created,
            // Left behind by a killed process with the same number.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
            Err(error) => return Err(error),
        };
        unfinished.insert(path.clone());
        drop(unfinished);
        let Some(locked) = file(&created) else {
            return Ok((path, created));
        };
        // Some file systems have no locks; there, files of killed processes are left.
        let _ = locked.lock();
        if is_at(locked, &path) {
            return Ok((path, created));
        }
        // Another process took it for abandoned before it was locked.
        lock(&UNFINISHED).remove(&path);
    }
}

/// Removes temporary files in a folder whose process has ended; once for each folder.
fn remove_abandoned(folder: &Path) {
    let Ok(canonical) = folder.canonicalize() else {
        return;
    };
    if !lock(&SEARCHED).insert(canonical) {
        return;
    }
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let kind = entry.file_type();
        if !is_temporary(&entry.file_name()) || !kind.is_ok_and(|it| it.is_file() || it.is_dir()) {
            continue;
        }
        let path = entry.path();
        // The writer may have renamed it since, and its result must not be removed.
        let is_abandoned =
            File::open(&path).is_ok_and(|file| file.try_lock().is_ok() && is_at(&file, &path));
        if is_abandoned {
            remove(&path);
        }
    }
}

/// Returns true if a name is that of a temporary file of this program.
fn is_temporary(name: &OsStr) -> bool {
    let [beginning, end] = NAME;
    let name = name.to_str();
    let numbers = name.and_then(|name| name.strip_prefix(beginning)?.strip_suffix(end));
    numbers
        .and_then(|numbers| numbers.split_once('-'))
        .is_some_and(|(process, number)| {
            [process, number]
                .iter()
                .all(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
        })
}

/// Returns true if an open file is the one at `path`.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let [open, found] = [file.metadata(), path.symlink_metadata()];
    let identity = |data: fs::Metadata| (data.dev(), data.ino());
    open.is_ok_and(|open| found.is_ok_and(|found| identity(open) == identity(found)))
}

/// Returns true if there is a file at `path`, which is then the open one: it cannot be replaced.
#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.symlink_metadata().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_temporary_files_are_known() {
        for (name, expected) in [
            (".headbox-12-3.part", true),
            (".headbox-12-.part", false),
            (".headbox-12-3a.part", false),
            (".headbox-12.part", false),
            ("headbox-12-3.part", false),
            (".headbox-12-3.part.png", false),
        ] {
            assert_eq!(is_temporary(OsStr::new(name)), expected, "{name}");
        }
    }

    #[test]
    fn abandoned_files_are_removed_and_locked_ones_kept() {
        let dir = tempfile::tempdir().expect("a folder");
        let at = |name: &str| dir.path().join(name);
        for name in [".headbox-1-0.part", ".headbox-1-2.part", "notes.part"] {
            fs::write(at(name), "x").expect("written");
        }
        fs::create_dir(at(".headbox-1-1.part")).expect("made");
        fs::write(at(".headbox-1-1.part/z.exr"), "x").expect("written");
        let running = File::open(at(".headbox-1-2.part")).expect("opened");
        running.lock().expect("locked");
        let own = Unfinished::create_next_to(&at("a.png")).expect("made");
        let exists = |name: &str| at(name).symlink_metadata().is_ok();
        assert!(!exists(".headbox-1-0.part"), "its process has ended");
        assert!(!exists(".headbox-1-1.part") || cfg!(not(unix)), "a folder");
        assert!(exists(".headbox-1-2.part") && exists("notes.part"));
        // A second process would search again.
        lock(&SEARCHED).remove(&dir.path().canonicalize().expect("there"));
        drop(running);
        let staging = StagingFolder::create_in(dir.path()).expect("made");
        assert!(!exists(".headbox-1-2.part"), "its process has ended, too");
        assert!(own.path().exists(), "it is locked by this process");
        let path = staging.path().to_path_buf();
        fs::write(path.join("z.exr"), "x").expect("written");
        drop((staging, own));
        assert_eq!(fs::read_dir(dir.path()).expect("a folder").count(), 1);
    }
}
