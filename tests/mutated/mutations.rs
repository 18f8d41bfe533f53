//! Seeded mutations of files, and an allocator that records the largest allocation and the sum of
//! all.
//!
//! Without a variable each kind of file is tried a fixed number of times, with the same seeds.
//! `HEADBOX_FUZZ_SECONDS` tries each kind for that time, from the seed `HEADBOX_FUZZ_SEED` on
//! (`.ci/fuzz`). Input that fails is kept in `target/fuzz`.
#![allow(
    missing_docs,
    unreachable_pub,
    unsafe_code,
    dead_code,
    reason = "nobody but the tests reads it, and not every test all of it"
)]

use crate::mend;
use headbox_core::memory::set_limit;
use headbox_core::random::Rng;
use std::alloc::{GlobalAlloc, Layout, System};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use std::time::{Duration, Instant};

/// The largest allocation since it was last reset, bytes.
pub static LARGEST: AtomicUsize = AtomicUsize::new(0);
/// Bytes that are allocated now.
static LIVE: AtomicUsize = AtomicUsize::new(0);
/// The largest number of them since it was last reset.
static PEAK: AtomicUsize = AtomicUsize::new(0);

/// The system's allocator, which records the largest requested size and the sum of all.
pub struct RecordingAllocator;

fn record(bytes: usize) {
    LARGEST.fetch_max(bytes, Ordering::Relaxed);
    let before = LIVE.fetch_add(bytes, Ordering::Relaxed);
    PEAK.fetch_max(before.wrapping_add(bytes), Ordering::Relaxed);
}

// SAFETY: every call goes to the system's allocator unchanged; only atomic counters are added.
unsafe impl GlobalAlloc for RecordingAllocator {
    // SAFETY: as the trait asks; the size is noted, and the call handed on unchanged.
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        record(layout.size());
        // SAFETY: the caller keeps the contract of `alloc`, which is the system's.
        unsafe { System.alloc(layout) }
    }

    // SAFETY: as the trait asks; the size is noted, and the call handed on unchanged.
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        record(layout.size());
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    // SAFETY: as the trait asks; the size is noted, and the call handed on unchanged.
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        record(size);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }

    // SAFETY: as the trait asks; the size is noted, and the call handed on unchanged.
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: RecordingAllocator = RecordingAllocator;

/// Budget of decoders, as `--memory` sets it.
const BUDGET_BYTES: u64 = 256 << 20;
/// Maximum size of a single allocation. The largest one of a valid small file is the head of an
/// accumulator store for the largest allowed face (8,192 px), some tens of MiB; a picture may take
/// the budget. An unchecked count would request gigabytes.
const MOST_BYTES: usize = 256 << 20;
/// Kinds of files whose readers allocate in proportion to the file: geometry, also compressed, and
/// uncompressed images. Other images have no such bound: a valid PNG may expand 1032 times, a blank
/// row of a TIFF (CCITT G4) has one bit, and a WebP of one colour has the same size at any width.
const PROPORTIONAL: [&str; 10] = [
    "a.obj",
    "a.ply",
    "a.stl",
    "a.glb",
    "chunks.glb",
    "draco.glb",
    "meshopt.glb",
    "a.npy",
    "a.bin",
    "encodings",
];
/// Maximum size of a single allocation for these, as a multiple of the size of all files of the
/// case, beside [`SMALL_BYTES`].
const MOST_TIMES: usize = 10;
/// Size up to which allocations do not depend on the file: buffers of readers and threads.
const SMALL_BYTES: usize = 64 << 10;
/// Maximum sum of all allocations: the budget, and as much for what is not counted in it.
const MOST_LIVE_BYTES: usize = 2 * BUDGET_BYTES as usize;
/// Time after which a reader is too slow. A development build takes at most a fifth of it for a
/// file that declares as much as the budget allows.
const MOST_TIME: Duration = Duration::from_secs(20);
/// Number of mutations of each kind of file.
const CASES: u64 = 400;
/// Pause between two mutations above which it is due to the machine and does not count.
const LONGEST: Duration = Duration::from_secs(2);

/// The only test that runs. The allocator records what every thread requests, so that a test takes
/// this before it builds its first file; else its originals count as another test's reader.
pub struct Alone(MutexGuard<'static, ()>);

impl Alone {
    /// Waits until no other test runs.
    pub fn lock() -> Self {
        static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
        set_limit(BUDGET_BYTES);
        Self(ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Tries mutations of the originals, for a number of cases or a time.
    pub fn try_mutations(
        &self,
        name: &str,
        originals: &[Vec<u8>],
        in_sections: bool,
        read: impl Fn(&Path) -> bool,
    ) {
        let mutant = |original: &[u8], rng: &mut MutationRng| match in_sections {
            true if rng.below(4) > 0 => {
                let mut parts = Parts::parse(original);
                parts.mutate(rng);
                parts.file()
            }
            _ => mutant_of(name, original, rng),
        };
        let folders: Vec<Files> = originals
            .iter()
            .map(|original| vec![(name.to_owned(), original.clone())])
            .collect();
        try_cases(name, &folders, mutant, |folder| read(&folder.join(name)));
    }

    /// Tries folders in which one file is mutated, each of them equally often.
    pub fn try_folders(&self, kind: &str, folders: &[Files], read: impl Fn(&Path) -> bool) {
        try_cases(kind, folders, |_, _| Vec::new(), read);
    }
}

/// Seeds for a number of cases or, if `HEADBOX_FUZZ_SECONDS` is set, for that time.
pub struct Rounds {
    first_seed: u64,
    cases: u64,
    most: Option<Duration>,
    done: u64,
    spent: Duration,
    last: Instant,
}

impl Rounds {
    pub fn new(cases: u64) -> Self {
        let number = |name| std::env::var(name).ok().and_then(|s| s.parse().ok());
        let most = number("HEADBOX_FUZZ_SECONDS").map(Duration::from_secs);
        Self {
            first_seed: number("HEADBOX_FUZZ_SEED").unwrap_or(0),
            cases,
            most,
            done: 0,
            spent: Duration::ZERO,
            last: Instant::now(),
        }
    }

    /// Returns the next seed, or `None` at the end.
    pub fn next(&mut self) -> Option<u64> {
        self.spent += self.last.elapsed().min(LONGEST);
        self.last = Instant::now();
        if self
            .most
            .map_or(self.done >= self.cases, |most| self.spent >= most)
        {
            return None;
        }
        self.done += 1;
        Some(self.first_seed.wrapping_add(self.done - 1))
    }

    pub fn done(&self) -> u64 {
        self.done
    }
}

/// Files of a folder, by their names relative to it.
pub type Files = Vec<(String, Vec<u8>)>;

/// Mutates a file; three quarters of the mutants of a format with checksums or lengths of its own
/// get valid ones, so that they reach the decoder.
fn mutant_of(name: &str, original: &[u8], rng: &mut MutationRng) -> Vec<u8> {
    if rng.below(4) > 0
        && let Some(mended) = mend::mutate_inside(name, original, rng)
    {
        return mended;
    }
    let mut bytes = original.to_vec();
    mutate(&mut bytes, rng);
    bytes
}

/// Tries mutants of folders. `mutant` makes that of a file; an empty one stands for
/// [`mutant_of`].
fn try_cases(
    kind: &str,
    folders: &[Files],
    mutant: impl Fn(&[u8], &mut MutationRng) -> Vec<u8>,
    read: impl Fn(&Path) -> bool,
) {
    let temporary = tempfile::tempdir().expect("a folder");
    let write_all = |folder: &Path, files: &Files| {
        for (name, bytes) in files {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            std::fs::write(path, bytes).expect("written");
        }
    };
    for (i, files) in folders.iter().enumerate() {
        let folder = temporary.path().join(i.to_string());
        write_all(&folder, files);
        let names: Vec<&String> = files.iter().map(|(name, _)| name).collect();
        assert!(read(&folder), "{kind}: the original is sound: {names:?}");
    }
    let (mut rounds, mut sound) = (Rounds::new(CASES), 0u64);
    while let Some(seed) = rounds.next() {
        let mut rng = MutationRng::new(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
        let which = rng.below(folders.len());
        let files = &folders[which];
        let (name, original) = &files[rng.below(files.len())];
        let bytes = match mutant(original, &mut rng) {
            bytes if bytes.is_empty() => mutant_of(name, original, &mut rng),
            bytes => bytes,
        };
        let folder = temporary.path().join(which.to_string());
        std::fs::write(folder.join(name), &bytes).expect("written");
        sound += u64::from(run_reader(kind, seed, &folder, &read));
        std::fs::write(folder.join(name), original).expect("written");
    }
    let seconds = rounds.spent.as_secs_f64();
    println!(
        "{kind}: {} mutations in {seconds:.1} s, of which {sound} were sound files",
        rounds.done()
    );
}

/// Runs a reader on a mutant; keeps the mutant and fails if the reader panics, takes too much
/// memory, or too long.
fn run_reader(kind: &str, seed: u64, folder: &Path, read: impl Fn(&Path) -> bool) -> bool {
    let before = LIVE.load(Ordering::Relaxed);
    LARGEST.store(0, Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    *running() = Some((Instant::now(), kind.to_owned(), seed, folder.to_path_buf()));
    watch();
    let started = Instant::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| read(folder)));
    let elapsed = started.elapsed();
    *running() = None;
    let largest = LARGEST.load(Ordering::Relaxed);
    let most = if PROPORTIONAL.contains(&kind) {
        SMALL_BYTES + MOST_TIMES * folder_bytes(folder)
    } else {
        MOST_BYTES
    };
    let peak = PEAK.load(Ordering::Relaxed).saturating_sub(before);
    let fault = match outcome {
        Err(_) => "panic".to_owned(),
        Ok(_) if largest > most => format!("an allocation of {largest} bytes"),
        Ok(_) if peak > MOST_LIVE_BYTES => format!("{peak} bytes of memory"),
        Ok(_) if elapsed > MOST_TIME => format!("{:.1} s", elapsed.as_secs_f64()),
        Ok(is_sound) => return is_sound,
    };
    let kept = keep(kind, seed, folder);
    panic!("{kind}, seed {seed}: {fault}; kept as {}", kept.display());
}

/// Returns the size of all files in a folder, bytes.
fn folder_bytes(folder: &Path) -> usize {
    let files = std::fs::read_dir(folder).expect("a folder").flatten();
    files
        .map(|file| file.metadata().expect("written").len() as usize)
        .sum()
}

/// Start, kind, seed and folder of the reader that is running.
type Running = Option<(Instant, String, u64, PathBuf)>;

fn running() -> MutexGuard<'static, Running> {
    static RUNNING: Mutex<Running> = Mutex::new(None);
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends the program, with the input kept, if a reader does not come to an end.
fn watch() {
    static STARTED: Once = Once::new();
    let work = || loop {
        std::thread::sleep(Duration::from_secs(1));
        if let Some((since, kind, seed, folder)) = &*running()
            && since.elapsed() > 3 * MOST_TIME
        {
            let kept = keep(kind, *seed, folder);
            eprintln!("{kind}, seed {seed}: no end; kept as {}", kept.display());
            std::process::exit(101);
        }
    };
    STARTED.call_once(|| drop(std::thread::spawn(work)));
}

/// Copies a folder to `target/fuzz`.
fn keep(kind: &str, seed: u64, folder: &Path) -> PathBuf {
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .with_file_name("fuzz")
        .join(format!("{kind}-{seed}").replace(' ', "-"));
    copy_all(folder, &kept);
    kept
}

fn copy_all(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("made");
    for entry in std::fs::read_dir(from).expect("a folder").flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_all(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).expect("copied");
        }
    }
}

/// Returns the bytes that `write` writes to a file.
pub fn written_bytes(write: impl FnOnce(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("original");
    write(&path);
    std::fs::read(&path).expect("written")
}

/// A file of the corpus.
pub fn corpus(name: &str) -> Vec<u8> {
    std::fs::read(corpus_folder().join(name)).expect("in the corpus")
}

pub fn corpus_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus")
}

/// Random choices of mutations.
pub struct MutationRng(Rng);

impl MutationRng {
    pub fn new(seed: u64) -> Self {
        Self(Rng::keyed(seed))
    }

    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// Random number in 0..count, or 0 if `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        self.0.below(count as u64) as usize
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
/// Bytes with a meaning for text parsers.
const SIGNS: &[u8] = b"0123456789-./\\ \n\r\t\"{}[],:eE#nfvtrue";

/// Applies one to four random changes.
pub fn mutate(bytes: &mut Vec<u8>, rng: &mut MutationRng) {
    for _ in 0..1 + rng.below(4) {
        let at = rng.below(bytes.len() + 1);
        match rng.below(9) {
            0 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << rng.below(8);
                }
            }
            1 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = rng.bits() as u8;
                }
            }
            2 => {
                let sign = *rng.pick(SIGNS);
                bytes.insert(at, sign);
            }
            3 => {
                let end = (at + 1 + rng.below(24)).min(bytes.len());
                bytes.drain(at..end);
            }
            4 => bytes.truncate(at),
            5 => {
                let end = (at + rng.below(64)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = rng.below(bytes.len() + 1);
                bytes.splice(to..to, piece);
            }
            6 | 7 => replace_number(bytes, at, rng),
            _ => {
                let width = *rng.pick(&[2, 4, 8]);
                let value = *rng.pick(&[
                    0u64,
                    1,
                    0x7f,
                    0x8000,
                    0xffff,
                    0x7fff_ffff,
                    0xffff_ffff,
                    1 << 40,
                    u64::MAX,
                ]);
                let value = value.to_le_bytes();
                bytes
                    .iter_mut()
                    .skip(at)
                    .take(width)
                    .zip(value)
                    .for_each(|(byte, new)| *byte = new);
            }
        }
    }
}

/// Replaces the digits at or after a position by another number.
fn replace_number(bytes: &mut Vec<u8>, from: usize, rng: &mut MutationRng) {
    let Some(start) = (from..bytes.len()).find(|&i| bytes[i].is_ascii_digit()) else {
        return;
    };
    let in_number = |b: &u8| b.is_ascii_digit() || b".eE+-".contains(b);
    let end = (start..bytes.len())
        .find(|&i| !in_number(&bytes[i]))
        .unwrap_or(bytes.len());
    let number = rng.pick(&NUMBERS).bytes();
    bytes.splice(start..end, number);
}

/// Parsed headbox file: 16 bytes of magic, kind and version, and the sections.
pub struct Parts {
    head: Vec<u8>,
    sections: Vec<([u8; 12], Vec<u8>)>,
}

impl Parts {
    /// Parses an undamaged file.
    pub fn parse(file: &[u8]) -> Self {
        let word = |at: usize| {
            u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes")) as usize
        };
        let sections = (0..word(16)).map(|i| {
            let entry = 24 + 32 * i;
            let name = file[entry..entry + 12].try_into().expect("twelve bytes");
            (
                name,
                file[word(entry + 16)..word(entry + 16) + word(entry + 24)].to_vec(),
            )
        });
        Self {
            head: file[..16].to_vec(),
            sections: sections.collect(),
        }
    }

    /// Changes the content of a section; checksums stay valid.
    pub fn mutate(&mut self, rng: &mut MutationRng) {
        let count = self.sections.len();
        // The first section describes the others.
        let which = if rng.below(3) > 0 {
            0
        } else {
            rng.below(count)
        };
        mutate(&mut self.sections[which].1, rng);
        if rng.below(20) == 0 {
            let from = rng.below(count);
            self.sections[which].1 = self.sections[from].1.clone();
        }
    }

    /// Assembles the file with valid lengths and checksums.
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
        [
            self.head.as_slice(),
            &count,
            &crc32fast::hash(&table).to_le_bytes(),
            &table,
            &body,
        ]
        .concat()
    }
}
