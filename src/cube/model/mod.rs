//! The unpacked cube LDI: samples and their order, depth bins, the header, and the validation of
//! all of these.

pub mod depth_bins;
pub mod info;
pub mod parameters;
pub mod samples;
pub(crate) mod tangent;
pub mod validate;
