//! Readers of image sets, one module per format or family of formats.
//!
//! `text` and `json` parse numbers and fields with errors that name them; `text` also lists
//! folders; `paths` finds files; `left_out` collects unusable frames; `intrinsics` and
//! `byte_reader` read what several formats have in common.

mod byte_reader;
pub(crate) mod colmap;
mod intrinsics;
pub(crate) mod json;
mod left_out;
pub(crate) mod metashape;
pub(crate) mod nerfstudio;
pub(crate) mod panorama;
pub(crate) mod paths;
pub(crate) mod projections;
pub(crate) mod rgbd;
pub(crate) mod seurat;
#[cfg(test)]
pub(crate) mod test_set;
#[cfg(test)]
mod tests;
pub(crate) mod text;
