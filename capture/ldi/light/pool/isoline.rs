//! Windows along isolines: lines on which light comes from equally near.
//!
//! In a corner, irradiance changes within a few pixels across the edge where walls meet, and hardly
//! along it. Every window wider than the narrowest is biased there, and the narrowest leaves grain.
//! So successive narrow windows are averaged along the line of equal harmonic mean distance, across
//! which irradiance may change the most (Ward and Heckbert 1992, "Irradiance gradients").

use super::block_windows::WindowReader;
use super::window::{NEARNESS, SAMPLES, Sums, add, smooth_step};
use super::{Pooling, middle, narrow_windows};

/// Distance from one narrow window to the next, pixels: they hardly overlap.
const STEP_PX: f32 = 4.0;

/// Number of narrow windows to either side of the middle.
const REACH: i32 = 6;

/// Standard deviation of their weights along the line, steps.
const RADIUS: f32 = 3.0;

/// Correlation of the means of two successive windows, from Gaussians as wide as the narrow window.
const CORRELATION: f32 = 0.2;

/// Distance to either side over which nearness is compared to find the line, pixels.
const BASE_PX: i32 = 4;

/// Minimum change over that distance, as a share, for there to be a line.
const LEAST_CHANGE: f32 = 0.1;

/// Relative difference of nearness up to which a window counts in full, and from which not at all.
const AS_NEAR: [f32; 2] = [0.1, 0.3];

impl Pooling<'_> {
    /// Sums over the narrow windows along the isoline through surface sample `i`, and the support
    /// of the window; `None` where there is no line.
    pub(super) fn along_isoline(
        &self,
        i: usize,
        narrow: &[Sums],
        reader: &mut WindowReader,
    ) -> Option<(Sums, f32)> {
        let own_nearness = self.nearness(i, [0, 0], reader)?;
        let [x, y] = self.isoline_direction(i, own_nearness, reader)?;
        let mut sums = Sums::default();
        let mut total = 0.0;
        let mut squares = 0.0;
        let mut last = 0.0;
        for step in -REACH..=REACH {
            let offset = [x, y].map(|c| (c * STEP_PX * step as f32).round() as i32);
            let window = self
                .same_surface_at(i, offset)
                .zip(self.nearness(i, offset, reader));
            let weight = window.map_or(0.0, |(_, nearness)| {
                let gauss = (-0.5 * (step as f32 / RADIUS).powi(2)).exp();
                gauss * (1.0 - smooth_step(AS_NEAR, (nearness / own_nearness - 1.0).abs()))
            });
            if let Some((other, _)) = window {
                add(&mut sums, &narrow[other], weight);
            }
            total += weight;
            squares += weight * (weight + 2.0 * CORRELATION * last);
            last = weight;
        }
        Some((
            sums.map(|sum| sum / total),
            narrow_windows::support() * total * total / squares,
        ))
    }

    /// The direction in pixels in which nearness does not change.
    fn isoline_direction(
        &self,
        i: usize,
        own_nearness: f32,
        reader: &mut WindowReader,
    ) -> Option<[f32; 2]> {
        let mut change = |[x, y]: [i32; 2]| {
            let [before, after] = [[-x, -y], [x, y]].map(|offset| self.nearness(i, offset, reader));
            match (before, after) {
                (Some(before), Some(after)) => (after - before) / 2.0,
                (before, after) => {
                    after.map_or(0.0, |after| after - own_nearness)
                        + before.map_or(0.0, |before| own_nearness - before)
                }
            }
        };
        let [x, y] = [[BASE_PX, 0], [0, BASE_PX]].map(|offset| change(offset) / own_nearness);
        let length = x.hypot(y);
        (length >= LEAST_CHANGE).then(|| [-y / length, x / length])
    }

    /// One over the harmonic mean distance to the sources of light of a sample's surface, at an
    /// offset in pixels, 1/m.
    fn nearness(&self, i: usize, offset: [i32; 2], reader: &mut WindowReader) -> Option<f32> {
        let sums = reader.read(&self.keys[i], middle(self.pixel_at(i, offset)?));
        (sums[SAMPLES] > 0.0 && sums[NEARNESS] > 0.0).then(|| sums[NEARNESS] / sums[SAMPLES])
    }

    /// The first sample of the same surface at an offset in pixels.
    fn same_surface_at(&self, i: usize, offset: [i32; 2]) -> Option<usize> {
        let [x, y] = self.pixel_at(i, offset)?.map(u32::from);
        self.surfaces
            .range(x, y)
            .find(|&other| self.keys[i].is_same(&self.keys[other]))
    }

    /// The pixel at an offset, on the same face.
    fn pixel_at(&self, i: usize, offset: [i32; 2]) -> Option<[u16; 2]> {
        let [x, y] = [0, 1].map(|axis| i32::from(self.pixels[i][axis]) + offset[axis]);
        let side = 0..self.surfaces.size_px.cast_signed();
        (side.contains(&x) && side.contains(&y)).then_some([x as u16, y as u16])
    }
}
