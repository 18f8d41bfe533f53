//! What is kept between runs because it costs time to make: files in the user's cache folder, named by what they are made of.

use std::hash::{DefaultHasher, Hasher};
use std::path::PathBuf;

/// A folder in the user's cache folder, `headbox/NAME`, or `None` if the system has none.
pub fn folder(name: &str) -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let caches = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")))?;
    Some(caches.join("headbox").join(name))
}

/// The name of a file: a digest of all that `feed` writes, 128 bits of it, and an ending.
pub fn file_name(ending: &str, feed: impl Fn(&mut DefaultHasher)) -> String {
    let [first, second] = digest(feed);
    format!("{first:016x}{second:016x}.{ending}")
}

/// 128 bits of what `feed` writes.
pub fn digest(feed: impl Fn(&mut DefaultHasher)) -> [u64; 2] {
    [0, 1].map(|lane| {
        let mut hash = DefaultHasher::new();
        hash.write_u8(lane);
        feed(&mut hash);
        hash.finish()
    })
}
