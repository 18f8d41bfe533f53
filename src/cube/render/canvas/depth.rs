//! Depth of a frame's pixels, for compositing with geometry, sprites and overlays.

use crate::render::footprint::splat::{Splats, covered_pixels};
use crate::render::planes::{PlaneLayer, Rim};
use std::ops::Range;

/// 1 / eye depth of the last splat drawn on each pixel.
///
/// Splats arrive in occlusion-compatible order, so that the last one is in front, without depth
/// comparisons, which could fail where surfaces touch. A splat overwrites the pixels of its core,
/// the sample's own area of the surface; outside the core, where its rim is blended with adjacent
/// splats, it only fills empty pixels.
#[derive(Default)]
pub(crate) struct DepthCanvas {
    width: u32,
    /// Rows of the frame.
    rows: Range<u32>,
    /// 1/m; 0 for empty pixels.
    inverse_depth: Vec<f32>,
}

/// Excess of a footprint over its radius, px, for canvases that round its centre to a pixel.
/// (Pixels without coverage get no depth in the end. Half a pixel and more would depend on the
/// bands, which cull splats by their radius.)
pub(crate) const BORDER: f32 = 0.25;

impl DepthCanvas {
    /// Clears the canvas for some rows of a frame `width` pixels wide, keeping its memory.
    pub(crate) fn clear(&mut self, width: u32, rows: Range<u32>) {
        self.inverse_depth.clear();
        self.inverse_depth.resize(width as usize * rows.len(), 0.0);
        self.width = width;
        self.rows = rows;
    }

    /// Initialises the empty canvas from the background.
    pub(crate) fn set_background(&mut self, background: &PlaneLayer) {
        for (pixels, (colors, inverse_depths)) in self
            .inverse_depth
            .chunks_mut(self.width as usize)
            .zip(background.visible_rows())
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

    /// Adds partly covered pixels, after all splats: those at least half covered take the rim's
    /// depth if it is nearer.
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

    /// Draws splats, in their order; large ones are tested against the background pixel by pixel.
    /// `core` is the fraction of a radius that is the splat's core.
    pub(crate) fn draw(&mut self, splats: &Splats, core: f32, background: &PlaneLayer) {
        let columns = [0.0, self.width as f32];
        let rows = [self.rows.start as f32, self.rows.end as f32];
        for i in 0..splats.count() {
            let (x, y) = (splats.x[i], splats.y[i]);
            let [rx, ry] = [splats.radius_x[i], splats.radius_y[i]];
            let [left, right] = covered_pixels(x, rx + BORDER, columns);
            let [core_left, core_right] = covered_pixels(x, (rx * core).max(0.5), columns);
            let [top, bottom] = covered_pixels(y, ry + BORDER, rows);
            let [core_top, core_bottom] = covered_pixels(y, (ry * core).max(0.5), rows);
            let is_hidden = |column: i32, row: i32| {
                splats.is_large(i)
                    && background.hides([column as f32, row as f32], splats.inverse_depth[i])
            };
            for row in top..bottom {
                let start = (row - self.rows.start.cast_signed()) as usize * self.width as usize;
                let is_core_row = (core_top..core_bottom).contains(&row);
                for column in left..right {
                    let Some(pixel) = self.inverse_depth.get_mut(start + column as usize) else {
                        continue;
                    };
                    let is_core = is_core_row && (core_left..core_right).contains(&column);
                    if (*pixel == 0.0 || is_core) && !is_hidden(column, row) {
                        *pixel = splats.inverse_depth[i];
                    }
                }
            }
        }
    }

    /// Writes eye depths of a row, counted from the canvas's first, from a column on: metres,
    /// infinite for empty pixels. Does nothing if `depths_m` is empty.
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

    fn one_splat(x: f32, y: f32, [rx, ry]: [f32; 2], inverse_depth: f32) -> Box<Splats> {
        let mut splats = Box::new(Splats::new());
        splats.len = 1;
        splats.x[0] = x;
        splats.y[0] = y;
        splats.radius_x[0] = rx;
        splats.radius_y[0] = ry;
        splats.inverse_depth[0] = inverse_depth;
        splats
    }

    #[test]
    fn splat_overwrites_core_and_fills_empty_pixels() {
        let width = 12;
        let rows = 3..11;
        let splats = [
            one_splat(5.2, 6.4, [3.0, 2.0], 0.5),
            one_splat(8.1, 7.3, [2.4, 3.1], 0.25),
            one_splat(0.3, 3.2, [1.9, 1.2], 2.0),
            one_splat(11.6, 10.5, [0.4, 0.3], 1.0),
        ];
        for core in [0.5, 0.2] {
            let mut canvas = DepthCanvas::default();
            canvas.clear(width, rows.clone());
            let mut expected = vec![0.0f32; 12 * 8];
            for splat in &splats {
                canvas.draw(splat, core, &PlaneLayer::default());
                let [rx, ry] = [splat.radius_x[0], splat.radius_y[0]];
                for (i, pixel) in expected.iter_mut().enumerate() {
                    let dx = (i % 12) as f32 + 0.5 - splat.x[0];
                    let dy = (i / 12) as f32 + 3.5 - splat.y[0];
                    let within = |rx: f32, ry: f32| dx.abs() < rx && dy.abs() < ry;
                    let is_core = within((rx * core).max(0.5), (ry * core).max(0.5));
                    if within(rx + BORDER, ry + BORDER) && (*pixel == 0.0 || is_core) {
                        *pixel = splat.inverse_depth[0];
                    }
                }
            }
            for row in 0..8 {
                let mut depths_m = vec![0.0; 9];
                canvas.resolve(row, 2, &mut depths_m);
                let expected: Vec<f32> = expected[row * 12 + 2..row * 12 + 11]
                    .iter()
                    .map(|q| 1.0 / q)
                    .collect();
                assert_eq!(depths_m, expected, "row {row}");
            }
        }
    }

    #[test]
    fn rims_count_where_they_cover_half_a_pixel() {
        let mut canvas = DepthCanvas::default();
        canvas.clear(4, 0..2);
        canvas.draw(
            &one_splat(1.5, 1.5, [0.5, 0.5], 0.5),
            1.0,
            &PlaneLayer::default(),
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
            "less than half"
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
            "at least half, if nearer"
        );
    }
}
