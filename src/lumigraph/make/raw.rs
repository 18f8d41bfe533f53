//! Images with a disparity per pixel, and their division into layers (L5).

use super::layers::{Placement, classify, place};
use crate::{CameraGrid, DisparityLayer, Lumigraph, LumigraphError, MAX_LAYERS, Picture};
use headbox_core::environment::Environment;
use rayon::prelude::*;

/// Images of a camera grid with a disparity per pixel, from which any number of layers can be made.
#[derive(Clone, Debug)]
pub struct RawLumigraph {
    pub(super) grid: CameraGrid,
    /// Picture of each camera, in the grid's size, row by row from the lowest.
    pub(super) pictures: Vec<RawPicture>,
    pub(super) environment: Environment,
}

/// Image of one camera, with disparities.
#[derive(Clone, Debug, Default)]
pub(super) struct RawPicture {
    pub(super) color: Vec<[u8; 3]>,
    /// 1 / eye depth, 1/m; 0 at infinity, NaN if unknown.
    pub(super) disparity: Vec<f32>,
}

/// Largest relative difference in depth of rays in a pixel, or of adjacent pixels, that hit the
/// same surface. Others do not contribute to its colour, which would otherwise move with the
/// surface.
pub(super) const SAME_SURFACE: f32 = 0.05;

impl RawLumigraph {
    /// Grid of the cameras.
    pub fn grid(&self) -> &CameraGrid {
        &self.grid
    }

    /// Returns the smallest and the largest disparity of all pixels, 1/m.
    pub fn range(&self) -> Option<[f64; 2]> {
        let seen = self
            .pictures
            .iter()
            .flat_map(|picture| &picture.disparity)
            .filter(|d| **d > 0.0);
        let range = seen.fold([f32::INFINITY, 0.0], |[min, max], &d| {
            [min.min(d), max.max(d)]
        });
        (range[1] > 0.0).then(|| range.map(f64::from))
    }

    /// Assigns each pixel to one of at most `count` layers.
    ///
    /// # Errors
    /// [`LumigraphError::TooManyLayers`], where unknown pixels count as a layer;
    /// [`LumigraphError::NothingSeen`] if no pixel has a disparity.
    pub fn layered(&self, count: usize, placement: Placement) -> Result<Lumigraph, LumigraphError> {
        let disparities: Vec<f32> = self
            .pictures
            .iter()
            .flat_map(|picture| picture.disparity.iter().copied())
            .collect();
        let unknown = disparities.iter().any(|disparity| disparity.is_nan());
        if count > MAX_LAYERS - usize::from(unknown) {
            return Err(LumigraphError::TooManyLayers(count));
        }
        let layers = place(&disparities, count, placement);
        if layers.is_empty() {
            return Err(LumigraphError::NothingSeen);
        }
        let pictures = self
            .pictures
            .par_iter()
            .map(|picture| picture.classify(&layers))
            .collect();
        let mut lumigraph = Lumigraph::new(self.grid.clone(), layers, pictures)?;
        lumigraph.info.placement = placement;
        lumigraph.environment = self.environment.clone();
        Ok(lumigraph)
    }
}

impl RawPicture {
    /// Replaces disparities by layers.
    fn classify(&self, layers: &[DisparityLayer]) -> Picture {
        let unknown = (layers.len() + 1) as u16;
        let index = |&disparity: &f32| {
            if disparity.is_nan() {
                unknown
            } else {
                classify(layers, disparity)
            }
        };
        Picture {
            color: self.color.clone(),
            index: self.disparity.iter().map(index).collect(),
        }
    }
}
