//! Where accumulators live during a capture: tiles of face pixels, each behind its own lock, spilled to disk when the
//! memory budget is used up.

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

/// Accumulators are allocated this many at a time, so that a growing tile is never copied.
const CHUNK: usize = 64;

/// Accumulators in the list of a pixel, at most.
const LIST_LIMIT: u32 = 16;

/// So many samples' pixels are [touched](Tile::touch) before these samples are added.
const TOUCHED: usize = 32;

/// All accumulators of a capture.
pub struct TileStore {
    tiles_per_side: u32,
    tiles: Vec<Mutex<Tile>>,
    chunks_in_memory: AtomicUsize,
    chunk_budget: usize,
    spill: Mutex<Option<Spill>>,
}

/// The accumulators of `TILE_PX` x `TILE_PX` pixels: a linked list per pixel, and a table for those that found the list
/// of their pixel full.
///
/// Lists alone are not enough: a plane through the centre of the headbox puts all of itself into one row of pixels,
/// hundreds of bins in each. A table alone needs more of the cache. (docs/decisions/0006.)
#[derive(Default)]
struct Tile {
    /// First accumulator of each pixel; empty until the first sample.
    heads: Vec<u32>,
    /// Numbers of the accumulators beyond [`LIST_LIMIT`] of a pixel, by pixel, bin and class.
    beyond: FxHashMap<(u32, u16, u16), u32>,
    chunks: Vec<Box<[Accumulator]>>,
    len: usize,
}

/// Runs of accumulators on disk, in a file that vanishes with the process.
struct Spill {
    file: File,
    end: u64,
    /// Per tile: where its runs start and how long they are.
    runs: Vec<Vec<(u64, usize)>>,
}

impl TileStore {
    /// A store for six faces of `face_size_px` pixels a side. Once accumulators take more than `budget_bytes`, they
    /// are written to an unnamed file in `spill_dir`; without a budget they stay in memory.
    ///
    /// # Errors
    /// If the spill file cannot be made.
    pub fn new(face_size_px: u32, budget: Option<(u64, &Path)>) -> io::Result<Self> {
        let tiles_per_side = face_size_px.div_ceil(TILE_PX);
        let count = 6 * (tiles_per_side as usize).pow(2);
        let spill = match budget {
            Some((_, dir)) => Some(Spill {
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

    /// Number of tiles, all faces.
    pub fn tile_count(&self) -> usize {
        self.tiles.len()
    }

    /// Number of tiles along a side of a face.
    pub fn tiles_per_side(&self) -> u32 {
        self.tiles_per_side
    }

    /// Face and upper left pixel of a tile.
    pub fn tile_place(&self, tile: usize) -> (Face, u32, u32) {
        let per_face = (self.tiles_per_side as usize).pow(2);
        let (face, rest) = (tile / per_face, (tile % per_face) as u32);
        (
            Face::ALL[face],
            rest % self.tiles_per_side * TILE_PX,
            rest / self.tiles_per_side * TILE_PX,
        )
    }

    fn tile_of(&self, sample: &Sample) -> usize {
        let (tx, ty) = (u32::from(sample.x) / TILE_PX, u32::from(sample.y) / TILE_PX);
        ((sample.face.index() as u32 * self.tiles_per_side + ty) * self.tiles_per_side + tx)
            as usize
    }

    /// Keeps a batch of samples, in any order.
    ///
    /// # Errors
    /// If spilling to disk fails.
    pub fn insert(&self, samples: &[Sample], scratch: &mut InsertScratch) -> io::Result<()> {
        scratch.sort_by_tile(samples.iter().map(|s| self.tile_of(s)), self.tiles.len());
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
            for batch in batch.chunks(TOUCHED) {
                let batch = || {
                    batch
                        .iter()
                        .map(|&i| &samples[i as usize])
                        .map(|sample| (pixel_in_tile(sample), sample))
                };
                tile.touch(batch().map(|(pixel, _)| pixel));
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
            return Ok(()); // another thread has just done it
        }
        for (tile, runs) in self.tiles.iter().zip(&mut spill.runs) {
            let mut tile = lock(tile);
            let run = tile.run(|_| true);
            self.chunks_in_memory
                .fetch_sub(tile.chunks.len(), Ordering::Relaxed);
            *tile = Tile::default();
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

    /// No fewer than the accumulators of a tile.
    pub fn most_in_tile(&self, tile: usize) -> usize {
        let in_memory = lock(&self.tiles[tile]).len;
        let spilled: usize = lock(&self.spill).as_ref().map_or(0, |spill| {
            spill.runs[tile].iter().map(|(_, len)| *len).sum()
        });
        in_memory + spilled
    }

    /// All accumulators of a tile, sorted by [`Accumulator::run_order`], each (pixel, bin, class) once; the link of each
    /// is its pixel in the tile, row-major.
    ///
    /// # Errors
    /// If the spill file cannot be read.
    pub fn tile_run(&self, tile: usize) -> io::Result<Vec<Accumulator>> {
        self.tile_run_of(tile, |_| true)
    }

    /// As [`Self::tile_run`], of those pixels of the tile only for which `wanted` says so.
    ///
    /// # Errors
    /// As [`Self::tile_run`].
    pub fn tile_run_of(
        &self,
        tile: usize,
        wanted: impl Fn(u32) -> bool,
    ) -> io::Result<Vec<Accumulator>> {
        let mut run = lock(&self.tiles[tile]).run(&wanted);
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
        run.retain(|acc| wanted(acc.link)); // spilled runs are whole
        combine(&mut run);
        Ok(run)
    }

    /// Forgets a tile's accumulators in memory.
    pub fn clear_tile(&self, tile: usize) {
        let mut tile = lock(&self.tiles[tile]);
        self.chunks_in_memory
            .fetch_sub(tile.chunks.len(), Ordering::Relaxed);
        *tile = Tile::default();
    }
}

/// Sorts accumulators by [`Accumulator::run_order`] and adds up those of equal order.
pub fn combine(run: &mut Vec<Accumulator>) {
    run.sort_unstable_by_key(Accumulator::run_order);
    run.dedup_by(|next, kept| {
        let same = next.run_order() == kept.run_order();
        if same {
            kept.absorb(next);
        }
        same
    });
}

/// The pixel of a sample in its tile, row-major.
fn pixel_in_tile(sample: &Sample) -> u32 {
    u32::from(sample.y) % TILE_PX * TILE_PX + u32::from(sample.x) % TILE_PX
}

impl Tile {
    /// Reads the first accumulator of each of these pixels, so that it is in the cache when it is wanted: these reads wait for memory
    /// together, those of one sample after the other each by itself.
    fn touch(&self, pixels: impl Iterator<Item = u32>) {
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
        let (mut at, mut length) = (head, 0);
        while at != Accumulator::NO_NEXT {
            let here = &mut self.chunks[at as usize / CHUNK][at as usize % CHUNK];
            if (here.bin, here.class) == (new.bin, new.class) {
                here.absorb(new);
                return;
            }
            at = here.link;
            length += 1;
        }
        if length < LIST_LIMIT {
            self.heads[pixel as usize] = self.push(Accumulator { link: head, ..*new });
            return;
        }
        let next = self.len as u32;
        match self.beyond.entry((pixel, new.bin, new.class)) {
            Entry::Occupied(at) => {
                let at = *at.get() as usize;
                self.chunks[at / CHUNK][at % CHUNK].absorb(new);
            }
            Entry::Vacant(free) => {
                free.insert(next);
                self.push(*new);
            }
        }
    }

    /// Appends an accumulator and returns its number.
    fn push(&mut self, new: Accumulator) -> u32 {
        let index = self.len;
        if index.is_multiple_of(CHUNK) {
            self.chunks.push(bytemuck::zeroed_slice_box(CHUNK));
        }
        self.chunks[index / CHUNK][index % CHUNK] = new;
        self.len += 1;
        index as u32
    }

    /// The accumulators of the pixels for which `wanted` says so, pixel by pixel, each sorted, and then those beyond the lists: nearly in
    /// the order that [`combine`] gives them, which takes little time then.
    fn run(&self, wanted: impl Fn(u32) -> bool) -> Vec<Accumulator> {
        let mut run = Vec::with_capacity(self.len);
        let at = |number: u32| self.chunks[number as usize / CHUNK][number as usize % CHUNK];
        for (pixel, &head) in (0..).zip(&self.heads).filter(|(pixel, _)| wanted(*pixel)) {
            let (mut next, before) = (head, run.len());
            while next != Accumulator::NO_NEXT {
                let here = at(next);
                run.push(Accumulator {
                    link: pixel,
                    ..here
                });
                next = here.link;
            }
            run[before..].sort_unstable_by_key(Accumulator::run_order);
        }
        let beyond = self.beyond.iter().filter(|(of, _)| wanted(of.0));
        run.extend(beyond.map(|(&(pixel, ..), &number)| Accumulator {
            link: pixel,
            ..at(number)
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
    /// Counting sort of sample numbers by tile.
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
            let place = &mut self.starts[tile as usize];
            self.order[*place as usize] = i as u32;
            *place += 1;
        }
    }
}

/// A panic on another thread ends the capture anyway; its half-done tile is never read.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
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
    fn spilling_and_order_of_arrival_change_nothing() {
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
            "the budget was meant to be exceeded"
        );
        let expected = runs(&in_memory);
        assert_eq!(expected, runs(&spilling));
        let total: u64 = expected.iter().flatten().map(|a| u64::from(a.count)).sum();
        assert_eq!(total, 200_000);
    }

    #[test]
    fn crowded_pixels_keep_every_accumulator_apart() {
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
        let found: Vec<_> = runs
            .iter()
            .flatten()
            .map(|acc| (acc.link, acc.bin, acc.class, acc.count))
            .collect();
        let expected: Vec<_> = (0..1000)
            .map(|bin| (5 * TILE_PX + 3, bin, bin % 3, 3))
            .collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn samples_land_in_the_tile_and_pixel_that_hold_them() {
        let store = TileStore::new(70, None).unwrap();
        let mut sample = random_samples(1)[0];
        (sample.face, sample.x, sample.y) = (Face::PosZ, 69, 33);
        store
            .insert(&[sample], &mut InsertScratch::default())
            .unwrap();
        let found: Vec<_> = (0..store.tile_count())
            .filter(|&t| !store.tile_run(t).unwrap().is_empty())
            .collect();
        assert_eq!(found.len(), 1);
        assert_eq!(store.tile_place(found[0]), (Face::PosZ, 64, 32));
        assert_eq!(store.tile_run(found[0]).unwrap()[0].link, TILE_PX + 5);
        store.clear_tile(found[0]);
        assert!(store.tile_run(found[0]).unwrap().is_empty());
    }
}
