//! Captures as points: surfels, Gaussian splats, PLY and GLB.

pub mod ply;
mod reduce;
pub mod splats;
pub mod splats_glb;
pub(crate) mod surfels;

use self::reduce::Reduced;
use self::surfels::{Surfel, surfels};
use crate::ExportError;
use headbox_core::progress::Progress;
use headbox_cube::pack::CubeLdi;

/// Budget of a file of points.
#[derive(Clone, Copy, Debug, Default)]
pub struct PointBudget {
    /// Maximum number of points.
    pub points: Option<u64>,
    /// Maximum size of the file, bytes.
    pub bytes: Option<u64>,
}

/// Summary of a file of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSummary {
    /// Number of points in the file.
    pub points: u64,
    /// Number of samples of the capture.
    pub samples: u64,
    /// Number of samples left out to stay within the budget, since they could not be merged.
    pub dropped_samples: u64,
    /// Estimated error of colours, root mean square, levels of 255; 0 if nothing was merged.
    pub error_levels: f64,
}

/// Points of a cube within a budget.
struct Points<'a> {
    cube: &'a CubeLdi,
    /// True with the environment.
    sky: bool,
    /// Surfels of merged samples; `None` for all samples as they are.
    merged: Option<Vec<Surfel>>,
    summary: PointSummary,
}

impl<'a> Points<'a> {
    /// Chooses the points of a cube, with `sky` those of the environment too; a point takes
    /// `point_bytes` in the file after `header_bytes`.
    ///
    /// # Errors
    /// [`ExportError::Empty`], or [`ExportError::Budget`] if the budget is below one point.
    fn new(
        cube: &'a CubeLdi,
        sky: bool,
        budget: PointBudget,
        [header_bytes, point_bytes]: [u64; 2],
        progress: &dyn Progress,
    ) -> Result<Self, ExportError> {
        let samples = surfels(cube, sky).count() as u64;
        if samples == 0 {
            return Err(ExportError::Empty);
        }
        let fitting = |bytes: u64| bytes.saturating_sub(header_bytes) / point_bytes;
        let points = budget.points.unwrap_or(u64::MAX);
        let points = points.min(budget.bytes.map_or(u64::MAX, fitting));
        if points == 0 {
            return Err(ExportError::Budget {
                least_bytes: header_bytes + point_bytes,
            });
        }
        let mut all = Self {
            cube,
            sky,
            merged: None,
            summary: PointSummary {
                points: samples,
                samples,
                dropped_samples: 0,
                error_levels: 0.0,
            },
        };
        if points < samples {
            let Reduced {
                surfels,
                dropped_samples,
                error_levels,
            } = reduce::reduce(cube, sky, points as usize, progress);
            all.summary = PointSummary {
                points: surfels.len() as u64,
                samples,
                dropped_samples,
                error_levels,
            };
            all.merged = Some(surfels);
        }
        Ok(all)
    }

    /// Calls `write` for each surfel.
    ///
    /// # Errors
    /// Those of `write`.
    fn for_each(
        &self,
        progress: &dyn Progress,
        write: &mut dyn FnMut(&Surfel) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        /// Number of points of a step of the progress bar.
        const STEP: u64 = 1 << 14;
        progress.begin("writing", "points", self.summary.points);
        let mut written = 0;
        let mut counted = |surfel: &Surfel| {
            written += 1;
            if written % STEP == 0 {
                progress.advance(STEP);
            }
            write(surfel)
        };
        match &self.merged {
            Some(merged) => merged.iter().try_for_each(&mut counted),
            None => surfels(self.cube, self.sky).try_for_each(|surfel| counted(&surfel)),
        }
    }
}
