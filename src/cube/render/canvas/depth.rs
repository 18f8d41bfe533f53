//! How far what a frame shows is, for what is to be put into it: geometry, sprites, overlays.

use crate::render::planes::{PlaneCanvas, Rim};
use crate::render::footprint::splat;
use crate::render::footprint::splat::{Splats, covered};
use crate::render::Spans;
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
        for (pixels, (colors, inverse_depths)) in self.inverse_depth.chunks_mut(self.width as usize).zip(ground.rows())
        {
            for ((pixel, color), inverse_depth) in pixels.iter_mut().zip(colors).zip(inverse_depths) {
                *pixel = if color[3] == 255 { inverse_depth.max(0.0) } else { 0.0 };
            }
        }
    }

    /// Adds what covers its pixel in part, after all splats: a pixel's depth is that of what covers half of it.
    pub(crate) fn add_rims(&mut self, rims: &[Rim]) {
        for rim in rims {
            let [column, row] = rim.pixel.map(|v| v as usize);
            if let Some(pixel) = self.inverse_depth.get_mut(row * self.width as usize + column)
                && (*pixel == 0.0 || rim.color[3] >= 128 && rim.inverse_depth > *pixel)
            {
                *pixel = rim.inverse_depth.max(0.0);
            }
        }
    }

    /// Draws splats, in their order, large ones where the ground does not hide them; `own` is the part of a radius that belongs to the sample
    /// alone.
    pub(crate) fn draw(&mut self, splats: &Splats, own: f32, ground: &PlaneCanvas) {
        let (columns, rows) = ([0.0, self.width as f32], [self.rows.start as f32, self.rows.end as f32]);
        for i in 0..splats.count() {
            let (x, y) = (splats.x[i], splats.y[i]);
            let [rx, ry] = [splats.radius_x[i], splats.radius_y[i]];
            let (own_x, own_y) = ((rx * own).max(0.5), (ry * own).max(0.5));
            let [left, right] = covered(x, rx + BORDER, columns);
            let [own_left, own_right] = covered(x, own_x, columns);
            let [top, bottom] = covered(y, ry + BORDER, rows);
            let [own_top, own_bottom] = covered(y, own_y, rows);
            let is_hidden = |column: i32, row: i32| {
                splats.is_large(i) && ground.hides([column as f32, row as f32], splats.inverse_depth[i])
            };
            for row in top..bottom {
                let start = (row - self.rows.start.cast_signed()) as usize * self.width as usize;
                let is_own_row = (own_top..own_bottom).contains(&row);
                for column in left..right {
                    let Some(pixel) = self.inverse_depth.get_mut(start + column as usize) else { continue };
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
            depths_m.iter_mut().zip(from).for_each(|(depth_m, inverse_depth)| *depth_m = 1.0 / inverse_depth);
        }
    }
}

#[cfg(test)]
mod tests;
