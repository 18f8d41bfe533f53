//! Captures within `--memory`: bytes of accumulators before they are spilled, number of threads.

use super::spill_folder;
use crate::messages::UsageError;
use headbox_core::memory;
use std::path::{Path, PathBuf};

/// Buffers of a thread for each pixel along a side of a face, bytes: rays and hits of a cell, the
/// accumulators of a tile, a test frame. 16 threads take 19 to 21 kB more each than one, on faces
/// of 128, 256 and 1,024 pixels.
const THREAD_BYTES_PER_PX: u64 = 20_000;

/// Memory of a capture on one thread that does not grow with its samples, bytes: 7 to 19 MB in
/// three scenes.
const FIXED_BYTES: f64 = 20e6;

/// Peak memory for each depth pixel if samples are spilled and freed memory is returned, bytes: the
/// surface samples of a face, and the LDI. 59 to 61 more for each, from faces of 256 to 512 and to
/// 1,024 pixels in two scenes.
const SPILLED_BYTES: f64 = 62.0;

/// Peak memory for each depth pixel, bytes, when the surface samples of all faces wait to be lit:
/// 170 to 283 in captures of two scenes, on two threads.
const MEMORY_BYTES: f64 = 250.0;

/// Suggestions of an error are for a peak that is this much larger.
const MARGIN: f64 = 1.05;

/// Limit of the memory of a capture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MemoryLimit {
    /// Limit, bytes.
    limit: u64,
    /// Peak of the resident memory before the capture, bytes: while its scene was loaded.
    peak: u64,
    /// Resident memory before the capture, with its scene, bytes.
    used: u64,
    face_size_px: u32,
}

impl MemoryLimit {
    /// Creates the limit of `--memory`, MiB, for faces of this size; `None` without one. The scene
    /// must be loaded.
    pub(crate) fn new(memory_mb: Option<u64>, face_size_px: u32) -> Option<Self> {
        let limit = memory_mb? << 20;
        let [peak, used] = memory::peak_and_resident().unwrap_or_default();
        Some(Self {
            limit,
            peak,
            used,
            face_size_px,
        })
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
        let capture = unlimited.min(self.limit as f64).max(least.min(unlimited));
        capture.max(self.peak as f64)
    }

    /// Refuses a capture whose peak, bytes, is beyond the limit. `alternative` is another way out,
    /// as in [`Self::smaller_faces`].
    ///
    /// # Errors
    /// If the limit cannot be kept: which one can, with a margin for the scatter of estimates.
    pub(crate) fn check(&self, peak: f64, alternative: &str) -> Result<(), UsageError> {
        if peak <= self.limit as f64 {
            return Ok(());
        }
        let [mib, more] = [peak, peak * MARGIN].map(|bytes| (bytes / f64::from(1 << 20)).ceil());
        bail_usage!(
            "--memory {}: loading the scene and capturing it take about {mib} MiB, even with samples \
             on disk; set --memory {more}{alternative}",
            self.limit >> 20
        );
    }

    /// Returns the option for faces that fit instead of those with about this number of depth
    /// pixels, with a margin for the scatter of estimates; empty if none do.
    pub(crate) fn smaller_faces(&self, depth_pixels: f64) -> String {
        let fixed = self.used as f64 + FIXED_BYTES;
        let share = (self.limit as f64 / MARGIN - fixed) / (SPILLED_BYTES * depth_pixels);
        let fits = (f64::from(self.face_size_px) * share.max(0.0).sqrt()).floor();
        if fits >= 1.0 && self.peak <= self.limit {
            format!(" or --face-size {fits}")
        } else {
            String::new()
        }
    }

    /// Bytes of accumulators in memory before they are spilled, and the folder to spill to, for a
    /// capture of about this number of depth pixels: what is left beside the LDI, because the
    /// allocator keeps the small blocks of spilled accumulators while the LDI grows.
    pub(crate) fn spill_budget(
        &self,
        depth_pixels: f64,
        threads: usize,
        output: &Path,
    ) -> (u64, PathBuf) {
        /// Least budget: smaller ones spill most of the time.
        const LEAST: u64 = 12 << 20;
        let buffers = self.thread_bytes() * (threads as u64 - 1);
        let left = self
            .limit
            .saturating_sub(self.least_bytes(depth_pixels) + buffers);
        (left.max(LEAST), spill_folder(output))
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

/// Returns the warning that a capture of about `peak` bytes does not fit into the memory of which
/// it uses `used` bytes and `free` bytes are left; `None` if it fits.
pub(crate) fn too_large_warning(peak: f64, used: u64, free: u64) -> Option<String> {
    let fits = used + free;
    if peak <= fits as f64 {
        return None;
    }
    let [needed, fits] = [peak, fits as f64].map(|bytes| (bytes / f64::from(1 << 20)) as u64);
    Some(format!(
        "warning: about {needed} MiB of memory are needed, but only {fits} MiB are there; with \
         --memory {} samples that do not fit are kept in a temporary file, and a smaller --face-size \
         needs less",
        fits / 10 * 9
    ))
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
            peak: 60_000_000,
            used: 50_000_000,
            face_size_px: 1000,
        }
    }

    #[test]
    fn threads_fit_beside_samples() {
        // 50 MB, 20 MB and 62 MB on one thread.
        for (megabytes, most, expected) in [
            (120, 16, 1),
            (151, 16, 1),
            (153, 16, 2),
            (173, 16, 3),
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
        assert_eq!(peak(1000, 4), 320.0, "less than the limit");
        assert_eq!(peak(220, 2), 220.0, "spills");
        assert_eq!(peak(120, 1), 132.0, "cannot be kept");
        let large_scene = MemoryLimit {
            peak: 400_000_000,
            ..limit(220)
        };
        assert_eq!(large_scene.peak_bytes(1e6, 1), 400e6, "was exceeded before");
    }

    #[test]
    fn capture_beyond_limit_is_refused() {
        let check = |limit: MemoryLimit| {
            let peak = limit.peak_bytes(1e6, 1);
            let checked = limit.check(peak, &limit.smaller_faces(1e6));
            checked.map_err(|error| error.to_string())
        };
        assert_eq!(check(limit(133)), Ok(()));
        // 120 MB are 114 MiB, 132 MB are 126 MiB; 44.3 of 62 MB are left for the samples.
        assert_eq!(
            check(limit(120)).expect_err("12 MB too much"),
            "--memory 114: loading the scene and capturing it take about 126 MiB, even with samples \
             on disk; set --memory 133 or --face-size 845"
        );
        let message = check(limit(69)).expect_err("not even without samples");
        assert!(message.ends_with("set --memory 133"), "{message}");
    }

    #[test]
    fn capture_larger_than_free_memory_is_announced() {
        let warning = |peak| too_large_warning(peak, 1 << 20, 99 << 20);
        assert_eq!(warning(100.0 * 1_048_576.0), None);
        let warning = warning(200.0 * 1_048_576.0).expect("twice as much");
        assert!(
            warning.contains("about 200 MiB") && warning.contains("only 100 MiB"),
            "{warning}"
        );
        assert!(warning.contains("--memory 90 "), "{warning}");
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
