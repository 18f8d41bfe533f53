//! What surfaces say of which way is up, by their names and by how they lie.

use glam::DVec3;

/// Names of what lies, in lower case, and of what stands.
pub(super) const FLOORS: [&str; 7] = [
    "floor", "ground", "carpet", "parquet", "ceiling", "grass", "pavement",
];
pub(super) const WALLS: [&str; 2] = ["wall", "facade"];

/// Normals within some 11 degrees of an axis lie along it.
const ALONG: f64 = 0.98;

/// How several surfaces lie.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lying {
    /// Their area that lies flat along each axis.
    pub(super) along: DVec3,
    /// All of it.
    pub(super) area: f64,
}

impl Lying {
    /// Takes in a surface by its area along its normal.
    pub(super) fn add(&mut self, area: DVec3) {
        self.along += along(area.normalize_or_zero()) * area.length();
        self.area += area.length();
    }
}

/// Along which axes a surface of this normal lies flat: 1 or 0 each.
pub(super) fn along(normal: DVec3) -> DVec3 {
    DVec3::select(
        normal.abs().cmpgt(DVec3::splat(ALONG)),
        DVec3::ONE,
        DVec3::ZERO,
    )
}
