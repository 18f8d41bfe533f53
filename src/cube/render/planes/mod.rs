//! Plane textures in a frame: nearest first, each pixel by a homography, with the inverse depth of
//! every pixel (inventory S3, C6, S25, D14); and other rendered content with depth
//! ([`DepthLayer`]), such as polygons.
//!
//! In the order of work: `plan` (textures in view, once per frame), `kernel` (pixels of a texture
//! in rows of the frame), `layer` (the result, which splats are tested against).
//!
//! Both the face position of a plane's pixel times 1/w and its inverse depth in the frame are
//! affine in frame pixels, so that depth is tested before any texel is fetched, and a homography
//! needs one division per pixel.

mod kernel;
mod layer;
mod plan;
#[cfg(test)]
mod tests;

pub use layer::DepthLayer;
pub(crate) use layer::{MAX_RADIUS_TESTED_AT_CENTRE_PX, PlaneLayer, ROWS_AROUND, Rim};
pub(crate) use plan::PlanesInView;
