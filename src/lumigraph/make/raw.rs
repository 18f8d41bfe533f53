//! Images with disparities before they have layers, and the layers of their pixels (L5).

use super::layers::{Placement, classify, place};
use crate::{CameraGrid, DisparityLayer, Lumigraph, LumigraphError, MAX_LAYERS, Picture};
use headbox_core::environment::Environment;
use rayon::prelude::*;

/// Images with a disparity for each pixel: what layers are made of, as many as wanted.
#[derive(Clone, Debug)]
pub struct RawLumigraph {
    grid: CameraGrid,
    pictures: Vec<RawPicture>,
    environment: Environment,
}

/// Image of one camera, with disparities.
#[derive(Clone, Debug, Default)]
pub(super) struct RawPicture {
    pub(super) color: Vec<[u8; 3]>,
    /// 1 / eye depth, 1/m; 0 where no surface is, NaN where nothing is known.
    pub(super) disparity: Vec<f32>,
}

/// Rays of one pixel, or of pixels side by side, see the same surface if their depths differ by no
/// more than this share. Others take no part in its colour, which would come along when the surface
/// is moved.
pub(super) const SAME_SURFACE: f32 = 0.05;

impl RawLumigraph {
    /// A picture of the grid's size for each camera, row by row from the lowest.
    pub(super) fn new(
        grid: CameraGrid,
        pictures: Vec<RawPicture>,
        environment: Environment,
    ) -> Self {
        Self {
            grid,
            pictures,
            environment,
        }
    }

    /// The cameras.
    pub fn grid(&self) -> &CameraGrid {
        &self.grid
    }

    /// Images of the cameras, row by row from the lowest.
    #[cfg(test)]
    pub(super) fn pictures(&self) -> &[RawPicture] {
        &self.pictures
    }

    /// The least and the greatest disparity of all pixels, 1/m.
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

    /// Puts each pixel into one of at most `count` layers.
    ///
    /// # Errors
    /// [`LumigraphError::TooManyLayers`], of which what is not known counts as one;
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
            .map(|picture| picture.layered(&layers))
            .collect();
        let mut lumigraph = Lumigraph::new(self.grid.clone(), layers, pictures)?;
        lumigraph.info.placement = placement;
        lumigraph.environment = self.environment.clone();
        Ok(lumigraph)
    }
}

impl RawPicture {
    fn layered(&self, layers: &[DisparityLayer]) -> Picture {
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
