//! Rendering of a packed cube LDI to a frame: six faces and two segments in occlusion-compatible
//! order, the incremental warp, splats, and the environment behind them (S17 to S23, C3, C3b, C8 to
//! C10, C12, C15, C17).
//!
//! In the order of work:
//!
//! * [`setup`]: once per frame: drawing order, transfers, footprint tables, clipping.
//! * `traverse`: depth pixels in drawing order, in batches of one row.
//! * `warp`: from a batch to splats.
//! * [`footprint`]: splat kernels and the sizes of footprints.
//! * [`canvas`]: pixels in which splats accumulate.
//! * [`resolve`]: compositing over the environment, filling of small holes.
//! * `planes`: plane textures and inserted content behind the splats.
//! * [`band`]: all of this for one band of rows, on one thread; [`renderer`]: the bands of a frame
//!   on all threads.
//! * [`mod@reference`]: the oracle, clip counts, overdraw.
//!
//! A band's canvas stays in the cache, no thread waits for another, and every pixel receives the
//! same splats in the same order whatever the bands are (tents, whose result does not depend on the
//! order, come in memory order): any number of threads gives the same frame, bit for bit. The cost
//! is that depth pixels near the border of two bands are warped for both.

pub mod band;
pub mod canvas;
pub mod footprint;
pub(crate) mod planes;
pub mod reference;
pub mod renderer;
pub mod resolve;
pub mod settings;
pub mod setup;
#[cfg(test)]
pub(crate) mod tests;
mod traverse;
mod warp;

pub use planes::DepthLayer;
pub use reference::count::ClipCounts;
pub use renderer::Renderer;
pub use settings::{FrameStats, RenderSettings};
