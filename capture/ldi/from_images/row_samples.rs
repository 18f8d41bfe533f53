//! Samples of images, stored by row of the cube.
//!
//! A sample is written once, where it is read again when its row is merged: each row of the cube
//! has a chain of chunks in one vector.

use glam::Vec3;
use headbox_core::color::linear_levels;
use headbox_cube::model::samples::EncodedNormal;
use std::sync::{LazyLock, Mutex, PoisonError};

/// A sample that an image, or a ray, gives a pixel of the cube.
#[derive(Clone, Copy, Debug)]
pub struct ImageSample {
    /// Column in its row.
    pub column: u16,
    /// Colour.
    pub color: LinearColor16,
    /// Inverse depth about the cube's centre, 1/m.
    pub inverse_depth: f32,
    /// Normal in world axes, on the side that the camera sees.
    pub normal: EncodedNormal,
    /// Weight in a mean.
    pub weight: f32,
    /// Area of the surface that a pixel of its image covers, up to a factor common to all (C10).
    pub area: f32,
}

impl ImageSample {
    /// An empty sample.
    pub(super) const NONE: Self = Self {
        column: 0,
        color: LinearColor16([0; 3]),
        inverse_depth: 0.0,
        normal: EncodedNormal::Z,
        weight: 0.0,
        area: 0.0,
    };
}

/// A linear colour in 16 bits per channel: at the dark end of sRGB, a level is 20 steps. It is
/// small because memory bandwidth limits the merging of many samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearColor16(pub(super) [u16; 3]);

impl LinearColor16 {
    /// Value of white.
    const WHITE: f32 = 65535.0;

    /// The nearest colour. Values beyond white become white, and NaN black.
    #[inline]
    pub fn new(linear: Vec3) -> Self {
        Self(linear.to_array().map(Self::quantise))
    }

    /// Quantises one channel.
    #[inline]
    fn quantise(linear: f32) -> u16 {
        (linear * Self::WHITE + 0.5) as u16
    }

    /// The value of every sRGB level.
    pub(super) fn srgb_table() -> &'static [u16; 256] {
        static LEVELS: LazyLock<[u16; 256]> =
            LazyLock::new(|| linear_levels().map(LinearColor16::quantise));
        &LEVELS
    }

    /// The linear colour.
    #[inline(always)]
    pub(super) fn linear(self) -> Vec3 {
        Vec3::from_array(self.0.map(f32::from)) * (1.0 / Self::WHITE)
    }
}

/// Samples per chunk: a few rows of an image give a few hundred samples to a row of the cube.
const CHUNK: usize = 64;

/// End of a chain of chunks.
const NONE: u32 = u32::MAX;

/// The chunks of a row.
#[derive(Clone, Copy, Debug)]
struct ChunkChain {
    /// Index of the first chunk, or [`NONE`].
    first: u32,
    /// Index after the last sample.
    end: u32,
}

const EMPTY: ChunkChain = ChunkChain {
    first: NONE,
    end: 0,
};

/// Samples of one image by row of the cube, in the order in which they were pushed.
pub struct RowSamples {
    /// Number of the image; image 0 is pinned (C11).
    pub(super) image: u32,
    /// Chain of each row of each face.
    chains: Vec<ChunkChain>,
    /// Chunk after chunk; those beyond the first `next.len()` are left from an earlier image.
    samples: Vec<ImageSample>,
    /// The chunk after each chunk, or [`NONE`].
    next: Vec<u32>,
}

impl RowSamples {
    /// No samples of an image, for a cube with faces of `face_px` pixels along a side.
    pub fn new(face_px: u32, image: u32) -> Self {
        Self {
            image,
            chains: vec![EMPTY; 6 * face_px as usize],
            samples: Vec::new(),
            next: Vec::new(),
        }
    }

    /// Adds a sample to a row, which is numbered through all faces. Rows beyond the cube's are
    /// ignored.
    #[inline(always)]
    pub fn push(&mut self, row: u32, sample: ImageSample) {
        let row = row as usize;
        match self.chains.get(row) {
            Some(chain) if (chain.end as usize).is_multiple_of(CHUNK) => self.add_chunk(row),
            Some(_) => {}
            None => return,
        }
        let chain = &mut self.chains[row];
        if let Some(slot) = self.samples.get_mut(chain.end as usize) {
            *slot = sample;
            chain.end += 1;
        }
    }

    /// Adds an empty chunk to the chain of a row whose last chunk is full.
    #[cold]
    fn add_chunk(&mut self, row: usize) {
        let chain = &mut self.chains[row];
        let chunk = self.next.len() as u32;
        match chain.first {
            NONE => chain.first = chunk,
            _ => self.next[(chain.end as usize - 1) / CHUNK] = chunk,
        }
        self.next.push(NONE);
        chain.end = chunk * CHUNK as u32;
        let end = self.next.len() * CHUNK;
        if self.samples.len() < end {
            self.samples.resize(end, ImageSample::NONE);
        }
    }

    /// Maximum number of samples: the last chunk of each row may not be full.
    pub(super) fn max_count(&self) -> usize {
        self.next.len() * CHUNK
    }

    /// The samples of a row, chunk by chunk.
    pub(super) fn row(&self, row: usize) -> impl Iterator<Item = &[ImageSample]> {
        let ChunkChain { first, end } = self.chains[row];
        let end = end as usize;
        let chunk = |index: u32| (index != NONE).then_some(index);
        let chunks =
            std::iter::successors(chunk(first), move |&last| chunk(self.next[last as usize]));
        chunks.map(move |chunk| {
            let start = chunk as usize * CHUNK;
            let is_last = (end - 1) / CHUNK == chunk as usize;
            &self.samples[start..if is_last { end } else { start + CHUNK }]
        })
    }
}

/// Pool of merged [`RowSamples`], whose memory is reused for the next images.
#[derive(Default)]
pub(super) struct RowSamplePool(Mutex<Vec<RowSamples>>);

impl RowSamplePool {
    /// No samples of an image.
    pub(super) fn take(&self, face_px: u32, image: u32) -> RowSamples {
        let reused = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let Some(mut rows) = reused else {
            return RowSamples::new(face_px, image);
        };
        rows.image = image;
        rows.chains.fill(EMPTY);
        rows.next.clear();
        rows
    }

    /// Memory of the samples in the pool, bytes.
    pub(super) fn bytes(&self) -> usize {
        let pool = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let counts = pool.iter().map(|rows| rows.samples.len());
        size_of::<ImageSample>() * counts.sum::<usize>()
    }

    /// Returns merged samples to the pool.
    pub(super) fn put_back(&self, merged: Vec<RowSamples>) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .extend(merged);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_return_their_samples_in_order() {
        let pool = RowSamplePool::default();
        for round in 0..3u32 {
            let mut rows = pool.take(5, round);
            let sample_row = |i: u32| (i.wrapping_mul(2_654_435_761) >> 20) % (30 - 7 * round);
            let count = 4000 - 1500 * round;
            for i in 0..count {
                rows.push(
                    sample_row(i),
                    ImageSample {
                        column: i as u16,
                        ..ImageSample::NONE
                    },
                );
            }
            rows.push(30, ImageSample::NONE);
            for row in 0..30u32 {
                let columns: Vec<u32> = rows
                    .row(row as usize)
                    .flatten()
                    .map(|sample| sample.column.into())
                    .collect();
                let expected: Vec<u32> = (0..count).filter(|&i| sample_row(i) == row).collect();
                assert_eq!(columns, expected, "round {round}, row {row}");
            }
            pool.put_back(vec![rows]);
        }
    }
}
