//! Methods of the papers that measured worse than the product's, built on parts of its renderer.
//!
//! * [`fragments`]: the parallel warp along epipolar lines (`epipolar`: their geometry; `assemble`:
//!   the frame from the canvases of all fragments).

mod assemble;
mod epipolar;
pub mod fragments;
