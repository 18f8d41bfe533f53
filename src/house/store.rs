//! Backdrops in memory: an LRU cache that a background thread fills ahead of need (R16).

use super::backdrop::{Backdrop, BackdropKind, BackdropQuality, PortalSide};
use super::house::House;
use headbox_core::lru::LruCache;
use headbox_core::progress::Progress;
use headbox_core::task::{Shared, Task};
use std::collections::{HashSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Key of a backdrop.
pub type Key = (PortalSide, BackdropKind);

/// Backdrops within a budget of bytes.
#[derive(Debug)]
pub struct Store {
    budget: u64,
    cache: Mutex<LruCache<Key, Arc<Backdrop>>>,
}

impl Store {
    /// Creates an empty store that keeps at most `budget_bytes`.
    pub fn new(budget_bytes: u64) -> Self {
        Self {
            budget: budget_bytes,
            cache: Mutex::default(),
        }
    }

    /// Returns a backdrop, if it is in memory, and marks it as used now.
    pub fn get(&self, key: Key) -> Option<Arc<Backdrop>> {
        let mut cache = self.lock();
        cache.next_tick();
        cache.get(key)
    }

    /// Returns true if a backdrop is in memory.
    pub fn contains(&self, key: Key) -> bool {
        self.lock().peek(key).is_some()
    }

    fn lock(&self) -> MutexGuard<'_, LruCache<Key, Arc<Backdrop>>> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns true if one more backdrop of average size fits beside `bytes` bytes.
    fn has_room_beside(&self, bytes: u64) -> bool {
        let cache = self.lock();
        let one = cache.bytes() / (cache.len() as u64).max(1);
        bytes.saturating_add(one) <= self.budget
    }

    /// Adds a backdrop and evicts the least recently used ones until the rest fits the budget.
    /// Returns false, without adding it, if the backdrop alone exceeds the budget.
    pub fn insert(&self, key: Key, backdrop: Arc<Backdrop>) -> bool {
        let bytes = backdrop.bytes();
        if bytes > self.budget {
            return false;
        }
        let mut cache = self.lock();
        cache.next_tick();
        cache.put(key, backdrop, bytes);
        let gone = cache.evict_to(self.budget);
        drop(cache);
        drop(gone);
        true
    }

    /// Bytes of all backdrops.
    pub fn bytes(&self) -> u64 {
        self.lock().bytes()
    }

    /// All backdrops, by key.
    pub fn all(&self) -> Vec<(Key, Arc<Backdrop>)> {
        self.lock()
            .iter()
            .map(|(key, backdrop)| (key, Arc::clone(backdrop)))
            .collect()
    }
}

/// A thread that captures the requested backdrops in order of urgency, as long as they fit the
/// store: a less urgent backdrop never evicts a more urgent one. It uses no thread that draws
/// frames, and ends after the current capture when it is dropped.
#[derive(Debug)]
pub struct BackdropBuilder {
    /// `None` if the system could not start a thread: no backdrop is built then.
    task: Option<Task<BuildQueue>>,
}

#[derive(Debug, Default)]
struct BuildQueue {
    /// Requested backdrops, the most urgent first.
    requested: VecDeque<Key>,
    /// Bytes of the backdrops that were taken from the front of the queue since it was replaced.
    kept_bytes: u64,
    /// Backdrops that cannot be captured or exceed the whole budget; they are not tried again.
    refused: HashSet<Key>,
    /// True while a backdrop is captured.
    busy: bool,
}

impl BackdropBuilder {
    /// Starts the thread.
    pub fn new(house: Arc<House>, store: Arc<Store>, quality: BackdropQuality) -> Self {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let work = move |shared: &Shared<BuildQueue>| {
            build_requested(shared, &house, &store, &quality);
            Ok(())
        };
        let start = |pool| Task::start("backdrops", pool, BuildQueue::default(), work).ok();
        Self {
            task: pool.ok().and_then(start),
        }
    }

    /// Replaces the queue by `keys`, the most urgent first.
    pub fn request(&self, keys: impl IntoIterator<Item = Key>) {
        if let Some(task) = &self.task {
            task.update(|state| {
                state.data.requested = keys.into_iter().collect();
                state.data.kept_bytes = 0;
            });
        }
    }

    /// Returns true if a requested backdrop can still be built.
    pub fn is_busy(&self) -> bool {
        let is_busy = |task: &Task<BuildQueue>| {
            let state = task.lock();
            !state.ended && state.data.has_work()
        };
        self.task.as_ref().is_some_and(is_busy)
    }

    /// Waits until no requested backdrop can still be built.
    pub fn wait(&self) {
        if let Some(task) = &self.task {
            drop(task.wait_while(|state| !state.ended && state.data.has_work()));
        }
    }
}

impl BuildQueue {
    fn has_work(&self) -> bool {
        self.busy || !self.requested.is_empty()
    }

    /// Takes the most urgent backdrop that is neither refused nor in the store, and empties the
    /// queue if there is no room for it.
    fn next(&mut self, store: &Store) -> Option<Key> {
        while let Some(key) = self.requested.pop_front() {
            if self.refused.contains(&key) {
                continue;
            }
            if let Some(backdrop) = store.get(key) {
                self.kept_bytes += backdrop.bytes();
            } else if store.has_room_beside(self.kept_bytes) {
                self.busy = true;
                return Some(key);
            } else {
                self.requested.clear();
            }
        }
        None
    }
}

/// Captures requested backdrops until the task is cancelled.
fn build_requested(
    shared: &Shared<BuildQueue>,
    house: &House,
    store: &Store,
    quality: &BackdropQuality,
) {
    while !shared.is_cancelled() {
        let Some(key) = shared.update(|state| state.data.next(store)) else {
            drop(
                shared
                    .wait_while(|state| state.data.requested.is_empty() && !shared.is_cancelled()),
            );
            continue;
        };
        let captured = Backdrop::capture(house, key.0, key.1, quality);
        let bytes = captured.as_ref().map_or(0, Backdrop::bytes);
        let kept = captured.is_ok_and(|backdrop| store.insert(key, Arc::new(backdrop)));
        shared.update(|state| {
            state.data.busy = false;
            if kept {
                state.data.kept_bytes += bytes;
            } else {
                state.data.refused.insert(key);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(portal: u32) -> Key {
        (PortalSide { portal, side: 0 }, BackdropKind::Texture)
    }

    #[test]
    fn the_least_recently_used_goes_first() {
        let store = Store::new(0);
        assert!(
            store.insert(key(0), Arc::new(Backdrop::Cubes(Vec::new()))),
            "nothing fits into nothing"
        );
        let cube = || {
            let environment = headbox_core::environment::Environment {
                size_px: 1,
                texels: vec![[0; 4]; 6],
            };
            let info = headbox_cube::model::info::CaptureInfo::default();
            let layout = headbox_cube::pack::SplatIndexLayout::Normal;
            let segments = Vec::new();
            Arc::new(Backdrop::Cubes(vec![headbox_cube::pack::CubeLdi {
                info,
                face_size_px: 8,
                layout,
                segments,
                environment,
                planes: headbox_cube::pack::PlaneSet::default(),
            }]))
        };
        assert_eq!(
            (cube().bytes(), store.insert(key(1), cube())),
            (24, false),
            "larger than the budget"
        );
        let store = Store::new(60);
        assert!(store.insert(key(1), cube()) && store.insert(key(2), cube()));
        assert!(store.get(key(1)).is_some());
        assert!(store.insert(key(3), cube()));
        assert_eq!(
            store
                .all()
                .iter()
                .map(|(key, _)| key.0.portal)
                .collect::<Vec<_>>(),
            [1, 3]
        );
        assert!(store.insert(key(3), cube()));
        assert_eq!(store.bytes(), 48);
    }
}
