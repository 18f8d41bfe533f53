//! Second pass: pixels sample the texture (`sampling`) by the homography and the moved
//! displacements (`backward`).

pub(super) mod backward;
pub(crate) mod sampling;
