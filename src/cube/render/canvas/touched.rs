//! What footprints do to pixels, counted rather than blended: for overlays that show how a frame is made.

use crate::render::footprint::splat::{Splats, covered};
use std::ops::Range;

/// What happened at one pixel of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Touched {
    /// Footprints that its centre lies in: how often the pixel was drawn.
    pub footprints: u32,
    /// Longer side of the front one, px, of those whose sample owns the pixel (see [`super::depth`]), or else of the first;
    /// 0 if there is none.
    pub width_px: f32,
}

/// Counts splats, in their order, on pixels: the rows `rows` of a frame that is `width` pixels wide. `own` is the part of a
/// radius that belongs to the sample alone.
pub(crate) fn touch(
    pixels: &mut [Touched],
    width: u32,
    rows: &Range<u32>,
    splats: &Splats,
    own: f32,
) {
    let (across, down) = ([0.0, width as f32], [rows.start as f32, rows.end as f32]);
    for i in 0..splats.count() {
        let [rx, ry] = [splats.radius_x[i], splats.radius_y[i]];
        let [left, right] = covered(splats.x[i], rx, across);
        let [top, bottom] = covered(splats.y[i], ry, down);
        let [own_left, own_right] = covered(splats.x[i], (rx * own).max(0.5), across);
        let [own_top, own_bottom] = covered(splats.y[i], (ry * own).max(0.5), down);
        for row in top..bottom {
            let start = (row - rows.start.cast_signed()) as usize * width as usize;
            let is_own_row = (own_top..own_bottom).contains(&row);
            for column in left..right {
                let Some(pixel) = pixels.get_mut(start + column as usize) else {
                    continue;
                };
                pixel.footprints += 1;
                if pixel.width_px == 0.0 || is_own_row && (own_left..own_right).contains(&column) {
                    pixel.width_px = 2.0 * rx.max(ry);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_count_the_footprints_that_hold_their_centres() {
        let mut splats = Splats::new();
        // Over pixels 1 and 2 of the row; then over 2 alone; then one that only fills what is around its own pixel, 4.
        let drawn = [(2.0, 1.0), (2.6, 0.5), (4.5, 1.5)];
        for (i, (x, radius)) in drawn.into_iter().enumerate() {
            (splats.x[i], splats.y[i]) = (x, 7.5);
            (splats.radius_x[i], splats.radius_y[i]) = (radius, 0.5);
        }
        splats.len = drawn.len();
        let mut pixels = [Touched::default(); 6];
        touch(&mut pixels, 6, &(7..8), &splats, 0.25);
        let found: Vec<_> = pixels.iter().map(|p| (p.footprints, p.width_px)).collect();
        assert_eq!(
            found,
            [(0, 0.0), (1, 2.0), (2, 1.0), (1, 3.0), (1, 3.0), (1, 3.0)]
        );
    }

    #[test]
    fn owned_pixels_tell_their_samples_longer_side_and_others_the_first() {
        let mut splats = Splats::new();
        // The first lies over columns 2 to 4 and rows 10 to 14, of which the middle is its own; the second over columns 2 and 3 and rows
        // 10 and 11, of which it owns pixel 2, 11.
        let drawn = [([3.5, 12.5], [1.5, 2.5]), ([2.7, 11.05], [1.0, 1.2])];
        for (i, ([x, y], [rx, ry])) in drawn.into_iter().enumerate() {
            (
                splats.x[i],
                splats.y[i],
                splats.radius_x[i],
                splats.radius_y[i],
            ) = (x, y, rx, ry);
        }
        splats.len = drawn.len();
        let width = 6;
        let touched = |rows: Range<u32>, own| {
            let mut pixels = vec![Touched::default(); rows.len() * width as usize];
            touch(&mut pixels, width, &rows, &splats, own);
            pixels
        };
        let whole = touched(9..16, 0.2);
        let at = |column: usize, row: usize| {
            let pixel = whole[(row - 9) * width as usize + column];
            (pixel.footprints, pixel.width_px)
        };
        assert_eq!(
            [at(3, 9), at(3, 10), at(3, 14), at(3, 15)],
            [(0, 0.0), (2, 5.0), (1, 5.0), (0, 0.0)]
        );
        assert_eq!(
            [at(1, 12), at(2, 12), at(4, 12), at(5, 12)],
            [(0, 0.0), (1, 5.0), (1, 5.0), (0, 0.0)]
        );
        assert_eq!(
            [at(2, 11), at(3, 11), at(2, 10)],
            [(2, 2.4), (2, 5.0), (2, 5.0)]
        );
        // A little more of it is its own, and not yet the next row.
        assert_eq!(touched(9..16, 0.44)[width as usize + 2].width_px, 5.0);
        let all_own = touched(9..16, 1.0);
        assert_eq!(
            all_own[2 * width as usize + 3].width_px,
            2.4,
            "what is drawn last is in front"
        );
        assert_eq!(all_own[3 * width as usize + 4].width_px, 5.0);
        // The same in a band that begins amid them.
        assert_eq!(touched(12..16, 0.2), whole[3 * width as usize..]);
    }
}
