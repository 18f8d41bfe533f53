//! Splats of one surface are averaged by weight, surfaces are then blended (the default kernel).
//!
//! With *over* alone, a splat that is larger than a pixel blends its rim over neighbours that are drawn already, also
//! where it is a hidden far layer of the next pixel: backgrounds bleed through (C12 asks to measure: on the test bed
//! 14 dB in a room). Here each pixel remembers the inverse depth of its front surface. A splat that lies on it adds to
//! a weighted mean, as bilinear interpolation does; a nearer one first sends the mean behind itself. Because drawing is
//! strictly back to front, one mean and one blended colour behind it are enough.
//!
//! Tried and lost: eight cells a SIMD register (51 against 42 ms for the tree, the same bits): rows of tents are three pixels
//! long, and what takes the time is which of three things to do in each, not memory.

use super::linear::LinearLight;
use super::size::LANES;
use super::{Canvas, Splats, covered_lanes};
use crate::warp::Spans;
use fearless_simd::{Level, Simd, SimdCvtFloat, SimdCvtTruncate, dispatch, f32x16, i32x16, prelude::*, u32x16};
use std::ops::Range;

/// Weight 1, with which the samples of a whole surface add up in every pixel.
const ONE: u64 = 128;

/// A pixel's weights stay at or below this, so that sums of 255 times a weight fit into 16 bits.
const MAX_WEIGHT: u64 = 257;

/// Weight at which a surface hides wholly what is behind it: inside a surface, rounded weights add up to [`ONE`] less a few.
const OPAQUE: u64 = 120;

/// The least share of 255 of a pixel that a surface has where it has any.
const MIN_SHARE: u64 = 13;

/// Weight in the middle of a splat, at least. The pixel that holds a sample of the least radius, 0.75 px, is at most half
/// a pixel away in x and y and gets (1 - 0.5 / 0.75)^2 = 1/9 of it, which must not round to nothing however small the
/// sample is: 9 / 2 / 128.
const MIN_PEAK: f32 = 0.036;

/// Where alpha lies in four bytes as they lie in memory.
const ALPHA_SHIFT: u32 = u32::from_ne_bytes([0, 0, 0, 1]).trailing_zeros();

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

static RECIPROCALS: [u64; MAX_WEIGHT as usize + 1] = super::reciprocals();

impl Cell {
    /// Weight of the front surface.
    #[inline(always)]
    fn weight(&self) -> u64 {
        self.sum >> 48
    }

    /// The front surface over what is behind it.
    ///
    /// The surface behind often ends here only because nobody could see it go on behind the front one, and the weights of
    /// its tents fade toward that border. It is therefore taken to fill the part of the pixel that the front surface
    /// leaves open as it fills the pixel, up to wholly: without this the sky shines through every crown of leaves along its
    /// branches (on `builtin:tree` 1.8 dB at the centre, 0.013 in FLIP).
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
        let [br, bg, bb, behind] = self.behind;
        let behind = (u32::from(behind) * 255 / u32::from(255 - share)).min(255) as u8;
        light.over([r, g, b, share], [br, bg, bb, behind])
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
        let share = (weight * 255 / ONE) as u8;
        self.behind = light.over([lane(0), lane(1), lane(2), share], self.behind);
    }

    /// Adds a splat of `lanes(color)`. `nearest_behind` and `farthest_in_front` are the inverse depths below and above
    /// which another surface lies behind and in front of the splat's.
    #[inline(always)]
    fn add(
        &mut self,
        color: u64,
        weight: u64,
        inverse_depth: f32,
        [nearest_behind, farthest_in_front]: [f32; 2],
        light: &LinearLight,
    ) {
        if self.inverse_depth < nearest_behind {
            if self.sum != 0 {
                self.send_behind(light);
            }
            self.sum = color * weight;
            self.inverse_depth = inverse_depth;
        } else if self.inverse_depth <= farthest_in_front {
            if self.weight() + weight > MAX_WEIGHT {
                self.halve();
            }
            self.sum += color * weight;
            self.inverse_depth = self.inverse_depth.max(inverse_depth);
        } else if self.weight() < OPAQUE {
            self.add_behind(color, weight, light);
        }
    }
}

/// An image of surfaces.
#[derive(Default)]
pub(crate) struct SurfaceCanvas {
    width: u32,
    /// Rows of the frame that it holds.
    rows: Range<u32>,
    cells: Vec<Cell>,
    prepared: Box<Prepared>,
    /// Relative difference of inverse depth up to which two splats of one pixel are of one surface.
    pub(crate) tolerance: f32,
    /// The least difference: the width of a depth bin of the capture, 1/m. A grazing, far surface puts several samples
    /// into one LDI pixel, each in a bin of its own; taken for surfaces behind one another, they let the background
    /// through. On `builtin:tree` one bin gained 0.3 dB at the centre and 0.1 dB in a corner of the headbox over none; two
    /// and three gained less than 0.1 dB more and lost in FLIP.
    pub(crate) bin: f32,
}

impl SurfaceCanvas {
    /// The tolerance for faces of `face_px` pixels: 1.5 % for what a capture merges (1 % loses 0.2 dB and a sixth of the FLIP on
    /// `builtin:interior`), and the change of
    /// depth over one face pixel of a surface at 74 degrees to the line of sight (2 / `face_px` is a face pixel's
    /// angle, tan 74 = 3.6). On the test bed a third of it lost up to 0.9 dB, 1.3 times as much gained 0.0 to 0.1 dB.
    pub(crate) fn tolerance(face_px: u32) -> f32 {
        0.015 + 3.6 * 2.0 / face_px as f32
    }
}

/// What drawing needs of each splat, made for all of a batch, a register at a time.
struct Prepared {
    columns: Lines,
    rows: Lines,
    /// A peak of up to 128 * 2^9, times 2^15 for each of the two distances: the tent in integers.
    peak: [u32; Splats::ROOM],
    /// The inverse depth below which another surface lies behind the splat's.
    nearest_behind: [f32; Splats::ROOM],
    /// The inverse depth above which another surface lies in front of the splat's.
    farthest_in_front: [f32; Splats::ROOM],
}

/// The lines of pixels that splats touch, along x or y.
struct Lines {
    /// The first line.
    first: [i32; Splats::ROOM],
    /// The one after the last.
    end: [i32; Splats::ROOM],
    /// Distance of the first line from the middle over the radius, in 2^-15.
    at: [i32; Splats::ROOM],
    /// From line to line, the same.
    step: [i32; Splats::ROOM],
}

impl Default for Lines {
    fn default() -> Self {
        let zero = [0; Splats::ROOM];
        Self { first: zero, end: zero, at: zero, step: zero }
    }
}

impl Lines {
    #[inline(always)]
    fn fill<S: Simd>(&mut self, simd: S, [position, radius]: [&[f32; Splats::ROOM]; 2], i: usize, bounds: [f32; 2]) {
        let [first, end] = covered_lanes(simd, [position, radius], i, bounds);
        let load = |values: &[f32; Splats::ROOM]| f32x16::from_slice(simd, &values[i..i + LANES]);
        let (position, scale) = (load(position), f32x16::splat(simd, 32_768.0) / load(radius));
        // Rounded at the middle, not at `first`, which depends on the band.
        let middle = i32x16::truncate_from(position);
        let at = i32x16::truncate_from((f32x16::float_from(middle) + 0.5 - position) * scale);
        let step = i32x16::truncate_from(scale);
        first.store_slice(&mut self.first[i..i + LANES]);
        end.store_slice(&mut self.end[i..i + LANES]);
        (at + (first - middle) * step).store_slice(&mut self.at[i..i + LANES]);
        step.store_slice(&mut self.step[i..i + LANES]);
    }

    /// The lines of a splat, and the tent's heights on them, one after the other.
    #[inline(always)]
    fn of(&self, i: usize) -> (Range<i32>, Tent) {
        (self.first[i]..self.end[i], Tent { at: self.at[i], step: self.step[i] })
    }
}

impl Default for Prepared {
    fn default() -> Self {
        let zero = [0.0; Splats::ROOM];
        Self {
            columns: Lines::default(),
            rows: Lines::default(),
            peak: [0; Splats::ROOM],
            nearest_behind: zero,
            farthest_in_front: zero,
        }
    }
}

impl Prepared {
    #[inline(always)]
    fn fill<S: Simd>(&mut self, simd: S, splats: &Splats, [width, height]: [[f32; 2]; 2], tolerance: f32, bin: f32) {
        for i in (0..splats.count()).step_by(LANES) {
            self.columns.fill(simd, [&splats.x, &splats.radius_x], i, width);
            self.rows.fill(simd, [&splats.y, &splats.radius_y], i, height);
            let load = |values: &[f32; Splats::ROOM]| f32x16::from_slice(simd, &values[i..i + LANES]);
            let splat = |v: f32| f32x16::splat(simd, v);
            let inverse_depth = load(&splats.inverse_depth);
            let apart = (inverse_depth * tolerance).max(splat(bin));
            (inverse_depth - apart).store_slice(&mut self.nearest_behind[i..i + LANES]);
            (inverse_depth + apart).store_slice(&mut self.farthest_in_front[i..i + LANES]);
            let alpha = (u32x16::from_slice(simd, &splats.color[i..i + LANES]) >> ALPHA_SHIFT) & 255;
            let alpha = f32x16::float_from(alpha);
            let peak = load(&splats.weight).max(splat(MIN_PEAK)) * alpha * (ONE as f32 * 512.0 / 255.0);
            u32x16::truncate_from(peak).store_slice(&mut self.peak[i..i + LANES]);
        }
    }
}

impl SurfaceCanvas {
    #[inline(always)]
    fn draw_all<S: Simd>(&mut self, simd: S, splats: &Splats) {
        let light = LinearLight::tables();
        let bounds = [[0.0, self.width as f32], [self.rows.start as f32, self.rows.end as f32]];
        let prepared = &mut self.prepared;
        prepared.fill(simd, splats, bounds, self.tolerance, self.bin);
        for i in 0..splats.count() {
            let (color, inverse_depth) = (lanes(splats.color[i].to_ne_bytes()), splats.inverse_depth[i]);
            let one_surface = [prepared.nearest_behind[i], prepared.farthest_in_front[i]];
            let ((columns, across), (rows, down)) = (prepared.columns.of(i), prepared.rows.of(i));
            for (row, height) in rows.zip(down) {
                let peak = (prepared.peak[i] * height) >> 15;
                let start = (row - self.rows.start as i32) as usize * self.width as usize;
                let row = &mut self.cells[start + columns.start as usize..start + columns.end as usize];
                for (cell, height) in row.iter_mut().zip(across) {
                    // At most ONE, as 2^16 * 2^15 = 2^31.
                    let weight = u64::from((peak * height + (1 << 23)) >> 24);
                    if weight > 0 {
                        cell.add(color, weight, inverse_depth, one_surface, light);
                    }
                }
            }
        }
    }
}

/// Heights of a tent, 0 to 2^15 = 1, at the centres of pixels one after the other.
#[derive(Clone, Copy, Default)]
struct Tent {
    /// Distance from the middle over the radius, in 2^-15.
    at: i32,
    step: i32,
}

impl Iterator for Tent {
    type Item = u32;

    #[inline(always)]
    fn next(&mut self) -> Option<u32> {
        let height = (32_768 - self.at.abs()).max(0) as u32;
        self.at += self.step;
        Some(height)
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
        super::clear_spans(&mut self.cells, width as usize, 0, Cell::default(), spans);
    }

    fn draw(&mut self, splats: &Splats, level: Level) {
        dispatch!(level, simd => self.draw_all(simd, splats));
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
    to_rest.iter_mut().zip(from_rest).for_each(|(to, cell)| *to = cell.flattened(light));
}

/// [`Cell::mean`] and 255 for cells whose front surface fills the pixel; of the others, the bits.
#[inline(always)]
fn fronts<S: Simd>(simd: S, cells: &[Cell; LANES]) -> ([[u8; 4]; LANES], u64) {
    let sum = |half: u32| {
        let words: [u32; LANES] = std::array::from_fn(|i| (cells[i].sum >> (32 * half)) as u32);
        u32x16::load_array(simd, words)
    };
    let (low, high) = (sum(0), sum(1));
    let weight = high >> 16;
    let divisor = f32x16::float_from(weight.max(u32x16::splat(simd, 1)));
    // Rounded down like the integers: a quotient of them that is not whole is at least 1 / 257 away from the next.
    let mean = |lane: u32x16<S>| u32x16::truncate_from(f32x16::float_from(lane + (weight >> 1)) / divisor).to_array();
    let [red, green, blue] = [mean(low & 0xffff), mean(low >> 16), mean(high & 0xffff)];
    let fills = weight.simd_ge(u32x16::splat(simd, OPAQUE as u32));
    (std::array::from_fn(|i| [red[i] as u8, green[i] as u8, blue[i] as u8, 255]), !fills.to_bitmask() & 0xffff)
}

#[cfg(test)]
mod tests {
    use super::*;

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
                    cell.add(lanes(color), weight, 1.0, [0.99, 1.01], LinearLight::tables());
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
            cell.add(lanes(color), weight, q, [q * 0.95, q * 1.05], LinearLight::tables());
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
