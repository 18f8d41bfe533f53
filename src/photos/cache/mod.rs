//! Cache of expensive results between runs: files in the user's cache folder, named by a hash of
//! their inputs.
//!
//! A result about an image set is found again by the name that [`views_file_name`] gives it, the
//! only place that decides whether a set is unchanged. A damaged file is recomputed, with a note to
//! the user ([`read`]). The least recently used files are removed to respect a size limit
//! ([`evict_to`]).

mod eviction;
mod neighbors;
mod refinement;
mod registration;

pub use eviction::{FileLock, MOST_BYTES, evict_to};
pub use neighbors::{DepthDoubts, compare_neighbors};
pub use refinement::refine_poses;
pub use registration::register;

use glam::{DMat3, DVec3};
use headbox_core::container::FileError;
use headbox_core::files;
use headbox_images::{Pose, View};
use std::hash::{DefaultHasher, Hasher};
use std::io;
use std::path::{Path, PathBuf};

/// Name of the folder of all caches.
const PROGRAM: &str = "headbox";

/// Name of the folder with the results about image sets.
pub const IMAGES: &str = "images";

/// Returns the folder `headbox/NAME` in the user's cache folder, or `None` if the system has none.
pub fn folder(name: &str) -> Option<PathBuf> {
    let absolute = |name: &str| {
        std::env::var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let caches = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")))?;
    Some(caches.join(PROGRAM).join(name))
}

/// Returns a file name: 128 bits of a digest of everything that `feed` writes, and an extension.
pub fn file_name(ending: &str, feed: impl Fn(&mut DefaultHasher)) -> String {
    let [first, second] = digest(feed);
    format!("{first:016x}{second:016x}.{ending}")
}

/// Returns 128 bits of a digest of everything that `feed` writes.
pub fn digest(feed: impl Fn(&mut DefaultHasher)) -> [u64; 2] {
    [0, 1].map(|lane| {
        let mut hash = DefaultHasher::new();
        hash.write_u8(lane);
        feed(&mut hash);
        hash.finish()
    })
}

/// Returns the name of the file with a result about `views`: a digest of their description in the
/// set, the sizes and modification times of their files, and the method `how`. `None` if a file of
/// a view no longer exists.
pub fn views_file_name(ending: &str, how: &str, views: &[View]) -> Option<String> {
    let mut parts = vec![how.to_owned()];
    for view in views {
        parts.push(format!("{view:?}"));
        let depth = view.depth.as_ref().map(|depth| &depth.path);
        for file in [Some(&view.color), depth, view.mask.as_ref()]
            .into_iter()
            .flatten()
        {
            let metadata = std::fs::metadata(file).ok()?;
            parts.push(format!(
                "{} {:?}",
                metadata.len(),
                metadata.modified().ok()?
            ));
        }
    }
    Some(file_name(ending, |hash| {
        parts.iter().for_each(|part| hash.write(part.as_bytes()));
    }))
}

/// A [`Pose`] in a file.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct PoseRecord {
    eye: DVec3,
    world_from_eye: DMat3,
}

impl From<Pose> for PoseRecord {
    fn from(pose: Pose) -> Self {
        Self {
            eye: pose.eye,
            world_from_eye: pose.world_from_eye,
        }
    }
}

impl From<PoseRecord> for Pose {
    fn from(record: PoseRecord) -> Self {
        Self {
            eye: record.eye,
            world_from_eye: record.world_from_eye,
        }
    }
}

/// Origin of a cacheable result.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CacheOrigin {
    /// True if it was read from the cache.
    pub kept: bool,
    /// Reason why the cached file could not be used: a sentence.
    pub note: Option<String>,
}

/// Returns the path of a cached file, or a note if a symbolic link leads to it, which is not
/// followed.
pub fn refuse_links(file: Option<PathBuf>) -> (Option<PathBuf>, Option<String>) {
    let Some(file) = file else {
        return (None, None);
    };
    let folder = file.parent().unwrap_or(Path::new(""));
    // The folder of all caches is ours, too.
    let above = folder.parent().filter(|above| above.ends_with(PROGRAM));
    match files::refuse_links(above.unwrap_or(folder), &file) {
        Ok(()) => (Some(file), None),
        Err(link) => (None, Some(format!("the cache is not used: {link}"))),
    }
}

/// Reads a cached file with `open`; if it is absent or damaged, calls `make` and writes the result.
fn read_or_make<T, E>(
    folder: Option<&Path>,
    name: Option<String>,
    open: impl FnOnce(&Path) -> Result<T, FileError>,
    make: impl FnOnce() -> Result<T, E>,
    write: impl FnOnce(&Path, &T) -> Result<(), FileError>,
) -> Result<(T, CacheOrigin), E> {
    let (file, link) = refuse_links(folder.zip(name).map(|(folder, name)| folder.join(name)));
    let (kept, note) = file
        .as_deref()
        .map_or((None, link), |file| read(file, open));
    if let Some(kept) = kept {
        // It was read; failing to mark it as used does no harm.
        let _ = file.as_deref().map(FileLock::of);
        return Ok((kept, CacheOrigin { kept: true, note }));
    }
    let made = make()?;
    // A cache that cannot be written only costs time.
    if let Some((file, folder)) = file.as_deref().zip(folder)
        && write(file, &made).is_ok()
    {
        evict_to(folder, MOST_BYTES);
    }
    Ok((made, CacheOrigin { kept: false, note }))
}

/// Reads a cached file, if present; an unreadable one gives the reason in a sentence.
pub fn read<T>(
    path: &Path,
    read: impl FnOnce(&Path) -> Result<T, FileError>,
) -> (Option<T>, Option<String>) {
    match read(path) {
        Ok(kept) => (Some(kept), None),
        Err(FileError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
            (None, None)
        }
        Err(error) => (None, Some(format!("{error}; it is made anew"))),
    }
}
