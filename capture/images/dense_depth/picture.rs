//! Grey image pyramids for matching; each level has half the size of the one before.

use super::relative::LevelCamera;
use crate::{Lens, LoadedView, Pinhole, Pose};

/// Grey image with the four texels of each bilinear lookup packed together.
#[derive(Clone, Debug)]
pub(super) struct Grey {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Four levels for each pixel, one byte each from the lowest: its own, that of the pixel to the
    /// right, below, and diagonally below. Clamped at the borders.
    pub(super) quads: Vec<u32>,
    /// True for background pixels: masked out or part of a dark backdrop.
    pub(super) nothing: Vec<bool>,
}

impl Grey {
    pub(super) fn new(width: usize, height: usize, levels: &[u8], nothing: Vec<bool>) -> Self {
        let mut quads = vec![0; width * height];
        for (y, row) in quads.chunks_exact_mut(width).enumerate() {
            let [upper, lower] =
                [y, (y + 1).min(height - 1)].map(|y| &levels[y * width..(y + 1) * width]);
            for (x, quad) in row.iter_mut().enumerate() {
                let right = (x + 1).min(width - 1);
                *quad = u32::from_le_bytes([upper[x], upper[right], lower[x], lower[right]]);
            }
        }
        Self {
            width,
            height,
            quads,
            nothing,
        }
    }

    /// Returns the level of a pixel, clamped at the borders.
    #[inline(always)]
    pub(super) fn level(&self, x: i32, y: i32) -> u8 {
        let x = x.clamp(0, self.width as i32 - 1) as usize;
        let y = y.clamp(0, self.height as i32 - 1) as usize;
        self.quads[y * self.width + x] as u8
    }

    /// Returns the image at half the size: means of four pixels. An odd last column or row is
    /// dropped.
    fn halved(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let (mut levels, mut nothing) = (
            Vec::with_capacity(width * height),
            Vec::with_capacity(width * height),
        );
        for y in 0..height {
            for x in 0..width {
                let [own, right, below, last] = self.quads[2 * y * self.width + 2 * x]
                    .to_le_bytes()
                    .map(u32::from);
                levels.push(((own + right + below + last + 2) / 4) as u8);
                let at = |dx: usize, dy: usize| {
                    self.nothing[(2 * y + dy).min(self.height - 1) * self.width
                        + (2 * x + dx).min(self.width - 1)]
                };
                nothing.push(at(0, 0) && at(1, 0) && at(0, 1) && at(1, 1));
            }
        }
        Self::new(width, height, &levels, nothing)
    }
}

/// Image pyramid and camera of a view.
#[derive(Clone, Debug)]
pub(super) struct MatchView {
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
    pub(super) fn new(
        view: &LoadedView,
        nothing: Vec<bool>,
        longest_px: u32,
        coarsest_px: u32,
    ) -> Option<Self> {
        let Lens::Pinhole(lens) = view.lens else {
            return None;
        };
        let [width, height] = view.size_px.map(|side| side as usize);
        // Weights of Rec. 601, in 1/256.
        let grey = |&[r, g, b, _]: &[u8; 4]| {
            ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b) + 128) >> 8) as u8
        };
        let levels: Vec<u8> = view.color.iter().map(grey).collect();
        let mut finest = Grey::new(width, height, &levels, nothing);
        let mut shift = 0;
        while finest.width.max(finest.height) > longest_px.max(1) as usize {
            finest = finest.halved();
            shift += 1;
        }
        let mut levels = vec![finest];
        while let Some(last) = levels.last()
            && last.width.min(last.height) >= 2 * coarsest_px as usize
        {
            levels.push(last.halved());
        }
        Some(Self {
            pose: view.pose,
            lens,
            shift,
            levels,
        })
    }

    /// Returns the number of levels; 0 is the finest.
    pub(super) fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Returns the image of a level, or the coarsest beyond.
    pub(super) fn level(&self, level: usize) -> &Grey {
        &self.levels[level.min(self.levels.len() - 1)]
    }

    /// Returns the camera of a level.
    pub(super) fn camera(&self, level: usize) -> LevelCamera {
        let level = level.min(self.levels.len() - 1);
        LevelCamera::new(self.lens, self.pose, level as u32 + self.shift)
    }

    /// Returns the reduction factor of the finest level.
    pub(super) fn reduced(&self) -> u32 {
        1 << self.shift
    }

    /// Returns the memory use, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.levels.iter().map(|level| level.quads.len() * 5).sum()
    }
}
