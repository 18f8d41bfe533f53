//! Numbers in COLMAP's binary files.

use crate::ImagesError;
use std::path::Path;

/// Bounds-checked reader of little-endian numbers.
pub(super) struct ByteReader<'a> {
    pub(super) file: &'a Path,
    pub(super) rest: &'a [u8],
}

impl<'a> ByteReader<'a> {
    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], ImagesError> {
        let (taken, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or_else(|| self.truncated())?;
        self.rest = rest;
        Ok(taken)
    }

    /// Skips a list of items of a size: their number, and the items.
    pub(super) fn skip_list(&mut self, item_bytes: usize) -> Result<(), ImagesError> {
        let bytes = usize::try_from(self.u64()?)
            .ok()
            .and_then(|count| count.checked_mul(item_bytes));
        self.take(bytes.ok_or_else(|| self.truncated())?)?;
        Ok(())
    }

    pub(super) fn truncated(&self) -> ImagesError {
        ImagesError::field(
            self.file,
            "the file",
            "ends too early: it is truncated or not a COLMAP model",
        )
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], ImagesError> {
        let taken = self.take(N)?;
        taken.try_into().map_err(|_| self.truncated())
    }

    pub(super) fn u32(&mut self) -> Result<u32, ImagesError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(super) fn u64(&mut self) -> Result<u64, ImagesError> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    pub(super) fn f64(&mut self) -> Result<f64, ImagesError> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], ImagesError> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64()?;
        }
        Ok(numbers)
    }
}
