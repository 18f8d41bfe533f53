//! Matching of pixels: pyramids (`picture`), warps (`relative`), planes (`hypotheses`), their cost
//! (`zncc`), and the search (`patch_match`).

pub(super) mod hypotheses;
pub(super) mod patch_match;
pub(super) mod picture;
pub(super) mod relative;
pub(super) mod zncc;
