//! Overdraw: number and size of the footprints on each pixel.

use crate::render::footprint::splat::{Splats, covered_pixels};
use std::ops::Range;

/// Overdraw of one pixel of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overdraw {
    /// Number of footprints that contain the pixel's centre.
    pub footprints: u32,
    /// Longer side, px, of the front footprint whose core contains the centre, or else of the first
    /// footprint; 0 if there is none. See [`crate::render::canvas::depth`] about cores.
    pub width_px: f32,
}

/// Counts splats, in their order, on the pixels of some rows of a frame `width` pixels wide. `core`
/// is the fraction of a radius that is the splat's core.
pub(crate) fn count_footprints(
    pixels: &mut [Overdraw],
    width: u32,
    rows: &Range<u32>,
    splats: &Splats,
    core: f32,
) {
    let column_bounds = [0.0, width as f32];
    let row_bounds = [rows.start as f32, rows.end as f32];
    for i in 0..splats.count() {
        let [rx, ry] = [splats.radius_x[i], splats.radius_y[i]];
        let (x, y) = (splats.x[i], splats.y[i]);
        let [left, right] = covered_pixels(x, rx, column_bounds);
        let [top, bottom] = covered_pixels(y, ry, row_bounds);
        let [core_left, core_right] = covered_pixels(x, (rx * core).max(0.5), column_bounds);
        let [core_top, core_bottom] = covered_pixels(y, (ry * core).max(0.5), row_bounds);
        for row in top..bottom {
            let start = (row - rows.start.cast_signed()) as usize * width as usize;
            let is_core_row = (core_top..core_bottom).contains(&row);
            for column in left..right {
                let Some(pixel) = pixels.get_mut(start + column as usize) else {
                    continue;
                };
                pixel.footprints += 1;
                let is_core = is_core_row && (core_left..core_right).contains(&column);
                if pixel.width_px == 0.0 || is_core {
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
    fn pixels_count_footprints_over_their_centres() {
        let mut splats = Splats::new();
        // Over pixels 1 and 2 of the row; then over 2 alone; then over 3 to 5, with the core in 4.
        let positions = [(2.0, 1.0), (2.6, 0.5), (4.5, 1.5)];
        for (i, (x, radius)) in positions.into_iter().enumerate() {
            splats.x[i] = x;
            splats.y[i] = 7.5;
            splats.radius_x[i] = radius;
            splats.radius_y[i] = 0.5;
        }
        splats.len = positions.len();
        let mut pixels = [Overdraw::default(); 6];
        count_footprints(&mut pixels, 6, &(7..8), &splats, 0.25);
        let overdraw: Vec<_> = pixels.iter().map(|p| (p.footprints, p.width_px)).collect();
        assert_eq!(
            overdraw,
            [(0, 0.0), (1, 2.0), (2, 1.0), (1, 3.0), (1, 3.0), (1, 3.0)]
        );
    }

    #[test]
    fn width_is_of_front_core_or_first_footprint() {
        let mut splats = Splats::new();
        // The first covers columns 2 to 4 and rows 10 to 14, with the core in the middle; the
        // second columns 2 and 3 and rows 10 and 11, with the core in pixel 2, 11.
        let footprints = [([3.5, 12.5], [1.5, 2.5]), ([2.7, 11.05], [1.0, 1.2])];
        for (i, ([x, y], [rx, ry])) in footprints.into_iter().enumerate() {
            splats.x[i] = x;
            splats.y[i] = y;
            splats.radius_x[i] = rx;
            splats.radius_y[i] = ry;
        }
        splats.len = footprints.len();
        let width = 6;
        let overdraw = |rows: Range<u32>, core| {
            let mut pixels = vec![Overdraw::default(); rows.len() * width as usize];
            count_footprints(&mut pixels, width, &rows, &splats, core);
            pixels
        };
        let whole = overdraw(9..16, 0.2);
        let pixel = |column: usize, row: usize| {
            let overdraw = whole[(row - 9) * width as usize + column];
            (overdraw.footprints, overdraw.width_px)
        };
        assert_eq!(
            [pixel(3, 9), pixel(3, 10), pixel(3, 14), pixel(3, 15)],
            [(0, 0.0), (2, 5.0), (1, 5.0), (0, 0.0)]
        );
        assert_eq!(
            [pixel(1, 12), pixel(2, 12), pixel(4, 12), pixel(5, 12)],
            [(0, 0.0), (1, 5.0), (1, 5.0), (0, 0.0)]
        );
        assert_eq!(
            [pixel(2, 11), pixel(3, 11), pixel(2, 10)],
            [(2, 2.4), (2, 5.0), (2, 5.0)]
        );
        // A slightly larger core does not yet reach the next row.
        assert_eq!(overdraw(9..16, 0.44)[width as usize + 2].width_px, 5.0);
        let all_core = overdraw(9..16, 1.0);
        assert_eq!(
            all_core[2 * width as usize + 3].width_px,
            2.4,
            "the last one is in front"
        );
        assert_eq!(all_core[3 * width as usize + 4].width_px, 5.0);
        // The same in a band that begins inside them.
        assert_eq!(overdraw(12..16, 0.2), whole[3 * width as usize..]);
    }
}
