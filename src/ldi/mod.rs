//! The build-time layered depth image: per pixel of a cube face, every surface that rays met there.
//!
//! S11, S14. Depth pixels of one layered depth pixel are kept **farthest first** (the render-time order,
//! C9), addressed through prefix sums:
//!
//! ```text
//! a face of 2 pixels, three samples on the left, one on the right:
//! samples  [ far  mid  near | only ]        offsets  [ 0, 3, 4 ]
//! ```

pub mod accumulate;
pub mod build;
pub(crate) mod coverage;
mod dark;
pub mod finish;
pub mod from_deep;
pub mod from_images;
mod illuminate;
pub mod job;
pub mod mend;
pub mod merge;
mod merged_face;
pub mod misses;
pub mod parameters;
pub mod parts;
mod pixel_set;
mod pool;
pub mod ray_plan;
mod rows;
pub mod shade;
pub mod shape;
pub mod shard;
mod spread;
pub mod store;
pub(crate) mod tangent;
mod validate;
pub mod voxel_colouring;

pub use validate::{LdiError, MAX_FACE_SIZE_PX};

use crate::capture::images::ImageSet;
use crate::capture::rig::Face;
use crate::capture::scene::{FileFrame, ToneMap};
use crate::environment::Environment;
use crate::scene_source::LightParameters;
use glam::{DVec3, Vec3};
use parameters::CaptureParameters;
use serde::{Deserialize, Serialize};

/// One sample of a layered depth image.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Zeroable)]
pub struct DepthPixel {
    /// 1/Z about the cube's centre, 1/m, Z along the face's normal. Positive and finite.
    pub inverse_depth: f32,
    /// Unit surface normal, world axes, turned toward the rays that found it.
    pub normal: EncodedNormal,
    /// 8-bit sRGB, straight alpha: the share of its pixel that the surface fills.
    pub color_srgb: [u8; 4],
}

/// A unit vector in 32 bits: octahedral map, 16 bits a side (error below 0.004 degrees).
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Zeroable)]
pub struct EncodedNormal([i16; 2]);

impl EncodedNormal {
    /// +Z.
    pub(crate) const Z: Self = Self([0, 0]);

    /// Of the two numbers of 16 bits, the first in the lower half.
    pub(crate) fn from_bits(bits: u32) -> Self {
        Self([bits as u16 as i16, (bits >> 16) as i16])
    }

    /// Encodes a unit vector; a zero or non-finite one becomes +Z.
    pub fn new(n: Vec3) -> Self {
        let sum = n.x.abs() + n.y.abs() + n.z.abs();
        if !(sum > 0.0 && sum.is_finite()) {
            return Self([0, 0]);
        }
        let (x, y) = (n.x / sum, n.y / sum);
        let fold = |a: f32, b: f32| (1.0 - b.abs()) * if a < 0.0 { -1.0 } else { 1.0 };
        let (x, y) = if n.z < 0.0 { (fold(x, y), fold(y, x)) } else { (x, y) };
        Self([x, y].map(|c| (c * 32767.0).round() as i16))
    }

    /// The unit vector.
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
    /// The face, which gives the camera: at the cube's centre, 90 degrees, see [`Face`].
    pub face: Face,
    /// Pixels a side.
    pub size_px: u32,
    /// Prefix sums over the pixels in row-major order, row 0 on top: `size_px * size_px + 1` entries; the samples of
    /// pixel p are `samples[offsets[p]..offsets[p + 1]]`.
    pub offsets: Vec<u32>,
    /// All samples, farthest first inside a pixel.
    pub samples: Vec<DepthPixel>,
}

impl LayeredDepthImage {
    /// A face without samples.
    pub fn empty(face: Face, size_px: u32) -> Self {
        Self { face, size_px, offsets: vec![0; (size_px as usize).pow(2) + 1], samples: Vec::new() }
    }

    /// The samples of pixel (x, y), farthest first.
    pub fn pixel(&self, x: u32, y: u32) -> &[DepthPixel] {
        let p = y as usize * self.size_px as usize + x as usize;
        &self.samples[self.offsets[p] as usize..self.offsets[p + 1] as usize]
    }
}

/// What a capture was and what it knows of itself; travels in the `.ldi` file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CaptureInfo {
    /// The scene, as given on the command line.
    pub scene: String,
    /// Centre of the headbox, world metres.
    pub centre: DVec3,
    /// Half of the headbox's edge, metres.
    pub half_size_m: f64,
    /// Axes and unit of the scene's file.
    #[serde(flatten)]
    pub frame: FileFrame,
    /// Linear radiance times this is what `tone` is of.
    pub exposure: f32,
    /// What became of exposed radiance before it was stored.
    #[serde(default)]
    pub tone: ToneMap,
    /// The scene's light, where it is not its own.
    #[serde(default)]
    pub light: LightParameters,
    /// Which rays were to be traced, and what became of what they hit.
    #[serde(flatten)]
    pub parameters: CaptureParameters,
    /// Rays traced, all faces.
    pub rays_traced: u64,
    /// Share of the headbox that its centre does not see because geometry is in the way.
    pub blocked_share: f64,
    /// Where to look by default: the horizontal direction with the most to see, world axes; `None` in files made before it
    /// was kept.
    #[serde(default)]
    pub ahead: Option<DVec3>,
    /// What is up by default where it is not +Y, world axes: pictures may be taken with the camera on its side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<DVec3>,
    /// Per face of the ray domain: the estimated probability that one more ray would find a depth pixel that is not in
    /// the LDI (Good 1953: share of samples seen once); `None` where rays were not random.
    pub missing_estimate: [Option<f64>; 6],
    /// What frames lack; `None` where nobody looked.
    #[serde(default)]
    pub holes: Option<Holes>,
}

impl CaptureInfo {
    /// Of an image set: its pictures have their light, and their exposure, in them.
    fn of_images(set: &ImageSet, centre: DVec3, half_size_m: f64) -> Self {
        Self {
            scene: set.folder.display().to_string(),
            centre,
            half_size_m,
            frame: set.frame,
            exposure: 1.0,
            parameters: CaptureParameters::unlit(0, 0),
            ..Self::default()
        }
    }
}

/// What frames of a capture lack, as found by frames from all over the headbox held against rays ([`crate::gaps`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Holes {
    /// Share of the frames' pixels that show less than rays find there, when they were last looked at.
    pub share: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// The same share before any ray was aimed.
    pub share_before: f64,
    /// Rays that were aimed at what was lacking, and kept.
    pub aimed_rays: u64,
    /// How often frames were looked at.
    pub rounds: u32,
}

/// Six layered depth images about one centre, and the environment behind them.
#[derive(Clone, Debug, PartialEq)]
pub struct CubeLdi {
    /// What it was captured from.
    pub info: CaptureInfo,
    /// In the order of [`Face::ALL`].
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
        // Half a step of 1/32767 on the octahedron, stretched by at most sqrt(3) on the sphere, is 6.5e-5 rad.
        assert!(worst < 5e-4, "{worst}");
        assert_eq!(EncodedNormal::new(Vec3::NAN).decode(), Vec3::Z);
    }
}
