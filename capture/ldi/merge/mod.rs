//! Stage 6: surface samples become depth pixels with coverage.
//!
//! * `centre_rays`: rays from the centre through the pixels of a face.
//! * `shares`: the share of a pixel that each of several surfaces covers.
//! * `clusters`: surface samples of one pixel become depth pixels.
//! * `merged_face`: a face of depth pixels.
//! * `coverage`: the alpha of a depth pixel.
//! * `finish`: runs stages 3, 5 and 6 for all faces.

pub(crate) mod centre_rays;
pub(crate) mod clusters;
pub(crate) mod coverage;
pub(crate) mod finish;
pub(crate) mod merged_face;
pub(crate) mod shares;
#[cfg(test)]
mod tests;
