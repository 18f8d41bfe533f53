//! View-dependent geometry: many depth images shown without a global model (E4 to E13).
//!
//! For each frame anew: the cameras that serve it best are ranked (`rank`), their depth samples
//! (`samples`) fused in a grid of the frame (`fuse`), the grid's nodes triangulated (`delaunay`),
//! and the pixels that they cover (`scan`) coloured by the cameras' pictures (`picture`, `store`,
//! `texture`). Nothing needs to agree beyond what one frame shows, so that a long capture may
//! drift, and a camera's data is at most read, never merged. `oracle` does the same slowly, in
//! `f64`, for tests.
//!
//! One owner for each thing: [`ViewGeometry`] has the cameras, their samples and the store of
//! pictures, and does not change from frame to frame but for the pictures at hand;
//! [`GeometryRenderer`] has the grid, the mesh and the frame. The one invariant that the steps
//! share is the grid's: a node lies in its own cell.

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
