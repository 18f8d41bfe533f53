//! The warp: batches of depth pixels from the LDI's image to the frame's.

pub(crate) mod batch;
