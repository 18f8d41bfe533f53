//! First pass: displacements are moved by pure parallax (`pure_parallax`, `forward`), planar
//! patches whole (`patches`, `planes`).

pub(crate) mod forward;
pub(super) mod patches;
pub(crate) mod planes;
pub(crate) mod pure_parallax;
