//! Decoding of packed depth pixels.

use super::packed_depth_pixel::{INVERSE_DEPTH_CODE_MAX, PackedDepthPixel, SplatIndexLayout};
use super::splat_index::DepthCodeRange;
use crate::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
use crate::pack::blocks::BlockIndex;
use crate::pack::layout::{CubeLdi, PackedSegment};
use glam::DVec3;
use headbox_core::cube_face::Face;

/// A decoded depth pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodedDepthPixel {
    /// 1/Z about the centre, 1/m; the quantisation error is at most half a code.
    pub inverse_depth: f64,
    /// Unit surface normal, world axes, as quantised by the splat index.
    pub normal: DVec3,
    /// sRGB, straight alpha.
    pub color_srgb: [u8; 4],
}

impl PackedSegment {
    /// Difference of inverse depth between adjacent codes, 1/m.
    pub fn inverse_depth_step(&self) -> f64 {
        (f64::from(self.inverse_depth_max) - f64::from(self.inverse_depth_min))
            / f64::from(INVERSE_DEPTH_CODE_MAX)
    }

    /// Decodes an inverse depth, 1/m.
    pub fn inverse_depth(&self, code: u32) -> f64 {
        f64::from(self.inverse_depth_min) + f64::from(code) * self.inverse_depth_step()
    }

    /// Decodes a depth pixel of this segment.
    pub fn decode(&self, layout: SplatIndexLayout, pixel: PackedDepthPixel) -> DecodedDepthPixel {
        DecodedDepthPixel {
            inverse_depth: self.inverse_depth(pixel.inverse_depth_code()),
            normal: self.face.world_from_eye() * layout.normal(pixel.splat_index()).as_dvec3(),
            color_srgb: pixel.color_srgb,
        }
    }

    /// Returns the range of the 5-bit depth code of [`SplatIndexLayout::Paper`] in this segment.
    pub fn depth_code_range(&self) -> DepthCodeRange {
        DepthCodeRange::from_inverse_depths(self.inverse_depth_min, self.inverse_depth_max)
    }

    /// Returns the depth pixels of row `y` of the rectangle and the `width + 1` running counts of
    /// its pixels; two empty slices if the tables of an invalid segment are out of range.
    pub fn row(&self, y: u32) -> (&[PackedDepthPixel], &[u32]) {
        self.slice_row(&self.depth_pixels, y)
    }

    /// Same as [`Self::row`] for depth pixels in another format, in the same order.
    pub(crate) fn slice_row<'a, P>(
        &'a self,
        depth_pixels: &'a [P],
        y: u32,
    ) -> (&'a [P], &'a [u32]) {
        let (y, width) = (y as usize, self.width as usize);
        let ends = self.row_offsets.get(y..y + 2).unwrap_or(&[0, 0]);
        let samples = depth_pixels.get(ends[0] as usize..ends[1] as usize);
        let start = y.saturating_mul(width + 1);
        let counts = self.row_counts.get(start..start.saturating_add(width + 1));
        match (samples, counts) {
            (Some(samples), Some(counts)) => (samples, counts),
            _ => (&[], &[]),
        }
    }

    /// Computes the content of [`Self::blocks`].
    pub(crate) fn block_index(&self) -> BlockIndex {
        BlockIndex::new([self.x0, self.y0], [self.width, self.height], |y| {
            self.row(y)
        })
    }

    /// Returns the depth pixels of pixel (x, y) of the rectangle, farthest first; empty outside.
    pub fn pixel(&self, x: u32, y: u32) -> &[PackedDepthPixel] {
        let (samples, counts) = self.row(y);
        let ends = counts.get(x as usize..x as usize + 2).unwrap_or(&[0, 0]);
        samples
            .get(ends[0] as usize..ends[1] as usize)
            .unwrap_or(&[])
    }
}

impl CubeLdi {
    /// Decodes the cube LDI, but for its plane textures.
    pub fn unpack(&self) -> CubeSamples {
        let faces = Face::ALL.map(|face| {
            let size_px = self.face_size_px;
            let mut ldi = LayeredDepthImage::empty(face, size_px);
            // Far before near, as they are stored: farthest first in every pixel.
            let segments: Vec<&PackedSegment> =
                self.segments.iter().filter(|s| s.face == face).collect();
            for y in 0..size_px {
                for x in 0..size_px {
                    for segment in &segments {
                        let Some((x, y)) = x.checked_sub(segment.x0).zip(y.checked_sub(segment.y0))
                        else {
                            continue;
                        };
                        ldi.samples.extend(segment.pixel(x, y).iter().map(|p| {
                            let decoded = segment.decode(self.layout, *p);
                            DepthPixel {
                                inverse_depth: decoded.inverse_depth as f32,
                                normal: EncodedNormal::new(decoded.normal.as_vec3()),
                                color_srgb: decoded.color_srgb,
                            }
                        }));
                    }
                    ldi.offsets[(y * size_px + x) as usize + 1] = ldi.samples.len() as u32;
                }
            }
            ldi
        });
        CubeSamples {
            info: self.info.clone(),
            faces: faces.to_vec(),
            environment: self.environment.clone(),
        }
    }

    /// Centre of the headbox, world metres, where all directions have the best quality.
    pub fn center(&self) -> DVec3 {
        self.info.centre
    }

    /// Half of the headbox's edge length, metres.
    pub fn half_size(&self) -> f64 {
        self.info.half_size_m
    }

    /// Number of depth pixels in all segments.
    pub fn depth_pixel_count(&self) -> usize {
        self.segments.iter().map(|s| s.depth_pixels.len()).sum()
    }

    /// Bytes of all depth pixels, offsets, counts, plane textures and environment texels in memory.
    pub fn bytes(&self) -> usize {
        let segment = |s: &PackedSegment| {
            size_of_val(&s.depth_pixels[..])
                + size_of_val(&s.row_offsets[..])
                + size_of_val(&s.row_counts[..])
        };
        let segments = self.segments.iter().map(segment).sum::<usize>();
        segments + size_of_val(&self.environment.texels[..]) + self.planes.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::SegmentSide;

    fn pixel(code: u32) -> PackedDepthPixel {
        PackedDepthPixel {
            geometry: code,
            color_srgb: [1, 2, 3, 255],
        }
    }

    /// Two rows of three pixels: 1, 0 and 2 samples, then 0, 2 and 0.
    fn segment() -> PackedSegment {
        PackedSegment {
            face: Face::NegY,
            side: SegmentSide::Far,
            x0: 5,
            y0: 9,
            width: 3,
            height: 2,
            inverse_depth_min: 0.25,
            inverse_depth_max: 2.0,
            row_offsets: vec![0, 3, 5],
            row_counts: vec![0, 1, 1, 3, 0, 0, 2, 2],
            depth_pixels: (10..15).map(pixel).collect(),
            blocks: BlockIndex::default(),
        }
    }

    #[test]
    fn geometry_word_is_depth_and_index() {
        let found = |geometry: u32| {
            (
                pixel(geometry).inverse_depth_code(),
                pixel(geometry).splat_index(),
            )
        };
        assert_eq!(found(0x5a5 << 20 | 0xab_cde), (0xab_cde, 0x5a5));
        assert_eq!(found(0x7ff << 20), (0, 0x7ff));
        assert_eq!(
            found(u32::MAX),
            (INVERSE_DEPTH_CODE_MAX, 0x7ff),
            "the last bit is unused"
        );
    }

    #[test]
    fn depth_codes_are_linear_over_range() {
        let segment = segment();
        for (share, exact) in [(0.0, 0.25), (0.25, 0.6875), (0.5, 1.125), (1.0, 2.0)] {
            let code = (share * f64::from(INVERSE_DEPTH_CODE_MAX)) as u32;
            // At most one code is rounded down.
            assert!(
                (segment.inverse_depth(code) - exact).abs() <= segment.inverse_depth_step(),
                "{share}"
            );
        }
        assert!(
            (segment.inverse_depth_step() * f64::from(INVERSE_DEPTH_CODE_MAX) - 1.75).abs() < 1e-12
        );
    }

    #[test]
    fn pixels_decode_to_their_own_samples() {
        let segment = segment();
        let codes = |x: u32, y: u32| -> Vec<u32> {
            segment
                .pixel(x, y)
                .iter()
                .map(|sample| sample.inverse_depth_code())
                .collect()
        };
        let rows = [0, 1, 2].map(|y| [0, 1, 2, 3].map(|x| codes(x, y)));
        let none = Vec::new;
        assert_eq!(rows[0], [vec![10], none(), vec![11, 12], none()]);
        assert_eq!(rows[1], [none(), vec![13, 14], none(), none()]);
        assert_eq!(rows[2], [none(), none(), none(), none()]);
        let wrong = PackedSegment {
            row_offsets: vec![0, 3, 99],
            ..segment.clone()
        };
        assert_eq!(
            (wrong.row(0).0.len(), wrong.row(1)),
            (3, (&[][..], &[][..])),
            "a table that points outside"
        );
    }
}
