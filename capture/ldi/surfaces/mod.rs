//! Stage 3: unlit surface samples of a face.
//!
//! * `surface_samples`: the samples of a face, by pixel.
//! * `unlit`: builds them from accumulators.
//! * `repair`: adds samples that are certainly missing.
//! * `geometry_pass`: depth pixels without light, for the search for holes.
//! * `distribute`: distributes light samples over surface samples.
//! * `rows`, `pixel_set`: slices by rows of a face, and sets of its pixels.

pub(crate) mod distribute;
pub(crate) mod geometry_pass;
pub(crate) mod pixel_set;
pub(crate) mod repair;
pub(crate) mod rows;
pub(crate) mod surface_samples;
pub(crate) mod unlit;
