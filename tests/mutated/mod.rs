//! Seeded mutations of files, and a watch over the size of allocations.
#![allow(missing_docs, unreachable_pub)] // nobody but the tests reads it

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The largest allocation since it was last reset, bytes.
pub static LARGEST: AtomicUsize = AtomicUsize::new(0);

/// The system's allocator, which notes how much is asked for.
pub struct Watched;

// SAFETY: every call goes to the system's allocator unchanged; an atomic number is all that is added.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `alloc`, which is the system's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// SplitMix64.
pub struct Dice(pub u64);

impl Dice {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// 0..count, or 0.
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count.max(1) as u64) as usize
    }

    fn pick<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }
}

/// Numbers that break readers, as text.
const NUMBERS: [&str; 14] = [
    "0",
    "-1",
    "1",
    "255",
    "256",
    "65535",
    "65536",
    "2147483648",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "1e308",
    "-1e-308",
    "1e999",
];
/// Bytes that mean something to a parser of text.
const SIGNS: &[u8] = b"0123456789-./\\ \n\r\t\"{}[],:eE#nfvtrue";

/// One to four changes.
pub fn mutate(bytes: &mut Vec<u8>, dice: &mut Dice) {
    for _ in 0..1 + dice.below(4) {
        let at = dice.below(bytes.len() + 1);
        match dice.below(9) {
            0 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << dice.below(8);
                }
            }
            1 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = dice.bits() as u8;
                }
            }
            2 => {
                let sign = *dice.pick(SIGNS);
                bytes.insert(at, sign);
            }
            3 => {
                let end = (at + 1 + dice.below(24)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => bytes.truncate(at),
            5 => {
                let end = (at + dice.below(64)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = dice.below(bytes.len() + 1);
                bytes.splice(to..to, piece);
            }
            6 | 7 => replace_number(bytes, at, dice),
            _ => {
                let width = *dice.pick(&[2, 4, 8]);
                let value = *dice.pick(&[0u64, 1, 0x7f, 0x8000, 0xffff, 0x7fff_ffff, 0xffff_ffff, 1 << 40, u64::MAX]);
                let value = value.to_le_bytes();
                bytes.iter_mut().skip(at).take(width).zip(value).for_each(|(byte, new)| *byte = new);
            }
        }
    }
}

/// Replaces the digits at or after a place by another number.
fn replace_number(bytes: &mut Vec<u8>, from: usize, dice: &mut Dice) {
    let Some(start) = (from..bytes.len()).find(|&i| bytes[i].is_ascii_digit()) else { return };
    let in_number = |b: &u8| b.is_ascii_digit() || b".eE+-".contains(b);
    let end = (start..bytes.len()).find(|&i| !in_number(&bytes[i])).unwrap_or(bytes.len());
    let number = dice.pick(&NUMBERS).bytes();
    bytes.splice(start..end, number);
}

/// A headbox file taken apart: 16 bytes of magic, kind and version, and the sections.
pub struct Parts {
    head: Vec<u8>,
    sections: Vec<([u8; 12], Vec<u8>)>,
}

impl Parts {
    /// Of an undamaged file.
    pub fn of(file: &[u8]) -> Self {
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes")) as usize;
        let sections = (0..word(16)).map(|i| {
            let entry = 24 + 32 * i;
            let name = file[entry..entry + 12].try_into().expect("twelve bytes");
            (name, file[word(entry + 16)..word(entry + 16) + word(entry + 24)].to_vec())
        });
        Self { head: file[..16].to_vec(), sections: sections.collect() }
    }

    /// Changes what is in a section; every checksum will fit.
    pub fn mutate(&mut self, dice: &mut Dice) {
        let count = self.sections.len();
        // The first section says what the others hold.
        let which = if dice.below(3) > 0 { 0 } else { dice.below(count) };
        mutate(&mut self.sections[which].1, dice);
        if dice.below(20) == 0 {
            let from = dice.below(count);
            self.sections[which].1 = self.sections[from].1.clone();
        }
    }

    /// The file, with lengths and checksums that fit.
    pub fn file(&self) -> Vec<u8> {
        let mut at = 24 + 32 * self.sections.len();
        let (mut table, mut body) = (Vec::new(), Vec::new());
        for (name, bytes) in &self.sections {
            let start = at.next_multiple_of(64);
            body.resize(body.len() + start - at, 0);
            body.extend(bytes);
            at = start + bytes.len();
            table.extend(name);
            table.extend(crc32fast::hash(bytes).to_le_bytes());
            table.extend((start as u64).to_le_bytes());
            table.extend((bytes.len() as u64).to_le_bytes());
        }
        let count = (self.sections.len() as u32).to_le_bytes();
        [self.head.as_slice(), &count, &crc32fast::hash(&table).to_le_bytes(), &table, &body].concat()
    }
}
