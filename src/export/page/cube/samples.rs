//! Encoding of a segment's samples that deflates well and that a page decodes in one loop
//! (`samples.js`, its counterpart).
//!
//! A part has some blocks of [`BLOCK_PX`] face pixels a side, as arrays of variable length, one
//! after the other:
//!
//! ```text
//! blocks   u16 column, u16 row of each block, in blocks, little-endian
//! counts   of each pixel of each block, row by row: samples in the pixel; 255 is followed by the rest
//! depth    three arrays of a byte a sample: low, middle and high byte of the zigzag of code - expected code
//! splat    two arrays of a byte a sample: low and high byte of index - expected index, modulo 2^11
//! colour   four arrays of a byte a sample: green, red - green, blue - green and alpha, each minus its expectation
//! ```
//!
//! A sample is predicted from the neighbouring pixel on the left or else above, by the sample at
//! the same position counted from the nearest. On a plane, inverse depth is affine in the pixels,
//! so left + above - above left predicts it exactly.

use crate::page::zigzag;
use headbox_cube::pack::{INVERSE_DEPTH_CODE_MAX, PackedDepthPixel, PackedSegment};

/// Size of a block, face pixels.
pub(super) const BLOCK_PX: u32 = 32;

/// Number of samples after which a part ends, at the end of a block.
const PART_SAMPLES: usize = 1 << 17;

/// Encoded blocks of a segment.
pub(super) struct SamplePart {
    pub(super) bytes: Vec<u8>,
    pub(super) blocks: usize,
    pub(super) samples: usize,
}

/// Encodes all samples of a segment.
pub(super) fn parts(segment: &PackedSegment) -> Vec<SamplePart> {
    let (mut parts, mut part) = (Vec::new(), PartEncoder::default());
    let blocks = |first: u32, length: u32| first / BLOCK_PX..(first + length).div_ceil(BLOCK_PX);
    for row in blocks(segment.y0, segment.height) {
        for column in blocks(segment.x0, segment.width) {
            part.add(segment, column, row);
            if part.codes.len() >= PART_SAMPLES {
                parts.push(std::mem::take(&mut part).finish());
            }
        }
    }
    if !part.codes.is_empty() {
        parts.push(part.finish());
    }
    parts
}

/// Range of a pixel's samples.
#[derive(Clone, Copy, Default)]
struct Pixel {
    start: usize,
    count: usize,
}

impl Pixel {
    /// Returns the index of the sample at the same position from the nearest as the `i`th of
    /// `count`.
    fn counterpart(self, i: usize, count: usize) -> usize {
        self.start + (self.count + i).saturating_sub(count)
    }
}

#[derive(Default)]
struct PartEncoder {
    blocks: Vec<u8>,
    counts: Vec<u8>,
    codes: Vec<i32>,
    samples: Vec<PackedDepthPixel>,
    depth: [Vec<u8>; 3],
    splat: [Vec<u8>; 2],
    color: [Vec<u8>; 4],
}

/// Appends a byte to each plane, lowest first.
fn push_bytes<const N: usize, const BYTES: usize>(planes: &mut [Vec<u8>; N], bytes: [u8; BYTES]) {
    for (plane, byte) in planes.iter_mut().zip(bytes) {
        plane.push(byte);
    }
}

impl PartEncoder {
    fn add(&mut self, segment: &PackedSegment, column: u32, row: u32) {
        let (counts, samples) = (self.counts.len(), self.samples.len());
        let side = BLOCK_PX as usize;
        let mut pixels = vec![Pixel::default(); side * side];
        for i in 0..pixels.len() {
            let x = column * BLOCK_PX + (i % side) as u32;
            let y = row * BLOCK_PX + (i / side) as u32;
            let pixel_samples = match (x.checked_sub(segment.x0), y.checked_sub(segment.y0)) {
                (Some(x), Some(y)) => segment.pixel(x, y),
                _ => &[],
            };
            pixels[i] = Pixel {
                start: self.samples.len(),
                count: pixel_samples.len(),
            };
            let mut left = pixel_samples.len();
            while left >= 255 {
                self.counts.push(255);
                left -= 255;
            }
            self.counts.push(left as u8);
            let neighbour = |exists: bool, back: usize| {
                if exists {
                    pixels[i - back]
                } else {
                    Pixel::default()
                }
            };
            let (on_left, above) = (neighbour(i % side > 0, 1), neighbour(i >= side, side));
            let above_left = neighbour(i % side > 0 && i >= side, side + 1);
            for (k, sample) in pixel_samples.iter().enumerate() {
                self.put(
                    *sample,
                    k,
                    pixel_samples.len(),
                    [on_left, above, above_left],
                );
            }
        }
        if self.samples.len() == samples {
            self.counts.truncate(counts);
            return;
        }
        self.blocks.extend(
            [column as u16, row as u16]
                .into_iter()
                .flat_map(u16::to_le_bytes),
        );
    }

    fn put(
        &mut self,
        sample: PackedDepthPixel,
        i: usize,
        count: usize,
        [left, above, above_left]: [Pixel; 3],
    ) {
        let all = [left, above, above_left]
            .iter()
            .all(|pixel| pixel.count == count);
        let predictor = match (left.count, above.count) {
            (1.., _) => Some(left.counterpart(i, count)),
            (0, 1..) => Some(above.counterpart(i, count)),
            (0, 0) => self.samples.len().checked_sub(1),
        };
        let expected = match (all, predictor) {
            (true, _) => {
                self.codes[left.start + i] + self.codes[above.start + i]
                    - self.codes[above_left.start + i]
            }
            (false, Some(at)) => self.codes[at],
            (false, None) => 0,
        };
        let code = sample.inverse_depth_code() as i32;
        let off = code - expected.clamp(0, INVERSE_DEPTH_CODE_MAX as i32);
        push_bytes(&mut self.depth, zigzag(off).to_le_bytes());
        let predictor = predictor.map_or(
            PackedDepthPixel {
                geometry: 0,
                color_srgb: [0; 4],
            },
            |at| self.samples[at],
        );
        let splat =
            (sample.splat_index().wrapping_sub(predictor.splat_index()) & 0x7ff).to_le_bytes();
        push_bytes(&mut self.splat, splat);
        let ([r, g, b, a], [er, eg, eb, ea]) = (sample.color_srgb, predictor.color_srgb);
        let (dr, dg, db) = (r.wrapping_sub(er), g.wrapping_sub(eg), b.wrapping_sub(eb));
        let color = [
            dg,
            dr.wrapping_sub(dg),
            db.wrapping_sub(dg),
            a.wrapping_sub(ea),
        ];
        push_bytes(&mut self.color, color);
        self.codes.push(code);
        self.samples.push(sample);
    }

    fn finish(self) -> SamplePart {
        let arrays = [self.blocks, self.counts]
            .into_iter()
            .chain(self.depth)
            .chain(self.splat)
            .chain(self.color);
        let arrays: Vec<Vec<u8>> = arrays.collect();
        SamplePart {
            blocks: arrays[0].len() / 4,
            samples: self.codes.len(),
            bytes: arrays.concat(),
        }
    }
}
