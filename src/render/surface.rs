//! Splats of one surface are averaged by weight, surfaces are then blended (the default kernel).
//!
//! With *over* alone, a splat that is larger than a pixel blends its rim over neighbours that are drawn already, also
//! where it is a hidden far layer of the next pixel: backgrounds bleed through (C12). Here each pixel remembers the inverse depth of its front surface. A splat that lies on it adds to
//! a weighted mean, as bilinear interpolation does; a nearer one first sends the mean behind itself. Because drawing is
//! strictly back to front, one mean and one blended colour behind it are enough.
//! Cell by cell, with branches: docs/decisions.md: surfaces are averaged before they are blended.

use super::linear::LinearLight;
use super::planes::Rim;
use super::size::LANES;
use super::splat::{self, Canvas, Splats, load};
use super::tent::{ONE, SIDE, SmallWeights, Tents};
use crate::render::Spans;
use fearless_simd::{Level, Simd, SimdCvtFloat, SimdCvtTruncate, dispatch, f32x16, prelude::*, u32x16};
use std::ops::Range;

/// A pixel's weights stay at or below this, so that sums of 255 times a weight fit into 16 bits.
const MAX_WEIGHT: u64 = 257;

/// Weight at which a surface hides wholly what is behind it: inside a surface, rounded weights add up to [`ONE`] less a few.
pub(super) const OPAQUE: u64 = 120;

/// The least share of 255 of a pixel that a surface has where it has any.
pub(super) const MIN_SHARE: u64 = 13;

/// One pixel: 16 bytes.
#[derive(Clone, Copy, Default)]
#[repr(C, align(16))]
struct Cell {
    /// Of the front surface, 16 bits each from the lowest: red, green and blue times weight, and weight. No lane
    /// overflows into the next, so that one multiplication and one addition serve all four.
    sum: u64,
    /// 1 / eye depth of the front surface, 1/m: the largest in the mean. 0 for none.
    inverse_depth: f32,
    /// What is behind it: straight colour, and the share of the pixel that is covered.
    behind: [u8; 4],
}

const _: () = assert!(size_of::<Cell>() == 16, "one SIMD register a pixel");

/// Red, green, blue and 1, 16 bits each: times a weight, what a splat adds to a sum.
fn lanes([r, g, b, _]: [u8; 4]) -> u64 {
    u64::from(r) | u64::from(g) << 16 | u64::from(b) << 32 | 1 << 48
}

static RECIPROCALS: [u64; MAX_WEIGHT as usize + 1] = splat::reciprocals();

impl Cell {
    /// Weight of the front surface.
    #[inline]
    fn weight(&self) -> u64 {
        self.sum >> 48
    }

    /// The front surface over what is behind it.
    #[inline(always)]
    fn flattened(&self, light: &LinearLight) -> [u8; 4] {
        let weight = self.weight();
        if weight == 0 {
            return self.behind;
        }
        let [r, g, b] = self.mean();
        let share = (weight * 255 / OPAQUE).clamp(MIN_SHARE, 255) as u8;
        if share == 255 {
            return [r, g, b, share];
        }
        beside([r, g, b, share], self.behind, light)
    }

    /// Mean colour of the front surface, if there is one.
    #[inline(always)]
    fn mean(&self) -> [u8; 3] {
        let weight = self.weight();
        let reciprocal = RECIPROCALS[(weight as usize).min(RECIPROCALS.len() - 1)];
        let mean = |lane: u32| {
            let sum = (self.sum >> (16 * lane)) & 0xffff;
            (((sum + weight / 2) * reciprocal) >> 32) as u8
        };
        [mean(0), mean(1), mean(2)]
    }

    /// Halves the sums, so that more splats have room. An odd weight first loses one mean colour: rounding it down alone
    /// would brighten.
    #[cold]
    fn halve(&mut self) {
        if self.weight() % 2 == 1 {
            let [r, g, b] = self.mean();
            self.sum -= lanes([r, g, b, 0]);
        }
        self.sum = self.sum >> 1 & 0x7fff_7fff_7fff_7fff;
    }

    /// Makes way for a nearer surface. Out of the loop, like [`Self::add_behind`], whose registers it would take.
    #[inline(never)]
    fn send_behind(&mut self, light: &LinearLight) {
        self.behind = self.flattened(light);
    }

    /// Adds a splat behind a surface that does not fill the pixel (yet).
    #[inline(never)]
    fn add_behind(&mut self, color: u64, weight: u64, light: &LinearLight) {
        let lane = |lane: u32| (color >> (16 * lane)) as u8;
        let share = (weight * 255 / OPAQUE).min(255) as u8;
        self.behind = beside([lane(0), lane(1), lane(2), share], self.behind, light);
    }

    /// Adds a splat by a weight, which may be 0.
    #[inline(always)]
    fn add(&mut self, added: &Added, weight: u64, light: &LinearLight) {
        if weight == 0 {
            return;
        }
        if self.inverse_depth < added.nearest_behind {
            if self.sum != 0 {
                self.send_behind(light);
            }
            self.sum = added.color * weight;
            self.inverse_depth = added.inverse_depth;
        } else if self.inverse_depth <= added.farthest_in_front {
            if self.weight() + weight > MAX_WEIGHT {
                self.halve();
            }
            self.sum += added.color * weight;
            self.inverse_depth = self.inverse_depth.max(added.inverse_depth);
        } else if self.weight() < OPAQUE {
            self.add_behind(added.color, weight, light);
        }
    }
}

/// A straight colour over another, each with the share of 255 of a pixel that it has: what is behind shows beside what is in front,
/// as far as there is room.
///
/// The surface behind often ends here only because nobody could see it go on behind the front one, and the weights of
/// its tents fade toward that border. It is therefore taken to lie in the part of the pixel that the front surface
/// leaves open: without this the sky shines through every crown of leaves along its branches (docs/decisions.md: surfaces are averaged
/// before they are blended). So shares of one surface's splats add up behind another surface as they do in front of it
/// (docs/decisions.md: shares behind a surface add up).
#[inline(always)]
fn beside(front: [u8; 4], behind: [u8; 4], light: &LinearLight) -> [u8; 4] {
    let share = front[3];
    let rest = behind[3].min(255 - share);
    let rgb = |[r, g, b, _]: [u8; 4]| [r, g, b];
    let [r, g, b] = light.mix([rgb(front), rgb(behind)], [u32::from(share), u32::from(rest)]);
    [r, g, b, share + rest]
}

/// What of a splat is added to every cell that it touches.
struct Added {
    /// As [`lanes`] makes it.
    color: u64,
    /// 1/m.
    inverse_depth: f32,
    /// The inverse depth below which another surface lies behind the splat's.
    nearest_behind: f32,
    /// The inverse depth above which another surface lies in front of the splat's.
    farthest_in_front: f32,
}

/// An image of surfaces.
#[derive(Default)]
pub(crate) struct SurfaceCanvas {
    width: u32,
    /// Rows of the frame that it holds.
    rows: Range<u32>,
    cells: Vec<Cell>,
    tents: Box<Tents>,
    /// Relative difference of inverse depth up to which two splats of one pixel are of one surface.
    pub(crate) tolerance: f32,
    /// The least difference: the width of a depth bin of the capture, 1/m. A grazing, far surface puts several samples
    /// into one LDI pixel, each in a bin of its own; taken for surfaces behind one another, they let the background
    /// through.
    pub(crate) bin: f32,
}

impl SurfaceCanvas {
    /// The tolerance for faces of `face_px` pixels: 1.5 % for what a capture merges, and the change of depth over one face pixel
    /// of a surface at 74 degrees to the line of sight (2 / `face_px` is a face pixel's angle, tan 74 = 3.6). Other tolerances:
    /// docs/decisions.md: surfaces are averaged before they are blended.
    pub(crate) fn tolerance(face_px: u32) -> f32 {
        0.015 + 3.6 * 2.0 / face_px as f32
    }
}

impl SurfaceCanvas {
    #[inline(always)]
    fn draw_all<S: Simd>(&mut self, simd: S, splats: &Splats) {
        let light = LinearLight::tables();
        let (width, first_row) = (self.width as usize, self.rows.start as i32);
        let bounds = [[0.0, self.width as f32], [self.rows.start as f32, self.rows.end as f32]];
        self.tents.fill(simd, splats, bounds);
        for start in (0..splats.count()).step_by(LANES) {
            let (small, [nearest_behind, farthest_in_front]) =
                (self.tents.small(simd, start), self.one_surface(simd, splats, start));
            for (lane, i) in (start..splats.count().min(start + LANES)).enumerate() {
                let [columns, rows] = self.tents.pixels(i);
                if columns.is_empty() || rows.is_empty() {
                    continue;
                }
                let added = Added {
                    color: lanes(splats.color[i].to_ne_bytes()),
                    inverse_depth: splats.inverse_depth[i],
                    nearest_behind: nearest_behind[lane],
                    farthest_in_front: farthest_in_front[lane],
                };
                let at = (rows.start - first_row) as usize * width + columns.start as usize;
                let Some(cells) = self.cells.get_mut(at..) else { continue };
                let small = Small { weights: &small, lane, rows: rows.len() };
                match if rows.len() <= SIDE { columns.len() } else { usize::MAX } {
                    1 => small.add::<1>(cells, width, &added, light),
                    2 => small.add::<2>(cells, width, &added, light),
                    3 => small.add::<3>(cells, width, &added, light),
                    SIDE => small.add::<SIDE>(cells, width, &added, light),
                    _ => {
                        for (row, weights) in cells.chunks_mut(width).take(rows.len()).zip(self.tents.any(i)) {
                            for (cell, weight) in row.iter_mut().take(columns.len()).zip(weights) {
                                cell.add(&added, weight, light);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Of sixteen splats, the inverse depths below and above which another surface lies behind and in front of the splat's.
    #[inline(always)]
    fn one_surface<S: Simd>(&self, simd: S, splats: &Splats, start: usize) -> [[f32; LANES]; 2] {
        let inverse_depth = load(simd, &splats.inverse_depth, start);
        let apart = (inverse_depth * self.tolerance).max(self.bin);
        [(inverse_depth - apart).to_array(), (inverse_depth + apart).to_array()]
    }
}

/// A splat that touches at most [`SIDE`] columns and rows.
struct Small<'a> {
    weights: &'a SmallWeights,
    lane: usize,
    /// Rows that it touches.
    rows: usize,
}

impl Small<'_> {
    /// Adds it to `COLUMNS` cells of each of its rows: a number that is known here, for a loop without an end that no processor
    /// foresees. `cells` begin with its first, in rows of `width`.
    #[inline(always)]
    fn add<const COLUMNS: usize>(&self, cells: &mut [Cell], width: usize, added: &Added, light: &LinearLight) {
        for (row, weights) in self.weights.iter().take(self.rows).enumerate() {
            let Some(cells) = cells.get_mut(row * width..).and_then(|cells| cells.first_chunk_mut::<COLUMNS>()) else {
                return;
            };
            for (cell, weights) in cells.iter_mut().zip(weights) {
                cell.add(added, u64::from(weights[self.lane]), light);
            }
        }
    }
}

impl Canvas for SurfaceCanvas {
    fn clear(&mut self, width: u32, rows: Range<u32>) {
        self.width = width;
        self.rows = rows;
        self.cells.clear();
        self.cells.resize(width as usize * self.rows.len(), Cell::default());
    }

    fn clear_spans(&mut self, [width, height]: [u32; 2], spans: &dyn Fn(u32) -> Spans) {
        if (self.width, &self.rows) != (width, &(0..height)) {
            self.clear(width, 0..height);
        }
        splat::clear_spans(&mut self.cells, width as usize, 0, Cell::default(), spans);
    }

    fn lay(&mut self, row: usize, colors: &[[u8; 4]], inverse_depths: &[f32]) {
        let start = row * self.width as usize;
        let cells = self.cells.get_mut(start..start + colors.len()).unwrap_or(&mut []);
        for ((cell, color), inverse_depth) in cells.iter_mut().zip(colors).zip(inverse_depths) {
            if color[3] == 255 {
                (cell.sum, cell.inverse_depth) = (lanes(*color) * ONE, inverse_depth.max(0.0));
            }
        }
    }

    fn add_rims(&mut self, rims: &[Rim]) {
        let light = LinearLight::tables();
        for rim in rims {
            let q = rim.inverse_depth.max(0.0);
            let apart = (q * self.tolerance).max(self.bin);
            let (nearest_behind, farthest_in_front) = (q - apart, q + apart);
            let added = Added { color: lanes(rim.color), inverse_depth: q, nearest_behind, farthest_in_front };
            let [column, row] = rim.pixel.map(|v| v as usize);
            if let Some(cell) = self.cells.get_mut(row * self.width as usize + column) {
                cell.add(&added, (u64::from(rim.color[3]) * ONE + 127) / 255, light);
            }
        }
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => self.draw_all(simd, splats));
    }

    fn tell_depths(&self, row: usize, column: usize, to: &mut [f32]) {
        let start = row * self.width as usize + column;
        let from = self.cells.get(start..start + to.len()).unwrap_or(&[]);
        to.iter_mut().zip(from).for_each(|(to, cell)| *to = cell.inverse_depth);
    }

    fn resolve(&self, row: usize, column: usize, to: &mut [[u8; 4]], level: Level) {
        let start = row * self.width as usize + column;
        let from = self.cells.get(start..start + to.len()).unwrap_or(&[]);
        dispatch!(level, simd => resolve_all(simd, from, to));
    }
}

/// Writes [`Cell::flattened`] of each cell.
#[inline(always)]
fn resolve_all<S: Simd>(simd: S, from: &[Cell], to: &mut [[u8; 4]]) {
    let light = LinearLight::tables();
    let ((from, from_rest), (to, to_rest)) = (from.as_chunks::<LANES>(), to.as_chunks_mut::<LANES>());
    for (from, to) in from.iter().zip(to) {
        let mut others;
        (*to, others) = fronts(simd, from);
        while others != 0 {
            let i = others.trailing_zeros() as usize;
            others &= others - 1;
            to[i] = from[i].flattened(light);
        }
    }
    for (to, cell) in to_rest.iter_mut().zip(from_rest) {
        *to = cell.flattened(light);
    }
}

/// [`Cell::mean`] and 255 for cells whose front surface fills the pixel; of the others, the bits.
#[inline(always)]
fn fronts<S: Simd>(simd: S, cells: &[Cell; LANES]) -> ([[u8; 4]; LANES], u64) {
    let (mut low, mut high) = ([0; LANES], [0; LANES]);
    for i in 0..LANES {
        (low[i], high[i]) = (cells[i].sum as u32, (cells[i].sum >> 32) as u32);
    }
    let (low, high) = (u32x16::load_array(simd, low), u32x16::load_array(simd, high));
    let weight = high >> 16;
    let fills = weight.simd_ge(OPAQUE as u32);
    let (red, green, blue) = (mean(low & 0xffff, weight), mean(low >> 16, weight), mean(high & 0xffff, weight));
    let colors = (red | (green << 8) | (blue << 16) | 0xff00_0000).to_array();
    let mut bytes = [[0; 4]; LANES];
    for (bytes, color) in bytes.iter_mut().zip(colors) {
        *bytes = color.to_le_bytes();
    }
    (bytes, !fills.to_bitmask() & 0xffff)
}

/// Sums over weights, rounded to the nearest; 0 for weight 0, whose sums are 0.
#[inline(always)]
fn mean<S: Simd>(sum: u32x16<S>, weight: u32x16<S>) -> u32x16<S> {
    let divisor = f32x16::float_from(weight.max(1));
    // Rounded down like the integers: a quotient of them that is not whole is at least 1 / 257 away from the next.
    u32x16::truncate_from(f32x16::float_from(sum + (weight >> 1)) / divisor)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn added(color: [u8; 4], q: f32, tolerance: f32) -> Added {
        let (nearest_behind, farthest_in_front) = (q * (1.0 - tolerance), q * (1.0 + tolerance));
        Added { color: lanes(color), inverse_depth: q, nearest_behind, farthest_in_front }
    }

    #[test]
    fn means_are_exact_divisions() {
        for weight in 1..=MAX_WEIGHT {
            for sum in (0..=255 * weight).step_by(7).chain([255 * weight]) {
                let cell = Cell { sum: sum | weight << 48, ..Cell::default() };
                assert_eq!(u64::from(cell.mean()[0]), (sum + weight / 2) / weight, "{sum} / {weight}");
            }
        }
    }

    #[test]
    fn one_colour_stays_one_colour_however_many_splats() {
        let color = [201, 0, 255, 255];
        for weights in [[1, 3, 5, 7], [127, 128, 1, 2], [0, 0, 64, 91], [37, 99, 128, 128]] {
            let mut cell = Cell::default();
            for i in 0..10_000 {
                let weight = weights[i % 4];
                if weight > 0 {
                    cell.add(&added(color, 1.0, 0.01), weight, LinearLight::tables());
                    assert_eq!(cell.flattened(LinearLight::tables())[..3], color[..3]);
                    assert!(cell.weight() <= MAX_WEIGHT);
                }
            }
            assert_eq!(cell.flattened(LinearLight::tables()), color);
        }
    }

    #[test]
    fn surfaces_are_blended_in_depth_order() {
        let (red, blue, green) = ([250, 0, 0, 255], [0, 0, 250, 255], [0, 250, 0, 255]);
        let add = |cell: &mut Cell, color, weight, q: f32| {
            cell.add(&added(color, q, 0.05), weight, LinearLight::tables());
        };
        let mut cell = Cell::default();
        add(&mut cell, blue, ONE, 1.0);
        add(&mut cell, red, OPAQUE / 2, 2.0);
        let [r, g, b, share] = cell.flattened(LinearLight::tables());
        assert!(r.abs_diff(184) <= 2 && g == 0 && b.abs_diff(184) <= 2 && share == 255, "half red over blue");
        add(&mut cell, green, ONE, 1.5);
        let [r, g, b, _] = cell.flattened(LinearLight::tables());
        assert!(r.abs_diff(184) <= 2 && g.abs_diff(184) <= 2 && b == 0, "green comes between");
        add(&mut cell, red, ONE, 2.02);
        assert_eq!(cell.flattened(LinearLight::tables()), red);
        add(&mut cell, green, ONE, 1.5);
        assert_eq!(cell.flattened(LinearLight::tables()), red, "hidden");
    }
}
