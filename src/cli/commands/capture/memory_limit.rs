//! Captures within `--memory`: bytes of accumulators before they are spilled, number of threads.

use super::spill_folder;
use headbox_core::memory;
use std::path::{Path, PathBuf};

/// Buffers of a thread for each pixel along a side of a face, bytes: rays and hits of a cell, the
/// accumulators of a tile, a test frame. 16 threads take 19 to 21 kB more each than one, on faces of
/// 128, 256 and 1,024 pixels.
const THREAD_BYTES_PER_PX: u64 = 20_000;

/// Memory of a capture on one thread that does not grow with its samples, bytes.
const FIXED_BYTES: f64 = 24e6;

/// Peak memory for each depth pixel if samples are spilled, bytes: the surface samples of a face,
/// and the LDI. 81 to 106 in three scenes.
const SPILLED_BYTES: f64 = 95.0;

/// Peak memory for each depth pixel, bytes, when the surface samples of all faces wait to be lit:
/// 170 to 283 in captures of two scenes, on two threads.
const MEMORY_BYTES: f64 = 250.0;

/// Limit of the memory of a capture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MemoryLimit {
    /// Limit, bytes.
    limit: u64,
    /// Resident memory before the capture, with its scene, bytes.
    used: u64,
    face_size_px: u32,
}

impl MemoryLimit {
    /// Creates the limit of `--memory`, MiB, for faces of this size; `None` without one. The scene
    /// must be loaded.
    pub(crate) fn new(memory_mb: Option<u64>, face_size_px: u32) -> Option<Self> {
        Some(Self {
            limit: memory_mb? << 20,
            used: memory::peak_and_resident().map_or(0, |[_, now]| now),
            face_size_px,
        })
    }

    /// Limit, bytes.
    pub(crate) fn bytes(&self) -> f64 {
        self.limit as f64
    }

    fn thread_bytes(&self) -> u64 {
        THREAD_BYTES_PER_PX * u64::from(self.face_size_px)
    }

    /// Peak memory of a capture of about this number of depth pixels on one thread that spills what
    /// it can, bytes.
    fn least_bytes(&self, depth_pixels: f64) -> u64 {
        self.used + (FIXED_BYTES + SPILLED_BYTES * depth_pixels) as u64
    }

    /// Number of threads, at most `most`, whose buffers fit beside about this number of depth
    /// pixels: one if nothing fits.
    pub(crate) fn threads(&self, depth_pixels: f64, most: usize) -> usize {
        let left = self.limit.saturating_sub(self.least_bytes(depth_pixels));
        let more = left / self.thread_bytes().max(1);
        most.min(1 + usize::try_from(more).unwrap_or(usize::MAX))
    }

    /// Estimates the peak memory on a number of threads, bytes: at most the limit if that can be
    /// kept.
    pub(crate) fn peak_bytes(&self, depth_pixels: f64, threads: usize) -> f64 {
        let buffers = self.thread_bytes() * (threads as u64 - 1);
        let unlimited = unlimited_bytes(self.used as f64, depth_pixels);
        let least = (self.least_bytes(depth_pixels) + buffers) as f64;
        unlimited.min(self.limit as f64).max(least.min(unlimited))
    }

    /// Bytes of accumulators in memory before they are spilled, and the folder to spill to.
    pub(crate) fn spill_budget(&self, threads: usize, output: &Path) -> (u64, PathBuf) {
        /// Least memory for thread buffers, the heads of tiles, and the sorting of a tile.
        const RESERVE: u64 = 96 << 20;
        /// The rest is shared with the LDI that grows at the end, while the allocator still holds
        /// the memory of freed accumulators.
        const SHARE: u64 = 2;
        /// Least budget: smaller ones spill most of the time.
        const LEAST: u64 = 16 << 20;
        let reserve = RESERVE.max(self.thread_bytes() * threads as u64);
        let left = self.limit.saturating_sub(self.used + reserve);
        ((left / SHARE).max(LEAST), spill_folder(output))
    }

    /// Warns if the process has taken more than the limit.
    pub(crate) fn warn_if_exceeded(&self) {
        let peak = memory::peak_and_resident().map_or(0, |[peak, _]| peak);
        if peak > self.limit {
            eprintln!(
                "warning: the capture took {} MiB of memory, more than --memory allows ({} MiB); a \
                 smaller --face-size or fewer --threads take less",
                peak >> 20,
                self.limit >> 20
            );
        }
    }
}

/// Estimates the peak memory of a capture without a limit, bytes.
pub(crate) fn unlimited_bytes(used: f64, depth_pixels: f64) -> f64 {
    used + FIXED_BYTES + MEMORY_BYTES * depth_pixels
}

/// Runs work on a number of threads: those of the process if they are no more.
///
/// # Errors
/// If threads cannot be started.
pub(crate) fn run_on<R: Send>(
    threads: usize,
    work: impl FnOnce() -> R + Send,
) -> Result<R, rayon::ThreadPoolBuildError> {
    if threads >= rayon::current_num_threads() {
        return Ok(work());
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    Ok(pool.install(work))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Faces of 1,000 pixels: a thread takes 20 MB.
    fn limit(megabytes: u64) -> MemoryLimit {
        MemoryLimit {
            limit: megabytes * 1_000_000,
            used: 50_000_000,
            face_size_px: 1000,
        }
    }

    #[test]
    fn threads_fit_beside_samples() {
        // 50 MB, 24 MB and 95 MB on one thread.
        for (megabytes, most, expected) in [
            (150, 16, 1),
            (188, 16, 1),
            (190, 16, 2),
            (210, 16, 3),
            (1000, 16, 16),
            (300, 2, 2),
        ] {
            assert_eq!(
                limit(megabytes).threads(1e6, most),
                expected,
                "{megabytes} MB"
            );
        }
    }

    #[test]
    fn estimate_is_limit_only_where_that_can_be_kept() {
        let peak = |megabytes: u64, threads| limit(megabytes).peak_bytes(1e6, threads) / 1e6;
        assert_eq!(peak(1000, 4), 324.0, "less than the limit");
        assert_eq!(peak(220, 2), 220.0, "spills");
        assert_eq!(peak(150, 1), 169.0, "cannot be kept");
    }

    #[test]
    fn work_runs_on_fewer_threads() {
        assert_eq!(run_on(1, rayon::current_num_threads).expect("one"), 1);
        let all = rayon::current_num_threads();
        assert_eq!(
            run_on(all + 9, rayon::current_num_threads).expect("all"),
            all
        );
    }
}
