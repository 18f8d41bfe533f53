//! Canvas that blends each splat *over* its pixels, in 8-bit integers (S21, C12).

#[cfg(test)]
mod tests;

use super::linear::{LinearLight, unpremultiply};
use super::{Canvas, Tolerance};
use crate::render::footprint::size::LANES;
use crate::render::footprint::splat::{Splats, ceil_to_i32, covered_pixels_lanes, load};
use crate::render::planes::PlaneLayer;
use fearless_simd::{Level, Simd, SimdCvtTruncate, dispatch, i32x16, prelude::*, u8x16, u16x16};
use std::ops::Range;

/// Canvas in which every splat is blended over the ones before it.
///
/// Colours are premultiplied by coverage, so that one blend serves all four bytes, and the
/// environment can be composited *under* the finished image, where it is visible, instead of being
/// drawn first, everywhere.
#[derive(Default)]
pub(crate) struct OverCanvas {
    width: u32,
    /// Rows of the frame.
    rows: Range<u32>,
    /// Red, green and blue times coverage, and coverage; rows of `stride` pixels, of which
    /// [`MARGIN`] lie to the left of the frame and as many to the right, for stamps that reach out
    /// of it.
    pixels: Vec<[u8; 4]>,
    background: PlaneLayer,
    shape: SplatShape,
}

/// Pixels that a splat covers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum SplatShape {
    /// A rectangle of alpha 1.
    #[default]
    Rectangle,
    /// The pixel that contains the sample.
    Point,
    /// The pixel that contains the sample, and the rest of its row and column inside the rectangle.
    Plus,
    /// The paper's squares, whose alpha falls toward their borders.
    PaperSquare,
}

/// Pixels outside the frame on either side: half of the widest stamp beyond the farthest splat that
/// touches the frame, and the excess of a blend of whole registers.
const MARGIN: usize = 16;

/// Pixels that are blended at once.
const PIXELS: usize = 4;

/// Least coverage that counts as opaque: blends by a quarter converge to 254.
const OPAQUE: u8 = 252;

/// Weights of the paper's footprints in 1/128, for 1, 3, 5 and 7 pixels, by distance from the
/// middle row, from the left column on, each four times for the channels. A Gaussian of sigma =
/// width / 4, rounded to 1, 1/2 and 1/4 in the logarithm (C12); the 3x3 one is the centre 1, edges
/// 1/2, corners 1/4.
static STAMPS: [[[[u16; 4 * PIXELS]; 2]; 4]; 4] = {
    const SHIFTS: [[[u8; 4]; 4]; 4] = [
        [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
        [[0, 1, 0, 0], [1, 2, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
        [[0, 0, 2, 0], [0, 1, 2, 0], [2, 2, 2, 0], [0, 0, 0, 0]],
        [[0, 0, 1, 2], [0, 0, 1, 2], [1, 1, 2, 2], [2, 2, 2, 2]],
    ];
    let mut stamps = [[[[0; 4 * PIXELS]; 2]; 4]; 4];
    let mut i = 0;
    while i < 4 * 4 * 2 * PIXELS {
        let (class, row, column) = (i / 32, i / 8 % 4, i % 8);
        if row <= class && column <= 2 * class {
            let from_middle = column.abs_diff(class);
            let weight = 128 >> SHIFTS[class][row][from_middle];
            let mut channel = 0;
            while channel < 4 {
                stamps[class][row][column / PIXELS][column % PIXELS * 4 + channel] = weight;
                channel += 1;
            }
        }
        i += 1;
    }
    stamps
};

/// Computes `d + (s - d) * weight / 256`, rounded to the nearest, ties toward `s`. This rounding
/// has no bias: over many blends, rounding down darkens by 1.6 levels, and ties that go up brighten
/// by 0.5 (see the test).
#[inline(always)]
fn blend<S: Simd>(simd: S, pixels: &mut [[u8; 4]; PIXELS], source: u16x16<S>, weight: u16x16<S>) {
    let (low, high) = u8x16::load_array(simd, bytemuck::cast(*pixels)).widen();
    let destination = simd.combine_u16x8(low, high);
    let half = source
        .simd_gt(destination)
        .select(u16x16::splat(simd, 128), u16x16::splat(simd, 127));
    let rest = u16x16::splat(simd, 256) - weight;
    let (low, high) = simd.split_u16x16((destination * rest + source * weight + half) >> 8);
    *pixels = bytemuck::cast(simd.narrow_u16x8(low, high).to_array());
}

impl OverCanvas {
    pub(crate) fn new(shape: SplatShape) -> Self {
        Self {
            shape,
            ..Self::default()
        }
    }

    fn stride(&self) -> usize {
        self.width as usize + 2 * MARGIN
    }

    #[inline(always)]
    fn draw_all<S: Simd>(&mut self, simd: S, splats: &Splats) {
        match self.shape {
            SplatShape::PaperSquare => self.draw_paper_squares(simd, splats),
            SplatShape::Point => self.draw_points(simd, splats),
            SplatShape::Rectangle => self.draw_rectangles::<_, false>(simd, splats),
            SplatShape::Plus => self.draw_rectangles::<_, true>(simd, splats),
        }
    }

    /// Blends a splat over [`PIXELS`] pixels from index `start` on.
    #[inline(always)]
    fn blend_pixels<S: Simd>(
        &mut self,
        simd: S,
        start: usize,
        source: u16x16<S>,
        weight: u16x16<S>,
    ) {
        if let Some(pixels) = self
            .pixels
            .get_mut(start..)
            .and_then(|pixels| pixels.first_chunk_mut())
        {
            blend(simd, pixels, source, weight);
        }
    }

    /// Draws single pixels.
    #[inline(always)]
    fn draw_points<S: Simd>(&mut self, simd: S, splats: &Splats) {
        let stride = self.stride() as i32;
        let rows = self.rows.len() as i32;
        for start in (0..splats.count()).step_by(LANES) {
            let row = i32x16::truncate_from(load(simd, &splats.y, start).floor())
                - self.rows.start as i32;
            let column = i32x16::truncate_from(load(simd, &splats.x, start).floor());
            let index = row * stride + column + MARGIN as i32;
            let inside = row.simd_ge(0) & row.simd_lt(rows);
            // -1 is no pixel's index.
            let index = inside.select(index, i32x16::splat(simd, -1)).to_array();
            for (i, index) in (start..splats.count()).zip(index) {
                let color = splats.color[i].to_ne_bytes();
                match self.pixels.get_mut(index as usize) {
                    Some(pixel) if color[3] == 255 => *pixel = color,
                    Some(_) => {
                        let (source, alpha) = blend_source(simd, splats.color[i]);
                        let weights = leading_weights(simd, alpha, 1);
                        self.blend_pixels(simd, index as usize, source, weights);
                    }
                    None => {}
                }
            }
        }
    }

    /// Draws the paper's squares, centred on the pixels that contain the samples.
    #[inline(always)]
    fn draw_paper_squares<S: Simd>(&mut self, simd: S, splats: &Splats) {
        let stride = self.stride();
        let rows = self.rows.start as i32..self.rows.end as i32;
        let mut columns = [0; Splats::CAPACITY];
        let mut middles = [0; Splats::CAPACITY];
        for i in 0..splats.count() {
            // Rounded down.
            columns[i] = -ceil_to_i32(-splats.x[i]);
            middles[i] = -ceil_to_i32(-splats.y[i]);
        }
        for i in 0..splats.count() {
            let class = (splats.radius_x[i] as usize).min(3);
            let reach = class as i32;
            let (source, alpha) = blend_source(simd, splats.color[i]);
            let first = (columns[i] - reach + MARGIN as i32) as usize;
            let top = (middles[i] - reach).max(rows.start);
            let bottom = (middles[i] + reach + 1).min(rows.end);
            for row in top..bottom {
                let start = (row - rows.start) as usize * stride + first;
                if class == 0 && alpha == 256 {
                    if let Some(pixel) = self.pixels.get_mut(start) {
                        *pixel = splats.color[i].to_ne_bytes();
                    }
                    continue;
                }
                let weights = &STAMPS[class][((row - middles[i]).unsigned_abs() as usize).min(3)];
                // In 1/256: at most 128 * 256 / 128.
                let left = (u16x16::load_array(simd, weights[0]) * alpha) >> 7;
                self.blend_pixels(simd, start, source, left);
                if class > 1 {
                    let right = (u16x16::load_array(simd, weights[1]) * alpha) >> 7;
                    self.blend_pixels(simd, start + PIXELS, source, right);
                }
            }
        }
    }

    /// Draws rectangles, on the pixels whose centres they contain; large ones are tested against
    /// the background pixel by pixel. With `PLUS`, draws only the row and the column that contain
    /// the sample.
    #[inline(always)]
    fn draw_rectangles<S: Simd, const PLUS: bool>(&mut self, simd: S, splats: &Splats) {
        let columns = [0.0, self.width as f32];
        let rows = [self.rows.start as f32, self.rows.end as f32];
        let has_background = !self.background.is_empty();
        for start in (0..splats.count()).step_by(LANES) {
            let [left, right] =
                covered_pixels_lanes(simd, [&splats.x, &splats.radius_x], start, columns);
            let [top, bottom] =
                covered_pixels_lanes(simd, [&splats.y, &splats.radius_y], start, rows);
            let left = left.to_array();
            let right = right.to_array();
            let top = top.to_array();
            let bottom = bottom.to_array();
            for (lane, i) in (start..splats.count().min(start + LANES)).enumerate() {
                let columns = left[lane]..right[lane];
                let rows = top[lane]..bottom[lane];
                let is_small = (1..=2).contains(&columns.len()) && (1..=2).contains(&rows.len());
                if has_background && splats.is_large(i) {
                    self.draw_depth_tested::<_, PLUS>(simd, splats, i, columns, rows);
                } else if is_small && !PLUS && splats.color[i].to_ne_bytes()[3] == 255 {
                    self.fill_corners(columns, rows, splats.color[i]);
                } else {
                    self.draw_rectangle::<_, PLUS>(simd, splats, i, columns, rows);
                }
            }
        }
    }

    /// Same as [`Self::draw_rectangle`], on the pixels whose background does not hide the splat.
    #[inline(always)]
    fn draw_depth_tested<S: Simd, const PLUS: bool>(
        &mut self,
        simd: S,
        splats: &Splats,
        i: usize,
        columns: Range<i32>,
        rows: Range<i32>,
    ) {
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            if !self
                .background
                .hides([column as f32, row as f32], splats.inverse_depth[i])
            {
                self.draw_rectangle::<_, PLUS>(simd, splats, i, column..column + 1, row..row + 1);
            }
        }
    }

    /// Fills a rectangle at most two pixels wide and high by writing its corners, without loops
    /// whose trip counts would be mispredicted (docs/decisions/0050).
    #[inline(always)]
    fn fill_corners(&mut self, columns: Range<i32>, rows: Range<i32>, color: u32) {
        let first = (rows.start - self.rows.start as i32) as usize * self.stride()
            + columns.start as usize
            + MARGIN;
        let right = columns.len() - 1;
        let below = (rows.len() - 1) * self.stride();
        for index in [first, first + right, first + below, first + below + right] {
            if let Some(pixel) = self.pixels.get_mut(index) {
                *pixel = color.to_ne_bytes();
            }
        }
    }

    /// Draws the part of splat `i` that lies in some columns and rows of the frame.
    #[inline(always)]
    fn draw_rectangle<S: Simd, const PLUS: bool>(
        &mut self,
        simd: S,
        splats: &Splats,
        i: usize,
        columns: Range<i32>,
        rows: Range<i32>,
    ) {
        // Rounded down.
        let column = -ceil_to_i32(-splats.x[i]);
        let middle = -ceil_to_i32(-splats.y[i]);
        let (source, alpha) = blend_source(simd, splats.color[i]);
        for row in rows {
            let [left, right] = if PLUS && row != middle {
                [column.max(columns.start), (column + 1).min(columns.end)]
            } else {
                [columns.start, columns.end]
            };
            let width = (right - left).max(0) as usize;
            let start =
                (row - self.rows.start as i32) as usize * self.stride() + left as usize + MARGIN;
            if alpha == 256 {
                if let Some(pixels) = self.pixels.get_mut(start..start + width) {
                    pixels.fill(splats.color[i].to_ne_bytes());
                }
                continue;
            }
            for offset in (0..width).step_by(PIXELS) {
                let weights = leading_weights(simd, alpha, width - offset);
                self.blend_pixels(simd, start + offset, source, weights);
            }
        }
    }
}

/// Returns the blend operands of a colour: the colour as if it were opaque, for [`PIXELS`] pixels,
/// and its alpha in 1/256.
#[inline(always)]
fn blend_source<S: Simd>(simd: S, color: u32) -> (u16x16<S>, u16) {
    let [r, g, b, alpha] = color.to_ne_bytes().map(u16::from);
    let source = [r, g, b, 255, r, g, b, 255, r, g, b, 255, r, g, b, 255];
    (u16x16::load_array(simd, source), alpha + (alpha >> 7))
}

/// Returns `weight` for the first `pixels` of [`PIXELS`], and 0 for the others.
#[inline(always)]
fn leading_weights<S: Simd>(simd: S, weight: u16, pixels: usize) -> u16x16<S> {
    let mut weights = [0; 4 * PIXELS];
    for (i, weights) in weights.as_chunks_mut::<4>().0.iter_mut().enumerate() {
        *weights = [if i < pixels { weight } else { 0 }; 4];
    }
    u16x16::load_array(simd, weights)
}

/// Applies [`straight_color`] to each pixel.
#[inline(always)]
fn straight_colors<S: Simd>(_: S, from: &[[u8; 4]], to: &mut [[u8; 4]]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = straight_color(*from);
    }
}

impl Canvas for OverCanvas {
    fn clear(&mut self, width: u32, rows: Range<u32>, _: Tolerance) {
        self.width = width;
        self.rows = rows;
        let pixels = self.stride() * self.rows.len();
        self.pixels.clear();
        self.pixels.resize(pixels, [0; 4]);
    }

    fn background(&self) -> &PlaneLayer {
        &self.background
    }

    fn background_mut(&mut self) -> &mut PlaneLayer {
        &mut self.background
    }

    fn set_background(&mut self) {
        let stride = self.stride();
        for (pixels, (colors, _)) in self
            .pixels
            .chunks_mut(stride)
            .zip(self.background.visible_rows())
        {
            for (pixel, color) in pixels[MARGIN..]
                .iter_mut()
                .zip(colors)
                .filter(|(_, color)| color[3] == 255)
            {
                *pixel = *color;
            }
        }
    }

    fn add_rims(&mut self, _: Level) {
        let light = LinearLight::tables();
        let stride = self.stride();
        for rim in self.background.rims() {
            let [column, row] = rim.pixel.map(|v| v as usize);
            if let Some(pixel) = self.pixels.get_mut(row * stride + MARGIN + column) {
                let [r, g, b, share] = light.over(rim.color, straight_color(*pixel));
                let premultiply = |c: u8| ((u16::from(c) * u16::from(share) + 127) / 255) as u8;
                *pixel = [premultiply(r), premultiply(g), premultiply(b), share];
            }
        }
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => self.draw_all(simd, splats));
    }

    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], level: Level) {
        let start = row * self.stride() + MARGIN + column;
        let from = self.pixels.get(start..start + to.len()).unwrap_or(&[]);
        dispatch!(level, simd => straight_colors(simd, from, to));
    }
}

/// Converts a premultiplied colour to a straight one.
#[inline(always)]
fn straight_color([r, g, b, share]: [u8; 4]) -> [u8; 4] {
    if share == 255 || share == 0 {
        return [r, g, b, share];
    }
    let [r, g, b] = [r, g, b].map(|c| unpremultiply(c, share));
    [r, g, b, if share >= OPAQUE { 255 } else { share }]
}
