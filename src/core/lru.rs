//! LRU cache bounded in bytes: backdrops of portals (R16), images of cameras (E10).
//!
//! Time is counted in ticks, such as frames. Values used during the current tick are never evicted,
//! so that a frame keeps everything it needs even where that exceeds the budget.

use std::collections::BTreeMap;

/// Values by key, with their sizes in bytes and the tick of their last use.
#[derive(Debug)]
pub struct LruCache<K, V> {
    entries: BTreeMap<K, Entry<V>>,
    bytes: u64,
    tick: u64,
}

#[derive(Debug)]
struct Entry<V> {
    value: V,
    bytes: u64,
    last_used: u64,
}

impl<K, V> Default for LruCache<K, V> {
    fn default() -> Self {
        Self {
            entries: BTreeMap::new(),
            bytes: 0,
            tick: 0,
        }
    }
}

impl<K: Ord + Copy, V: Clone> LruCache<K, V> {
    /// Starts the next tick: no value counts as in use.
    pub fn next_tick(&mut self) {
        self.tick += 1;
    }

    /// Returns the value of `key`, if present, and marks it as used.
    pub fn get(&mut self, key: K) -> Option<V> {
        let entry = self.entries.get_mut(&key)?;
        entry.last_used = self.tick;
        Some(entry.value.clone())
    }

    /// Returns the value of `key`, if present, without marking it as used.
    pub fn peek(&self, key: K) -> Option<&V> {
        self.entries.get(&key).map(|entry| &entry.value)
    }

    /// Inserts or replaces a value of `bytes` bytes and marks it as used.
    pub fn put(&mut self, key: K, value: V, bytes: u64) {
        self.bytes += bytes;
        if let Some(replaced) = self.entries.insert(
            key,
            Entry {
                value,
                bytes,
                last_used: self.tick,
            },
        ) {
            self.bytes -= replaced.bytes;
        }
    }

    /// Evicts values until the others take at most `budget` bytes: least recently used first, ties
    /// by lowest key, none that is in use. Returns the evicted values, so that a caller that holds
    /// a lock can drop them after releasing it.
    pub fn evict_to(&mut self, budget: u64) -> Vec<V> {
        let mut evicted = Vec::new();
        while self.bytes > budget {
            let idle = self
                .entries
                .iter()
                .filter(|(_, entry)| entry.last_used < self.tick);
            let Some(oldest) = idle
                .min_by_key(|(key, entry)| (entry.last_used, **key))
                .map(|(key, _)| *key)
            else {
                break;
            };
            let Some(entry) = self.entries.remove(&oldest) else {
                break;
            };
            self.bytes -= entry.bytes;
            evicted.push(entry.value);
        }
        evicted
    }

    /// Total size of all values, bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Returns true if there is no value.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Iterates over all values in the order of their keys.
    pub fn iter(&self) -> impl Iterator<Item = (K, &V)> {
        self.entries.iter().map(|(key, entry)| (*key, &entry.value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(cache: &LruCache<u32, char>) -> Vec<u32> {
        cache.iter().map(|(key, _)| key).collect()
    }

    #[test]
    fn eviction_spares_values_in_use() {
        let mut cache = LruCache::default();
        for (key, value) in (0..5).zip("abcde".chars()) {
            cache.put(key, value, 10);
        }
        assert!(cache.evict_to(0).is_empty(), "all values are in use");
        cache.next_tick();
        assert_eq!((cache.get(1), cache.get(9)), (Some('b'), None));
        assert_eq!(
            (cache.evict_to(50).len(), cache.evict_to(30)),
            (0, vec!['a', 'c'])
        );
        cache.next_tick();
        cache.get(4);
        assert_eq!(cache.peek(3), Some(&'d'));
        assert_eq!(
            (cache.evict_to(20), keys(&cache)),
            (vec!['d'], vec![1, 4]),
            "peek does not mark as used"
        );
        assert_eq!(
            (cache.evict_to(1), cache.len()),
            (vec!['b'], 1),
            "the rest is in use"
        );
        cache.put(4, 'f', 25);
        assert_eq!((cache.bytes(), cache.peek(4)), (25, Some(&'f')));
    }
}
