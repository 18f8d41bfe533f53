//! From what pixels show to their colours (E9): of one camera, of the best ranked of a triangle's
//! corners', of up to three blended, or the mean of all good ones.
//!
//! At a pixel, position and inverse depth give its place in any picture by one product with a
//! homography and one with an epipole (Shade's `start + q * depth`), which is perspective-correct
//! by construction. [`LANES`] pixels of a row look into a camera's picture together.
//!
//! The paper projects textures through whatever stands between. Here each texel knows its depth: a
//! camera that shows something nearer does not see the pixel's point and has no say in it.

use super::scan::{BandBuffers, LANES, MOST_CAMERAS, OWNER_BITS, Pixels, Scanner, Spot, UNCOVERED};
use super::texture_camera::TextureCamera;
use crate::view_geometry::Texturing;
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16, mask32x16, u32x16};
use headbox_core::frame::Coverage;
use headbox_core::srgb_table::{SrgbTable, encode_srgb};
use std::ops::Range;

/// Linear light of texels, 16 bits.
const PER_FULL: f32 = 1.0 / 65_535.0;

/// Cameras whose mean a pixel shows: the fourth still takes more noise away than it blurs.
const MOST_AVERAGED: f32 = 4.0;

/// The column of each lane.
const COLUMNS: [f32; LANES] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

/// Places of neighbouring pixels.
#[derive(Clone, Copy)]
struct TexturePositions<S: Simd> {
    /// Pixels, of their centres.
    x: f32x16<S>,
    y: f32,
    /// 1/m.
    inverse_depth: f32x16<S>,
}

/// Weighted sums of colours of neighbouring pixels.
#[derive(Clone, Copy)]
struct Sums<S: Simd> {
    color: [f32x16<S>; 3],
    weight: f32x16<S>,
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let zero = f32x16::splat(simd, 0.0);
        Self {
            color: [zero; 3],
            weight: zero,
        }
    }

    /// Adds what a camera shows of the `wanted` lanes, where it sees them.
    fn add(
        &mut self,
        simd: S,
        camera: &TextureCamera,
        places: &TexturePositions<S>,
        wanted: u64,
        weight: f32x16<S>,
    ) {
        simd.vectorize(
            #[inline(always)]
            || self.add_at(simd, camera, places, wanted, weight),
        );
    }

    #[inline(always)]
    fn add_at(
        &mut self,
        simd: S,
        camera: &TextureCamera,
        places: &TexturePositions<S>,
        wanted: u64,
        weight: f32x16<S>,
    ) {
        let &TexturePositions {
            x,
            y,
            inverse_depth,
        } = places;
        let row = camera.start + camera.down * y;
        let [h, v, w] = [0, 1, 2].map(|axis| (row[axis], camera.right[axis], camera.shift[axis]));
        let (h, v, w) = (
            along(h, x, inverse_depth),
            along(v, x, inverse_depth),
            along(w, x, inverse_depth),
        );
        let per = 1.0 / w;
        let (u, v, there) = (h * per, v * per, inverse_depth * per);
        let in_front = w.simd_gt(0.0).to_bitmask() & wanted;
        let levels = camera.picture.levels_for(camera.scale * per);
        let bound = there * camera.hidden + camera.slack;
        let mut left = in_front;
        let mut level = 0;
        while left != 0 {
            let here = levels.simd_eq(level).to_bitmask() & left;
            left &= !here;
            if here != 0 {
                let found = camera.picture.sample_sixteen(simd, level, [u, v], here);
                let seen = found.known & !found.inverse_depth.simd_gt(bound).to_bitmask();
                let share =
                    mask32x16::from_bitmask(simd, seen).select(weight, f32x16::splat(simd, 0.0));
                for channel in 0..3 {
                    self.color[channel] += found.color[channel] * share;
                }
                self.weight += share;
            }
            level += 1;
        }
    }
}

/// A homogeneous coordinate of places in a row.
#[inline(always)]
fn along<S: Simd>(
    (row, right, shift): (f32, f32, f32),
    x: f32x16<S>,
    inverse_depth: f32x16<S>,
) -> f32x16<S> {
    x * right + row + inverse_depth * shift
}

/// Context of colouring a frame.
pub(super) struct FramePainter<'a> {
    pub(super) level: Level,
    pub(super) scanner: Scanner<'a>,
    pub(super) texturing: Texturing,
}

/// Rows of a frame.
pub(super) struct Band<'a> {
    pub(super) number: u32,
    pub(super) width: u32,
    pub(super) rows: Range<u32>,
    pub(super) colors: &'a mut [[u8; 4]],
    pub(super) coverage: &'a mut [Coverage],
}

impl FramePainter<'_> {
    /// Colours what the mesh covers of a band.
    pub(super) fn paint(&self, band: &mut Band, described: &mut BandBuffers) {
        match self.texturing {
            Texturing::Nearest => described.fill(band.width, band.rows.len() as u32),
            _ => self
                .scanner
                .describe(band.number, band.width, &band.rows, described),
        }
        dispatch!(self.level, simd => self.color(simd, band, described));
    }

    #[inline(always)]
    fn color<S: Simd>(&self, simd: S, band: &mut Band, described: &BandBuffers) {
        let width = band.width as usize;
        let rows = band
            .colors
            .chunks_mut(width)
            .zip(band.coverage.chunks_mut(width));
        for ((colors, coverage), (y, pixels)) in rows.zip(
            band.rows
                .clone()
                .zip(described.pixels.chunks(described.per_row)),
        ) {
            let chunks = colors
                .chunks_mut(LANES)
                .zip(coverage.chunks_mut(LANES))
                .zip(pixels);
            for (((colors, coverage), pixels), x) in chunks.zip((0..).step_by(LANES)) {
                self.color_pixels(simd, pixels, [x, y], colors, coverage);
            }
        }
    }

    #[inline(always)]
    fn color_pixels<S: Simd>(
        &self,
        simd: S,
        pixels: &Pixels,
        [x, y]: [u32; 2],
        colors: &mut [[u8; 4]],
        coverage: &mut [Coverage],
    ) {
        let covered = !u32x16::load_array_ref(simd, &pixels.owners)
            .simd_eq(UNCOVERED)
            .to_bitmask()
            & 0xffff;
        if covered == 0 {
            return;
        }
        let places = TexturePositions {
            x: f32x16::load_array_ref(simd, &COLUMNS) + (x as f32 + 0.5),
            y: y as f32 + 0.5,
            inverse_depth: f32x16::load_array_ref(simd, &pixels.inverse_depth),
        };
        let sums = self.sums(simd, pixels, &places, covered);
        let per = PER_FULL / sums.weight;
        let table = SrgbTable::get();
        let mut color = u32x16::splat(simd, 0xff00_0000);
        for channel in 0..3 {
            color |= table.encode_sixteen(simd, sums.color[channel] * per, LANES)
                << (8 * channel as u32);
        }
        let color = color.to_array();
        let seen = sums.weight.simd_gt(0.0).to_bitmask() & covered;
        if seen == 0xffff && colors.len() == LANES {
            colors.copy_from_slice(bytemuck::cast_slice(&color.map(u32::to_le)));
            coverage.fill(Coverage::FULL);
            return;
        }
        let of_corners = !matches!(self.texturing, Texturing::Nearest | Texturing::Single);
        let mut left = covered;
        while left != 0 {
            let lane = left.trailing_zeros();
            left &= left - 1;
            let found = match seen >> lane & 1 == 1 {
                true => Some(color[lane as usize].to_le_bytes()),
                false if of_corners => self.unseen(pixels, lane, [x + lane, y]),
                false => None,
            };
            let (Some(found), Some(color), Some(coverage)) = (
                found,
                colors.get_mut(lane as usize),
                coverage.get_mut(lane as usize),
            ) else {
                continue;
            };
            (*color, *coverage) = (found, Coverage::FULL);
        }
    }

    /// The sums of what the cameras show of the covered lanes.
    #[inline(always)]
    fn sums<S: Simd>(
        &self,
        simd: S,
        pixels: &Pixels,
        places: &TexturePositions<S>,
        covered: u64,
    ) -> Sums<S> {
        let mut sums = Sums::new(simd);
        let one = f32x16::splat(simd, 1.0);
        let cameras = self.scanner.cameras;
        match self.texturing {
            Texturing::Nearest | Texturing::Single => {
                if let Some(camera) = cameras.first() {
                    sums.add(simd, camera, places, covered, one);
                }
            }
            Texturing::Averaged => {
                for camera in cameras {
                    let wanted = sums.weight.simd_lt(MOST_AVERAGED).to_bitmask() & covered;
                    if wanted == 0 {
                        break;
                    }
                    sums.add(simd, camera, places, wanted, one);
                }
            }
            Texturing::Multi | Texturing::Blended => {
                let owners = u32x16::load_array_ref(simd, &pixels.owners);
                let mut ranks = Ranks::of(&pixels.owners);
                while let Some(rank) = ranks.take_first() {
                    let Some(camera) = cameras.get(rank as usize) else {
                        continue;
                    };
                    let weight = weight_of(simd, owners, rank, &pixels.weights);
                    let mut wanted = weight.simd_gt(0.0).to_bitmask() & covered;
                    if self.texturing == Texturing::Multi {
                        wanted &= !sums.weight.simd_gt(0.0).to_bitmask();
                    }
                    if wanted != 0 {
                        sums.add(simd, camera, places, wanted, weight);
                    }
                }
            }
        }
        sums
    }

    /// The colours of the corners themselves, by weight: of a surface that its cameras do not see
    /// here, as something hides it from them.
    #[cold]
    fn unseen(&self, pixels: &Pixels, lane: u32, at: [u32; 2]) -> Option<[u8; 4]> {
        self.scanner.look_up(
            pixels.triangles[lane as usize % LANES],
            at,
            |Spot {
                 triangle, weights, ..
             }| {
                let (mut sum, mut total) = ([0.0; 3], 0.0);
                for k in (0..3).filter(|k| weights[*k] > 0.0) {
                    let camera = self.scanner.cameras.get(triangle.owners[k] as usize);
                    let looked = camera.and_then(|camera| {
                        camera.color_at(triangle.at[k], triangle.inverse_depth[k])
                    });
                    let Some(color) = looked else { continue };
                    (0..3).for_each(|c| sum[c] += color[c] * weights[k]);
                    total += weights[k];
                }
                let [r, g, b] = sum.map(|c| encode_srgb(c * (PER_FULL / total)));
                (total > 0.0).then_some([r, g, b, 255])
            },
        )
    }
}

/// Sum of the weights of the corners that a camera owns.
#[inline(always)]
fn weight_of<S: Simd>(
    simd: S,
    owners: u32x16<S>,
    rank: u32,
    weights: &[[f32; LANES]; 3],
) -> f32x16<S> {
    let zero = f32x16::splat(simd, 0.0);
    let mut sum = zero;
    let mut is_all = mask32x16::splat(simd, true);
    for k in 0..3u32 {
        let is_owner = ((owners >> (k * OWNER_BITS)) & MOST_CAMERAS as u32).simd_eq(rank);
        // Of neighbours' weights that lie outside by rounding some are negative.
        sum += is_owner.select(
            f32x16::load_array_ref(simd, &weights[k as usize]).max(zero),
            zero,
        );
        is_all &= is_owner;
    }
    is_all.select(f32x16::splat(simd, 1.0), sum)
}

/// Some cameras' ranks.
struct Ranks {
    words: [u64; MOST_CAMERAS.div_ceil(64)],
    first: usize,
}

impl Ranks {
    /// The owners of pixels.
    #[inline(always)]
    fn of(owners: &[u32; LANES]) -> Self {
        let mut words = [0; _];
        let mut last = UNCOVERED;
        for &owners in owners {
            if owners != last && owners != UNCOVERED {
                for corner in 0..3 {
                    let rank = (owners >> (corner * OWNER_BITS)) as usize & MOST_CAMERAS;
                    words[rank / 64] |= 1u64 << (rank % 64);
                }
            }
            last = owners;
        }
        Self { words, first: 0 }
    }

    /// Takes the best of them.
    #[inline(always)]
    fn take_first(&mut self) -> Option<u32> {
        while let Some(word) = self.words.get_mut(self.first) {
            if *word != 0 {
                let bit = word.trailing_zeros();
                *word &= *word - 1;
                return Some(self.first as u32 * 64 + bit);
            }
            self.first += 1;
        }
        None
    }
}
