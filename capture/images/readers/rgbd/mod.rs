//! Sequences of RGB-D cameras.

pub(crate) mod folders;
pub(crate) mod frames;
pub(crate) mod phone_exports;
