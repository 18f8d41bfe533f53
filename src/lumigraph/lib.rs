//! Layered lumigraphs (*Layered Lumigraph with LOD Control*; L1 to L11, corrected by C18 to C22):
//! images from a grid of cameras on a plane, with a disparity layer per pixel. More layers need
//! fewer images and vice versa, and an eye far behind the plane needs few layers. They serve views
//! from outside: of a stage, through a window, of an object.
//!
//! | paper | here |
//! |---|---|
//! | sampling curve, best disparity, error for an eye off the plane (Eq. 1 to 8) | `bounds` |
//! | layers, uniform in disparity or placed where surfaces are | `layers` |
//! | data structure (table 1) | [`Lumigraph`], `grid`; `file` |
//! | construction: by rays, from pictures with depth | `capture`; `from_images`, `find_grid`, `reproject`; `raw` |
//! | hierarchical representation | `pyramid` |
//! | merging layers for a frame (table 3) | `merge` |
//! | several light slabs, which the paper leaves open | `slabs`, `slabs_render` |
//! | rendering (table 2): what a frame needs, rectangles with ranges of layers, the loop over pixels | `plan`, `cells`, `render`, `kernel`, `rays`, `pending`, `taps`; `oracle`; overlays: `show` |

mod bounds;
mod error;
mod file;
mod grid;
mod make;
mod oracle;
mod render;
mod settings;
#[cfg(test)]
mod tests;
pub mod view;

pub use crate::make::capture::{LumigraphCapture, middle_disparity};
pub use crate::make::from_images::FromImages;
pub use crate::make::from_images_error::FromImagesError;
pub use crate::make::layers::{DisparityLayer, Placement, classify, place, uniform};
pub use crate::make::raw::RawLumigraph;
pub use crate::make::slabs::{MAX_SLABS, SlabShare, Slabs};
pub use crate::render::frame::LumigraphRenderer;
pub use crate::render::merge::merge;
pub use crate::render::show::LumigraphOverlay;
pub use crate::render::slabs_render::{SlabsRenderer, render_slabs_by_rays};
pub use bounds::{ErrorBound, detail, max_spacing, min_layers, optimal_disparity};
pub use error::LumigraphError;
pub use file::LUMI_FILE;
pub use grid::{CameraGrid, GridParts};
pub use oracle::render as render_by_rays;
pub use settings::{Blend, LumigraphSettings, LumigraphStats};

use crate::render::cells::{Buckets, Cells};
use crate::render::pyramid::Pyramid;
use headbox_core::color::tone::ToneMap;
use headbox_core::environment::Environment;
use headbox_core::file_frame::FileFrame;
use serde::{Deserialize, Serialize};

/// Maximum number of pixels of all images together: texel indices have 32 bits, and the levels of
/// detail add a third.
pub const MAX_PIXELS: u64 = 3 << 30;

/// Maximum number of layers: an index of two bytes distinguishes these and infinity.
pub const MAX_LAYERS: usize = 65_535;

/// Source of a lumigraph; stored in the `.lumi` file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LumigraphInfo {
    /// The scene or the images, as given on the command line; empty if unknown.
    pub source: String,
    /// Axes and unit of the source.
    #[serde(flatten)]
    pub frame: FileFrame,
    /// Placement of the layers.
    pub placement: Placement,
    /// Tone curve of the images; those of older files are taken for linear ones.
    #[serde(default)]
    pub tone: ToneMap,
}

/// Image of one camera, with the layer of each pixel (L4).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Colours, 8-bit sRGB, row-major, row 0 on top.
    pub color: Vec<[u8; 3]>,
    /// Layer of each pixel, counted from 1 for the farthest; 0 for infinity. The number of layers
    /// plus one marks unknown pixels: they are not drawn, and do not occlude what other cameras
    /// see.
    pub index: Vec<u16>,
}

/// Images of a grid of cameras, with a layer per pixel (L4).
///
/// Invariants: a picture of the grid's size for each camera, row by row from the lowest; layers
/// positive, finite, ascending and disjoint; no index above the number of layers plus one.
#[derive(Clone, Debug)]
pub struct Lumigraph {
    /// Source of the lumigraph.
    pub info: LumigraphInfo,
    /// Environment behind all surfaces; of size 0 if unknown.
    pub environment: Environment,
    grid: CameraGrid,
    layers: Vec<DisparityLayer>,
    pictures: Vec<Picture>,
    unknown_pixels: u64,
    pyramid: Pyramid,
    buckets: Buckets,
    cells: Cells,
}

impl Lumigraph {
    /// Creates a lumigraph, and the levels of detail and cells for rendering.
    ///
    /// # Errors
    /// [`LumigraphError`] if an invariant does not hold.
    pub fn new(
        grid: CameraGrid,
        layers: Vec<DisparityLayer>,
        pictures: Vec<Picture>,
    ) -> Result<Self, LumigraphError> {
        if layers.len() > MAX_LAYERS {
            return Err(LumigraphError::TooManyLayers(layers.len()));
        }
        let is_sane = |layer: &DisparityLayer| {
            layer.min > 0.0 && layer.max >= layer.min && layer.max.is_finite()
        };
        if !layers.iter().all(is_sane) || !layers.windows(2).all(|pair| pair[0].max < pair[1].min) {
            return Err(LumigraphError::Layers);
        }
        let pixels = grid.picture_pixels();
        let fits = |picture: &Picture| {
            let in_range = |index: &u16| usize::from(*index) <= layers.len() + 1;
            picture.color.len() == pixels
                && picture.index.len() == pixels
                && picture.index.iter().all(in_range)
        };
        if let Some(bad) = pictures.iter().position(|picture| !fits(picture)) {
            return Err(LumigraphError::Picture(bad));
        }
        if pictures.len() != grid.camera_count() {
            return Err(LumigraphError::Picture(
                pictures.len().min(grid.camera_count()),
            ));
        }
        let unknown = |picture: &Picture| {
            picture
                .index
                .iter()
                .filter(|i| usize::from(**i) > layers.len())
                .count() as u64
        };
        let unknown_pixels = pictures.iter().map(unknown).sum();
        let pyramid = Pyramid::new(&grid, &pictures);
        let buckets = Buckets::new(layers.len());
        Ok(Self {
            info: LumigraphInfo::default(),
            environment: Environment::default(),
            grid,
            layers,
            pictures,
            unknown_pixels,
            cells: Cells::new(&pyramid, buckets),
            pyramid,
            buckets,
        })
    }

    /// Grid of the cameras.
    pub fn grid(&self) -> &CameraGrid {
        &self.grid
    }

    /// Layers, from far to near.
    pub fn layers(&self) -> &[DisparityLayer] {
        &self.layers
    }

    /// Images of the cameras, row by row from the lowest.
    pub fn pictures(&self) -> &[Picture] {
        &self.pictures
    }

    /// Number of unknown pixels of all pictures.
    pub fn unknown_pixels(&self) -> u64 {
        self.unknown_pixels
    }

    /// Returns the size in memory of what rendering needs, bytes: texels of all levels, sets of
    /// layers, and the environment.
    pub fn bytes(&self) -> u64 {
        let own = self.pyramid.bytes() + self.cells.bytes();
        (own + size_of_val(&self.environment.texels[..])) as u64
    }

    /// Returns the size of a layer index in a file, bytes.
    pub fn index_bytes(&self) -> usize {
        file::index_bytes(self.layers.len(), self.unknown_pixels > 0)
    }

    /// Returns the range of disparity of all surfaces, 1/m; `None` if there are none.
    pub fn range(&self) -> Option<[f64; 2]> {
        Some([self.layers.first()?.min, self.layers.last()?.max])
    }

    /// Returns [`CameraGrid::clear_fov_deg`] for the range of disparity of the surfaces.
    pub fn clear_fov_deg(&self, size_px: [u32; 2]) -> f64 {
        self.grid
            .clear_fov_deg(self.range().unwrap_or_default(), size_px)
    }
}
