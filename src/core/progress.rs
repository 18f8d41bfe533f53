//! How far long work is, and whether to give it up.

use std::io;

/// Where long work reports how far it is. Called from many threads.
pub trait Progress: Sync {
    /// A stage of `total` steps begins; `unit` names them ("rays", "tiles").
    fn begin(&self, stage: &str, unit: &str, total: u64);
    /// `steps` more are done.
    fn advance(&self, steps: u64);
    /// Whether the work should be given up: whoever does it then returns an error of kind
    /// [`io::ErrorKind::Interrupted`] soon, or something that nobody will look at.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// The error of work that was given up.
pub fn check_cancelled(progress: &dyn Progress) -> io::Result<()> {
    if progress.is_cancelled() {
        Err(io::ErrorKind::Interrupted.into())
    } else {
        Ok(())
    }
}

/// Reports to nobody.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: &str, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
}
