//! Readers of image sets, one module per format.
//!
//! `text` and `json` parse numbers and fields with errors that name them; `text` also lists
//! folders; `mat5` reads variables of MATLAB files. `nerfstudio` also writes sets.

pub(crate) mod colmap;
pub(crate) mod colmap_points;
pub(crate) mod json;
mod mat5;
pub(crate) mod middlebury;
pub(crate) mod nerfstudio;
pub(crate) mod panorama;
pub(crate) mod projections;
pub(crate) mod rgbd;
pub(crate) mod seurat;
#[cfg(test)]
pub(crate) mod test_set;
pub(crate) mod text;
