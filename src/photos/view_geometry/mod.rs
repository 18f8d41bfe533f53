//! View-dependent geometry: rendering of many depth images without a global model (E4 to E13).
//!
//! For each frame, the cameras that suit it best are ranked (`rank`), their depth samples
//! (`samples`) are fused in a grid over the frame (`fuse`), the grid's nodes are triangulated
//! (`delaunay`), and the pixels that the triangles cover (`scan`) are coloured from the cameras'
//! images (`picture`, `store`, `texture`). Cameras only need to agree within one frame, so a long
//! capture may drift, and a camera's data are never merged. `oracle` is a slow `f64` implementation
//! for tests.
//!
//! Ownership: [`ViewGeometry`] has the cameras, their samples and the image store, and only the
//! images in memory change between frames. [`GeometryRenderer`] has the grid, the mesh and the
//! frame. The steps share one invariant, the grid's: a node lies in its own cell.

mod cameras;
#[cfg(test)]
mod castle;
mod effort;
mod inspect;
#[cfg(test)]
mod oracle;
mod overlay;
mod render;
mod set;
mod settings;
#[cfg(test)]
pub mod tests;
pub mod view;

pub use crate::view_geometry::cameras::samples::SampleGrid;
pub use crate::view_geometry::cameras::store::WaitPolicy;
pub use crate::view_geometry::render::delaunay::NodeMesh;
pub use crate::view_geometry::render::rank::RankWeights;
pub use crate::view_geometry::render::renderer::{GeometryRenderer, GeometryStats};
pub use effort::TimeBudget;
pub use inspect::PixelTriangle;
pub use set::{GeometryError, GeometryResources, RealCamera, ViewGeometry};
pub use settings::{GeometrySettings, Texturing};

use settings::EdgeRule;
