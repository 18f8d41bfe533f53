//! What is kept in memory within a budget of bytes: backdrops of portals (R16) and pictures of cameras (E10). What was used longest ago
//! makes room.
//!
//! Time goes by in moments, such as frames. What was used at the present one makes no room, so that a frame has all it wants at
//! hand even where that alone takes more than the budget.

use std::collections::BTreeMap;

/// Values by key, each of so many bytes and last used at some moment.
#[derive(Debug)]
pub struct Shelves<K, V> {
    held: BTreeMap<K, Held<V>>,
    bytes: u64,
    now: u64,
}

#[derive(Debug)]
struct Held<V> {
    value: V,
    bytes: u64,
    last_used: u64,
}

impl<K, V> Default for Shelves<K, V> {
    fn default() -> Self {
        Self {
            held: BTreeMap::new(),
            bytes: 0,
            now: 0,
        }
    }
}

impl<K: Ord + Copy, V: Clone> Shelves<K, V> {
    /// From now on nothing has been used yet.
    pub fn next_moment(&mut self) {
        self.now += 1;
    }

    /// A value, if it is there; it counts as used now.
    pub fn take_down(&mut self, key: K) -> Option<V> {
        let held = self.held.get_mut(&key)?;
        held.last_used = self.now;
        Some(held.value.clone())
    }

    /// A value, if it is there, without any use of it.
    pub fn look_at(&self, key: K) -> Option<&V> {
        self.held.get(&key).map(|held| &held.value)
    }

    /// Puts a value in its place, where none or another was; it counts as used now.
    pub fn put(&mut self, key: K, value: V, bytes: u64) {
        self.bytes += bytes;
        if let Some(before) = self.held.insert(
            key,
            Held {
                value,
                bytes,
                last_used: self.now,
            },
        ) {
            self.bytes -= before.bytes;
        }
    }

    /// Lets values go until the others fit into so many bytes, those used longest ago first, of these the lowest key, but none that is used
    /// now. They are returned, so that whoever holds a lock can drop them without it.
    pub fn make_room(&mut self, budget: u64) -> Vec<V> {
        let mut gone = Vec::new();
        while self.bytes > budget {
            let idle = self
                .held
                .iter()
                .filter(|(_, held)| held.last_used < self.now);
            let Some(oldest) = idle
                .min_by_key(|(key, held)| (held.last_used, **key))
                .map(|(key, _)| *key)
            else {
                break;
            };
            let Some(held) = self.held.remove(&oldest) else {
                break;
            };
            self.bytes -= held.bytes;
            gone.push(held.value);
        }
        gone
    }

    /// Bytes of all values.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// How many values there are.
    pub fn len(&self) -> usize {
        self.held.len()
    }

    /// All values, by key.
    pub fn iter(&self) -> impl Iterator<Item = (K, &V)> {
        self.held.iter().map(|(key, held)| (*key, &held.value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(shelves: &Shelves<u32, char>) -> Vec<u32> {
        shelves.iter().map(|(key, _)| key).collect()
    }

    #[test]
    fn what_was_used_longest_ago_makes_room_but_nothing_that_is_used_now() {
        let mut shelves = Shelves::default();
        for (key, value) in (0..5).zip("abcde".chars()) {
            shelves.put(key, value, 10);
        }
        assert!(shelves.make_room(0).is_empty(), "all are used now");
        shelves.next_moment();
        assert_eq!(
            (shelves.take_down(1), shelves.take_down(9)),
            (Some('b'), None)
        );
        assert_eq!(
            (shelves.make_room(50).len(), shelves.make_room(30)),
            (0, vec!['a', 'c'])
        );
        shelves.next_moment();
        shelves.take_down(4);
        assert_eq!(shelves.look_at(3), Some(&'d'));
        assert_eq!(
            (shelves.make_room(20), keys(&shelves)),
            (vec!['d'], vec![1, 4]),
            "a look is no use"
        );
        assert_eq!(
            (shelves.make_room(1), shelves.len()),
            (vec!['b'], 1),
            "the rest is used now"
        );
        shelves.put(4, 'f', 25);
        assert_eq!((shelves.bytes(), shelves.look_at(4)), (25, Some(&'f')));
    }
}
