//! Storage of accumulators during a capture: tiles of face pixels, each behind its own lock,
//! spilled to disk when the memory budget is used up.

use crate::accumulate::accumulator::{Accumulator, Sample};
use headbox_core::cube_face::Face;
use rustc_hash::FxHashMap;
use std::collections::hash_map::Entry;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Pixels along a side of a tile.
pub const TILE_PX: u32 = 32;

/// Number of accumulators that are allocated at a time, so that a growing tile is never copied.
const CHUNK: usize = 64;

/// Maximum number of accumulators in the list of a pixel.
const LIST_LIMIT: u32 = 16;

/// Number of samples whose pixels are [prefetched](Tile::prefetch) before these samples are added.
const PREFETCH: usize = 32;

/// All accumulators of a capture.
pub struct TileStore {
    /// Number of tiles along a side of a face.
    pub(crate) tiles_per_side: u32,
    tiles: Vec<Mutex<Tile>>,
    chunks_in_memory: AtomicUsize,
    chunk_budget: usize,
    spill: Mutex<Option<SpillFile>>,
}

/// The accumulators of `TILE_PX` x `TILE_PX` pixels: a linked list per pixel, and an overflow table
/// for pixels whose list is full.
///
/// Lists alone are not enough: a plane through the centre of the headbox lies in one row of pixels,
/// with hundreds of bins in each. A table alone needs more of the cache (docs/decisions/0006).
#[derive(Default)]
struct Tile {
    /// First accumulator of each pixel; empty until the first sample.
    heads: Vec<u32>,
    /// Indices of the accumulators beyond [`LIST_LIMIT`] of a pixel, by pixel, bin and class.
    overflow: FxHashMap<(u32, u16, u16), u32>,
    chunks: Vec<Box<[Accumulator]>>,
    len: usize,
}

/// Runs of accumulators on disk, in a file that vanishes with the process.
struct SpillFile {
    file: File,
    end: u64,
    /// Byte offset and length of each run, per tile.
    runs: Vec<Vec<(u64, usize)>>,
}

impl TileStore {
    /// An empty store for six faces of `face_size_px` pixels along a side. Once accumulators take
    /// more bytes than the budget, they are written to an unnamed file in its folder; without a
    /// budget they stay in memory.
    ///
    /// # Errors
    /// If the spill file cannot be created.
    pub fn new(face_size_px: u32, budget: Option<(u64, &Path)>) -> io::Result<Self> {
        let tiles_per_side = face_size_px.div_ceil(TILE_PX);
        let count = 6 * (tiles_per_side as usize).pow(2);
        let spill = match budget {
            Some((_, dir)) => Some(SpillFile {
                file: tempfile::tempfile_in(dir)?,
                end: 0,
                runs: vec![Vec::new(); count],
            }),
            None => None,
        };
        let chunk_bytes = (CHUNK * size_of::<Accumulator>()) as u64;
        Ok(Self {
            tiles_per_side,
            tiles: (0..count).map(|_| Mutex::default()).collect(),
            chunks_in_memory: AtomicUsize::new(0),
            chunk_budget: budget.map_or(usize::MAX, |(bytes, _)| {
                (bytes / chunk_bytes).max(1) as usize
            }),
            spill: Mutex::new(spill),
        })
    }

    /// Number of tiles of all faces.
    pub fn tile_count(&self) -> usize {
        self.tiles.len()
    }

    /// Face and upper left pixel of a tile.
    pub fn tile_origin(&self, tile: usize) -> (Face, u32, u32) {
        let per_face = (self.tiles_per_side as usize).pow(2);
        let in_face = (tile % per_face) as u32;
        (
            Face::ALL[tile / per_face],
            in_face % self.tiles_per_side * TILE_PX,
            in_face / self.tiles_per_side * TILE_PX,
        )
    }

    fn tile_index(&self, sample: &Sample) -> usize {
        let tx = u32::from(sample.x) / TILE_PX;
        let ty = u32::from(sample.y) / TILE_PX;
        let row = sample.face.index() as u32 * self.tiles_per_side + ty;
        (row * self.tiles_per_side + tx) as usize
    }

    /// Adds a batch of samples, in any order.
    ///
    /// # Errors
    /// If spilling to disk fails.
    pub fn insert(&self, samples: &[Sample], scratch: &mut InsertScratch) -> io::Result<()> {
        scratch.sort_by_tile(samples.iter().map(|s| self.tile_index(s)), self.tiles.len());
        let mut order = scratch.order.as_slice();
        while let Some(&first) = order.first() {
            let tile_index = scratch.tiles[first as usize];
            let same = order
                .iter()
                .take_while(|&&i| scratch.tiles[i as usize] == tile_index)
                .count();
            let (batch, rest) = order.split_at(same);
            order = rest;
            let mut tile = lock(&self.tiles[tile_index as usize]);
            let before = tile.chunks.len();
            for batch in batch.chunks(PREFETCH) {
                let batch = || {
                    batch
                        .iter()
                        .map(|&i| &samples[i as usize])
                        .map(|sample| (pixel_in_tile(sample), sample))
                };
                tile.prefetch(batch().map(|(pixel, _)| pixel));
                batch().for_each(|(pixel, sample)| tile.add(pixel, &Accumulator::new(sample)));
            }
            self.chunks_in_memory
                .fetch_add(tile.chunks.len() - before, Ordering::Relaxed);
        }
        self.keep_within_budget()
    }

    /// Adds a run that [`Self::tile_run`] made for the same tile, perhaps in another process.
    ///
    /// # Errors
    /// If spilling to disk fails.
    pub fn absorb_run(&self, tile: usize, run: &[Accumulator]) -> io::Result<()> {
        let mut tile = lock(&self.tiles[tile]);
        let before = tile.chunks.len();
        for acc in run {
            // A damaged link must not lead outside the tile.
            tile.add(acc.link % (TILE_PX * TILE_PX), acc);
        }
        self.chunks_in_memory
            .fetch_add(tile.chunks.len() - before, Ordering::Relaxed);
        drop(tile);
        self.keep_within_budget()
    }

    fn keep_within_budget(&self) -> io::Result<()> {
        if self.chunks_in_memory.load(Ordering::Relaxed) > self.chunk_budget {
            self.spill_all()
        } else {
            Ok(())
        }
    }

    /// Writes every accumulator in memory to disk.
    ///
    /// # Errors
    /// If writing fails.
    pub fn spill_all(&self) -> io::Result<()> {
        let mut spill = lock(&self.spill);
        let Some(spill) = spill.as_mut() else {
            return Ok(());
        };
        if self.chunks_in_memory.load(Ordering::Relaxed) == 0 {
            return Ok(()); // another thread has just spilled
        }
        for (tile, runs) in self.tiles.iter().zip(&mut spill.runs) {
            let mut tile = lock(tile);
            let run = tile.run(|_| true);
            self.clear(&mut tile);
            drop(tile);
            if !run.is_empty() {
                let bytes: &[u8] = bytemuck::cast_slice(&run);
                spill.file.seek(SeekFrom::Start(spill.end))?;
                spill.file.write_all(bytes)?;
                runs.push((spill.end, run.len()));
                spill.end += bytes.len() as u64;
            }
        }
        Ok(())
    }

    /// An upper bound on the number of accumulators of a tile.
    pub fn max_in_tile(&self, tile: usize) -> usize {
        let in_memory = lock(&self.tiles[tile]).len;
        let spilled: usize = lock(&self.spill).as_ref().map_or(0, |spill| {
            spill.runs[tile].iter().map(|(_, len)| *len).sum()
        });
        in_memory + spilled
    }

    /// All accumulators of a tile, sorted by [`Accumulator::run_order`], each (pixel, bin, class)
    /// once. The link of each is its pixel in the tile, row-major.
    ///
    /// # Errors
    /// If the spill file cannot be read.
    pub fn tile_run(&self, tile: usize) -> io::Result<Vec<Accumulator>> {
        self.tile_run_where(tile, |_| true)
    }

    /// The [run](Self::tile_run) of the pixels of a tile that `is_selected` accepts.
    ///
    /// # Errors
    /// If the spill file cannot be read.
    pub fn tile_run_where(
        &self,
        tile: usize,
        is_selected: impl Fn(u32) -> bool,
    ) -> io::Result<Vec<Accumulator>> {
        let mut run = lock(&self.tiles[tile]).run(&is_selected);
        let mut spill = lock(&self.spill);
        if let Some(spill) = spill.as_mut() {
            for &(start, len) in &spill.runs[tile] {
                let old = run.len();
                run.resize(old + len, bytemuck::Zeroable::zeroed());
                spill.file.seek(SeekFrom::Start(start))?;
                spill
                    .file
                    .read_exact(bytemuck::cast_slice_mut(&mut run[old..]))?;
            }
        }
        drop(spill);
        run.retain(|acc| is_selected(acc.link)); // spilled runs hold all pixels
        combine(&mut run);
        Ok(run)
    }

    /// Drops a tile's accumulators in memory.
    pub fn clear_tile(&self, tile: usize) {
        self.clear(&mut lock(&self.tiles[tile]));
    }

    fn clear(&self, tile: &mut Tile) {
        self.chunks_in_memory
            .fetch_sub(tile.chunks.len(), Ordering::Relaxed);
        *tile = Tile::default();
    }
}

/// Sorts accumulators by [`Accumulator::run_order`] and sums those of equal order.
pub fn combine(run: &mut Vec<Accumulator>) {
    run.sort_unstable_by_key(Accumulator::run_order);
    run.dedup_by(|next, last| {
        let is_same = next.run_order() == last.run_order();
        if is_same {
            last.absorb(next);
        }
        is_same
    });
}

/// The pixel of a sample in its tile, row-major.
fn pixel_in_tile(sample: &Sample) -> u32 {
    u32::from(sample.y) % TILE_PX * TILE_PX + u32::from(sample.x) % TILE_PX
}

impl Tile {
    /// Reads the first accumulator of each pixel into the cache. The cache misses of these reads
    /// overlap; without prefetching, each sample would wait by itself.
    fn prefetch(&self, pixels: impl Iterator<Item = u32>) {
        let mut read = 0;
        for head in pixels.filter_map(|pixel| self.heads.get(pixel as usize)) {
            let first = self
                .chunks
                .get(*head as usize / CHUNK)
                .map_or(0, |chunk| chunk[*head as usize % CHUNK].link);
            read ^= first;
        }
        std::hint::black_box(read);
    }

    #[inline]
    fn add(&mut self, pixel: u32, new: &Accumulator) {
        if self.heads.is_empty() {
            self.heads = vec![Accumulator::NO_NEXT; (TILE_PX * TILE_PX) as usize];
        }
        let head = self.heads[pixel as usize];
        let mut index = head;
        let mut length = 0;
        while index != Accumulator::NO_NEXT {
            let acc = &mut self.chunks[index as usize / CHUNK][index as usize % CHUNK];
            if (acc.bin, acc.class) == (new.bin, new.class) {
                acc.absorb(new);
                return;
            }
            index = acc.link;
            length += 1;
        }
        if length < LIST_LIMIT {
            self.heads[pixel as usize] = self.push(Accumulator { link: head, ..*new });
            return;
        }
        let next = self.len as u32;
        match self.overflow.entry((pixel, new.bin, new.class)) {
            Entry::Occupied(entry) => {
                let index = *entry.get() as usize;
                self.chunks[index / CHUNK][index % CHUNK].absorb(new);
            }
            Entry::Vacant(entry) => {
                entry.insert(next);
                self.push(*new);
            }
        }
    }

    /// Appends an accumulator and returns its index.
    fn push(&mut self, new: Accumulator) -> u32 {
        let index = self.len;
        if index.is_multiple_of(CHUNK) {
            self.chunks.push(bytemuck::zeroed_slice_box(CHUNK));
        }
        self.chunks[index / CHUNK][index % CHUNK] = new;
        self.len += 1;
        index as u32
    }

    /// The accumulators of the selected pixels, pixel by pixel, each sorted, and then the overflow:
    /// nearly in the order of [`combine`], which then takes little time.
    fn run(&self, is_selected: impl Fn(u32) -> bool) -> Vec<Accumulator> {
        let mut run = Vec::with_capacity(self.len);
        let get = |index: u32| self.chunks[index as usize / CHUNK][index as usize % CHUNK];
        let heads = (0..).zip(&self.heads);
        for (pixel, &head) in heads.filter(|(pixel, _)| is_selected(*pixel)) {
            let before = run.len();
            let mut next = head;
            while next != Accumulator::NO_NEXT {
                let acc = get(next);
                run.push(Accumulator { link: pixel, ..acc });
                next = acc.link;
            }
            run[before..].sort_unstable_by_key(Accumulator::run_order);
        }
        let overflow = self.overflow.iter().filter(|(key, _)| is_selected(key.0));
        run.extend(overflow.map(|(&(pixel, ..), &index)| Accumulator {
            link: pixel,
            ..get(index)
        }));
        run
    }
}

/// Buffers that [`TileStore::insert`] reuses.
#[derive(Default)]
pub struct InsertScratch {
    starts: Vec<u32>,
    tiles: Vec<u32>,
    order: Vec<u32>,
}

impl InsertScratch {
    /// Sorts sample indices by tile, by counting.
    fn sort_by_tile(&mut self, tiles: impl Iterator<Item = usize>, tile_count: usize) {
        self.starts.clear();
        self.starts.resize(tile_count + 1, 0);
        self.tiles.clear();
        for tile in tiles {
            self.tiles.push(tile as u32);
            self.starts[tile + 1] += 1;
        }
        for i in 0..tile_count {
            self.starts[i + 1] += self.starts[i];
        }
        self.order.clear();
        self.order.resize(self.tiles.len(), 0);
        for (i, &tile) in self.tiles.iter().enumerate() {
            let next = &mut self.starts[tile as usize];
            self.order[*next as usize] = i as u32;
            *next += 1;
        }
    }
}

/// Locks a mutex even if it is poisoned: a panic on another thread ends the capture, and what it
/// left half done is never read.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_trace::sampler::{RayKey, random4};

    fn random_samples(count: u32) -> Vec<Sample> {
        let sample = |i: u32| {
            let [a, b, c, d] = random4([i, 1, 2, 3]);
            Sample {
                face: Face::ALL[(a % 6) as usize],
                x: (b % 70) as u16,
                y: (c % 70) as u16,
                bin: (d % 3) as u16,
                offset: (a >> 8) as u16,
                class: (d >> 8 & 1) as u16,
                albedo: [1, 2, (b >> 16) as u16],
                primitive: i,
                barycentric: [0, i as u16],
                area: (c % 7) as f32,
                key: RayKey::new(0, i, 0),
            }
        };
        (0..count).map(sample).collect()
    }

    fn runs(store: &TileStore) -> Vec<Vec<Accumulator>> {
        (0..store.tile_count())
            .map(|t| store.tile_run(t).unwrap())
            .collect()
    }

    #[test]
    fn runs_are_independent_of_spilling_and_order() {
        let samples = random_samples(200_000);
        let in_memory = TileStore::new(70, None).unwrap();
        in_memory
            .insert(&samples, &mut InsertScratch::default())
            .unwrap();
        let dir = tempfile::tempdir().unwrap();
        let spilling = TileStore::new(70, Some((100_000, dir.path()))).unwrap();
        let mut scratch = InsertScratch::default();
        for batch in samples.rchunks(1000) {
            spilling.insert(batch, &mut scratch).unwrap();
        }
        assert!(
            lock(&spilling.spill).as_ref().is_some_and(|s| s.end > 0),
            "the test must exceed the budget"
        );
        let expected = runs(&in_memory);
        assert_eq!(expected, runs(&spilling));
        let total: u64 = expected.iter().flatten().map(|a| u64::from(a.count)).sum();
        assert_eq!(total, 200_000);
    }

    #[test]
    fn overflowing_pixel_keeps_all_accumulators() {
        let store = TileStore::new(70, None).unwrap();
        let crowded = |bin: u16| Sample {
            x: 3,
            y: 5,
            face: Face::NegX,
            bin,
            class: bin % 3,
            ..random_samples(1)[0]
        };
        let samples: Vec<Sample> = (0..3000).map(|i| crowded(i * 7 % 1000)).collect();
        store
            .insert(&samples, &mut InsertScratch::default())
            .unwrap();
        let runs = runs(&store);
        let accumulators: Vec<_> = runs
            .iter()
            .flatten()
            .map(|acc| (acc.link, acc.bin, acc.class, acc.count))
            .collect();
        let expected: Vec<_> = (0..1000)
            .map(|bin| (5 * TILE_PX + 3, bin, bin % 3, 3))
            .collect();
        assert_eq!(accumulators, expected);
    }

    #[test]
    fn sample_lands_in_its_tile_and_pixel() {
        let store = TileStore::new(70, None).unwrap();
        let sample = Sample {
            face: Face::PosZ,
            x: 69,
            y: 33,
            ..random_samples(1)[0]
        };
        store
            .insert(&[sample], &mut InsertScratch::default())
            .unwrap();
        let tiles: Vec<_> = (0..store.tile_count())
            .filter(|&t| !store.tile_run(t).unwrap().is_empty())
            .collect();
        assert_eq!(tiles.len(), 1);
        assert_eq!(store.tile_origin(tiles[0]), (Face::PosZ, 64, 32));
        assert_eq!(store.tile_run(tiles[0]).unwrap()[0].link, TILE_PX + 5);
        store.clear_tile(tiles[0]);
        assert!(store.tile_run(tiles[0]).unwrap().is_empty());
    }
}
