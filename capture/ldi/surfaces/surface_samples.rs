//! The lit parts of a face.

use crate::light::shade::LitPart;
use rayon::prelude::*;
use std::ops::Range;

/// The lit parts of a face, by pixel.
pub(crate) struct FaceParts {
    /// Pixels a side.
    pub size_px: u32,
    /// Prefix sums over the pixels in row-major order.
    pub offsets: Vec<u32>,
    /// All parts; of a pixel sorted by bin and class.
    pub parts: Vec<LitPart>,
}

impl FaceParts {
    /// The parts of pixel (x, y).
    pub(crate) fn pixel(&self, x: u32, y: u32) -> &[LitPart] {
        &self.parts[self.range(x, y)]
    }

    /// The numbers of the parts of pixel (x, y).
    pub(crate) fn range(&self, x: u32, y: u32) -> Range<usize> {
        let p = y as usize * self.size_px as usize + x as usize;
        self.offsets[p] as usize..self.offsets[p + 1] as usize
    }

    /// The class of every part.
    pub(crate) fn classes(&self) -> Vec<u16> {
        self.parts.par_iter().map(|part| part.class).collect()
    }

    /// The pixel of every part.
    pub(crate) fn pixels(&self) -> Vec<[u16; 2]> {
        let mut pixels = Vec::with_capacity(self.parts.len());
        for (y, row) in (0..).zip(
            self.offsets
                .windows(self.size_px as usize + 1)
                .step_by(self.size_px as usize),
        ) {
            for (x, run) in (0..).zip(row.windows(2)) {
                pixels.extend(std::iter::repeat_n([x, y], (run[1] - run[0]) as usize));
            }
        }
        pixels
    }
}
