//! Identity of surfaces: determines if surface samples lie on one surface.

use crate::accumulate::accumulator::material_and_side;
use crate::light::shade::SurfaceSample;
use glam::Vec3;
use headbox_core::cube_face::Face;

/// Identity of a surface: its plane, material and side, the same on all faces.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct SurfaceKey {
    pub(super) normal: Vec3,
    distance: f32,
    /// See [`crate::accumulate::accumulator::Accumulator::class`].
    pub(super) class: u16,
}

/// Maximum width of a pixel on a surface, metres; larger than any scene.
const MAX_WIDTH_M: f32 = 1e20;

impl SurfaceKey {
    /// A key unlike that of any surface sample.
    pub(super) const NONE: Self = Self {
        normal: Vec3::ZERO,
        distance: 0.0,
        class: u16::MAX,
    };

    pub(super) fn new(sample: &SurfaceSample) -> Self {
        Self {
            normal: sample.plane_normal,
            distance: sample.plane_distance,
            class: sample.class,
        }
    }

    /// See [`same_surface`].
    #[inline]
    pub(super) fn is_same(&self, other: &Self) -> bool {
        const MIN_COS: f32 = 0.9976;
        let separation = (self.distance - other.distance).abs();
        material_and_side(self.class) == material_and_side(other.class)
            && separation <= 1e-3 * self.distance.abs().max(other.distance.abs())
            && self.normal.dot(other.normal) >= MIN_COS
    }

    /// Width of a pixel on the surface where it is widest, metres, at a position in pixels; huge on
    /// an edge-on surface.
    pub(super) fn pixel_width(&self, face: Face, [x, y]: [f32; 2], size_px: u32) -> f32 {
        let direction = face.direction(x.into(), y.into(), size_px).as_vec3();
        let facing = self.normal.dot(direction).abs();
        let eye_depth = self.distance.abs() / facing;
        // Infinite for a plane seen exactly edge-on, and NaN for one through the centre.
        (2.0 * eye_depth / size_px as f32 * direction.length() / facing).min(MAX_WIDTH_M)
    }
}

/// Returns true if two samples lie on one side of one plane of one material: normals within 4
/// degrees, planes no farther apart than a thousandth of their distance from the centre.
pub(crate) fn same_surface(a: &SurfaceSample, b: &SurfaceSample) -> bool {
    SurfaceKey::new(a).is_same(&SurfaceKey::new(b))
}
