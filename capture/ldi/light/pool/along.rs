//! Windows along lines on which light comes from equally near.
//!
//! Where walls meet irradiance changes across the corner, within a few pixels, and hardly along it: no window wider than the
//! narrowest stays clear of bias there, and that one leaves grain. So narrow windows are averaged that follow each other along the
//! line of equal harmonic mean distance, across which irradiance may change the most (Ward and Heckbert 1992, "Irradiance gradients").

use super::around::Reader;
use super::window::{NEARNESS, SAMPLES, Sums, smooth_step};
use super::{Pooling, middle};
use crate::light::pool::narrow;

/// From one narrow window to the next, pixels: they hardly overlap.
const STEP_PX: f32 = 4.0;

/// Narrow windows to either side of the middle.
const REACH: i32 = 6;

/// Standard deviation of their weights along the line, steps.
const RADIUS: f32 = 3.0;

/// Correlation of the means of two windows that follow each other: of Gaussians as wide as the narrow window.
const CORRELATION: f32 = 0.2;

/// How far to either side nearness is compared to find the line, pixels.
const BASE_PX: i32 = 4;

/// A change over that distance, as a share, below which there is no line.
const LEAST_CHANGE: f32 = 0.1;

/// What is as near as the middle but for the first of these shares counts in full, and beyond the second not at all.
const AS_NEAR: [f32; 2] = [0.1, 0.3];

impl Pooling<'_> {
    /// What was found over the narrow windows along a part's line, and parts over which a mean is as good; `None` where
    /// there is no line.
    pub(super) fn along(
        &self,
        part: usize,
        narrow: &[Sums],
        reader: &mut Reader,
    ) -> Option<(Sums, f32)> {
        let here = self.nearness(part, [0, 0], reader)?;
        let [x, y] = self.line(part, here, reader)?;
        let (mut sums, mut total, mut squares, mut last) = (Sums::default(), 0.0, 0.0, 0.0);
        for step in -REACH..=REACH {
            let away = [x, y].map(|c| (c * STEP_PX * step as f32).round() as i32);
            let found = self
                .same_surface_at(part, away)
                .zip(self.nearness(part, away, reader));
            let weight = found.map_or(0.0, |(_, near)| {
                let gauss = (-0.5 * (step as f32 / RADIUS).powi(2)).exp();
                gauss * (1.0 - smooth_step(AS_NEAR, (near / here - 1.0).abs()))
            });
            if let Some((other, _)) = found {
                sums.iter_mut()
                    .zip(&narrow[other])
                    .for_each(|(sum, value)| *sum += weight * value);
            }
            total += weight;
            squares += weight * (weight + 2.0 * CORRELATION * last);
            last = weight;
        }
        Some((
            sums.map(|sum| sum / total),
            narrow::parts() * total * total / squares,
        ))
    }

    /// The direction in pixels in which nearness does not change.
    fn line(&self, part: usize, here: f32, reader: &mut Reader) -> Option<[f32; 2]> {
        let mut change = |[x, y]: [i32; 2]| {
            let [before, after] = [[-x, -y], [x, y]].map(|away| self.nearness(part, away, reader));
            match (before, after) {
                (Some(before), Some(after)) => (after - before) / 2.0,
                (before, after) => {
                    after.map_or(0.0, |after| after - here)
                        + before.map_or(0.0, |before| here - before)
                }
            }
        };
        let [x, y] = [[BASE_PX, 0], [0, BASE_PX]].map(|away| change(away) / here);
        let length = x.hypot(y);
        (length >= LEAST_CHANGE).then(|| [-y / length, x / length])
    }

    /// One over the harmonic mean distance to what a part's surface has its light from, so many pixels away, 1/m.
    fn nearness(&self, part: usize, away: [i32; 2], reader: &mut Reader) -> Option<f32> {
        let sums = reader.at(&self.surfaces[part], middle(self.pixel_at(part, away)?));
        (sums[SAMPLES] > 0.0 && sums[NEARNESS] > 0.0).then(|| sums[NEARNESS] / sums[SAMPLES])
    }

    /// The first part of a part's surface so many pixels away.
    fn same_surface_at(&self, part: usize, away: [i32; 2]) -> Option<usize> {
        let [x, y] = self.pixel_at(part, away)?.map(u32::from);
        self.parts
            .range(x, y)
            .find(|&other| self.surfaces[part].is_same(&self.surfaces[other]))
    }

    /// The pixel so many pixels away, on the same face.
    fn pixel_at(&self, part: usize, away: [i32; 2]) -> Option<[u16; 2]> {
        let [x, y] = [0, 1].map(|i| i32::from(self.pixels[part][i]) + away[i]);
        let side = 0..self.parts.size_px.cast_signed();
        (side.contains(&x) && side.contains(&y)).then_some([x as u16, y as u16])
    }
}
