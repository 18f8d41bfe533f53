//! Grey image pyramids for matching; each level has half the size of the one before.

use super::relative::LevelCamera;
use crate::{Lens, LoadedView, Pinhole, Pose};
use headbox_core::image::mip::{MipLevel, OddEdge};
use std::iter::successors;

/// Grey image with the four texels of each bilinear lookup packed together.
#[derive(Clone, Debug)]
pub(crate) struct Grey {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Four levels for each pixel, one byte each from the lowest: its own, that of the pixel to the
    /// right, below, and diagonally below. Clamped at the borders.
    pub(super) quads: Vec<u32>,
    /// True for background pixels: masked out or part of a dark backdrop.
    pub(crate) background: Vec<bool>,
}

impl Grey {
    fn new(level: &MipLevel<GreyPixel>) -> Self {
        let [width, height] = level.size;
        let mut quads = vec![0; width * height];
        for (y, row) in quads.chunks_exact_mut(width).enumerate() {
            let [upper, lower] =
                [y, (y + 1).min(height - 1)].map(|y| &level.texels[y * width..(y + 1) * width]);
            for (x, quad) in row.iter_mut().enumerate() {
                let right = (x + 1).min(width - 1);
                let four = [upper[x], upper[right], lower[x], lower[right]];
                *quad = u32::from_le_bytes(four.map(|pixel| pixel.level));
            }
        }
        Self {
            width,
            height,
            quads,
            background: level
                .texels
                .iter()
                .map(|pixel| pixel.is_background)
                .collect(),
        }
    }

    /// Returns the level of a pixel, clamped at the borders.
    #[inline(always)]
    pub(crate) fn level(&self, x: i32, y: i32) -> u8 {
        let x = x.clamp(0, self.width as i32 - 1) as usize;
        let y = y.clamp(0, self.height as i32 - 1) as usize;
        self.quads[y * self.width + x] as u8
    }
}

/// Pixel of a [`Grey`] image before packing.
#[derive(Clone, Copy, Debug)]
struct GreyPixel {
    level: u8,
    is_background: bool,
}

/// Returns the image at half the size: means of four pixels. An odd last column or row is dropped.
fn halved(finer: &MipLevel<GreyPixel>) -> MipLevel<GreyPixel> {
    finer.halved(OddEdge::Drop, |four| {
        let sum: u32 = four.iter().map(|pixel| u32::from(pixel.level)).sum();
        GreyPixel {
            level: ((sum + 2) / 4) as u8,
            is_background: four.iter().all(|pixel| pixel.is_background),
        }
    })
}

/// Image pyramid and camera of a view.
#[derive(Clone, Debug)]
pub(crate) struct MatchView {
    pose: Pose,
    /// Lens of the full-size image.
    lens: Pinhole,
    /// Number of halvings from the full-size image to the finest level.
    shift: u32,
    levels: Vec<Grey>,
}

impl MatchView {
    /// Builds the pyramid, from a longer side of at most `longest_px` down to a shorter side of at
    /// least `coarsest_px`; `None` for a panorama.
    pub(crate) fn new(
        view: &LoadedView,
        background: Vec<bool>,
        longest_px: u32,
        coarsest_px: u32,
    ) -> Option<Self> {
        let Lens::Pinhole(lens) = view.lens else {
            return None;
        };
        // Weights of Rec. 601, in 1/256.
        let grey = |&[r, g, b, _]: &[u8; 4]| {
            ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b) + 128) >> 8) as u8
        };
        let pixels = view.color.iter().map(grey).zip(background);
        let mut finest = MipLevel {
            size: view.size_px.map(|side| side as usize),
            texels: pixels
                .map(|(level, is_background)| GreyPixel {
                    level,
                    is_background,
                })
                .collect(),
        };
        let mut shift = 0;
        while finest.size[0].max(finest.size[1]) > longest_px.max(1) as usize {
            finest = halved(&finest);
            shift += 1;
        }
        let levels = successors(Some(finest), |level| {
            let shorter = level.size[0].min(level.size[1]);
            (shorter >= 2 * coarsest_px as usize).then(|| halved(level))
        });
        Some(Self {
            pose: view.pose,
            lens,
            shift,
            levels: levels.map(|level| Grey::new(&level)).collect(),
        })
    }

    /// Returns the number of levels; 0 is the finest.
    pub(crate) fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Returns the image of a level, or the coarsest beyond.
    pub(crate) fn level(&self, level: usize) -> &Grey {
        &self.levels[level.min(self.levels.len() - 1)]
    }

    /// Returns the camera of a level.
    pub(crate) fn camera(&self, level: usize) -> LevelCamera {
        let level = level.min(self.levels.len() - 1);
        LevelCamera::new(self.lens, self.pose, level as u32 + self.shift)
    }

    /// Returns the reduction factor of the finest level.
    pub(crate) fn reduced(&self) -> u32 {
        1 << self.shift
    }

    /// Returns the memory use, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.levels.iter().map(|level| level.quads.len() * 5).sum()
    }
}
