//! The build-time layered depth image (S11, S14): for each pixel of a cube face, every surface that
//! rays hit there.
//!
//! Depth pixels of one layered depth pixel are stored **farthest first** (the render-time order,
//! C9), addressed through prefix sums:
//!
//! ```text
//! a face of 2 pixels, three samples on the left, one on the right:
//! samples  [ far  mid  near | only ]        offsets  [ 0, 3, 4 ]
//! ```

use super::info::CaptureInfo;
use glam::Vec3;
use headbox_core::cube_face::Face;
use headbox_core::environment::Environment;

/// One sample of a layered depth image.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Zeroable)]
pub struct DepthPixel {
    /// 1/Z about the cube's centre, 1/m, Z along the face's normal. Positive and finite.
    pub inverse_depth: f32,
    /// Unit surface normal, world axes, on the side of the rays that hit the surface.
    pub normal: EncodedNormal,
    /// 8-bit sRGB, straight alpha: the share of its pixel that the surface covers.
    pub color_srgb: [u8; 4],
}

/// A unit vector in 32 bits: octahedral map, 16 bits per coordinate (error below 0.004 degrees).
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Zeroable)]
pub struct EncodedNormal([i16; 2]);

impl EncodedNormal {
    /// +Z.
    pub const Z: Self = Self([0, 0]);

    /// Creates from two 16-bit numbers, the first in the lower half.
    pub fn from_bits(bits: u32) -> Self {
        Self([bits as u16 as i16, (bits >> 16) as i16])
    }

    /// Encodes a unit vector; a zero or non-finite one becomes +Z.
    pub fn new(n: Vec3) -> Self {
        let sum = n.x.abs() + n.y.abs() + n.z.abs();
        if !(sum > 0.0 && sum.is_finite()) {
            return Self::Z;
        }
        let (x, y) = (n.x / sum, n.y / sum);
        let fold = |a: f32, b: f32| (1.0 - b.abs()) * if a < 0.0 { -1.0 } else { 1.0 };
        let (x, y) = if n.z < 0.0 {
            (fold(x, y), fold(y, x))
        } else {
            (x, y)
        };
        Self([x, y].map(|c| (c * 32767.0).round() as i16))
    }

    /// Decodes the unit vector.
    pub fn decode(self) -> Vec3 {
        let [x, y] = self.0.map(|c| (f32::from(c) / 32767.0).max(-1.0));
        let z = 1.0 - x.abs() - y.abs();
        let t = (-z).max(0.0);
        Vec3::new(x - t.copysign(x), y - t.copysign(y), z).normalize()
    }
}

/// The layered depth image of one cube face.
#[derive(Clone, Debug, PartialEq)]
pub struct LayeredDepthImage {
    /// The face, which defines the camera: at the cube's centre, 90 degrees, see [`Face`].
    pub face: Face,
    /// Pixels a side.
    pub size_px: u32,
    /// Prefix sums over the pixels in row-major order, row 0 on top: `size_px * size_px + 1`
    /// entries; the samples of pixel p are `samples[offsets[p]..offsets[p + 1]]`.
    pub offsets: Vec<u32>,
    /// All samples, farthest first inside a pixel.
    pub samples: Vec<DepthPixel>,
}

impl LayeredDepthImage {
    /// Creates a face without samples.
    pub fn empty(face: Face, size_px: u32) -> Self {
        Self {
            face,
            size_px,
            offsets: vec![0; (size_px as usize).pow(2) + 1],
            samples: Vec::new(),
        }
    }

    /// Returns the samples of pixel (x, y), farthest first.
    pub fn pixel(&self, x: u32, y: u32) -> &[DepthPixel] {
        let p = y as usize * self.size_px as usize + x as usize;
        &self.samples[self.offsets[p] as usize..self.offsets[p + 1] as usize]
    }
}

/// A cube LDI before packing: six layered depth images about one centre, and the environment behind
/// them.
#[derive(Clone, Debug, PartialEq)]
pub struct CubeSamples {
    /// Header of the capture.
    pub info: CaptureInfo,
    /// Faces in the order of [`Face::ALL`].
    pub faces: Vec<LayeredDepthImage>,
    /// The environment.
    pub environment: Environment,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_survive_encoding() {
        let mut worst: f32 = 0.0;
        for i in 0..2000 {
            let (a, z) = (i as f32 * 2.399_963, 1.0 - (i as f32 + 0.5) / 1000.0);
            let r = (1.0 - z * z).sqrt();
            let n = Vec3::new(r * a.cos(), r * a.sin(), z);
            worst = worst.max(n.angle_between(EncodedNormal::new(n).decode()));
        }
        // Half a step of 1/32767 on the octahedron, stretched by at most sqrt(3) on the sphere, is
        // 6.5e-5 rad.
        assert!(worst < 5e-4, "{worst}");
        assert_eq!(EncodedNormal::new(Vec3::NAN).decode(), Vec3::Z);
    }
}
