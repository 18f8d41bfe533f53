//! How far what a frame shows is, for what is to be put into it: geometry, sprites, overlays.

use crate::render::Spans;
use crate::render::footprint::splat;
use crate::render::footprint::splat::{Splats, covered};
use crate::render::planes::{PlaneCanvas, Rim};
use std::ops::Range;

/// 1 / eye depth of the splat that was drawn last on each pixel.
///
/// Splats arrive in occlusion-compatible order, so that the last one is the one in front, and no comparison of depths, which
/// could go wrong where surfaces touch, is needed. A splat owns its sample's share of the surface; beyond it, where its rim
/// is blended with its neighbours', it only fills what nothing else has touched.
#[derive(Default)]
pub(crate) struct DepthCanvas {
    width: u32,
    /// Rows of the frame that it holds.
    rows: Range<u32>,
    /// 1/m; 0 where there is nothing.
    inverse_depth: Vec<f32>,
}

/// Pixels by which a footprint may reach beyond its radius, because a canvas centres it on a pixel: rounding. (Where it does
/// not reach, the pixel's coverage says so. Half a pixel and more would depend on the bands, which leave out splats by
/// their radius.)
const BORDER: f32 = 0.25;

impl DepthCanvas {
    /// Makes it empty, for these rows of a frame that is `width` pixels wide, keeping the memory it has.
    pub(crate) fn clear(&mut self, width: u32, rows: Range<u32>) {
        self.inverse_depth.clear();
        self.inverse_depth.resize(width as usize * rows.len(), 0.0);
        (self.width, self.rows) = (width, rows);
    }

    /// As [`crate::render::footprint::splat::Canvas::clear_spans`].
    pub(crate) fn clear_spans(&mut self, [width, height]: [u32; 2], spans: &dyn Fn(u32) -> Spans) {
        if (self.width, &self.rows) != (width, &(0..height)) {
            self.clear(width, 0..height);
        }
        splat::clear_spans(&mut self.inverse_depth, width as usize, 0, 0.0, spans);
    }

    /// As [`crate::render::footprint::splat::Canvas::lay`].
    pub(crate) fn lay(&mut self, ground: &PlaneCanvas) {
        for (pixels, (colors, inverse_depths)) in self
            .inverse_depth
            .chunks_mut(self.width as usize)
            .zip(ground.rows())
        {
            for ((pixel, color), inverse_depth) in pixels.iter_mut().zip(colors).zip(inverse_depths)
            {
                *pixel = if color[3] == 255 {
                    inverse_depth.max(0.0)
                } else {
                    0.0
                };
            }
        }
    }

    /// Adds what covers its pixel in part, after all splats: a pixel's depth is that of what covers half of it.
    pub(crate) fn add_rims(&mut self, rims: &[Rim]) {
        for rim in rims {
            let [column, row] = rim.pixel.map(|v| v as usize);
            if let Some(pixel) = self
                .inverse_depth
                .get_mut(row * self.width as usize + column)
                && (*pixel == 0.0 || rim.color[3] >= 128 && rim.inverse_depth > *pixel)
            {
                *pixel = rim.inverse_depth.max(0.0);
            }
        }
    }

    /// Draws splats, in their order, large ones where the ground does not hide them; `own` is the part of a radius that belongs to the sample
    /// alone.
    pub(crate) fn draw(&mut self, splats: &Splats, own: f32, ground: &PlaneCanvas) {
        let (columns, rows) = (
            [0.0, self.width as f32],
            [self.rows.start as f32, self.rows.end as f32],
        );
        for i in 0..splats.count() {
            let (x, y) = (splats.x[i], splats.y[i]);
            let [rx, ry] = [splats.radius_x[i], splats.radius_y[i]];
            let (own_x, own_y) = ((rx * own).max(0.5), (ry * own).max(0.5));
            let [left, right] = covered(x, rx + BORDER, columns);
            let [own_left, own_right] = covered(x, own_x, columns);
            let [top, bottom] = covered(y, ry + BORDER, rows);
            let [own_top, own_bottom] = covered(y, own_y, rows);
            let is_hidden = |column: i32, row: i32| {
                splats.is_large(i)
                    && ground.hides([column as f32, row as f32], splats.inverse_depth[i])
            };
            for row in top..bottom {
                let start = (row - self.rows.start.cast_signed()) as usize * self.width as usize;
                let is_own_row = (own_top..own_bottom).contains(&row);
                for column in left..right {
                    let Some(pixel) = self.inverse_depth.get_mut(start + column as usize) else {
                        continue;
                    };
                    let is_own = is_own_row && (own_left..own_right).contains(&column);
                    if (*pixel == 0.0 || is_own) && !is_hidden(column, row) {
                        *pixel = splats.inverse_depth[i];
                    }
                }
            }
        }
    }

    /// Writes the eye depths of the pixels of a row, counted from its first row on, from a column on: metres, infinite where
    /// there is nothing. Nothing if `depths_m` is empty.
    pub(crate) fn resolve(&self, row: usize, column: usize, depths_m: &mut [f32]) {
        let start = row * self.width as usize + column;
        if let Some(from) = self.inverse_depth.get(start..start + depths_m.len()) {
            depths_m
                .iter_mut()
                .zip(from)
                .for_each(|(depth_m, inverse_depth)| *depth_m = 1.0 / inverse_depth);
        }
    }
}

#[cfg(test)]
mod tests {
    //! Small canvases, pixel by pixel.

    use super::*;

    fn one(x: f32, y: f32, [rx, ry]: [f32; 2], inverse_depth: f32) -> Box<Splats> {
        let mut splats = Box::new(Splats::new());
        splats.len = 1;
        (
            splats.x[0],
            splats.y[0],
            splats.radius_x[0],
            splats.radius_y[0],
        ) = (x, y, rx, ry);
        splats.inverse_depth[0] = inverse_depth;
        splats
    }

    #[test]
    fn a_splat_owns_its_share_and_fills_the_rest_where_nothing_is() {
        let (width, rows) = (12, 3..11);
        let splats = [
            one(5.2, 6.4, [3.0, 2.0], 0.5),
            one(8.1, 7.3, [2.4, 3.1], 0.25),
            one(0.3, 3.2, [1.9, 1.2], 2.0),
            one(11.6, 10.5, [0.4, 0.3], 1.0),
        ];
        for own in [0.5, 0.2] {
            let mut canvas = DepthCanvas::default();
            canvas.clear(width, rows.clone());
            let mut expected = vec![0.0f32; 12 * 8];
            for splat in &splats {
                canvas.draw(splat, own, &PlaneCanvas::default());
                let (x, y, [rx, ry]) = (
                    splat.x[0],
                    splat.y[0],
                    [splat.radius_x[0], splat.radius_y[0]],
                );
                for (i, pixel) in expected.iter_mut().enumerate() {
                    let (dx, dy) = ((i % 12) as f32 + 0.5 - x, (i / 12) as f32 + 3.5 - y);
                    let within = |rx: f32, ry: f32| dx.abs() < rx && dy.abs() < ry;
                    let is_own = within((rx * own).max(0.5), (ry * own).max(0.5));
                    if within(rx + BORDER, ry + BORDER) && (*pixel == 0.0 || is_own) {
                        *pixel = splat.inverse_depth[0];
                    }
                }
            }
            for row in 0..8 {
                let mut found = vec![0.0; 9];
                canvas.resolve(row, 2, &mut found);
                let expected: Vec<f32> = expected[row * 12 + 2..row * 12 + 11]
                    .iter()
                    .map(|q| 1.0 / q)
                    .collect();
                assert_eq!(found, expected, "row {row}");
            }
        }
    }

    #[test]
    fn a_pixel_has_the_depth_of_what_covers_half_of_it() {
        let mut canvas = DepthCanvas::default();
        canvas.clear(4, 0..2);
        canvas.draw(
            &one(1.5, 1.5, [0.5, 0.5], 0.5),
            1.0,
            &PlaneCanvas::default(),
        );
        let rim = |column: u32, share: u8, inverse_depth: f32| Rim {
            pixel: [column, 1],
            color: [0, 0, 0, share],
            inverse_depth,
        };
        canvas.add_rims(&[rim(0, 1, 0.25), rim(1, 127, 1.0), rim(2, 0, -1.0)]);
        assert_eq!(
            canvas.inverse_depth[4..],
            [0.25, 0.5, 0.0, 0.0],
            "less than half, and nothing before it"
        );
        canvas.add_rims(&[
            rim(0, 128, 0.2),
            rim(1, 128, 0.6),
            rim(1, 255, 0.5),
            rim(9, 255, 9.0),
        ]);
        assert_eq!(
            canvas.inverse_depth,
            [0.0, 0.0, 0.0, 0.0, 0.25, 0.6, 0.0, 0.0],
            "half, if it is nearer"
        );
    }

    #[test]
    fn some_columns_of_a_frame_are_made_empty() {
        let mut canvas = DepthCanvas::default();
        canvas.clear(6, 0..2);
        canvas.draw(
            &one(3.0, 1.0, [3.0, 1.0], 0.5),
            1.0,
            &PlaneCanvas::default(),
        );
        canvas.clear_spans([6, 2], &|y| [0..1 + y, 3..3, 4..5]);
        assert_eq!(
            canvas.inverse_depth,
            [0.0, 0.5, 0.5, 0.5, 0.0, 0.5, 0.0, 0.0, 0.5, 0.5, 0.0, 0.5]
        );
        canvas.clear_spans([3, 2], &|_| [0..0, 0..0, 0..0]);
        assert_eq!(canvas.inverse_depth, [0.0; 6], "another size is all new");
    }
}
