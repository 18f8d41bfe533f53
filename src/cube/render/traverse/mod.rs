//! Traversal of segments in drawing order, as batches of depth pixels.

pub(crate) mod batches;
pub(crate) mod format;
