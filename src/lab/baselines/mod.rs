//! Baselines of the papers that lose to the product by measurement, built on the parts of its
//! renderer.
//!
//! * [`fragments`]: the parallel warp along epipolar lines (`epipolar`: their geometry; `assemble`:
//!   the frame from the canvases of all fragments).

mod assemble;
mod epipolar;
pub mod fragments;
