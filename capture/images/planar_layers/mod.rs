//! Planar layers of a sequence of photographs: the dominant planes of its middle frame, each with
//! its pixels, their alpha and their depth (S10).
//!
//! The paper segments a film by layered motion, one planar perspective transformation per layer,
//! then finds the plane of each layer from tracked points and residual depth by stereo. Cameras are
//! known here, so a homography between frames *is* a plane, and the order is reversed: stereo first
//! (E3, `dense_depth`), then planes in its depths, which need no tracking and are the homographies
//! supported by most matches.
//!
//! | the paper's step | here |
//! |---|---|
//! | frames of the sequence, one of them in the middle | `frames` |
//! | a planar motion for each layer | `planes` |
//! | assignment of pixels to layers | `labels`, or masks drawn by hand |
//! | residual depth | `dense_depth`, extended to unmatched pixels by `fill` |
//! | alpha-matted sprites, wider than the frame | `background`, `matte`, `crop` |
//!
//! Positions are pixels of the *canvas* (`canvas`): the middle frame's image, extended on all
//! sides, with a centred principal point. Inverse depth of every plane is affine in these pixels.
//! Differences of inverse depth are measured in pixels of parallax: the motion of a point between
//! frames.

mod background;
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
use matte::LayerBuilder;
use planes::Affine;
use std::path::PathBuf;

/// Error of segmenting a sequence into layers.
#[derive(Debug, thiserror::Error)]
pub enum LayersError {
    /// A view could not be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Depth could not be estimated.
    #[error(transparent)]
    Depth(#[from] DenseDepthError),
    /// The view does not exist or is a panorama.
    #[error("{}: no perspective view \"{name}\"; choose one of the {count} views by name or by number from 1", folder.display())]
    NoView {
        /// Folder of the set.
        folder: PathBuf,
        /// Requested name or number.
        name: String,
        /// Number of views.
        count: usize,
    },
    /// All views have the same position.
    #[error("{}: no other view has another position than {name}: layers need parallax", folder.display())]
    NoParallax {
        /// Folder of the set.
        folder: PathBuf,
        /// Name of the middle view.
        name: String,
    },
    /// Too few pixels have depth.
    #[error(
        "{name}: only {known} of {pixels} pixels have depth, too few for a plane: the images have no texture, hardly overlap, or their cameras are wrong"
    )]
    NoDepth {
        /// Name of the middle view.
        name: String,
        /// Number of pixels with depth.
        known: usize,
        /// Number of pixels of the image.
        pixels: usize,
    },
    /// More masks than [`MAX_LAYERS`].
    #[error("{0} masks; at most {MAX_LAYERS} are supported")]
    TooManyMasks(usize),
    /// The size of a mask differs from that of the image.
    #[error("{}: is {}x{} pixels, but {name} is {}x{}: a mask must have the size of the image", path.display(), size[0], size[1], expected[0], expected[1])]
    MaskSize {
        /// File of the mask.
        path: PathBuf,
        /// Width and height of the mask.
        size: [u32; 2],
        /// Name of the middle view.
        name: String,
        /// Width and height of its image.
        expected: [u32; 2],
    },
    /// Too few pixels of a mask have depth.
    #[error("{}: only {known} of its white pixels have depth, too few for a plane", path.display())]
    EmptyMask {
        /// File of the mask.
        path: PathBuf,
        /// Number of white pixels with depth.
        known: usize,
    },
}

/// Hand-drawn region: white where a pixel of the middle view belongs to the layer.
#[derive(Clone, Debug)]
pub struct Mask {
    /// Source file, for errors.
    pub path: PathBuf,
    /// Image of the middle view's size; levels of at least 128 belong to the layer.
    pub picture: GrayImage,
}

/// Settings of a segmentation into layers.
#[derive(Clone, Debug)]
pub struct LayerJob {
    /// Index of the middle view in the set.
    pub view: usize,
    /// Maximum number of other views.
    pub others: usize,
    /// Maximum number of layers; ignored with masks.
    pub layers: usize,
    /// True to use measured depth of the set's files; otherwise only depth estimated from the
    /// images is used.
    pub own_depth: bool,
    /// Hand-drawn regions instead of computed ones; a pixel belongs to the first mask that contains
    /// it.
    pub masks: Vec<Mask>,
    /// Maximum longer side of the canvas, pixels.
    pub longest_px: u32,
}

impl LayerJob {
    /// Returns default settings for the view in the middle of a set.
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

    /// Finds the index of a view by its name (with or without extension) or by its number from 1.
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

/// A layer: a plane with colours and residual depth.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarLayer {
    /// Unit normal of the plane in world space.
    pub normal: DVec3,
    /// Signed distance of the world's origin from the plane, metres.
    pub offset: f64,
    /// Image of the camera's size: sRGB, straight alpha; transparent where the layer is unknown.
    pub color: RgbaImage,
    /// Eye depth of each pixel, metres; NaN where transparent.
    pub depth: Vec<f32>,
}

/// Layers of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarLayers {
    /// Camera with the middle view's eye and direction and a wider field of view.
    pub camera: Camera,
    /// Layers in order of decreasing pixel count.
    pub layers: Vec<PlanarLayer>,
    /// Visible layer at each pixel of the camera in the middle view.
    pub labels: Vec<Option<u8>>,
    /// Eye depth of the visible layer's plane at each pixel, metres; NaN where there is none.
    pub plane_depth: Vec<f32>,
    /// Eye depth of the middle view at each pixel by stereo, metres; NaN where unknown.
    pub matched_depth: Vec<f32>,
    /// Names of the used views, the middle one first.
    pub used: Vec<String>,
}

impl PlanarLayers {
    /// Returns the eye depth of the visible layer at each pixel, metres; NaN where there is none.
    pub fn depth(&self) -> Vec<f32> {
        let layer_depth = |(pixel, label): (usize, &Option<u8>)| {
            label
                .and_then(|label| self.layers.get(usize::from(label)))
                .map_or(f32::NAN, |layer| layer.depth[pixel])
        };
        self.labels.iter().enumerate().map(layer_depth).collect()
    }
}

/// Minimum number of pixels with depth for a plane.
const MIN_PIXELS: usize = 50;

/// Minimum fraction of the middle view's pixels with depth.
const MIN_SHARE: f64 = 0.03;

/// Maximum number of layers: layers are bits of a 64-bit mask.
pub const MAX_LAYERS: usize = 64;

impl LayerJob {
    /// Returns the maximum number of steps that [`Self::load`] reports.
    pub fn steps(&self, set: &ImageSet) -> u64 {
        DenseDepth::steps((self.others + 1).min(set.views.len()))
    }

    /// Chooses frames, reads them, and estimates their depth, which takes nearly all of the time.
    ///
    /// # Errors
    /// See [`LayersError`].
    pub fn load(&self, set: &ImageSet, advance: &dyn Fn(u64)) -> Result<Frames, LayersError> {
        Frames::load(self, set, advance)
    }

    /// Segments the middle frame into layers.
    ///
    /// # Errors
    /// See [`LayersError`].
    pub fn segment(&self, frames: &Frames) -> Result<PlanarLayers, LayersError> {
        if self.masks.len() > MAX_LAYERS {
            return Err(LayersError::TooManyMasks(self.masks.len()));
        }
        let canvas = Canvas::new(frames, self.longest_px);
        let known = canvas.inverse_depth.iter().filter(|q| **q > 0.0).count();
        let pixels = canvas.shown.iter().filter(|shown| **shown).count();
        if known < MIN_PIXELS || (known as f64) < MIN_SHARE * pixels as f64 {
            return Err(LayersError::NoDepth {
                name: frames.middle_name().into(),
                known,
                pixels,
            });
        }
        let (planes, labels) = match self.masks.as_slice() {
            [] => {
                let planes = planes::find_dominant(&canvas, self.layers.clamp(1, MAX_LAYERS));
                let labels = labels::assign(&canvas, frames, &planes);
                (planes, labels)
            }
            masks => labels::assign_masks(&canvas, frames, masks)?,
        };
        Ok(crop::crop(
            build_layers(&canvas, frames, &planes, labels),
            &canvas,
        ))
    }
}

/// Builds the layers' images from planes and labels.
fn build_layers(
    canvas: &Canvas,
    frames: &Frames,
    planes: &[Affine],
    labels: Vec<u8>,
) -> PlanarLayers {
    let background = background::accumulate(canvas, frames, planes, &labels);
    let mut counts = vec![0; planes.len()];
    for label in labels.iter().filter(|label| **label != labels::NONE) {
        counts[usize::from(*label)] += 1;
    }
    let build =
        |label: usize| LayerBuilder::new(canvas, planes, &labels, label, &background[label]);
    let mut layers: Vec<(usize, LayerBuilder)> = (0..planes.len())
        .filter(|label| counts[*label] > 0)
        .map(|label| (counts[label], build(label)))
        .collect();
    let mut builders: Vec<&mut LayerBuilder> = layers.iter_mut().map(|(_, layer)| layer).collect();
    matte::blend(canvas, &labels, &mut builders);
    // Stable sort: layers of equal size stay in the order of their planes.
    layers.sort_by_key(|(pixels, _)| std::cmp::Reverse(*pixels));
    let order: Vec<usize> = layers.iter().map(|(_, layer)| layer.label).collect();
    let layer_index = |label: u8| {
        order
            .iter()
            .position(|own| *own == usize::from(label))
            .map(|index| index as u8)
    };
    let on_plane = |(pixel, label): (usize, &u8)| match planes.get(usize::from(*label)) {
        Some(plane) => (1.0 / plane.inverse_depth(canvas.center(pixel))) as f32,
        None => f32::NAN,
    };
    PlanarLayers {
        camera: canvas.camera,
        plane_depth: labels.iter().enumerate().map(on_plane).collect(),
        labels: labels.iter().map(|label| layer_index(*label)).collect(),
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
