//! Layers of a sequence of photographs: the dominant planes of what one of them shows, each with its pixels, their alpha and their depth (S10).
//!
//! The paper segments a film by layered motion, a planar perspective transformation each, then finds the plane of each layer from tracked points and what lies off it by
//! stereo. Cameras are known here, so that a homography between frames *is* a plane. The order is turned round: stereo first (E3,
//! `dense_depth`), then planes in the depths that it found, which need no tracking and are the homographies that most matches agree with.
//!
//! | the paper's step | here |
//! |---|---|
//! | frames of the sequence, one of them in the middle | `frames` |
//! | a planar motion for each layer | `planes` |
//! | which pixel belongs to which layer | `labels`, or masks made by hand |
//! | residual depth | `dense_depth`, carried on to unmatched pixels by `fill` |
//! | alpha-matted sprites, wider than the frame | `behind`, `matte`, `crop` |
//!
//! A position is a pixel of the *canvas*: the picture of the middle frame, wider all round, its principal point in the middle. Inverse depths
//! there are affine in the pixel for every plane. Distances of inverse depth are told in pixels of parallax: by how much a point moves between frames.

mod behind;
mod canvas;
mod crop;
mod fill;
mod frames;
mod labels;
mod matte;
mod planes;
#[cfg(test)]
mod tests;

pub use frames::Frames;

use super::dense_depth::{DenseDepth, DenseDepthError};
use super::{ImageSet, ImagesError, View};
use canvas::Canvas;
use glam::DVec3;
use headbox_core::camera::Camera;
use image::{GrayImage, RgbaImage};
use planes::Affine;
use std::path::PathBuf;

/// Why a sequence has no layers.
#[derive(Debug, thiserror::Error)]
pub enum LayersError {
    /// A view could not be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Depth could not be found.
    #[error(transparent)]
    Depth(#[from] DenseDepthError),
    /// There is no such view, or it is a panorama.
    #[error("{}: no perspective view \"{name}\"; there are {count} views, by name or by number from 1", folder.display())]
    NoView {
        /// The set.
        folder: PathBuf,
        /// What was asked for.
        name: String,
        /// How many there are.
        count: usize,
    },
    /// All pictures were taken from one place.
    #[error("{}: no other view was taken from another place than {name}: without parallax there is no telling what is in front", folder.display())]
    NoParallax {
        /// The set.
        folder: PathBuf,
        /// The middle one.
        name: String,
    },
    /// Matching found too little.
    #[error(
        "{name}: depth was found for {found} of its {pixels} pixels only, too few for a plane: the pictures show no texture, hardly overlap, or their cameras are wrong"
    )]
    NoDepth {
        /// The middle view.
        name: String,
        /// Pixels with depth.
        found: usize,
        /// Pixels of the picture.
        pixels: usize,
    },
    /// A mask does not fit its picture.
    #[error("{}: is {}x{} pixels, but {name} {}x{}: masks have a pixel for each of the picture's", path.display(), size[0], size[1], wanted[0], wanted[1])]
    MaskSize {
        /// The mask.
        path: PathBuf,
        /// Its width and height.
        size: [u32; 2],
        /// The picture.
        name: String,
        /// The picture's width and height.
        wanted: [u32; 2],
    },
    /// A mask without depth has no plane.
    #[error("{}: depth was found for {found} of its white pixels only, too few for a plane", path.display())]
    EmptyMask {
        /// The mask.
        path: PathBuf,
        /// Pixels with depth.
        found: usize,
    },
}

/// A region made by hand: white where a pixel of the middle view belongs to the layer.
#[derive(Clone, Debug)]
pub struct Mask {
    /// Where it was read from, for errors.
    pub path: PathBuf,
    /// As large as the middle view's picture; from 128 on a pixel belongs.
    pub picture: GrayImage,
}

/// How layers are made.
#[derive(Clone, Debug)]
pub struct LayerJob {
    /// The middle view, by its number in the set.
    pub view: usize,
    /// Other views that are used, at most.
    pub others: usize,
    /// Layers at most; masks have as many as they are.
    pub layers: usize,
    /// Takes depth from the set's files where there is some; otherwise only what was found from the pictures themselves.
    pub own_depth: bool,
    /// Regions made by hand instead of found ones; a pixel belongs to the first that has it.
    pub masks: Vec<Mask>,
    /// The canvas is made smaller until its longer side has no more pixels than this.
    pub longest_px: u32,
}

impl LayerJob {
    /// Of the view in the middle of a set.
    pub fn suggest(set: &ImageSet) -> Self {
        Self {
            view: set.views.len() / 2,
            others: 6,
            layers: 6,
            own_depth: false,
            masks: Vec::new(),
            longest_px: 1600,
        }
    }

    /// The number of a view by its name (as the set has it, or without its ending) or by its number from 1.
    ///
    /// # Errors
    /// [`LayersError::NoView`].
    pub fn find_view(set: &ImageSet, name: &str) -> Result<usize, LayersError> {
        let stem = |view: &View| {
            view.name
                .rsplit_once('.')
                .map_or(view.name.clone(), |(stem, _)| stem.to_owned())
        };
        let named = set
            .views
            .iter()
            .position(|view| view.name == name || stem(view) == name);
        let numbered = || {
            name.parse::<usize>()
                .ok()?
                .checked_sub(1)
                .filter(|i| *i < set.views.len())
        };
        named.or_else(numbered).ok_or_else(|| no_view(set, name))
    }
}

fn no_view(set: &ImageSet, name: &str) -> LayersError {
    LayersError::NoView {
        folder: set.folder.clone(),
        name: name.into(),
        count: set.views.len(),
    }
}

/// A layer: a plane, and what lies on it or a little off.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarLayer {
    /// Unit normal of the plane, world.
    pub normal: DVec3,
    /// Signed distance of the world's origin from it, metres.
    pub offset: f64,
    /// As large as the camera's image: sRGB, straight alpha; transparent where nothing is known of the layer.
    pub color: RgbaImage,
    /// Eye depth of each pixel that is not transparent, metres, else NaN.
    pub depth: Vec<f32>,
}

/// The layers of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarLayers {
    /// The middle view's eye and direction; wider.
    pub camera: Camera,
    /// Those with more pixels first.
    pub layers: Vec<PlanarLayer>,
    /// For each pixel of the camera the layer that the middle view shows there.
    pub labels: Vec<Option<u8>>,
    /// For each pixel of the camera the eye depth on the plane of that layer, metres, NaN where there is none.
    pub plane_depth: Vec<f32>,
    /// For each pixel of the camera the eye depth that matching found for what the middle view shows there, metres, NaN where unknown.
    pub matched_depth: Vec<f32>,
    /// Names of the views that were used, the middle one first.
    pub used: Vec<String>,
}

impl PlanarLayers {
    /// For each pixel of the camera the eye depth of the layer that the middle view shows there, metres, NaN where there is none.
    pub fn depth(&self) -> Vec<f32> {
        let of = |(pixel, label): (usize, &Option<u8>)| {
            label
                .and_then(|label| self.layers.get(usize::from(label)))
                .map_or(f32::NAN, |layer| layer.depth[pixel])
        };
        self.labels.iter().enumerate().map(of).collect()
    }
}

/// Fewest pixels with depth that a plane is fitted to.
const LEAST_PIXELS: usize = 50;

/// Least share of the middle picture's pixels whose depth must be known.
const LEAST_SHARE: f64 = 0.03;

/// Most layers: labels are bytes.
pub const MOST_LAYERS: usize = 64;

impl LayerJob {
    /// How many steps [`Self::load`] tells of at most.
    pub fn steps(&self, set: &ImageSet) -> u64 {
        DenseDepth::steps((self.others + 1).min(set.views.len()))
    }

    /// Chooses frames, reads them, and finds their depth, which takes nearly all of the time.
    ///
    /// # Errors
    /// See [`LayersError`].
    pub fn load(&self, set: &ImageSet, advance: &dyn Fn()) -> Result<Frames, LayersError> {
        Frames::load(self, set, advance)
    }

    /// Makes the layers of what the middle one of some frames shows.
    ///
    /// # Errors
    /// See [`LayersError`].
    pub fn layers(&self, frames: &Frames) -> Result<PlanarLayers, LayersError> {
        let canvas = Canvas::new(frames, self.longest_px);
        let found = canvas.inverse_depth.iter().filter(|q| **q > 0.0).count();
        let pixels = canvas.shown.iter().filter(|shown| **shown).count();
        if found < LEAST_PIXELS || (found as f64) < LEAST_SHARE * pixels as f64 {
            return Err(LayersError::NoDepth {
                name: frames.middle_name().into(),
                found,
                pixels,
            });
        }
        let (planes, labels) = match self.masks.as_slice() {
            [] => {
                let planes = planes::dominant(&canvas, self.layers.clamp(1, MOST_LAYERS));
                let labels = labels::assign(&canvas, frames, &planes);
                (planes, labels)
            }
            masks => labels::from_masks(&canvas, frames, masks)?,
        };
        Ok(crop::crop(
            layers(&canvas, frames, &planes, labels),
            &canvas,
        ))
    }
}

/// From planes and labels to pictures.
fn layers(canvas: &Canvas, frames: &Frames, planes: &[Affine], labels: Vec<u8>) -> PlanarLayers {
    let seen = behind::see(canvas, frames, planes, &labels);
    let mut layers: Vec<(usize, matte::Built)> = (0..planes.len())
        .map(|label| {
            (
                labels
                    .iter()
                    .filter(|own| usize::from(**own) == label)
                    .count(),
                label,
            )
        })
        .filter(|(pixels, _)| *pixels > 0)
        .map(|(pixels, label)| {
            (
                pixels,
                matte::Built::new(canvas, planes, &labels, label, &seen[label]),
            )
        })
        .collect();
    matte::blend(
        canvas,
        &labels,
        &mut layers
            .iter_mut()
            .map(|(_, layer)| layer)
            .collect::<Vec<_>>(),
    );
    // Stable: equal ones stay in the order of their planes.
    layers.sort_by_key(|(pixels, _)| std::cmp::Reverse(*pixels));
    let order: Vec<usize> = layers.iter().map(|(_, layer)| layer.label).collect();
    let place = |label: u8| {
        order
            .iter()
            .position(|own| *own == usize::from(label))
            .map(|place| place as u8)
    };
    let on_plane = |(pixel, label): (usize, &u8)| match planes.get(usize::from(*label)) {
        Some(plane) => (1.0 / plane.at(canvas.center(pixel))) as f32,
        None => f32::NAN,
    };
    PlanarLayers {
        camera: canvas.camera,
        plane_depth: labels.iter().enumerate().map(on_plane).collect(),
        labels: labels.iter().map(|label| place(*label)).collect(),
        matched_depth: canvas
            .inverse_depth
            .iter()
            .map(|q| if *q > 0.0 { 1.0 / q } else { f32::NAN })
            .collect(),
        layers: layers
            .into_iter()
            .map(|(_, layer)| layer.finish(canvas))
            .collect(),
        used: frames.names.clone(),
    }
}
