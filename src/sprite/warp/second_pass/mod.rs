//! Second pass: pixels sample the texture by the homography and the moved displacements
//! (`backward`), in blocks (`pixel_block`) whose `footprints` are sampled (`sampling`).

pub(super) mod backward;
mod footprints;
mod pixel_block;
pub(crate) mod sampling;
