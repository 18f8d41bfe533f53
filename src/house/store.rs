//! Backdrops in memory: built ahead of need by a thread in the background, the least recently used
//! thrown away first (R16).

use super::backdrop::{Backdrop, BackdropKind, BackdropQuality, PortalSide};
use super::house::House;
use headbox_core::lru::LruCache;
use std::collections::{HashSet, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// Key of a backdrop.
pub type Key = (PortalSide, BackdropKind);

/// Backdrops within a budget of bytes.
#[derive(Debug)]
pub struct Store {
    budget: u64,
    cache: Mutex<LruCache<Key, Arc<Backdrop>>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Store {
    /// An empty store that keeps at most so many bytes.
    pub fn new(budget_bytes: u64) -> Self {
        Self {
            budget: budget_bytes,
            cache: Mutex::default(),
        }
    }

    /// A backdrop, if it is there; it counts as used now.
    pub fn get(&self, key: Key) -> Option<Arc<Backdrop>> {
        let mut cache = lock(&self.cache);
        cache.next_tick();
        cache.get(key)
    }

    /// Returns true if a backdrop is in memory.
    pub fn contains(&self, key: Key) -> bool {
        lock(&self.cache).peek(key).is_some()
    }

    /// Returns true if one more backdrop of average size fits beside `bytes` bytes.
    fn has_room_beside(&self, bytes: u64) -> bool {
        let cache = lock(&self.cache);
        let one = cache.bytes() / (cache.len() as u64).max(1);
        bytes.saturating_add(one) <= self.budget
    }

    /// Adds a backdrop and throws out what was not used for longest until all fits the budget. One
    /// that alone exceeds the budget is not kept; `false` then.
    pub fn insert(&self, key: Key, backdrop: Arc<Backdrop>) -> bool {
        let bytes = backdrop.bytes();
        if bytes > self.budget {
            return false;
        }
        let mut cache = lock(&self.cache);
        cache.next_tick();
        cache.put(key, backdrop, bytes);
        let gone = cache.evict_to(self.budget);
        drop(cache);
        drop(gone);
        true
    }

    /// Bytes of all backdrops.
    pub fn bytes(&self) -> u64 {
        lock(&self.cache).bytes()
    }

    /// All backdrops, by key.
    pub fn all(&self) -> Vec<(Key, Arc<Backdrop>)> {
        lock(&self.cache)
            .iter()
            .map(|(key, backdrop)| (key, Arc::clone(backdrop)))
            .collect()
    }
}

/// A thread that captures wanted backdrops, the first in the list first, as long as those before
/// fit the store: nothing that is wanted more is thrown out for something that is wanted less. It
/// works alone, so that the threads that draw frames never wait for it. Stops when it is dropped,
/// after the capture at hand.
#[derive(Debug)]
pub struct BackdropBuilder {
    desk: Arc<BuildQueue>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct BuildQueue {
    orders: Mutex<QueueState>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct QueueState {
    wanted: VecDeque<Key>,
    /// Bytes of those that were taken from the front of the list since it was written.
    kept_bytes: u64,
    /// Could not be captured, or are larger than the whole budget: not tried again.
    refused: HashSet<Key>,
    busy: bool,
    stop: bool,
}

impl QueueState {
    fn in_hand(&self) -> bool {
        self.busy || !self.wanted.is_empty()
    }
}

impl BackdropBuilder {
    /// Starts the thread.
    pub fn new(house: Arc<House>, store: Arc<Store>, quality: BackdropQuality) -> Self {
        let desk = Arc::new(BuildQueue::default());
        let at_desk = Arc::clone(&desk);
        let thread = std::thread::spawn(move || work(&at_desk, &house, &store, &quality));
        Self {
            desk,
            thread: Some(thread),
        }
    }

    /// Replaces the list of wanted backdrops, the most urgent first.
    pub fn want(&self, keys: impl IntoIterator<Item = Key>) {
        let mut orders = lock(&self.desk.orders);
        orders.wanted = keys.into_iter().collect();
        orders.kept_bytes = 0;
        self.desk.changed.notify_all();
    }

    /// Returns true if a requested backdrop can still be built.
    pub fn is_busy(&self) -> bool {
        lock(&self.desk.orders).in_hand()
    }

    /// Waits until nothing is wanted that could still be built.
    pub fn wait(&self) {
        let mut orders = lock(&self.desk.orders);
        while orders.in_hand() {
            orders = self
                .desk
                .changed
                .wait(orders)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Drop for BackdropBuilder {
    fn drop(&mut self) {
        lock(&self.desk.orders).stop = true;
        self.desk.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been printed; there is nobody here to tell.
            let _ = thread.join();
        }
    }
}

fn work(desk: &BuildQueue, house: &House, store: &Store, quality: &BackdropQuality) {
    // Without a pool of its own it would borrow the threads of the frames.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().ok();
    let mut orders = lock(&desk.orders);
    while !orders.stop {
        let Some(key) = orders.wanted.pop_front() else {
            desk.changed.notify_all();
            orders = desk
                .changed
                .wait(orders)
                .unwrap_or_else(PoisonError::into_inner);
            continue;
        };
        if orders.refused.contains(&key) {
            continue;
        }
        if let Some(backdrop) = store.get(key) {
            orders.kept_bytes += backdrop.bytes();
            continue;
        }
        if !store.has_room_beside(orders.kept_bytes) {
            orders.wanted.clear();
            continue;
        }
        orders.busy = true;
        drop(orders);
        let capture = || Backdrop::capture(house, key.0, key.1, quality);
        let captured = match &pool {
            Some(pool) => pool.install(capture),
            None => capture(),
        };
        let bytes = captured.as_ref().map_or(0, Backdrop::bytes);
        let kept = captured.is_ok_and(|backdrop| store.insert(key, Arc::new(backdrop)));
        orders = lock(&desk.orders);
        orders.busy = false;
        if kept {
            orders.kept_bytes += bytes;
        } else {
            orders.refused.insert(key);
        }
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
