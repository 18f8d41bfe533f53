//! The narrowest window: sums over rows and columns.

use super::surface::Surface;
use super::window::{Sums, parts_within, sums_of};
use super::{Gathered, Pooling};
use rayon::prelude::*;

/// The window is the result of so many doublings.
const LEVELS: u32 = 2;

/// Standard deviation of the window in each direction, pixels: of [1 2 1] / 4, dilated by 1, 2, 4...
fn radius() -> f32 {
    (((1 << (2 * LEVELS)) - 1) as f32 / 6.0).sqrt()
}

/// See [`parts_within`].
pub(super) fn parts() -> f32 {
    parts_within(radius())
}

/// The narrowest windows of all parts of a face.
pub(super) struct Narrow<'a> {
    pub(super) pooling: &'a Pooling<'a>,
    /// Of each part.
    pub(super) sums: Vec<Sums>,
}

impl Pooling<'_> {
    /// The window of each part.
    pub(super) fn narrow(&self, gathered: &[Gathered]) -> Narrow<'_> {
        let mut sums: Vec<Sums> = gathered.par_iter().map(sums_of).collect();
        for step in (0..LEVELS).map(|level| 1 << level) {
            let across = self.pass(&sums, [step, 0]);
            sums = self.pass(&across, [0, step]);
        }
        Narrow {
            pooling: self,
            sums,
        }
    }

    /// Half of what each part's surface has in its own pixel, and a quarter of what it has in those one step away in either
    /// direction.
    fn pass(&self, from: &[Sums], [step_x, step_y]: [u32; 2]) -> Vec<Sums> {
        let size = self.parts.size_px;
        let step = (step_y * size + step_x) as usize;
        let of_part = |p: usize| {
            let (here, [x, y]) = (&self.surfaces[p], self.pixels[p].map(u32::from));
            let pixel = (y * size + x) as usize;
            let mut all = Sums::default();
            self.add(from, here, (pixel, 0.5), &mut all);
            if x >= step_x && y >= step_y {
                self.add(from, here, (pixel - step, 0.25), &mut all);
            }
            if x + step_x < size && y + step_y < size {
                self.add(from, here, (pixel + step, 0.25), &mut all);
            }
            all
        };
        (0..from.len()).into_par_iter().map(of_part).collect()
    }

    /// Adds what a surface has in a pixel, with a weight. In a pixel that it crosses slantwise it has several parts, of which the
    /// mean counts.
    #[inline]
    fn add(&self, from: &[Sums], here: &Surface, (pixel, weight): (usize, f32), all: &mut Sums) {
        let run = self.parts.offsets[pixel] as usize..self.parts.offsets[pixel + 1] as usize;
        let (mut sum, mut count) = (Sums::default(), 0.0);
        for (other, values) in self.surfaces[run.clone()].iter().zip(&from[run]) {
            if here.is_same(other) {
                sum.iter_mut()
                    .zip(values)
                    .for_each(|(sum, value)| *sum += value);
                count += 1.0;
            }
        }
        if count > 0.0 {
            all.iter_mut()
                .zip(sum)
                .for_each(|(all, sum)| *all += sum * (weight / count));
        }
    }
}
