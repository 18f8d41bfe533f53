//! Rendering of a lumigraph, in the order of work: `plan` (layers and cameras that the frame
//! needs), `merge` and `cells` (visibility of layers), `lanes` (sixteen rays at a time), `kernel`
//! (blending), `frame` (threads and the whole frame). `pyramid` contains the levels of detail.

pub(crate) mod cells;
pub(crate) mod frame;
mod kernel;
pub(crate) mod lanes;
pub(crate) mod layer_in_view;
pub(crate) mod merge;
pub(crate) mod plan;
pub(crate) mod pyramid;
pub(crate) mod show;
pub(crate) mod slabs_render;
#[cfg(test)]
mod tests;
