//! Stage 5: light on surface samples.
//!
//! * [`shade`]: surface samples from accumulators, and the points where light is sampled.
//! * [`sampling_area`]: the area of a pixel over which light is taken.
//! * [`sample_light`]: takes the light samples of a face.
//! * [`cell_radiance`]: radiance at the ends of their first rays, shared in cells.
//! * [`sunlight`]: takes those of the sun.
//! * [`pool`]: averages soft light over surfaces.

mod cell_radiance;
pub(crate) mod pool;
pub(crate) mod sample_light;
mod sampling_area;
pub(crate) mod shade;
mod sunlight;
