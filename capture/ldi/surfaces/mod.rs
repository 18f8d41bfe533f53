//! Step 3: unlit surface samples of a face.

pub(crate) mod distribute;
pub(crate) mod geometry_pass;
mod pixel_set;
pub(crate) mod rows;
pub(crate) mod surface_samples;
pub(crate) mod unlit;
