//! Stage 5: light on surface samples.
//!
//! * [`shade`]: surface samples from accumulators, and the points where light is sampled.
//! * [`sample_light`]: takes the light samples of a face.
//! * [`sunlight`]: takes those of the sun.
//! * [`pool`]: averages soft light over surfaces.

pub(crate) mod pool;
pub(crate) mod sample_light;
pub(crate) mod shade;
mod sunlight;
