//! Windows over the frame.

pub(crate) mod keys;
pub(crate) mod open;
pub(crate) mod save;
