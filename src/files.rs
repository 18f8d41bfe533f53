//! Whole files or none: writing to a temporary name and renaming, also when the user presses Ctrl-C.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Temporary files that exist right now, to be removed if the process is interrupted.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn unfinished() -> std::sync::MutexGuard<'static, BTreeSet<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Writes a file through `write`: under a temporary name in the same folder, renamed to `path` only once everything is
/// on disk. On any error the old file, if there is one, stays as it was.
///
/// # Errors
/// Whatever creating, writing, syncing or renaming reports.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let temporary = tempfile::Builder::new().prefix(".headbox-").suffix(".part").tempfile_in(folder)?;
    let name = temporary.path().to_path_buf();
    unfinished().insert(name.clone());
    let written = write_and_rename(temporary, path, write);
    unfinished().remove(&name);
    written
}

fn write_and_rename(
    temporary: tempfile::NamedTempFile,
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> io::Result<()> {
    let mut writer = BufWriter::with_capacity(1 << 20, temporary.as_file());
    write(&mut writer)?;
    writer.flush()?;
    drop(writer);
    allow_everyone_to_read(temporary.as_file())?;
    temporary.as_file().sync_all()?;
    temporary.persist(path)?;
    Ok(())
}

/// Temporary files are private to their user; a result is an ordinary file.
#[cfg(unix)]
fn allow_everyone_to_read(file: &File) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn allow_everyone_to_read(_: &File) -> io::Result<()> {
    Ok(())
}

/// Makes Ctrl-C (and a request to terminate) remove half-written files and end the process with exit code 130.
///
/// # Errors
/// If a handler is already installed.
#[cfg(feature = "cli")]
pub fn clean_up_on_interrupt() -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(|| {
        for path in unfinished().iter() {
            // Nothing is left to do about a file that cannot be removed.
            let _ = std::fs::remove_file(path);
        }
        std::process::exit(130);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frame.png");
        write_atomically(&path, |w| w.write_all(b"old")).unwrap();
        let failed = write_atomically(&path, |w| {
            w.write_all(b"half of the n")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary file is left");
        write_atomically(&path, |w| w.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }
}
