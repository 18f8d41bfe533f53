//! Depth pixels of which nothing is quantised, to find out what packing costs and gains.

use super::depth_pixel::SplatIndexLayout;
use super::layout::{CubeLdi, PackedSegment};
use super::{PackError, PackedDepthPixel, Split};
use crate::model::samples::{CubeSamples, DepthPixel, LayeredDepthImage};

/// A depth pixel in 24 bytes instead of 8.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ExactDepthPixel {
    /// 1/Z about the cube's centre, 1/m.
    pub inverse_depth: f32,
    /// Unit surface normal in the face's frame.
    pub normal: [f32; 3],
    /// sRGB, straight alpha.
    pub color_srgb: [u8; 4],
    /// Splat index as in the packed depth pixel, for the kernel whose sizes are a table over it.
    pub splat_index: u32,
}

/// A packed cube LDI, and its depth pixels once more, as they were before packing.
#[derive(Clone, Debug, PartialEq)]
pub struct ExactCube {
    /// Everything but the depth pixels is taken from here.
    pub cube: CubeLdi,
    /// For each segment, as many as it has packed ones, in the same order.
    pub depth_pixels: Vec<Vec<ExactDepthPixel>>,
}

impl ExactCube {
    /// Packs a cube LDI and keeps what that loses.
    ///
    /// # Errors
    /// As [`CubeLdi::pack`].
    pub fn pack(
        ldi: &CubeSamples,
        layout: SplatIndexLayout,
        split: Split,
    ) -> Result<Self, PackError> {
        let cube = CubeLdi::pack(ldi, layout, split)?;
        let exact_of = |segment: &PackedSegment| {
            let face = ldi.faces.iter().find(|face| face.face == segment.face);
            face.map_or_else(Vec::new, |face| exact_segment(face, segment))
        };
        let depth_pixels = cube.segments.iter().map(exact_of).collect();
        Ok(Self { cube, depth_pixels })
    }

    /// From what packing has left, as of a file: for times, not for errors.
    pub fn unpack(cube: CubeLdi) -> Self {
        let of_segment = |segment: &PackedSegment| {
            let unpack = |packed: &PackedDepthPixel| ExactDepthPixel {
                inverse_depth: segment.inverse_depth(packed.inverse_depth_code()) as f32,
                normal: cube.layout.normal(packed.splat_index()).to_array(),
                color_srgb: packed.color_srgb,
                splat_index: packed.splat_index(),
            };
            segment.depth_pixels.iter().map(unpack).collect()
        };
        let depth_pixels = cube.segments.iter().map(of_segment).collect();
        Self { cube, depth_pixels }
    }

    /// Bytes of all depth pixels.
    pub fn depth_pixel_bytes(&self) -> usize {
        self.depth_pixels
            .iter()
            .map(|pixels| size_of_val(pixels.as_slice()))
            .sum()
    }
}

/// The samples of a segment's side of its face. Those of the other side have other inverse depths.
fn exact_segment(face: &LayeredDepthImage, segment: &PackedSegment) -> Vec<ExactDepthPixel> {
    let face_from_world = face.face.world_from_eye().transpose();
    let range = segment.inverse_depth_min..=segment.inverse_depth_max;
    let exact = |(sample, packed): (&DepthPixel, &PackedDepthPixel)| ExactDepthPixel {
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
