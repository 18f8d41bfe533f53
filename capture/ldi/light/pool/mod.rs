//! Pools soft light over surfaces: neighbouring depth pixels of one plane share their light
//! samples.
//!
//! Light from the sky, from lamps and from bounces varies slowly over a surface but is noisy per
//! sample. So it is stored separately from albedo, and each surface sample takes the mean over a
//! window of its surface: over surface samples of the same material and side in the same plane, in
//! any layer and on any face. The width of the window is chosen for
//! each surface sample, from narrow to wide:
//!
//! * The wider window's mean counts to the extent that it agrees with the narrower one's within the
//!   noise of both (Katkovnik 1999, "A new method for varying adaptive bandwidth selection":
//!   intersecting confidence intervals). Edges of shadows stay.
//! * It counts to the extent that the possible change of irradiance over it is less than the noise
//!   of the narrower one. The harmonic mean of the distances to where light comes from bounds the
//!   gradient of irradiance (Ward, Rubinstein and Clear 1988, "A ray tracing solution for diffuse
//!   interreflection"). Contact shadows stay.
//!
//! The narrowest window on large surfaces is a sum over dilated rows and columns, as in the a-trous
//! wavelet transform (Dammertz et al. 2010, "Edge-avoiding a-trous wavelet transform for fast
//! global illumination filtering"). All wider windows are computed once for a block of pixels, each
//! twice as wide as the one before, and cross the borders of faces. Sunlight, whose shadows have
//! edges, and albedo are never pooled.
//!
//! * `surface_key`: identity of surfaces.
//! * `blocks`: sums over blocks of pixels, block by block and surface by surface.
//! * `block_windows`: windows over the blocks of all faces.
//! * `narrow_windows`: the narrowest window of each surface sample.
//! * `isoline`: averages narrow windows along lines of equal nearness, where light comes from so
//!   near that no wider window would count.
//! * `shading_normals`: corrects for shading normals that vary over a window.
//! * `window`: the choice among windows, in lanes.
//! * `lanes`: pools the light of many points, in lanes.
//! * `block_survey`: the number of light samples that the surfaces of a block request.

mod block_survey;
mod block_windows;
mod blocks;
mod isoline;
mod lanes;
mod narrow_windows;
mod shading_normals;
mod surface_key;
#[cfg(test)]
mod tests;
mod window;

pub(super) use block_survey::BlockSurvey;
pub(super) use block_windows::BlockWindows;
pub(super) use blocks::Blocks;
pub(super) use shading_normals::NormalGradients;
pub(crate) use surface_key::same_surface;

use crate::surfaces::surface_samples::FaceSurfaces;
use glam::{DVec3, Vec3};
use headbox_core::color::luminance;
use headbox_core::cube_face::Face;
use lanes::{PoolingPoint, pool_points};
use rayon::prelude::*;
use surface_key::SurfaceKey;
use window::FEW_SAMPLES;

/// Sums over the light samples of a surface sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct GatheredLight {
    /// Sum of the samples, exposed.
    pub(super) light: Vec3,
    /// Sum of their squared luminances.
    pub(super) squares: f32,
    /// Sum of one over the distance to the hit of each sample's first ray, 1/m.
    pub(super) nearness: f32,
    /// Number of samples.
    pub(super) samples: f32,
}

impl GatheredLight {
    /// Multiplies the light of the samples.
    pub(super) fn scale(&mut self, factor: f32) {
        self.light *= factor;
        self.squares *= factor * factor;
    }
}

/// Light pooled over the chosen window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PooledLight {
    /// Radiosity per albedo.
    pub(super) light: Vec3,
    /// Variance of the luminance of a single light sample.
    pub(super) variance: f32,
    /// Approximate number of light samples in the window.
    pub(super) samples: f32,
    /// Support of the window: the number of surface samples whose plain mean would be as good.
    pub(super) support: f32,
}

/// Level of the windows over the second smallest blocks: about 500 pixels.
const SMALL_LEVEL: usize = 1;

/// Pooling of the soft light of a face.
pub(super) struct Pooling<'a> {
    surfaces: &'a FaceSurfaces,
    /// Pixel of each surface sample.
    pixels: Vec<[u16; 2]>,
    /// Key of each surface sample.
    keys: Vec<SurfaceKey>,
    /// Width of the pixel of each surface sample on its surface, metres.
    widths: Vec<f32>,
}

impl<'a> Pooling<'a> {
    pub(super) fn new(surfaces: &'a FaceSurfaces, face: Face) -> Self {
        let keys: Vec<SurfaceKey> = surfaces.samples.par_iter().map(SurfaceKey::new).collect();
        let size_px = surfaces.size_px;
        let pixels = surfaces.pixels();
        let width =
            |(key, pixel): (&SurfaceKey, &[u16; 2])| key.pixel_width(face, middle(*pixel), size_px);
        let widths = keys.par_iter().zip(&pixels).map(width).collect();
        Self {
            surfaces,
            pixels,
            keys,
            widths,
        }
    }

    /// The middle of the pixel of surface sample `i`, pixels.
    fn position(&self, i: usize) -> [f32; 2] {
        middle(self.pixels[i])
    }

    /// Pools the light of each surface sample over its window. `expected` is the expected variance
    /// of light samples by class.
    pub(super) fn pool(
        &self,
        gathered: Vec<GatheredLight>,
        windows: &BlockWindows,
        expected: &[f32],
    ) -> Vec<PooledLight> {
        let point = |i: usize| PoolingPoint {
            key: &self.keys[i],
            position: self.position(i),
            width_m: self.widths[i],
            expected: expected[self.keys[i].class as usize],
        };
        let narrow = self.narrow_windows(gathered);
        pool_points(self.keys.len(), point, windows, Some(&narrow))
    }
}

/// The middle of a pixel, pixels.
fn middle(pixel: [u16; 2]) -> [f32; 2] {
    pixel.map(|c| f32::from(c) + 0.5)
}

/// Statistics of light samples by class of surface.
#[derive(Default)]
pub(super) struct ClassStatistics {
    /// Number, sum of luminances, and sum of squared luminances of each class, up to the last one
    /// that has any.
    sums: Vec<DVec3>,
}

impl ClassStatistics {
    /// Statistics of the light samples of surface samples with these classes.
    pub(super) fn new(classes: &[u16], gathered: &[GatheredLight]) -> Self {
        let mut statistics = Self::default();
        for (&class, g) in classes
            .iter()
            .zip(gathered)
            .filter(|(_, g)| g.samples > 0.0)
        {
            let values = [g.samples, luminance(g.light.to_array()), g.squares].map(f64::from);
            statistics.extend(usize::from(class) + 1);
            statistics.sums[usize::from(class)] += DVec3::from_array(values);
        }
        statistics
    }

    /// Extends the statistics to at least this number of classes.
    fn extend(&mut self, classes: usize) {
        if self.sums.len() < classes {
            self.sums.resize(classes, DVec3::ZERO);
        }
    }

    /// Adds the statistics of another face.
    pub(super) fn absorb(&mut self, other: &Self) {
        self.extend(other.sums.len());
        for (sums, others) in self.sums.iter_mut().zip(&other.sums) {
            *sums += *others;
        }
    }

    /// Variance of the luminance of single light samples by class of surface, for all classes there
    /// can be; where a class has few, mixed with that of all classes.
    pub(super) fn variances(&self) -> Vec<f32> {
        let all: DVec3 = self.sums.iter().sum();
        let variance = |sums: DVec3| {
            let [samples, light, squares] = sums.to_array();
            let per_sample = 1.0 / samples.max(1e-20);
            (squares * per_sample - (light * per_sample).powi(2)).max(0.0)
        };
        let few = f64::from(FEW_SAMPLES);
        let class_variance = |sums: &DVec3| {
            ((variance(*sums) * sums.x + variance(all) * few) / (sums.x + few)) as f32
        };
        let without_samples = class_variance(&DVec3::ZERO);
        let mut variances: Vec<f32> = self.sums.iter().map(class_variance).collect();
        variances.resize(1 << 16, without_samples);
        variances
    }
}
