//! Readers of image sets, one module per format.
//!
//! `text` and `json` parse numbers and fields with errors that name them; `text` also lists
//! folders; `paths` finds files; `left_out` collects unusable frames; `mat5` reads variables of
//! MATLAB files. `nerfstudio` also writes sets; `depth_keys` reads its keys of depth.

mod byte_reader;
pub(crate) mod colmap;
mod colmap_cameras;
pub(crate) mod colmap_points;
mod depth_keys;
mod intrinsics;
pub(crate) mod json;
#[cfg(test)]
mod layout_tests;
mod left_out;
mod mat5;
pub(crate) mod metashape;
pub(crate) mod middlebury;
pub(crate) mod nerfstudio;
mod nerfstudio_lens;
pub(crate) mod panorama;
pub(crate) mod paths;
pub(crate) mod phone_exports;
pub(crate) mod projections;
pub(crate) mod rgbd;
pub(crate) mod rgbd_folders;
pub(crate) mod seurat;
#[cfg(test)]
pub(crate) mod test_set;
pub(crate) mod text;
