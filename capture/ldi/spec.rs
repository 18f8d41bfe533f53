//! Specification of a capture ([`CaptureSpec`]) and options of its run ([`RunOptions`]).

use crate::scene_source::SceneSource;
use glam::DVec3;
use headbox_core::progress::{Progress, Silent};
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::parameters::{CaptureParameters, Sampler};
use headbox_cube::model::validate::MAX_FACE_SIZE_PX;
use headbox_scene::scene::Scene;
use headbox_trace::sampler::{Sampling, Strata};
use headbox_trace::viewpoint::fitting_half_size;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Specification of a capture: everything that decides the bytes of its cube LDI.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureSpec {
    /// The scene.
    pub scene: SceneSource,
    /// Centre of the headbox, world metres.
    pub centre: DVec3,
    /// Half of its edge, metres.
    pub half_size_m: f64,
    /// Pixels along a side of a face.
    pub face_size_px: u32,
    /// Rays, merging and light.
    #[serde(flatten)]
    pub parameters: CaptureParameters,
}

impl CaptureSpec {
    /// Default of [`Self::face_size_px`].
    pub const DEFAULT_FACE_SIZE_PX: u32 = 1024;

    /// A spec with the default quality for a headbox in world metres.
    pub fn new(scene: SceneSource, centre: DVec3, half_size_m: f64) -> Self {
        Self {
            scene,
            centre,
            half_size_m,
            face_size_px: Self::DEFAULT_FACE_SIZE_PX,
            parameters: CaptureParameters::DEFAULT,
        }
    }

    /// Checks face size and parameters.
    ///
    /// # Errors
    /// [`RangeError`] of the first value out of range.
    pub fn check_quality(
        face_size_px: u32,
        parameters: &CaptureParameters,
    ) -> Result<(), RangeError> {
        let max_strata = f64::from(Strata::MAX_PER_DIMENSION);
        let max_rays = f64::from(Strata::MAX_RAYS);
        let rays = f64::from(parameters.rays_per_stratum);
        let max_face_px = f64::from(MAX_FACE_SIZE_PX);
        RangeError::check("the face size", face_size_px.into(), [1.0, max_face_px])?;
        RangeError::check(
            "the number of strata",
            parameters.strata.into(),
            [1.0, max_strata],
        )?;
        RangeError::check("the number of rays in a stratum", rays, [1.0, max_rays])?;
        RangeError::check("novelty", parameters.novelty, [0.0, 1.0])?;
        RangeError::check("the share of holes", parameters.holes, [0.0, 1.0])
    }

    /// Maximum number of rays, which novelty stopping may reduce.
    pub fn max_rays(&self) -> f64 {
        let parameters = &self.parameters;
        match parameters.sampler {
            Sampler::CentreRays => 6.0 * f64::from(self.face_size_px).powi(2),
            Sampler::Stratified | Sampler::WhiteNoise => {
                6.0 * f64::from(parameters.strata).powi(4) * f64::from(parameters.rays_per_stratum)
            }
        }
    }

    /// Maximum number of rays for each pixel of the faces.
    pub fn rays_per_pixel(&self) -> f64 {
        self.max_rays() / (6.0 * f64::from(self.face_size_px).powi(2))
    }

    /// Shrinks a headbox that was placed in free space to the part that the rays can fill
    /// ([`fitting_half_size`]). A headbox that the scene itself suggests is kept.
    pub fn fit_half_size(&mut self, scene: &Scene) {
        if scene.headbox.is_none() {
            self.half_size_m = fitting_half_size(self.half_size_m, self.rays_per_pixel());
        }
    }

    /// Ray strata of each face of the headbox.
    pub(crate) fn strata(&self) -> Strata {
        let sampling = match self.parameters.sampler {
            Sampler::WhiteNoise => Sampling::WhiteNoise,
            Sampler::Stratified | Sampler::CentreRays => Sampling::Stratified,
        };
        Strata {
            per_dimension: self.parameters.strata,
            rays: self.parameters.rays_per_stratum,
            seed: self.parameters.seed,
            sampling,
        }
    }

    /// Depth bins within which samples of a pixel count as one surface.
    pub(crate) fn depth_bins(&self) -> DepthBins {
        DepthBins::new(self.half_size_m, self.face_size_px)
    }
}

/// A parameter that is out of range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{name} is {value}; it must be from {} to {}", .allowed[0], .allowed[1])]
pub struct RangeError {
    /// The parameter.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Minimum and maximum.
    pub allowed: [f64; 2],
}

impl RangeError {
    /// Checks a value.
    ///
    /// # Errors
    /// If the value is out of range, or NaN.
    pub fn check(name: &'static str, value: f64, allowed: [f64; 2]) -> Result<(), Self> {
        if (allowed[0]..=allowed[1]).contains(&value) {
            Ok(())
        } else {
            Err(Self {
                name,
                value,
                allowed,
            })
        }
    }
}

/// Options of a run, which takes place on the current rayon thread pool. None of them changes the
/// bytes of the result.
#[derive(Clone)]
pub struct RunOptions<'a> {
    /// Memory budget for accumulators in bytes, and the folder to which the rest is spilled, with
    /// the light of faces that wait for others; no limit by default.
    pub budget: Option<(u64, PathBuf)>,
    /// Part `.0` (from 0) of `.1`: only this share of the rays is traced. Part 0 of 1 by default.
    pub shard: (u32, u32),
    /// Receives progress and can cancel the capture; silent by default.
    pub progress: &'a dyn Progress,
}

impl Default for RunOptions<'_> {
    fn default() -> Self {
        Self {
            budget: None,
            shard: (0, 1),
            progress: &Silent,
        }
    }
}

impl RunOptions<'_> {
    /// The budget of the accumulator store: bytes, and the folder of its spill file.
    pub(crate) fn spill_budget(&self) -> Option<(u64, &Path)> {
        let (bytes, folder) = self.budget.as_ref()?;
        Some((*bytes, folder))
    }
}
