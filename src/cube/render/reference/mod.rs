//! Slow and obvious renderers that the fast one is compared with, and counts of what it did.

pub(crate) mod count;
pub mod inspect;
pub mod oracle;
