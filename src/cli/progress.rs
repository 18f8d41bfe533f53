//! Progress bars on a terminal, nothing elsewhere.

use crate::progress::Progress;
use indicatif::{ProgressBar, ProgressStyle};

/// A bar on standard error, one stage after the other.
pub(super) struct Bar {
    bar: ProgressBar,
}

impl Bar {
    pub(super) fn new() -> Self {
        let bar = ProgressBar::new(0);
        let template = "{msg:>24} [{bar:30}] {percent:>3} %  {per_sec}, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar }
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Bar {
    fn begin(&self, stage: &str, unit: &str, total: u64) {
        self.bar.reset();
        self.bar.set_length(total);
        self.bar.set_message(format!("{stage} ({unit})"));
    }

    fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }
}
