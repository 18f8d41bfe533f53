//! Each splat over what is there, in 8-bit integers (inventory S21, C12).

use super::{Canvas, Splats, covered, over};
use fearless_simd::{Level, dispatch};
use std::ops::Range;

/// An image in which every splat is blended over the ones before it.
///
/// A pixel keeps its straight colour and the share of it that is covered, so that the environment can be put *under* the
/// finished image, where it shows, instead of being drawn first, everywhere.
#[derive(Default)]
pub(crate) struct OverCanvas {
    width: u32,
    /// Rows of the frame that it holds.
    rows: Range<u32>,
    color: Vec<[u8; 4]>,
    /// False for rectangles of alpha 1, true for the paper's kernels.
    pub(crate) soft: bool,
}

/// Alphas of the paper's footprints as shifts, 2^-shift, for 1, 3, 5 and 7 pixels, by distance from the middle row and
/// column. A Gaussian of sigma = width / 4, rounded to 1, 1/2 and 1/4 in the logarithm (C12); the 3x3 one is the
/// centre 1, edges 1/2, corners 1/4.
const SHIFTS: [[[u8; 4]; 4]; 4] = [
    [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
    [[0, 1, 0, 0], [1, 2, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
    [[0, 0, 2, 0], [0, 1, 2, 0], [2, 2, 2, 0], [0, 0, 0, 0]],
    [[0, 0, 1, 2], [0, 0, 1, 2], [1, 1, 2, 2], [2, 2, 2, 2]],
];

/// `d + (s - d) * 2^-shift`, rounded to the nearest, ties toward `s`. That is the rounding that neither darkens nor
/// brightens: over many blends, rounding down darkens by 1.6 levels, and ties that go up brighten by 0.5 (see the test).
#[inline(always)]
fn blend_by_shift(d: u8, s: u8, shift: u8) -> u8 {
    let step = ((u16::from(d.abs_diff(s)) + ((1 << shift) >> 1)) >> shift) as u8;
    if s >= d { d + step } else { d - step }
}

impl OverCanvas {
    #[inline(always)]
    fn draw_all(&mut self, splats: &Splats) {
        for i in 0..splats.len {
            let footprint = splats.footprint[i];
            let [r, g, b, alpha] = splats.color[i];
            let source = [r, g, b, 255];
            // The paper's squares are centred on the pixel that holds the sample.
            let (x, y) = match self.soft {
                true => (splats.x[i].floor() + 0.5, splats.y[i].floor() + 0.5),
                false => (splats.x[i], splats.y[i]),
            };
            let shifts = &SHIFTS[if self.soft { footprint.class() } else { 0 }];
            let columns = covered(x, footprint.radius_x, &(0..self.width));
            for py in covered(y, footprint.radius_y, &self.rows) {
                let row_shifts = &shifts[((py as f32 + 0.5 - y).abs() as usize).min(3)];
                let start = (py - self.rows.start) as usize * self.width as usize;
                let row = &mut self.color[start + columns.start as usize..start + columns.end as usize];
                for (px, pixel) in columns.clone().zip(row) {
                    let shift = row_shifts[((px as f32 + 0.5 - x).abs() as usize).min(3)];
                    *pixel = match (alpha, pixel[3]) {
                        (255, _) if shift == 0 => source,
                        (255, 255) => std::array::from_fn(|c| blend_by_shift(pixel[c], source[c], shift)),
                        _ => over([r, g, b, alpha >> shift], *pixel),
                    };
                }
            }
        }
    }
}

impl Canvas for OverCanvas {
    fn clear(&mut self, width: u32, rows: Range<u32>) {
        self.width = width;
        self.rows = rows;
        self.color.clear();
        self.color.resize(width as usize * self.rows.len(), [0; 4]);
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => {
            let _ = simd; // the code is plain; the level decides what it is compiled to
            self.draw_all(splats);
        });
    }

    fn pixel(&self, index: usize) -> ([u8; 3], u8) {
        let [r, g, b, share] = self.color[index];
        ([r, g, b], share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels by which many random blends may lie above or below exact ones, on average: a tenth of the smallest step.
    const MEAN_BIAS_LEVELS: f64 = 0.1;

    #[test]
    fn shifted_blends_do_not_drift() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 16
        };
        let (mut exact, mut found, mut bias) = (128.0, 128u8, 0.0);
        const BLENDS: u32 = 100_000;
        for _ in 0..BLENDS {
            let (source, shift) = (60 + (random() % 120) as u8, 1 + (random() % 2) as u8);
            found = blend_by_shift(found, source, shift);
            exact += (f64::from(source) - exact) / f64::from(1 << shift);
            bias += f64::from(found) - exact;
        }
        let bias = bias / f64::from(BLENDS);
        assert!(bias.abs() < MEAN_BIAS_LEVELS, "{bias}");
    }

    #[test]
    fn blending_a_colour_over_itself_changes_nothing() {
        for c in 0..=255 {
            for shift in 0..=2 {
                assert_eq!(blend_by_shift(c, c, shift), c);
            }
            assert_eq!(blend_by_shift(255 - c, c, 0), c);
            for (front, behind) in [(0, 1), (1, 0), (77, 13), (254, 255), (3, 200)] {
                assert_eq!(over([c, c, c, front], [c, c, c, behind])[..3], [c; 3]);
            }
        }
    }
}
