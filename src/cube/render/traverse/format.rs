//! Formats of depth pixels: packed into 8 bytes, or unquantised (S17, C10).

use crate::pack::{INVERSE_DEPTH_CODE_MAX, PackedDepthPixel, PackedSegment, UnquantisedDepthPixel};
use crate::render::footprint::size::{LANES, Normals};
use fearless_simd::{Simd, SimdCvtFloat, f32x16, prelude::*, u32x16};

/// A format of depth pixels.
pub(crate) trait Format: Copy {
    /// Placeholder for unused entries.
    const EMPTY: Self;

    /// Returns the inverse depth of code 0 and its change from code to code, 1/m.
    fn scale(segment: &PackedSegment) -> [f64; 2];

    /// Decodes the inverse depth, 1/m.
    fn inverse_depth(&self, segment: &PackedSegment) -> f64;

    /// Unpacks the first [`LANES`] of `depth_pixels`, which must have as many.
    fn load<S: Simd>(simd: S, depth_pixels: &[Self]) -> DepthPixelLanes<S>;
}

/// Depth pixels in registers.
pub(crate) struct DepthPixelLanes<S: Simd> {
    /// Inverse depth in units of [`Format::scale`].
    pub(crate) code: f32x16<S>,
    pub(crate) normals: Normals<S>,
    /// sRGB and alpha, in memory order.
    pub(crate) color: u32x16<S>,
}

impl Format for PackedDepthPixel {
    const EMPTY: Self = Self {
        geometry: 0,
        color_srgb: [0; 4],
    };

    fn scale(segment: &PackedSegment) -> [f64; 2] {
        [
            f64::from(segment.inverse_depth_min),
            segment.inverse_depth_step(),
        ]
    }

    #[inline]
    fn inverse_depth(&self, segment: &PackedSegment) -> f64 {
        segment.inverse_depth(self.inverse_depth_code())
    }

    #[inline(always)]
    fn load<S: Simd>(simd: S, depth_pixels: &[Self]) -> DepthPixelLanes<S> {
        let words: &[u32] = bytemuck::cast_slice(&depth_pixels[..LANES]);
        let first = u32x16::from_slice(simd, &words[..LANES]);
        let second = u32x16::from_slice(simd, &words[LANES..]);
        let (geometry, color) = simd.deinterleave_u32x16(first, second);
        let code = f32x16::float_from(geometry & INVERSE_DEPTH_CODE_MAX);
        DepthPixelLanes {
            code,
            normals: Normals::Index(geometry >> 20),
            color,
        }
    }
}

impl Format for UnquantisedDepthPixel {
    const EMPTY: Self = Self {
        inverse_depth: 1.0,
        normal: [0.0; 3],
        color_srgb: [0; 4],
        splat_index: 0,
    };

    fn scale(_: &PackedSegment) -> [f64; 2] {
        [0.0, 1.0]
    }

    #[inline]
    fn inverse_depth(&self, _: &PackedSegment) -> f64 {
        f64::from(self.inverse_depth)
    }

    #[inline(always)]
    fn load<S: Simd>(simd: S, depth_pixels: &[Self]) -> DepthPixelLanes<S> {
        let mut code = [0.0; LANES];
        let mut normal = [[0.0; LANES]; 3];
        let mut index = [0; LANES];
        let mut color = [0; LANES];
        for (i, pixel) in depth_pixels[..LANES].iter().enumerate() {
            code[i] = pixel.inverse_depth;
            for (lanes, component) in normal.iter_mut().zip(pixel.normal) {
                lanes[i] = component;
            }
            index[i] = pixel.splat_index;
            color[i] = u32::from_ne_bytes(pixel.color_srgb);
        }
        let [x, y, z] = normal;
        let normal = [
            f32x16::load_array(simd, x),
            f32x16::load_array(simd, y),
            f32x16::load_array(simd, z),
        ];
        DepthPixelLanes {
            code: f32x16::load_array(simd, code),
            normals: Normals::Exact {
                normal,
                index: u32x16::load_array(simd, index),
            },
            color: u32x16::load_array(simd, color),
        }
    }
}
