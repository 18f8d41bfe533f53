//! What images say of the pixels of a cube, kept row by row of the cube as it comes.
//!
//! A sample is written once, where it is read again when its row is merged: each row of the cube has a chain of chunks of one vector.

use glam::Vec3;
use headbox_core::color::linear_levels;
use headbox_cube::model::samples::EncodedNormal;
use std::sync::{LazyLock, Mutex, PoisonError};

/// What an image, or a ray, says of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Of its row.
    pub column: u16,
    pub color: Light,
    /// About the cube's centre, 1/m.
    pub inverse_depth: f32,
    /// World axes, turned toward where it was seen from.
    pub normal: EncodedNormal,
    /// What it counts for in a mean.
    pub weight: f32,
    /// Of the surface that a pixel of its image covers, up to one factor for all (C10).
    pub area: f32,
}

impl Sample {
    /// Of no pixel.
    pub(super) const NONE: Self = Self {
        column: 0,
        color: Light([0; 3]),
        inverse_depth: 0.0,
        normal: EncodedNormal::Z,
        weight: 0.0,
        area: 0.0,
    };
}

/// A linear colour in 16 bits a channel: at the dark end of sRGB a level is 20 steps. Samples are many, and memory is what they wait for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light(pub(super) [u16; 3]);

impl Light {
    /// Steps of white.
    const WHITE: f32 = 65535.0;

    /// The nearest; beyond white is white, and NaN black.
    #[inline]
    pub fn new(linear: Vec3) -> Self {
        Self(linear.to_array().map(Self::channel))
    }

    /// One channel of it.
    #[inline]
    fn channel(linear: f32) -> u16 {
        (linear * Self::WHITE + 0.5) as u16
    }

    /// Of every sRGB level.
    pub(super) fn of_levels() -> &'static [u16; 256] {
        static LEVELS: LazyLock<[u16; 256]> = LazyLock::new(|| linear_levels().map(Light::channel));
        &LEVELS
    }

    #[inline(always)]
    pub(super) fn linear(self) -> Vec3 {
        Vec3::from_array(self.0.map(f32::from)) * (1.0 / Self::WHITE)
    }
}

/// Samples in a chunk: some rows of an image send a few hundred to a row of the cube.
const CHUNK: usize = 64;

/// No chunk.
const NONE: u32 = u32::MAX;

/// The samples of a row.
#[derive(Clone, Copy, Debug)]
struct Chain {
    /// Number of the first chunk, or [`NONE`].
    first: u32,
    /// The place after its last sample.
    end: u32,
}

const EMPTY: Chain = Chain {
    first: NONE,
    end: 0,
};

/// Samples of one image by row of the cube; those of a row in the order in which they came.
pub struct RowSamples {
    /// Which image they are of; image 0 is pinned (C11).
    pub(super) image: u32,
    /// Of each row of each face.
    chains: Vec<Chain>,
    /// Chunk after chunk; those beyond the first `next.len()` are left from an earlier image.
    samples: Vec<Sample>,
    /// The chunk after each, or [`NONE`].
    next: Vec<u32>,
}

impl RowSamples {
    /// None, of an image of which there may be many others, in a cube with faces of `face_px` pixels a side.
    pub fn new(face_px: u32, image: u32) -> Self {
        Self {
            image,
            chains: vec![EMPTY; 6 * face_px as usize],
            samples: Vec::new(),
            next: Vec::new(),
        }
    }

    /// Adds a sample to a row: face and row of it, in this order of significance. Rows beyond the cube's are left out.
    #[inline(always)]
    pub fn push(&mut self, row: u32, sample: Sample) {
        let row = row as usize;
        match self.chains.get(row) {
            Some(chain) if (chain.end as usize).is_multiple_of(CHUNK) => self.lengthen(row),
            Some(_) => {}
            None => return,
        }
        let chain = &mut self.chains[row];
        if let Some(place) = self.samples.get_mut(chain.end as usize) {
            *place = sample;
            chain.end += 1;
        }
    }

    /// Adds an empty chunk to the chain of a row, whose last is full.
    #[cold]
    fn lengthen(&mut self, row: usize) {
        let (chain, chunk) = (&mut self.chains[row], self.next.len() as u32);
        match chain.first {
            NONE => chain.first = chunk,
            _ => self.next[(chain.end as usize - 1) / CHUNK] = chunk,
        }
        self.next.push(NONE);
        chain.end = chunk * CHUNK as u32;
        let end = self.next.len() * CHUNK;
        if self.samples.len() < end {
            self.samples.resize(end, Sample::NONE);
        }
    }

    /// The samples of a row, in pieces.
    pub(super) fn row(&self, row: usize) -> impl Iterator<Item = &[Sample]> {
        let Chain { first, end } = self.chains[row];
        let end = end as usize;
        std::iter::successors((first != NONE).then_some(first), |&chunk| {
            match self.next[chunk as usize] {
                NONE => None,
                next => Some(next),
            }
        })
        .map(move |chunk| {
            let start = chunk as usize * CHUNK;
            let last = (end - 1) / CHUNK == chunk as usize;
            &self.samples[start..if last { end } else { start + CHUNK }]
        })
    }
}

/// Piles that were merged, whose memory serves the next images.
#[derive(Default)]
pub(super) struct SparePiles(Mutex<Vec<RowSamples>>);

impl SparePiles {
    /// An empty pile for an image.
    pub(super) fn pile(&self, face_px: u32, image: u32) -> RowSamples {
        let spare = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let Some(mut pile) = spare else {
            return RowSamples::new(face_px, image);
        };
        pile.image = image;
        pile.chains.fill(EMPTY);
        pile.next.clear();
        pile
    }

    /// Takes back what was merged.
    pub(super) fn keep(&self, piles: Vec<RowSamples>) {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .extend(piles);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pile_gives_back_what_it_was_given_row_by_row_in_order() {
        let spare = SparePiles::default();
        for round in 0..3u32 {
            let mut pile = spare.pile(5, round);
            let row_of = |i: u32| (i.wrapping_mul(2_654_435_761) >> 20) % (30 - 7 * round);
            let count = 4000 - 1500 * round;
            for i in 0..count {
                pile.push(
                    row_of(i),
                    Sample {
                        column: i as u16,
                        ..Sample::NONE
                    },
                );
            }
            pile.push(30, Sample::NONE);
            for row in 0..30u32 {
                let found: Vec<u32> = pile
                    .row(row as usize)
                    .flatten()
                    .map(|sample| sample.column.into())
                    .collect();
                let expected: Vec<u32> = (0..count).filter(|&i| row_of(i) == row).collect();
                assert_eq!(found, expected, "round {round}, row {row}");
            }
            spare.keep(vec![pile]);
        }
    }
}
