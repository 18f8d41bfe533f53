//! Output files: the rule by which every file is written.
//!
//! | the path is | action |
//! |---|---|
//! | nothing | missing folders are created; the file is written under a temporary name next to it and renamed when it is complete |
//! | a regular file | it is replaced in the same way and keeps its permissions; refused if it is read-only or an input |
//! | a symbolic link | it is kept; its target is written by this rule, even if that does not exist yet |
//! | a character device, a FIFO, `/dev/stdout` | the complete result is written to an unnamed file and then streamed |
//! | `-` | the same, to standard output |
//! | a folder, a block device, a socket | refused |
//!
//! On any error, and when the process is interrupted, the old file remains unchanged and no partial
//! file is left. What a killed process leaves is removed by the next one that writes to the folder
//! (`unfinished`).
//!
//! `inputs` has the rule for files that inputs name.

mod inputs;
#[cfg(test)]
mod tests;
mod unfinished;

pub use inputs::{FoundInput, InputFolder, Refusal, set_permissions};
pub use unfinished::{StagingFolder, remove_unfinished};

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::{self, File, Metadata, OpenOptions, Permissions};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use unfinished::Unfinished;
use unicode_normalization::UnicodeNormalization;

/// Input files of the user, which must not be overwritten.
static INPUTS: Mutex<BTreeMap<Identity, PathBuf>> = Mutex::new(BTreeMap::new());

/// Path that means standard output.
pub const STANDARD_OUTPUT: &str = "-";

/// Maximum length of a chain of symbolic links before it counts as endless, as on Linux.
const MAX_LINKS: usize = 40;

fn lock<T>(mutex: &'static Mutex<T>) -> MutexGuard<'static, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Target of an output path.
#[derive(Debug)]
enum Target {
    /// A regular file, or none yet: its path behind all links, and the permissions to keep.
    File(PathBuf, Option<Permissions>),
    /// A device or FIFO to stream to.
    Stream(PathBuf),
    StandardOutput,
}

/// Returns true if output to `path` is streamed, so that its name implies no format.
///
/// # Errors
/// Same as [`check`], without inputs and permissions.
pub fn is_stream(path: &Path) -> io::Result<bool> {
    Ok(!matches!(target(path)?, Target::File(..)))
}

/// Returns a name in lower case and Unicode NFC, because macOS stores `ü` as `u` and a combining
/// mark; equal for file names that differ in case or normalization alone.
pub fn fold_name(name: &str) -> String {
    name.nfc().flat_map(char::to_lowercase).nfc().collect()
}

/// Finds `folder/relative`. A component without an exact match is that of the listed names which
/// `matcher` accepts for it, the first in alphabetical order.
pub fn find_similar<M: Fn(&OsStr) -> bool>(
    folder: &Path,
    relative: &Path,
    matcher: impl Fn(&str) -> M,
) -> Option<PathBuf> {
    let mut path = folder.to_path_buf();
    for component in relative.components() {
        let exact = path.join(component);
        if exact.exists() || !matches!(component, Component::Normal(_)) {
            path = exact;
            continue;
        }
        let accepts = matcher(&component.as_os_str().to_string_lossy());
        let listed = if path.as_os_str().is_empty() {
            Path::new(".")
        } else {
            &path
        };
        let names = fs::read_dir(listed)
            .ok()?
            .filter_map(|entry| Some(entry.ok()?.file_name()));
        let found = names.filter(|name| accepts(name)).min()?;
        path.push(found);
    }
    Some(path)
}

/// Checks in advance that [`write_whole`] will not refuse `path`. Creates nothing.
///
/// # Errors
/// Error that [`write_whole`] would return.
pub fn check(path: &Path) -> io::Result<()> {
    let Target::File(path, permissions) = target(path)? else {
        return Ok(());
    };
    if permissions.is_some() {
        refuse_input(&path)?;
        refuse_read_only(&path)?;
    }
    check_folder(parent_folder(&path))
}

/// Checks that files can be created in `folder`, which need not exist yet. Leaves nothing behind.
///
/// # Errors
/// If the folder, or its nearest existing ancestor, is not a folder or cannot be written to.
pub fn check_folder(folder: &Path) -> io::Result<()> {
    let nearest = folder
        .ancestors()
        .find(|folder| folder.as_os_str().is_empty() || folder.symlink_metadata().is_ok());
    let nearest = nearest
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    if !fs::metadata(nearest)?.is_dir() {
        return Err(refused(if nearest == folder {
            "a file stands where a folder is needed".into()
        } else {
            format!("{} is no folder", nearest.display())
        }));
    }
    Unfinished::create_next_to(&nearest.join("probe"))
        .map(drop)
        .map_err(|error| folder_error(nearest, &error))
}

/// Checks that no symbolic link leads from the folder `root`, or is it, to a file of a cache. They
/// are not followed: who can place a link could have any file read or replaced.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`], with the link.
pub fn refuse_links(root: &Path, file: &Path) -> io::Result<()> {
    let is_link = |path: &&Path| {
        path.symlink_metadata()
            .is_ok_and(|found| found.is_symlink())
    };
    let mut below = file.ancestors().take_while(|path| path.starts_with(root));
    match below.find(is_link) {
        Some(link) => Err(refused(format!(
            "{} is a symbolic link, which is not followed here; remove the link",
            link.display()
        ))),
        None => Ok(()),
    }
}

/// Declares `path` an input of this process: [`write_whole`] refuses to write to the same file
/// under any name (links, hard links, other spellings). Does nothing if there is no such file.
pub fn protect_input(path: &Path) {
    if let Some(identity) = identity(path) {
        lock(&INPUTS).insert(identity, path.to_owned());
    }
}

/// Writes a file through `write`, by the rule of this module.
///
/// # Errors
/// Errors of creating, writing, syncing or renaming; [`io::ErrorKind::InvalidInput`] if the rule
/// refuses the path. No message contains a temporary name.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> io::Result<()> {
    match target(path)? {
        Target::File(path, permissions) => replace(&path, permissions, write),
        Target::Stream(path) => {
            let mut whole = spool(write)?;
            // Does not create: if the device or FIFO has vanished, a regular file in its place
            // would be a surprise.
            let mut stream = OpenOptions::new().write(true).open(path)?;
            io::copy(&mut whole, &mut stream)?;
            stream.flush()
        }
        Target::StandardOutput => {
            let mut whole = spool(write)?;
            let mut stdout = io::stdout().lock();
            io::copy(&mut whole, &mut stdout)?;
            stdout.flush()
        }
    }
}

fn refused(why: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, why.into())
}

fn folder_error(folder: &Path, error: &io::Error) -> io::Error {
    io::Error::new(
        error.kind(),
        format!("no file can be made in {}: {error}", folder.display()),
    )
}

fn parent_folder(path: &Path) -> &Path {
    path.parent()
        .filter(|parent| !parent.as_os_str().is_empty())
        .unwrap_or(Path::new("."))
}

fn target(path: &Path) -> io::Result<Target> {
    if path.as_os_str() == STANDARD_OUTPUT {
        return Ok(Target::StandardOutput);
    }
    if path.as_os_str().is_empty() {
        return Err(refused("it has no name"));
    }
    if is_descriptor(path) {
        return Ok(Target::Stream(path.into()));
    }
    match fs::metadata(path) {
        Ok(found) if found.is_file() => Ok(Target::File(
            path.canonicalize()?,
            Some(found.permissions()),
        )),
        Ok(found) if found.is_dir() => {
            Err(refused("it is a folder; give the name of a file in it"))
        }
        Ok(found) if is_streamable(&found) => Ok(Target::Stream(path.into())),
        Ok(_) => Err(refused(
            "it is a block device or a socket, which are never written to",
        )),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            Ok(Target::File(follow_links(path)?, None))
        }
        Err(error) => Err(error),
    }
}

/// Returns true for names of open file descriptors: their owner decides about replacing the file,
/// and we write at the owner's position.
fn is_descriptor(path: &Path) -> bool {
    let is = |name: &str| path == Path::new(name);
    is("/dev/stdout")
        || is("/dev/stderr")
        || path.starts_with("/dev/fd")
        || path.starts_with("/proc")
}

/// Follows all links of a path that does not exist.
fn follow_links(path: &Path) -> io::Result<PathBuf> {
    let mut end = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match fs::read_link(&end) {
            Ok(link) => end = parent_folder(&end).join(link),
            Err(_) => return Ok(end),
        }
    }
    Err(refused("its symbolic links lead in a circle"))
}

#[cfg(unix)]
fn is_streamable(found: &Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    found.file_type().is_char_device() || found.file_type().is_fifo()
}

#[cfg(not(unix))]
fn is_streamable(_: &Metadata) -> bool {
    false
}

/// Identity of a file: device and inode.
#[cfg(unix)]
type Identity = (u64, u64);

#[cfg(unix)]
fn identity(path: &Path) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt;
    let found = fs::metadata(path).ok()?;
    found.is_file().then(|| (found.dev(), found.ino()))
}

/// Identity of a file without device and inode: the path behind all links.
#[cfg(not(unix))]
type Identity = PathBuf;

#[cfg(not(unix))]
fn identity(path: &Path) -> Option<Identity> {
    path.canonicalize().ok()
}

fn refuse_input(path: &Path) -> io::Result<()> {
    if identity(path).is_some_and(|identity| is_input(&identity)) {
        return Err(refused(
            "it is an input of this command, which would be lost; choose another name",
        ));
    }
    Ok(())
}

/// Returns true if a declared input still has this identity: after a deletion, the inode may be
/// reused.
fn is_input(wanted: &Identity) -> bool {
    let declared = lock(&INPUTS).get(wanted).cloned();
    declared.is_some_and(|path| identity(&path).as_ref() == Some(wanted))
}

/// Refuses a read-only file, which renaming would replace.
fn refuse_read_only(path: &Path) -> io::Result<()> {
    // Root can open read-only files, so the permission bits are tested too.
    let is_read_only = fs::metadata(path)?.permissions().readonly();
    if is_read_only || OpenOptions::new().write(true).open(path).is_err() {
        let why = "it is read-only; choose another name, or make it writable";
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, why));
    }
    Ok(())
}

fn replace(
    path: &Path,
    permissions: Option<Permissions>,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> io::Result<()> {
    if permissions.is_some() {
        refuse_input(path)?;
        refuse_read_only(path)?;
    }
    let folder = parent_folder(path);
    fs::create_dir_all(folder).map_err(|error| folder_error(folder, &error))?;
    let unfinished =
        Unfinished::create_next_to(path).map_err(|error| folder_error(folder, &error))?;
    write_buffered(unfinished.file(), write)?;
    if let Some(permissions) = permissions {
        unfinished.file().set_permissions(permissions)?;
    }
    unfinished.file().sync_all()?;
    fs::rename(unfinished.path(), path)
}

fn write_buffered(
    file: &File,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> io::Result<()> {
    let mut writer = BufWriter::with_capacity(1 << 20, file);
    write(&mut writer)?;
    writer.flush()
}

/// Writes a complete result to an unnamed temporary file, positioned at its beginning.
fn spool(write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<File> {
    let unfinished = Unfinished::create_next_to(&std::env::temp_dir().join("stream"))?;
    write_buffered(unfinished.file(), write)?;
    let mut file = unfinished.file().try_clone()?;
    file.rewind()?;
    Ok(file)
}
