//! Steps of a frame of view-dependent geometry, in the order of work: `rank` (the cameras),
//! `project` and `fuse` (their samples in the frame's grid), `delaunay` (the mesh), `owners` (the
//! camera of each node), `scan` (triangles to pixels), `texture` (colours of pixels). `renderer`
//! runs them.

pub(crate) mod delaunay;
pub(crate) mod fuse;
mod owners;
mod project;
pub(crate) mod rank;
pub(crate) mod renderer;
pub(crate) mod scan;
mod texture;
pub(crate) mod texture_camera;
