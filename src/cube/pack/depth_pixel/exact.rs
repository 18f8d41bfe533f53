//! Unquantised depth pixels, to measure the error and the speed of packing.

use super::packed_depth_pixel::SplatIndexLayout;
use crate::model::samples::{CubeSamples, DepthPixel, LayeredDepthImage};
use crate::pack::layout::{CubeLdi, PackedSegment};
use crate::pack::{PackError, PackedDepthPixel, Split};

/// A depth pixel in 24 bytes instead of 8.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct UnquantisedDepthPixel {
    /// 1/Z about the cube's centre, 1/m.
    pub inverse_depth: f32,
    /// Unit surface normal in the face's frame.
    pub normal: [f32; 3],
    /// sRGB, straight alpha.
    pub color_srgb: [u8; 4],
    /// Splat index of the packed depth pixel, for the kernel that looks up its size by it.
    pub splat_index: u32,
}

/// A packed cube LDI, and its depth pixels before quantisation.
#[derive(Clone, Debug, PartialEq)]
pub struct UnquantisedCube {
    /// The packed cube; its depth pixels are not drawn.
    pub cube: CubeLdi,
    /// For each segment, in the order of its packed depth pixels.
    pub depth_pixels: Vec<Vec<UnquantisedDepthPixel>>,
}

impl UnquantisedCube {
    /// Packs a cube LDI and keeps its unquantised samples.
    ///
    /// # Errors
    /// See [`CubeLdi::pack`].
    pub fn pack(
        ldi: &CubeSamples,
        layout: SplatIndexLayout,
        split: Split,
    ) -> Result<Self, PackError> {
        let cube = CubeLdi::pack(ldi, layout, split)?;
        let depth_pixels = cube
            .segments
            .iter()
            .map(|segment| exact_depth_pixels(&ldi.faces[segment.face.index()], segment))
            .collect();
        Ok(Self { cube, depth_pixels })
    }

    /// Bytes of all unquantised depth pixels.
    pub fn depth_pixel_bytes(&self) -> usize {
        self.cube.depth_pixel_count() * size_of::<UnquantisedDepthPixel>()
    }
}

/// Collects the samples of a segment from its face, by their range of inverse depth.
fn exact_depth_pixels(
    face: &LayeredDepthImage,
    segment: &PackedSegment,
) -> Vec<UnquantisedDepthPixel> {
    let face_from_world = face.face.world_from_eye().transpose();
    let range = segment.inverse_depth_min..=segment.inverse_depth_max;
    let exact = |(sample, packed): (&DepthPixel, &PackedDepthPixel)| UnquantisedDepthPixel {
        inverse_depth: sample.inverse_depth,
        normal: (face_from_world * sample.normal.decode().as_dvec3())
            .as_vec3()
            .to_array(),
        color_srgb: sample.color_srgb,
        splat_index: packed.splat_index(),
    };
    let rows = segment.y0..segment.y0 + segment.height;
    let columns = segment.x0..segment.x0 + segment.width;
    let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
    let samples = pixels
        .flat_map(|(x, y)| face.pixel(x, y))
        .filter(|s| range.contains(&s.inverse_depth));
    samples.zip(&segment.depth_pixels).map(exact).collect()
}
