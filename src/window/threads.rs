//! Frames rendered with fewer threads than the program uses elsewhere.

use headbox_core::view::RENDERING;
use headbox_viewer::{Setting, SettingValues};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

/// Pools of fewer threads than the program uses elsewhere, created on first use.
#[derive(Default)]
pub(super) struct FewerThreads(BTreeMap<usize, ThreadPool>);

impl FewerThreads {
    /// Setting of the number of threads that draw a frame.
    pub(super) fn setting() -> Setting {
        let cores = rayon::current_num_threads() as u32;
        Setting::count(
            "threads",
            "Threads",
            "Number of threads that draw a frame.",
            cores,
            1..=cores,
        )
        .folded_under(RENDERING)
    }

    /// Runs `work` on the number of threads that [`Self::setting`] specifies, or on the program's
    /// own threads if there are no more of them.
    ///
    /// # Errors
    /// One sentence, if there is no such setting or threads cannot be started.
    pub(super) fn install<R: Send>(
        &mut self,
        values: &SettingValues,
        work: impl FnOnce() -> R + Send,
    ) -> Result<R, String> {
        let count = values.number("threads")? as usize;
        if count >= rayon::current_num_threads() {
            return Ok(work());
        }
        let pool = match self.0.entry(count) {
            Entry::Occupied(pool) => pool.into_mut(),
            Entry::Vacant(place) => {
                let pool = ThreadPoolBuilder::new()
                    .num_threads(count)
                    .thread_name(|i| format!("frame {i}"))
                    .build();
                place.insert(
                    pool.map_err(|error| format!("Cannot start {count} threads: {error}."))?,
                )
            }
        };
        Ok(pool.install(work))
    }
}
