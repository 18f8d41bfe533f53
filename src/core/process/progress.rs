//! Progress reporting and cancellation.

use std::io;

/// Receiver of the progress of long work. Called from many threads.
pub trait Progress: Sync {
    /// Starts a stage of `total` steps; `unit` names them ("rays", "tiles").
    fn begin(&self, stage: &str, unit: &str, total: u64);
    /// Adds `steps` completed steps.
    fn advance(&self, steps: u64);
    /// Returns true if the work should stop: it then soon returns an error of kind
    /// [`io::ErrorKind::Interrupted`], or a result that is discarded.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Returns an error of kind [`io::ErrorKind::Interrupted`] if the work is cancelled.
pub fn check_cancelled(progress: &dyn Progress) -> io::Result<()> {
    if progress.is_cancelled() {
        Err(io::ErrorKind::Interrupted.into())
    } else {
        Ok(())
    }
}

/// Progress receiver that ignores everything.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: &str, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
}
