//! Correction of pooled light for shading normals that vary over a window.
//!
//! The samples of a facet of a smoothly shaded surface have different shading normals, and their
//! mean light would make the facet look flat. The gradient of irradiance by the shading normal
//! (Ward and Heckbert 1992, "Irradiance gradients") varies slowly, too, and is measured by the same
//! light samples. It gives the irradiance at each shading normal as a factor of that at the facet's
//! plane normal. Gathered light is divided by the factor and pooled as on a flat surface, and the
//! pooled light is multiplied by it.

use super::block_windows::{BlockWindows, WindowReader};
use super::blocks::{BlockMembership, Blocks};
use super::surface_key::SurfaceKey;
use super::window::{FEW_SAMPLES, LUMINANCES, SAMPLES};
use super::{GatheredLight, Pooling};
use crate::light::shade::Shader;
use glam::Vec3;
use headbox_core::color::luminance;
use headbox_core::cube_face::Face;
use rayon::prelude::*;

/// Number of light samples in the window over which a gradient is averaged, if there are so many.
const ENOUGH_SAMPLES: f32 = 256.0;

/// Limits of the factors.
const FACTORS: [f32; 2] = [0.25, 4.0];

/// Gradients of irradiance of a face with smoothly shaded surfaces.
pub(crate) struct NormalGradients {
    /// Sums of gradients in place of light, and of luminances in place of their squares.
    blocks: Blocks,
}

impl NormalGradients {
    /// Gradients of light samples. `blocks` are the blocks of the face; `gradients` are the sums of
    /// the gradients of luminance ([`headbox_trace::light::LitPoint::normal_gradient`]) of each
    /// surface sample, exposed.
    pub(crate) fn new(
        mut blocks: Blocks,
        membership: &BlockMembership,
        gathered: &[GatheredLight],
        gradients: &[Vec3],
    ) -> Self {
        let sums = |(gathered, gradient): (&GatheredLight, &Vec3)| GatheredLight {
            light: *gradient,
            squares: luminance(gathered.light.to_array()),
            nearness: 0.0,
            samples: gathered.samples,
        };
        let sums: Vec<GatheredLight> = gathered.iter().zip(gradients).map(sums).collect();
        blocks.fill(membership, &sums);
        Self { blocks }
    }

    /// Irradiance at the shading normal of each surface sample as a factor of that at its plane
    /// normal.
    pub(crate) fn factors(&self, pooling: &Pooling, face: Face, shader: &Shader) -> Vec<f32> {
        self.factors_at(pooling, face, |i| {
            shader.shading_normal(&pooling.surfaces.samples[i])
        })
    }

    /// [`Self::factors`] for given shading normals.
    pub(super) fn factors_at(
        &self,
        pooling: &Pooling,
        face: Face,
        shading_normal: impl Fn(usize) -> Vec3 + Sync,
    ) -> Vec<f32> {
        let windows = BlockWindows::new(face, pooling.surfaces.size_px, &self.blocks, [None; 6]);
        let factor = |readers: &mut Vec<WindowReader>, i: usize| {
            let key = &pooling.keys[i];
            let normal = shading_normal(i);
            if normal == key.normal {
                return 1.0;
            }
            let gradient = relative_gradient(readers, key, pooling.position(i));
            let tangential = gradient - key.normal * key.normal.dot(gradient);
            let [least, most] = FACTORS;
            (1.0 + tangential.dot(normal)).clamp(least, most)
        };
        (0..pooling.keys.len())
            .into_par_iter()
            .map_init(|| windows.readers(), factor)
            .collect()
    }
}

/// Gradient of luminance as a share of luminance on a surface about a position (pixels), over the
/// narrowest window of [`ENOUGH_SAMPLES`], or else the widest that the surface has.
fn relative_gradient(readers: &mut [WindowReader], key: &SurfaceKey, position: [f32; 2]) -> Vec3 {
    let mut gradient = Vec3::ZERO;
    for reader in readers {
        let sums = reader.read(key, position);
        let samples = sums[SAMPLES] * reader.level.support();
        if sums[LUMINANCES] > 0.0 {
            let [x, y, z, ..] = sums;
            let trust = samples / (samples + FEW_SAMPLES);
            gradient = Vec3::new(x, y, z) * (trust / sums[LUMINANCES]);
        }
        if samples >= ENOUGH_SAMPLES {
            break;
        }
    }
    gradient
}
