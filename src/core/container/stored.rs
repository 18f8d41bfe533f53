//! Sections that stay on disk: parts of them are read when they are needed.
//!
//! They are read and not mapped: a mapped file that another program truncates ends the process by
//! SIGBUS, while a read ends in an error.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Section that stays on disk. Its checksum is not verified, as that would read all of it: content
/// that needs verification must have a checksum of its own.
#[derive(Clone, Debug)]
pub struct StoredSection {
    file: Arc<Mutex<File>>,
    bytes: Range<u64>,
}

impl StoredSection {
    /// Creates a section from a range of a file.
    pub(super) fn new(file: Arc<Mutex<File>>, bytes: Range<u64>) -> Self {
        Self { file, bytes }
    }

    /// Number of values in it; a partial one at the end is ignored.
    #[must_use]
    pub fn count<T: bytemuck::Pod>(&self) -> usize {
        (self.bytes.end - self.bytes.start) as usize / size_of::<T>().max(1)
    }

    /// Reads a range of its values.
    ///
    /// # Errors
    /// If they are beyond its end, or cannot be read, for example from a file truncated meanwhile.
    pub fn values<T: bytemuck::Pod>(&self, range: Range<usize>) -> io::Result<Vec<T>> {
        if range.start > range.end || range.end > self.count::<T>() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        // Within the length of the file when it was opened, so no larger than that.
        let mut values = vec![T::zeroed(); range.len()];
        let start = self.bytes.start + (range.start * size_of::<T>()) as u64;
        read_exact_at(&self.file, start, bytemuck::cast_slice_mut(&mut values))?;
        Ok(values)
    }
}

/// Fills `bytes` from a position of a file.
pub(super) fn read_exact_at(file: &Mutex<File>, start: u64, bytes: &mut [u8]) -> io::Result<()> {
    let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
    file.seek(SeekFrom::Start(start))?;
    file.read_exact(bytes)
}
