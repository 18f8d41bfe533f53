//! From a canvas to the frame: the environment is put under what splats leave open.

use super::FramePlan;
use crate::capture::Camera;
use crate::environment::Environment;
use crate::frame::Coverage;
use crate::packed::PackedCube;
use crate::render::linear::LinearLight;
use fearless_simd::{Level, Simd, dispatch};
use glam::DVec3;
use rayon::prelude::*;

/// Pixels of the frame, row by row. What they hold before does not matter.
pub(super) struct Pixels<'a> {
    /// From a canvas: straight colour, and the share of 255 that splats cover. In the frame: colour and alpha, 255.
    pub(super) colors: &'a mut [[u8; 4]],
    pub(super) coverages: &'a mut [Coverage],
    /// Eye depth, m, infinite where no splat is. Empty if nobody wants it.
    pub(super) depths_m: &'a mut [f32],
}

impl<'a> Pixels<'a> {
    /// Its rows, each `width` pixels long.
    pub(super) fn rows(self, width: u32) -> impl Iterator<Item = Pixels<'a>> {
        let width = width as usize;
        let mut depths_m = self.depths_m.chunks_mut(width);
        let rows = self.colors.chunks_mut(width).zip(self.coverages.chunks_mut(width));
        rows.map(move |(colors, coverages)| Pixels { colors, coverages, depths_m: depths_m.next().unwrap_or(&mut []) })
    }
}

/// The pieces of `depths_m`, or as many empty ones if it is empty.
pub(super) fn depth_pieces(
    depths_m: &mut [f32],
    piece: usize,
    count: usize,
) -> impl IndexedParallelIterator<Item = &mut [f32]> {
    let missing = if depths_m.is_empty() { count } else { 0 };
    depths_m.par_chunks_mut(piece).chain((0..missing).into_par_iter().map(|_| Default::default()))
}

/// What shows where splats leave a frame open.
pub(super) struct Background<'a> {
    environment: &'a Environment,
    camera: &'a Camera,
    hole_color_srgb: [u8; 3],
    level: Level,
}

/// Pixels that are finished at a time.
const CHUNK: usize = 16;

impl<'a> Background<'a> {
    pub(super) fn new(plan: &FramePlan, cube: &'a PackedCube, camera: &'a Camera) -> Self {
        let FramePlan { level, hole_color_srgb, .. } = *plan;
        Self { environment: &cube.environment, camera, hole_color_srgb, level }
    }

    /// Makes the resolved pixels of a canvas in row `y` those of the frame, and returns how many of them are holes.
    pub(super) fn put_under(&self, y: u32, pixels: Pixels) -> u64 {
        let start = self.camera.direction(0.5, f64::from(y) + 0.5);
        let step = self.camera.direction(1.5, f64::from(y) + 0.5) - start;
        let holes =
            dispatch!(self.level, simd => self.put_under_row(simd, [start, step], pixels.colors, pixels.coverages));
        for (depth_m, coverage) in pixels.depths_m.iter_mut().zip(pixels.coverages) {
            if coverage.splat_share() == 0 {
                *depth_m = f32::INFINITY;
            }
        }
        holes
    }

    #[inline(always)]
    fn put_under_row<S: Simd>(
        &self,
        simd: S,
        [start, step]: [DVec3; 2],
        colors: &mut [[u8; 4]],
        coverages: &mut [Coverage],
    ) -> u64 {
        let mut holes = 0;
        let chunks = colors.chunks_mut(CHUNK).zip(coverages.chunks_mut(CHUNK)).zip((0..).step_by(CHUNK));
        for ((colors, coverages), first) in chunks {
            let open = colors.iter().rev().fold(0, |open, color| open << 1 | u64::from(color[3] < 255));
            if open == 0 {
                coverages.fill(Coverage::FULL);
                continue;
            }
            let directions = [start + step * f64::from(first), step].map(|v| v.as_vec3());
            let seen = self.environment.sample_sixteen(simd, open, directions[0], directions[1]);
            for ((color, coverage), seen) in colors.iter_mut().zip(coverages).zip(seen) {
                *coverage = self.finish_pixel(color, seen);
                holes += u64::from(coverage.is_hole());
            }
        }
        holes
    }

    /// Puts what is seen behind a pixel under it, if anything is known of it; alone, its colour stands for all of the pixel.
    #[inline(always)]
    fn finish_pixel(&self, color: &mut [u8; 4], [sr, sg, sb, known]: [u8; 4]) -> Coverage {
        let [r, g, b, share] = *color;
        let ([r, g, b], coverage) = match (share, known) {
            (0, 0) => (self.hole_color_srgb, Coverage::HOLE),
            (0, _) => ([sr, sg, sb], Coverage::ENVIRONMENT),
            (255, _) | (_, 0) => ([r, g, b], Coverage::of_splats(share)),
            _ => {
                let shares = [u32::from(share), u32::from(255 - share)];
                (LinearLight::tables().mix([[r, g, b], [sr, sg, sb]], shares), Coverage::of_splats(share))
            }
        };
        *color = [r, g, b, 255];
        coverage
    }
}
