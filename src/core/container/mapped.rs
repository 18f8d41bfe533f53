//! Sections of our files as they lie on disk, mapped into memory: what is not looked at is not
//! read, and what is can be let go of by the system at any time.

use memmap2::Mmap;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::sync::Arc;

/// A mapped section. Its checksum is not verified, which would be to read it: what is read of it
/// may need one of its own.
#[derive(Clone, Debug)]
pub struct MappedSection {
    map: Arc<Mmap>,
    bytes: Range<usize>,
}

impl MappedSection {
    /// Bytes of a mapped file.
    pub(super) fn new(map: Arc<Mmap>, bytes: Range<usize>) -> Self {
        Self { map, bytes }
    }

    /// Its values, as many as it holds whole ones of.
    pub fn values<T: bytemuck::Pod>(&self) -> &[T] {
        let bytes = self.map.get(self.bytes.clone()).unwrap_or_default();
        let whole = bytes.len() - bytes.len() % size_of::<T>().max(1);
        // Sections begin at multiples of 64 bytes, and maps at those of pages.
        bytemuck::try_cast_slice(&bytes[..whole]).unwrap_or_default()
    }
}

/// Maps a file of ours.
pub(super) fn map(file: &File) -> io::Result<Arc<Mmap>> {
    // SAFETY: our files are written under another name and renamed once they are whole; nothing of
    // ours changes one afterwards. What is looked up in them are plain values, of which any bytes
    // are one.
    let map = unsafe { Mmap::map(file) };
    map.map(Arc::new)
}
