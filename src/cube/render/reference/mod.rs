//! Slow references for the renderer, and inspection of a frame: the oracle, clip counts, overdraw.

pub(crate) mod count;
pub mod inspect;
pub mod oracle;
pub mod overdraw;
