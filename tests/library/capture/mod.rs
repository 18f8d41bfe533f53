//! Promises of a capture: its samples, its gaps and its light.

mod gaps;
mod light;
mod room;
mod samples;
