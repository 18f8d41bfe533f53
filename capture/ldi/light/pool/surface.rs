//! What parts are one surface.

use crate::light::shade::LitPart;
use glam::Vec3;
use headbox_core::cube_face::Face;

/// What tells a part's surface from others; the same on all faces.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Surface {
    normal: Vec3,
    distance: f32,
    /// See [`crate::accumulate::accumulator::Accumulator::class`].
    pub(super) class: u32,
}

/// Of pixels; larger than any scene.
const WIDEST_M: f32 = 1e20;

impl Surface {
    /// Unlike any surface of a part.
    pub(super) const NONE: Self = Self {
        normal: Vec3::ZERO,
        distance: 0.0,
        class: u32::MAX,
    };

    pub(super) fn of(part: &LitPart) -> Self {
        Self {
            normal: part.plane_normal,
            distance: part.plane_distance,
            class: u32::from(part.class),
        }
    }

    /// See [`same_surface`].
    #[inline]
    pub(super) fn is_same(&self, other: &Self) -> bool {
        const MIN_COS: f32 = 0.9976;
        let apart = (self.distance - other.distance).abs();
        self.class == other.class
            && apart <= 1e-3 * self.distance.abs().max(other.distance.abs())
            && self.normal.dot(other.normal) >= MIN_COS
    }

    /// Width of a pixel on the surface where it is widest, metres, at a position in pixels; huge for what is edge-on.
    pub(super) fn pixel_width(&self, face: Face, [x, y]: [f32; 2], size_px: u32) -> f32 {
        let direction = face.direction(x.into(), y.into(), size_px).as_vec3();
        let facing = self.normal.dot(direction).abs();
        let eye_depth = self.distance.abs() / facing;
        // Infinite for a plane that is seen exactly edge-on, and no number for one through the centre.
        (2.0 * eye_depth / size_px as f32 * direction.length() / facing).min(WIDEST_M)
    }
}

/// True if two parts lie on one plane of one kind of surface: normals within 4 degrees, planes no farther apart than a
/// thousandth of their distance from the centre.
pub(crate) fn same_surface(a: &LitPart, b: &LitPart) -> bool {
    Surface::of(a).is_same(&Surface::of(b))
}
