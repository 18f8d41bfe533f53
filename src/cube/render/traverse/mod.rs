//! Traversal: the depth pixels of a segment, in drawing order, in batches.

pub(crate) mod batches;
pub(crate) mod format;
