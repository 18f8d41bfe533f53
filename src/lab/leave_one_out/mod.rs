//! Leave-one-out tests of image sets: with depth (`images`), without (`photographs`), and of
//! sprites from a sequence (`sequence`); `held_out` has their common parts.

pub mod held_out;
pub mod images;
pub mod photographs;
pub mod sequence;
