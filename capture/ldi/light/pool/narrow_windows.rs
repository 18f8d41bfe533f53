//! The narrowest windows: sums over rows and columns.

use super::surface_key::SurfaceKey;
use super::window::{Sums, add, gaussian_support, sums};
use super::{GatheredLight, Pooling};
use rayon::prelude::*;

/// Number of passes, each with twice the step of the one before.
const LEVELS: u32 = 2;

/// Standard deviation of the window in each direction, pixels: from [1 2 1] / 4 with steps of 1, 2,
/// 4...
fn radius() -> f32 {
    (((1 << (2 * LEVELS)) - 1) as f32 / 6.0).sqrt()
}

/// See [`gaussian_support`].
pub(super) fn support() -> f32 {
    gaussian_support(radius())
}

/// The narrowest windows of all surface samples of a face.
pub(super) struct NarrowWindows<'a> {
    pub(super) pooling: &'a Pooling<'a>,
    /// Sums over the window of each surface sample.
    pub(super) sums: Vec<Sums>,
}

impl Pooling<'_> {
    /// Computes the narrowest window of each surface sample.
    pub(super) fn narrow_windows(&self, gathered: Vec<GatheredLight>) -> NarrowWindows<'_> {
        let mut sums: Vec<Sums> = gathered.par_iter().map(sums).collect();
        drop(gathered); // a pass needs two arrays of sums
        for step in (0..LEVELS).map(|level| 1 << level) {
            for direction in [[step, 0], [0, step]] {
                sums = self.pass(&sums, direction);
            }
        }
        NarrowWindows {
            pooling: self,
            sums,
        }
    }

    /// Applies [1 2 1] / 4 in one direction: adds half of the sums of each sample's surface in its
    /// own pixel, and a quarter of those in the pixels one step away to either side.
    fn pass(&self, from: &[Sums], [step_x, step_y]: [u32; 2]) -> Vec<Sums> {
        let size = self.surfaces.size_px;
        let step = (step_y * size + step_x) as usize;
        let window = |i: usize| {
            let key = &self.keys[i];
            let [x, y] = self.pixels[i].map(u32::from);
            let pixel = (y * size + x) as usize;
            let mut total = Sums::default();
            self.add_pixel(from, key, (pixel, 0.5), &mut total);
            if x >= step_x && y >= step_y {
                self.add_pixel(from, key, (pixel - step, 0.25), &mut total);
            }
            if x + step_x < size && y + step_y < size {
                self.add_pixel(from, key, (pixel + step, 0.25), &mut total);
            }
            total
        };
        (0..from.len()).into_par_iter().map(window).collect()
    }

    /// Adds the sums of a surface in a pixel, with a weight. A surface that crosses the pixel at a
    /// slant has several samples there, of which the mean counts.
    #[inline]
    fn add_pixel(
        &self,
        from: &[Sums],
        key: &SurfaceKey,
        (pixel, weight): (usize, f32),
        total: &mut Sums,
    ) {
        let offsets = &self.surfaces.offsets;
        let run = offsets[pixel] as usize..offsets[pixel + 1] as usize;
        let mut pixel_sums = Sums::default();
        let mut count = 0.0;
        for (other, values) in self.keys[run.clone()].iter().zip(&from[run]) {
            if key.is_same(other) {
                add(&mut pixel_sums, values, 1.0);
                count += 1.0;
            }
        }
        if count > 0.0 {
            add(total, &pixel_sums, weight / count);
        }
    }
}
