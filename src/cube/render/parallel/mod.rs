//! Division of a frame among threads: bands of rows, or the papers' fragments between epipolar lines.

mod assemble;
pub(crate) mod band;
pub(crate) mod epipolar;
pub(crate) mod fragments;
