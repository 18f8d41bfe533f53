//! Headbox: the cube from which a capture can be viewed.

use glam::DVec3;

/// Cube, aligned with the world's axes, in which the eye may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Headbox {
    /// Centre, world metres.
    pub centre: DVec3,
    /// Half of the edge length, metres.
    pub half_size_m: f64,
}
