//! Memory-mapped sections of our files: the system reads their pages on first access, and may drop
//! them at any time.

use memmap2::Mmap;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::sync::Arc;

/// Mapped section. Its checksum is not verified, as that would read all of it: content that needs
/// verification must have a checksum of its own.
#[derive(Clone, Debug)]
pub struct MappedSection {
    map: Arc<Mmap>,
    bytes: Range<usize>,
}

impl MappedSection {
    /// Creates a section from a range of a mapped file.
    pub(super) fn new(map: Arc<Mmap>, bytes: Range<usize>) -> Self {
        Self { map, bytes }
    }

    /// Returns its values; a partial one at the end is ignored.
    pub fn values<T: bytemuck::Pod>(&self) -> &[T] {
        let bytes = self.map.get(self.bytes.clone()).unwrap_or_default();
        let whole = bytes.len() - bytes.len() % size_of::<T>().max(1);
        // Sections begin at multiples of 64 bytes, and maps at those of pages.
        bytemuck::try_cast_slice(&bytes[..whole]).unwrap_or_default()
    }
}

/// Maps one of our files.
pub(super) fn map(file: &File) -> io::Result<Arc<Mmap>> {
    // SAFETY: our files are written under a temporary name and renamed once they are complete; none
    // of our programs modifies one afterwards. Only plain-old-data values are read from them, for
    // which all bytes are valid.
    let map = unsafe { Mmap::map(file) };
    map.map(Arc::new)
}
