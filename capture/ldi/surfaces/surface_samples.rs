//! The surface samples of a face.

use crate::light::shade::SurfaceSample;
use rayon::prelude::*;
use std::ops::Range;

/// The surface samples of a face, by pixel.
#[derive(Default)]
pub(crate) struct FaceSurfaces {
    /// Pixels along a side.
    pub size_px: u32,
    /// Prefix sums over the pixels in row-major order.
    pub offsets: Vec<u32>,
    /// All samples; those of a pixel are sorted by bin and class.
    pub samples: Vec<SurfaceSample>,
}

impl FaceSurfaces {
    /// The samples of pixel (x, y).
    pub(crate) fn pixel(&self, x: u32, y: u32) -> &[SurfaceSample] {
        &self.samples[self.range(x, y)]
    }

    /// The indices of the samples of pixel (x, y).
    pub(crate) fn range(&self, x: u32, y: u32) -> Range<usize> {
        let pixel = y as usize * self.size_px as usize + x as usize;
        self.offsets[pixel] as usize..self.offsets[pixel + 1] as usize
    }

    /// The class of every sample.
    pub(crate) fn classes(&self) -> Vec<u16> {
        self.samples.par_iter().map(|sample| sample.class).collect()
    }

    /// The pixel of every sample.
    pub(crate) fn pixels(&self) -> Vec<[u16; 2]> {
        let mut pixels = Vec::with_capacity(self.samples.len());
        for (y, row) in (0..).zip(
            self.offsets
                .windows(self.size_px as usize + 1)
                .step_by(self.size_px as usize),
        ) {
            for (x, ends) in (0..).zip(row.windows(2)) {
                pixels.extend(std::iter::repeat_n([x, y], (ends[1] - ends[0]) as usize));
            }
        }
        pixels
    }
}
