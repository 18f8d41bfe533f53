//! Step 5: light of surface samples, taken once per sample and pooled over surfaces.

pub(crate) mod illuminate;
pub(crate) mod pool;
pub(crate) mod shade;
