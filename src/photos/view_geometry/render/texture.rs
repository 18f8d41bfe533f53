//! Colours of pixels (E9): from one camera, from the best ranked camera of a triangle's corners,
//! from up to three blended, or the mean of all good ones.
//!
//! A pixel's position and inverse depth give its position in any image by one product with a
//! homography and one with an epipole (Shade's `start + q * depth`), which is perspective-correct
//! by construction. [`LANES`] pixels of a row are sampled in a camera's image together.
//!
//! The paper projects textures through occluders. Here each texel knows its depth: a camera whose
//! image shows something nearer does not see the pixel's point and does not contribute to it.

use super::scan::{
    BandBuffers, LANES, MOST_CAMERAS, OWNER_BITS, Pixels, Scanner, SurfacePoint, UNCOVERED,
};
use super::texture_camera::TextureCamera;
use crate::view_geometry::Texturing;
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16, mask32x16, u32x16};
use headbox_core::color::srgb_table::{SrgbTable, encode_srgb};
use headbox_core::color::tone::ToneMap;
use headbox_core::frame::Coverage;
use headbox_core::image::texels::LANE_INDICES;
use std::ops::Range;

/// Factor from 16-bit linear light to the range 0 to 1.
const PER_FULL: f32 = 1.0 / 65_535.0;

/// Maximum number of cameras averaged in a pixel: the fourth still reduces noise more than it
/// blurs.
const MOST_AVERAGED: f32 = 4.0;

/// Frame positions of adjacent pixels.
#[derive(Clone, Copy)]
struct TexturePositions<S: Simd> {
    /// Pixel centres, pixels.
    x: f32x16<S>,
    y: f32,
    /// Inverse depths, 1/m.
    inverse_depth: f32x16<S>,
}

/// Weighted sums of the colours of adjacent pixels.
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

    /// Adds the colours of a camera in the `wanted` lanes, where it sees their points.
    fn add(
        &mut self,
        simd: S,
        camera: &TextureCamera,
        positions: &TexturePositions<S>,
        wanted: u64,
        weight: f32x16<S>,
    ) {
        simd.vectorize(
            #[inline(always)]
            || self.add_at(simd, camera, positions, wanted, weight),
        );
    }

    #[inline(always)]
    fn add_at(
        &mut self,
        simd: S,
        camera: &TextureCamera,
        positions: &TexturePositions<S>,
        wanted: u64,
        weight: f32x16<S>,
    ) {
        let &TexturePositions {
            x,
            y,
            inverse_depth,
        } = positions;
        let row = camera.start + camera.down * y;
        let [h, v, w] = [0, 1, 2].map(|axis| (row[axis], camera.right[axis], camera.shift[axis]));
        let h = homogeneous(h, x, inverse_depth);
        let v = homogeneous(v, x, inverse_depth);
        let w = homogeneous(w, x, inverse_depth);
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

/// Computes one homogeneous image coordinate of positions in a row.
#[inline(always)]
fn homogeneous<S: Simd>(
    (row, right, shift): (f32, f32, f32),
    x: f32x16<S>,
    inverse_depth: f32x16<S>,
) -> f32x16<S> {
    x * right + row + inverse_depth * shift
}

/// Context of colouring a frame's bands.
pub(super) struct FramePainter<'a> {
    pub(super) level: Level,
    pub(super) scanner: Scanner<'a>,
    pub(super) texturing: Texturing,
}

/// Rows of a frame that are drawn together.
pub(super) struct Band<'a> {
    pub(super) number: u32,
    pub(super) width: u32,
    pub(super) rows: Range<u32>,
    pub(super) colors: &'a mut [[u8; 4]],
    pub(super) coverage: &'a mut [Coverage],
}

impl FramePainter<'_> {
    /// Colours the pixels of a band that the mesh covers.
    pub(super) fn paint(&self, band: &mut Band, buffers: &mut BandBuffers) {
        match self.texturing {
            Texturing::Nearest => buffers.assign_all(band.width, band.rows.len() as u32),
            _ => self
                .scanner
                .rasterise(band.number, band.width, &band.rows, buffers),
        }
        dispatch!(self.level, simd => self.color(simd, band, buffers));
    }

    #[inline(always)]
    fn color<S: Simd>(&self, simd: S, band: &mut Band, buffers: &BandBuffers) {
        let width = band.width as usize;
        let rows = band
            .colors
            .chunks_mut(width)
            .zip(band.coverage.chunks_mut(width));
        for ((colors, coverage), (y, pixels)) in rows.zip(
            band.rows
                .clone()
                .zip(buffers.pixels.chunks(buffers.per_row)),
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
        let positions = TexturePositions {
            x: f32x16::load_array_ref(simd, &LANE_INDICES) + (x as f32 + 0.5),
            y: y as f32 + 0.5,
            inverse_depth: f32x16::load_array_ref(simd, &pixels.inverse_depth),
        };
        let sums = self.accumulate(simd, pixels, &positions, covered);
        let per = PER_FULL / sums.weight;
        let table = SrgbTable::get(ToneMap::SrgbClipped);
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
        let uses_corners = !matches!(self.texturing, Texturing::Nearest | Texturing::Single);
        let mut left = covered;
        while left != 0 {
            let lane = left.trailing_zeros();
            left &= left - 1;
            let found = if seen >> lane & 1 == 1 {
                Some(color[lane as usize].to_le_bytes())
            } else if uses_corners {
                self.corner_color(pixels, lane, [x + lane, y])
            } else {
                None
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

    /// Sums the colours of the cameras over the covered lanes.
    #[inline(always)]
    fn accumulate<S: Simd>(
        &self,
        simd: S,
        pixels: &Pixels,
        positions: &TexturePositions<S>,
        covered: u64,
    ) -> Sums<S> {
        let mut sums = Sums::new(simd);
        let one = f32x16::splat(simd, 1.0);
        let cameras = self.scanner.cameras;
        match self.texturing {
            Texturing::Nearest | Texturing::Single => {
                if let Some(camera) = cameras.first() {
                    sums.add(simd, camera, positions, covered, one);
                }
            }
            Texturing::Averaged => {
                for camera in cameras {
                    let wanted = sums.weight.simd_lt(MOST_AVERAGED).to_bitmask() & covered;
                    if wanted == 0 {
                        break;
                    }
                    sums.add(simd, camera, positions, wanted, one);
                }
            }
            Texturing::Multi | Texturing::Blended => {
                let owners = u32x16::load_array_ref(simd, &pixels.owners);
                let mut ranks = Ranks::from_owners(&pixels.owners);
                while let Some(rank) = ranks.take_first() {
                    let Some(camera) = cameras.get(rank as usize) else {
                        continue;
                    };
                    let weight = owner_weights(simd, owners, rank, &pixels.weights);
                    let mut wanted = weight.simd_gt(0.0).to_bitmask() & covered;
                    if self.texturing == Texturing::Multi {
                        wanted &= !sums.weight.simd_gt(0.0).to_bitmask();
                    }
                    if wanted != 0 {
                        sums.add(simd, camera, positions, wanted, weight);
                    }
                }
            }
        }
        sums
    }

    /// Blends the colours of the corners themselves: for a surface that is hidden from its cameras
    /// at this pixel.
    #[cold]
    fn corner_color(&self, pixels: &Pixels, lane: u32, at: [u32; 2]) -> Option<[u8; 4]> {
        let number = pixels.triangles[lane as usize % LANES];
        let (triangle, SurfacePoint { weights, .. }) = self.scanner.point_at(number, at)?;
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for k in (0..3).filter(|k| weights[*k] > 0.0) {
            let camera = self.scanner.cameras.get(triangle.owners[k] as usize);
            let color = camera
                .and_then(|camera| camera.color_at(triangle.at[k], triangle.inverse_depth[k]));
            let Some(color) = color else { continue };
            (0..3).for_each(|c| sum[c] += color[c] * weights[k]);
            total += weights[k];
        }
        let [r, g, b] = sum.map(|c| encode_srgb(c * (PER_FULL / total)));
        (total > 0.0).then_some([r, g, b, 255])
    }
}

/// Sums the weights of the corners that a camera owns.
#[inline(always)]
fn owner_weights<S: Simd>(
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
        // Weights of adjacent pixels outside of the triangle by rounding may be negative.
        sum += is_owner.select(
            f32x16::load_array_ref(simd, &weights[k as usize]).max(zero),
            zero,
        );
        is_all &= is_owner;
    }
    is_all.select(f32x16::splat(simd, 1.0), sum)
}

/// Set of camera ranks.
struct Ranks {
    words: [u64; MOST_CAMERAS.div_ceil(64)],
    first: usize,
}

impl Ranks {
    /// Collects the owners of pixels.
    #[inline(always)]
    fn from_owners(owners: &[u32; LANES]) -> Self {
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

    /// Removes and returns the best rank.
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
