//! Step 6: surface samples become depth pixels; coverage is measured, pinholes are repaired.

pub(crate) mod clusters;
pub(crate) mod coverage;
pub(crate) mod finish;
pub(crate) mod merged_face;
pub(crate) mod repair;
