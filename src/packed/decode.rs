//! From packed bits back to numbers.

use super::layout::{PackedCube, PackedDepthPixel, PackedSegment, SplatIndexLayout};
use super::splat_index::DepthCodeRange;
use crate::capture::rig::Face;
use crate::ldi::{CubeLdi, DepthPixel, EncodedNormal, LayeredDepthImage};
use glam::DVec3;

/// The largest 20-bit inverse depth code.
pub const INVERSE_DEPTH_CODE_MAX: u32 = (1 << 20) - 1;

/// A packed depth pixel, read back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodedDepthPixel {
    /// 1/Z about the centre, 1/m; within half a step of the segment's range of what was packed.
    pub inverse_depth: f64,
    /// Unit surface normal, world axes, as well as the splat index says it.
    pub normal: DVec3,
    /// sRGB, straight alpha.
    pub color_srgb: [u8; 4],
}

impl PackedDepthPixel {
    /// The 20-bit inverse depth code.
    pub fn inverse_depth_code(self) -> u32 {
        self.geometry & INVERSE_DEPTH_CODE_MAX
    }

    /// The 11-bit splat index.
    pub fn splat_index(self) -> u32 {
        self.geometry >> 20 & 0x7ff
    }
}

impl PackedSegment {
    /// Inverse depth from one code to the next, 1/m.
    pub fn inverse_depth_step(&self) -> f64 {
        (f64::from(self.inverse_depth_max) - f64::from(self.inverse_depth_min)) / f64::from(INVERSE_DEPTH_CODE_MAX)
    }

    /// The inverse depth of a code, 1/m.
    pub fn inverse_depth(&self, code: u32) -> f64 {
        f64::from(self.inverse_depth_min) + f64::from(code) * self.inverse_depth_step()
    }

    /// Reads a depth pixel of this segment back.
    pub fn decode(&self, layout: SplatIndexLayout, pixel: PackedDepthPixel) -> DecodedDepthPixel {
        DecodedDepthPixel {
            inverse_depth: self.inverse_depth(pixel.inverse_depth_code()),
            normal: self.face.world_from_eye() * layout.normal(pixel.splat_index()).as_dvec3(),
            color_srgb: pixel.color_srgb,
        }
    }

    /// The range of the 5-bit depth code of [`SplatIndexLayout::Paper`] in this segment.
    pub fn depth_code_range(&self) -> DepthCodeRange {
        DepthCodeRange::from_inverse_depths(self.inverse_depth_min, self.inverse_depth_max)
    }

    /// The depth pixels of row `y` of the rectangle and the running counts of its pixels (`width + 1` of them), or two
    /// empty slices where the tables of an invalid segment point outside.
    pub fn row(&self, y: u32) -> (&[PackedDepthPixel], &[u32]) {
        self.row_of(&self.depth_pixels, y)
    }

    /// [`Self::row`] of depth pixels in another form, as many in the same order.
    pub(crate) fn row_of<'a, P>(&'a self, depth_pixels: &'a [P], y: u32) -> (&'a [P], &'a [u32]) {
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

    /// The depth pixels of pixel (x, y) of the rectangle, farthest first; empty outside.
    pub fn pixel(&self, x: u32, y: u32) -> &[PackedDepthPixel] {
        let (samples, counts) = self.row(y);
        let ends = counts.get(x as usize..x as usize + 2).unwrap_or(&[0, 0]);
        samples.get(ends[0] as usize..ends[1] as usize).unwrap_or(&[])
    }
}

impl PackedCube {
    /// The cube LDI that was packed, as well as packing has kept it. Pictures on planes are not part of it.
    pub fn unpack(&self) -> CubeLdi {
        let faces = Face::ALL.map(|face| {
            let size_px = self.face_size_px;
            let mut ldi = LayeredDepthImage::empty(face, size_px);
            // Far before near, as they are stored: farthest first in every pixel.
            let of_face: Vec<&PackedSegment> = self.segments.iter().filter(|s| s.face == face).collect();
            for y in 0..size_px {
                for x in 0..size_px {
                    for segment in &of_face {
                        let Some((x, y)) = x.checked_sub(segment.x0).zip(y.checked_sub(segment.y0)) else { continue };
                        let pixel = if x < segment.width { segment.pixel(x, y) } else { &[] };
                        ldi.samples.extend(pixel.iter().map(|p| {
                            let DecodedDepthPixel { inverse_depth, normal, color_srgb } =
                                segment.decode(self.layout, *p);
                            let normal = EncodedNormal::new(normal.as_vec3());
                            DepthPixel { inverse_depth: inverse_depth as f32, normal, color_srgb }
                        }));
                    }
                    ldi.offsets[(y * size_px + x) as usize + 1] = ldi.samples.len() as u32;
                }
            }
            ldi
        });
        CubeLdi { info: self.info.clone(), faces: faces.to_vec(), environment: self.environment.clone() }
    }

    /// The centre of the headbox, world metres: where every direction is seen best.
    pub fn center(&self) -> DVec3 {
        self.info.centre
    }

    /// Half of the headbox's edge, metres: how far an eye may move along each axis.
    pub fn half_size(&self) -> f64 {
        self.info.half_size_m
    }

    /// Number of depth pixels in all segments.
    pub fn depth_pixel_count(&self) -> usize {
        self.segments.iter().map(|s| s.depth_pixels.len()).sum()
    }

    /// Bytes of all depth pixels, offsets, counts, pictures on planes and environment texels in memory.
    pub fn bytes(&self) -> usize {
        let segment = |s: &PackedSegment| {
            size_of_val(&s.depth_pixels[..]) + size_of_val(&s.row_offsets[..]) + size_of_val(&s.row_counts[..])
        };
        let segments = self.segments.iter().map(segment).sum::<usize>();
        segments + size_of_val(&self.environment.texels[..]) + self.planes.bytes()
    }
}
